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
    let has_second = best.iter().any(|row| {
        let seconds = row.amplitude2_rad.iter().chain(&*row.rotor_amplitude2_rad);
        seconds.into_iter().any(|of| of.is_finite())
    });
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

/// Returns the parameters of an optimal gait: the frequency; the amplitude, offset and (if there are several commands)
/// phase of the command of each joint and rotor; and, if `has_second`, the amplitude and phase of the second harmonic of
/// each angle.
fn numbers(row: &OptimumRow, has_second: bool) -> Vec<Number> {
    type Of = fn(&GaitNumbers) -> &Vec<f64>;
    let OptimumRow { lower, upper, .. } = row;
    let mut found = vec![Number::new(
        "ω".to_owned(),
        "rad/s",
        [row.omega_rad_s, lower.omega_rad_s, upper.omega_rad_s],
    )];
    let amplitudes = [&row.amplitude_rad.0, &row.torque_amplitude_nm.0, &row.rotor_amplitude_rad.0];
    let commands = amplitudes.into_iter().flatten().filter(|amplitude| amplitude.is_finite());
    // The phase of the only command has no effect on the motion.
    let has_phase = commands.count() > 1;
    let angle = ("°", 1_f64.to_degrees());
    let of_joints: [(&str, bool, &Vec<f64>, Of, _); 5] = [
        ("Amplitude", true, &row.amplitude_rad, |of| &of.amplitude_rad, angle),
        ("Offset", true, &row.offset_rad, |of| &of.offset_rad, angle),
        ("Phase", has_phase, &row.phase_rad, |of| &of.phase_rad, angle),
        ("2nd amplitude", has_second, &row.amplitude2_rad, |of| &of.amplitude2_rad, angle),
        ("2nd phase", has_second, &row.phase2_rad, |of| &of.phase2_rad, angle),
    ];
    let of_torques: [(&str, bool, &Vec<f64>, Of, _); 3] = [
        ("Torque", true, &row.torque_amplitude_nm, |of| &of.torque_amplitude_nm, ("N m", 1.0)),
        ("Mean torque", true, &row.torque_mean_nm, |of| &of.torque_mean_nm, ("N m", 1.0)),
        ("Torque phase", has_phase, &row.torque_phase_rad, |of| &of.torque_phase_rad, angle),
    ];
    let of_rotors: [(&str, bool, &Vec<f64>, Of, _); 4] = [
        ("Rotor amplitude", true, &row.rotor_amplitude_rad, |of| &of.rotor_amplitude_rad, angle),
        ("Rotor phase", has_phase, &row.rotor_phase_rad, |of| &of.rotor_phase_rad, angle),
        (
            "2nd rotor amplitude",
            has_second,
            &row.rotor_amplitude2_rad,
            |of| &of.rotor_amplitude2_rad,
            angle,
        ),
        ("2nd rotor phase", has_second, &row.rotor_phase2_rad, |of| &of.rotor_phase2_rad, angle),
    ];
    // Joints are numbered from 1, and links from 0.
    for (first, kinds) in [(1, &of_joints[..]), (1, &of_torques), (0, &of_rotors)] {
        let count = kinds.first().map_or(0, |(_, _, amplitudes, ..)| amplitudes.len());
        for i in (0..count).filter(|i| kinds[0].2[*i].is_finite()) {
            let shown = kinds.iter().filter(|(_, is_shown, ..)| *is_shown);
            found.extend(shown.map(|(name, _, values, of, (unit, scale))| {
                let limits = [of(lower), of(upper)].map(|limits| limits.get(i).copied());
                let [low, high] = limits.map(|limit| limit.unwrap_or(f64::NAN));
                let numbers = [values[i], low, high].map(|number| scale * number);
                Number::new(format!("{name} {}", first + i), unit, numbers)
            }));
        }
    }
    found
}
