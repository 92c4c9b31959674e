//! Robot parameters measured by releases and coast-downs, beside the configured ones.

use super::output::say;
use crate::metrics::Estimate;
use crate::store::{RobotParameterRow, RobotQuantity};

/// A short table; nothing if nothing was measured.
pub(super) fn print_parameters(rows: &[RobotParameterRow]) {
    if rows.is_empty() {
        return;
    }
    say!("{:<32} {:<15} {:>10} {:>9} {:>10}", "trial", "parameter", "measured", "+-", "configured");
    for row in rows {
        for RobotQuantity { name, unit, measured, configured } in row.quantities() {
            let Estimate { value, se } = measured;
            let name = format!("{name} {unit}");
            let configured = match configured.is_nan() {
                true => "-".to_owned(),
                false => format!("{configured:.5}"),
            };
            say!("{:<32} {name:<15} {value:>10.5} {se:>9.5} {configured:>10}", row.trial);
        }
    }
}
