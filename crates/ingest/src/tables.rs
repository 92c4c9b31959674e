//! Tables of one trial.

use std::collections::BTreeMap;

use trilink_tables::config::Markers;
use trilink_tables::{Column, LABELS_APART, Table, numbers, repeated, texts};

use super::cycles::WheelVelocities;
use super::markers::labels::bit;
use super::poses::{Coordinates, Tracked};

/// `poses/<trial>.parquet`.
pub(super) fn poses(
    trial: &str,
    tracked: Tracked,
    smooth: Coordinates,
    markers: &Markers,
    rate_hz: f64,
) -> Table {
    let Tracked { first_frame, seen, filled, residual_mm, fill, outlier, unseen, .. } = tracked;
    // Of a long recording they are hundreds of megabytes.
    drop((seen, filled));
    let Coordinates { x_m, y_m, theta_rad, phi_rad: [phi1_rad, phi2_rad] } = smooth;
    let mut columns = frames(trial, first_frame, x_m.len(), rate_hz);
    columns.extend([
        numbers("x_m", x_m),
        numbers("y_m", y_m),
        numbers("theta_rad", theta_rad),
        numbers("phi1_rad", phi1_rad),
        numbers("phi2_rad", phi2_rad),
    ]);
    let residuals = residual_mm.into_iter().enumerate();
    columns.extend(residuals.map(|(i, values)| numbers(&format!("residual{i}_mm"), values)));
    let fill = |i: usize| texts(&format!("fill{i}"), fill[i].iter().map(|fill| fill.name()));
    let found =
        |i: usize| texts(&format!("outlier{i}"), outlier[i].iter().map(|found| found.name()));
    columns.extend((0..3).map(fill).chain((0..3).map(found)));
    let links = || markers.links().into_iter().enumerate();
    columns.extend(
        links().map(|(i, layout)| labels(&format!("unseen{i}"), layout, unseen[i].iter().copied())),
    );
    columns.extend(links().map(|(i, layout)| {
        let corrected = outlier[i].iter().map(|found| found.markers());
        labels(&format!("corrected{i}"), layout, corrected)
    }));
    Table::new(columns)
}

/// Labels of a link's markers, each a bit by its index in the layout.
fn labels(
    name: &str,
    layout: &BTreeMap<String, [f64; 3]>,
    markers: impl Iterator<Item = u64>,
) -> Column {
    let named = |bits: u64| {
        let labels = (0..).zip(layout.keys());
        let named = labels.filter(|(index, _)| bits & bit(*index) != 0);
        named.map(|(_, label)| label.as_str()).collect::<Vec<_>>().join(LABELS_APART)
    };
    let mut known = BTreeMap::new();
    let markers: Vec<u64> = markers.collect();
    markers.iter().for_each(|bits| {
        known.entry(*bits).or_insert_with(|| named(*bits));
    });
    texts(name, markers.iter().map(|bits| known[bits].as_str()))
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
