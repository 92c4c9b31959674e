//! What releases and coast-downs say of the robots, beside what is configured.

use super::output::say;
use crate::store::RobotParameterRow;

/// A short table; nothing if no trial says anything.
pub(super) fn print_parameters(rows: &[RobotParameterRow]) {
    if rows.is_empty() {
        return;
    }
    say!("{:<32} {:<15} {:>10} {:>9} {:>10}", "trial", "parameter", "measured", "+-", "configured");
    for row in rows {
        let line = |name: &str, measured: f64, se: f64, configured: f64| {
            if measured.is_nan() {
                return;
            }
            let configured = match configured.is_nan() {
                true => "-".to_owned(),
                false => format!("{configured:.5}"),
            };
            say!("{:<32} {name:<15} {measured:>10.5} {se:>9.5} {configured:>10}", row.trial);
        };
        let none = f64::NAN;
        line("omega_n rad/s", row.natural_rad_s, row.natural_rad_s_se, none);
        line("zeta", row.damping_ratio, row.damping_ratio_se, none);
        let (stiffness, damping) = (row.stiffness_nm_rad, row.damping_nm_s_rad);
        line("k_tau N m/rad", stiffness, row.stiffness_nm_rad_se, row.stiffness_configured_nm_rad);
        line("c_tau N m s/rad", damping, row.damping_nm_s_rad_se, row.damping_configured_nm_s_rad);
        line("sum c_R kg/s", row.roll_sum_kg_s, row.roll_sum_kg_s_se, row.roll_sum_configured_kg_s);
    }
}
