//! Synthetic tables with the poses, wheel velocities and cycles of a trial.

use std::f64::consts::TAU;
use std::path::Path;

use trilink_tables::{
    Columns, CycleRow, Provenance, Table, TrialRow, cycles_path, numbers, poses_path, repeated,
    texts, wheels_path,
};

const RATE_HZ: f64 = 120.0;
const CYCLES: usize = 8;

/// Writes the poses, wheel velocities and cycles of a trial in which the robot moves straight ahead at the speed given
/// in `trial`. The first two cycles are not used, and link 1 is missing in some frames.
pub(crate) fn write(derived: &Path, trial: &TrialRow) {
    let period_s = TAU / trial.omega_rad_s;
    let frames = ((CYCLES as f64 * period_s * RATE_HZ) as usize).min(20_000);
    let phase = |i: usize| trial.omega_rad_s * i as f64 / RATE_HZ;
    let along = |i: usize| trial.metrics.v_m_s * i as f64 / RATE_HZ;
    let name = trial.trial.as_str();
    let fill = |link: usize| {
        texts(
            &format!("fill{link}"),
            (0..frames).map(|i| match (link, i) {
                (1, 300..340) => "missing",
                (_, i) if i % 17 == link => "rigid",
                _ => "measured",
            }),
        )
    };
    let during = |name: String, labels: &'static str, some: std::ops::Range<usize>| {
        texts(&name, (0..frames).map(|i| if some.contains(&i) { labels } else { "" }))
    };
    let unseen = |link: usize, labels| during(format!("unseen{link}"), labels, 300..340);
    let corrected = |link: usize, labels| during(format!("corrected{link}"), labels, 600..660);
    let numbers =
        |name: &str, of: &dyn Fn(usize) -> f64| numbers(name, (0..frames).map(of).collect());
    let poses = Table::new(vec![
        frame(frames),
        numbers("time_s", &|i| i as f64 / RATE_HZ),
        numbers("x_m", &|i| if (300..340).contains(&i) { f64::NAN } else { along(i) }),
        numbers("y_m", &|i| 0.02 * phase(i).sin()),
        numbers("theta_rad", &|i| 0.3 * phase(i).cos()),
        numbers("phi1_rad", &|i| 0.52 * phase(i).cos()),
        numbers("phi2_rad", &|i| 0.52 * phase(i).sin()),
        numbers("residual0_mm", &|i| 0.2 + 0.001 * (i % 7) as f64),
        numbers("residual1_mm", &|i| 0.21 + 0.001 * (i % 5) as f64),
        numbers("residual2_mm", &|i| 0.19 + 0.001 * (i % 3) as f64),
        fill(0),
        fill(1),
        fill(2),
        repeated("outlier0", "none", frames),
        repeated("outlier1", "none", frames),
        repeated("outlier2", "none", frames),
        unseen(0, ""),
        unseen(1, "F1, F2, F3"),
        unseen(2, "R2"),
        corrected(0, ""),
        corrected(1, ""),
        corrected(2, "R1, R3"),
    ]);
    save(&poses, &poses_path(derived, name));
    save(&wheels(frames, &|i| 0.03 * phase(i).sin()), &wheels_path(derived, name));
    let cycles: Vec<CycleRow> = (0..CYCLES)
        .map(|i| CycleRow {
            trial: name.to_owned(),
            cycle: i as i64,
            start_s: i as f64 * period_s,
            metrics: trial.metrics,
            used: i >= 2,
            reason: if i < 2 { "one of the first 2, taken for transient" } else { "" }.to_owned(),
            ..CycleRow::blank()
        })
        .collect();
    save(&CycleRow::to_table(&cycles), &cycles_path(derived, name));
}

/// Writes the poses and wheel velocities of a released joint that oscillates with a natural frequency of 10.4 rad/s and
/// a damping ratio of 0.19.
pub(crate) fn write_release(derived: &Path, trial: &str) {
    let frames = 480;
    let swing = |i: usize| {
        let time_s = (i as f64 / RATE_HZ - 0.5).max(0.0);
        0.5 * (-0.19 * 10.4 * time_s).exp() * (10.21 * time_s).cos()
    };
    let numbers =
        |name: &str, of: &dyn Fn(usize) -> f64| numbers(name, (0..frames).map(of).collect());
    let nothing = |name: &str| numbers(name, &|_| 0.0);
    let poses = Table::new(vec![
        frame(frames),
        numbers("time_s", &|i| i as f64 / RATE_HZ),
        nothing("x_m"),
        nothing("y_m"),
        nothing("theta_rad"),
        numbers("phi1_rad", &swing),
        nothing("phi2_rad"),
        nothing("residual0_mm"),
        nothing("residual1_mm"),
        nothing("residual2_mm"),
        repeated("fill0", "measured", frames),
        repeated("fill1", "measured", frames),
        repeated("fill2", "measured", frames),
        repeated("outlier0", "none", frames),
        repeated("outlier1", "none", frames),
        repeated("outlier2", "none", frames),
    ]);
    save(&poses, &poses_path(derived, trial));
    save(&wheels(frames, &|_| 0.0), &wheels_path(derived, trial));
}

pub(crate) fn wheels(frames: usize, of: &dyn Fn(usize) -> f64) -> Table {
    let names = ["roll0_m_s", "roll1_m_s", "roll2_m_s", "skid0_m_s", "skid1_m_s", "skid2_m_s"];
    let time_s = numbers("time_s", (0..frames).map(|i| i as f64 / RATE_HZ).collect());
    let mut columns = vec![frame(frames), time_s];
    columns.extend(names.map(|name| numbers(name, (0..frames).map(of).collect())));
    Table::new(columns)
}

fn frame(frames: usize) -> polars::prelude::Column {
    polars::prelude::Column::new("frame".into(), (0..frames as i64).collect::<Vec<_>>())
}

pub(crate) fn save(table: &Table, path: &Path) {
    table.write(path, &Provenance { input: "made up".to_owned() }).expect("writes");
}
