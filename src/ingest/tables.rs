//! Tables of one trial.

use super::cycles::WheelVelocities;
use super::poses::{Coordinates, Tracked};
use crate::store::{Column, Table, numbers, repeated, texts};

/// `poses/<trial>.parquet`.
pub(super) fn poses(trial: &str, tracked: &Tracked, smooth: Coordinates, rate_hz: f64) -> Table {
    let Coordinates { x_m, y_m, theta_rad, phi_rad: [phi1_rad, phi2_rad] } = smooth;
    let mut columns = frames(trial, tracked.first_frame, x_m.len(), rate_hz);
    columns.extend([
        numbers("x_m", x_m),
        numbers("y_m", y_m),
        numbers("theta_rad", theta_rad),
        numbers("phi1_rad", phi1_rad),
        numbers("phi2_rad", phi2_rad),
    ]);
    let Tracked { residual_mm, fill, outlier, .. } = tracked;
    let residual = |i: usize| numbers(&format!("residual{i}_mm"), residual_mm[i].clone());
    let fill = |i: usize| texts(&format!("fill{i}"), fill[i].iter().map(|fill| fill.name()));
    let outlier =
        |i: usize| texts(&format!("outlier{i}"), outlier[i].iter().map(|found| found.name()));
    columns.extend((0..3).map(residual).chain((0..3).map(fill)).chain((0..3).map(outlier)));
    Table::new(columns)
}

/// `wheels/<trial>.parquet`.
pub(super) fn wheels(
    trial: &str,
    first_frame: i64,
    wheels: WheelVelocities,
    rate_hz: f64,
) -> Table {
    let WheelVelocities { roll_m_s, skid_m_s } = wheels;
    let mut columns = frames(trial, first_frame, roll_m_s[0].len(), rate_hz);
    for (name, of_wheels) in [("roll", roll_m_s), ("skid", skid_m_s)] {
        let of_wheels = of_wheels.into_iter().enumerate();
        columns.extend(of_wheels.map(|(i, values)| numbers(&format!("{name}{i}_m_s"), values)));
    }
    Table::new(columns)
}

/// The columns that tell the frames.
fn frames(trial: &str, first_frame: i64, frames: usize, rate_hz: f64) -> Vec<Column> {
    vec![
        repeated("trial", trial, frames),
        Column::new("frame".into(), (first_frame..).take(frames).collect::<Vec<_>>()),
        numbers("time_s", (0..frames).map(|i| i as f64 / rate_hz).collect()),
    ]
}
