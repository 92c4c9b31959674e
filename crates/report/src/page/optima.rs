//! Table of the optimal gaits for a campaign.

use minijinja::context;
use minijinja::value::{Serde, Value};
use trilink_base::numbers::place;
use trilink_tables::{GaitNumbers, OptimumRow};

use crate::tables::Tables;

/// Parameter of a gait in display units, with its 95 % confidence limits.
struct Number {
    head: String,
    unit: &'static str,
    value: f64,
    limits: [f64; 2],
}

impl Number {
    fn new(head: String, unit: &'static str, [value, low, high]: [f64; 3]) -> Self {
        Self { head, unit, value, limits: [low, high] }
    }
}

/// Returns the template values of the best gait for each objective and model; `None` if the campaign has no optima.
pub(super) fn section(tables: &Tables, campaign: &str) -> Option<Value> {
    let best: Vec<&OptimumRow> =
        tables.optima.iter().filter(|row| row.campaign == campaign && row.rank == 1).collect();
    let has_second = best.iter().any(|row| row.amplitude2_rad.iter().any(|of| of.is_finite()));
    let heads: Vec<Value> = numbers(best.first()?, has_second)
        .into_iter()
        .map(|Number { head, unit, .. }| context! { head, unit })
        .collect();
    let rows = best.iter().map(|row| {
        let numbers = numbers(row, has_second).into_iter();
        let numbers = numbers.map(|Number { value, limits, .. }| {
            context! { value, limits, place => place_of(value, limits) }
        });
        let limits = [row.lower.value, row.upper.value];
        context! {
            row => Serde(row),
            unit => row.objective.unit(),
            place => place_of(row.value, limits),
            limits,
            numbers => numbers.collect::<Vec<_>>(),
            counts => row.is_reachable(),
            outdated => tables.is_outdated(row),
        }
    });
    Some(context! { heads, rows => rows.collect::<Vec<_>>() })
}

/// Returns the decimal place to which a value and its limits are rounded.
fn place_of(value: f64, [low, high]: [f64; 2]) -> i32 {
    place(0.5 * (high - low), value)
}

/// Returns the parameters of an optimal gait: the frequency; the amplitude, offset and (if both joints are commanded)
/// phase of each commanded joint; and, if `has_second`, the amplitude and phase of each joint's second harmonic.
fn numbers(row: &OptimumRow, has_second: bool) -> Vec<Number> {
    let OptimumRow { lower, upper, .. } = row;
    let mut found = vec![Number::new(
        "ω".to_owned(),
        "rad/s",
        [row.omega_rad_s, lower.omega_rad_s, upper.omega_rad_s],
    )];
    let commanded: Vec<usize> =
        (0..2).filter(|joint| row.amplitude_rad[*joint].is_finite()).collect();
    for joint in commanded.iter().copied() {
        let limits = |of: fn(&GaitNumbers) -> &[f64; 2]| [of(lower)[joint], of(upper)[joint]];
        // If only one joint is commanded, its phase has no effect on the motion.
        let has_phase = commanded.len() > 1;
        let of_joint = [
            ("Amplitude", true, row.amplitude_rad, limits(|of| &of.amplitude_rad)),
            ("Offset", true, row.offset_rad, limits(|of| &of.offset_rad)),
            ("Phase", has_phase, row.phase_rad, limits(|of| &of.phase_rad)),
            ("2nd amplitude", has_second, row.amplitude2_rad, limits(|of| &of.amplitude2_rad)),
            ("2nd phase", has_second, row.phase2_rad, limits(|of| &of.phase2_rad)),
        ];
        let shown = of_joint.into_iter().filter(|(_, is_shown, ..)| *is_shown);
        found.extend(shown.map(|(name, _, value, [low, high])| {
            let rad = [value[joint], low, high];
            Number::new(format!("{name} {}", joint + 1), "°", rad.map(f64::to_degrees))
        }));
    }
    found
}
