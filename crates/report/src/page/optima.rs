//! What the page says of a campaign's best gaits.

use minijinja::context;
use minijinja::value::{Serde, Value};
use trilink_tables::{GaitNumbers, OptimumRow};

use crate::tables::Tables;

/// A number of a gait, as it is shown.
struct Number {
    head: String,
    unit: &'static str,
    value: f64,
    limits: [f64; 2],
}

/// The best gait for each objective by each model; nothing where none was asked for.
pub(super) fn section(tables: &Tables, campaign: &str) -> Option<Value> {
    let best: Vec<&OptimumRow> =
        tables.optima.iter().filter(|row| row.campaign == campaign && row.rank == 1).collect();
    let has_second = best.iter().any(|row| row.amplitude2_rad.iter().any(|of| of.is_finite()));
    let numbers = |row: &OptimumRow| numbers(row, has_second);
    let heads: Vec<Value> = numbers(best.first()?)
        .into_iter()
        .map(|Number { head, unit, .. }| context! { head, unit })
        .collect();
    let rows = best.iter().map(|row| {
        let numbers = numbers(row).into_iter();
        let numbers = numbers.map(|Number { value, limits, .. }| context! { value, limits });
        context! {
            row => Serde(row),
            unit => row.objective.unit(),
            limits => [row.lower.value, row.upper.value],
            numbers => numbers.collect::<Vec<_>>(),
            counts => row.counts(),
            outdated => tables.is_outdated(row),
        }
    });
    Some(context! { heads, rows => rows.collect::<Vec<_>>() })
}

/// The frequency and the numbers of the joints that are commanded.
fn numbers(row: &OptimumRow, has_second: bool) -> Vec<Number> {
    let number = |head: &str, unit, of: [f64; 3]| {
        let [value, low, high] = of;
        Number { head: head.to_owned(), unit, value, limits: [low, high] }
    };
    let OptimumRow { lower, upper, .. } = row;
    let mut found =
        vec![number("ω", "rad/s", [row.omega_rad_s, lower.omega_rad_s, upper.omega_rad_s])];
    let commanded: Vec<usize> =
        (0..2).filter(|joint| row.amplitude_rad[*joint].is_finite()).collect();
    for joint in commanded.iter().copied() {
        let limits = |of: fn(&GaitNumbers) -> &[f64; 2]| [of(lower)[joint], of(upper)[joint]];
        // The phase of the only commanded joint changes nothing.
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
            number(&format!("{name} {}", joint + 1), "°", rad.map(f64::to_degrees))
        }));
    }
    found
}
