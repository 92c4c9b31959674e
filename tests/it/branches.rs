//! Tests of branches of steady-state motions along a parameter.

use std::cell::Cell;
use std::f64::consts::TAU;

use serde_json::Value;
use trilink_mechanics::{
    Branch, BranchPoint, Laws, MotionError, Problem, REFERENCE_ACCURACY, Solver, branches,
};
use trilink_robot::metrics::{Bifurcation, BranchKind, MotionStatus};
use trilink_robot::{Gait, JointCommand, Robot};

use crate::common::{succeed, text, trilink};

/// Returns the steady-state problem of the paper's simulated semi-passive robot with almost no damping in its passive
/// joint.
fn semi_passive(omega_rad_s: f64) -> Problem {
    let robot = Robot { damping_nm_s_rad: 0.0005, ..Robot::semi_passive() };
    Problem::new(robot, Gait::passive_symmetric(), Laws::SKID_ROLL, omega_rad_s)
}

/// Returns the steady-state problem of the paper's simulated semi-passive robot, almost without damping and without
/// rolling resistance. It has two stable motions at low frequencies.
fn without_roll_resistance(omega_rad_s: f64) -> Problem {
    Problem { laws: Laws::SKID, ..semi_passive(omega_rad_s) }
}

/// Returns the steady-state problem of a robot that has a period-doubled motion at 3.5473 rad/s.
fn doubling(omega_rad_s: f64) -> Problem {
    let command = JointCommand::new(0.8137, 0.2838, 2.662);
    let robot = Robot {
        h_m: [0.1695; 2],
        l_m: [0.1551; 2],
        b_m: [0.02867; 2],
        mass_kg: [2.93, 0.196, 0.2922],
        inertia_kg_m2: [351e-4, 6e-4, 22.9e-4],
        roll_kg_s: [0.0; 3],
        skid_kg_s: [0.0; 3],
        stiffness_nm_rad: 0.4998,
        damping_nm_s_rad: 0.0643,
        rest_angle_rad: -0.1661,
        ..Robot::semi_passive()
    };
    let gait = Gait { joints: [Some(command), None] };
    Problem::new(robot, gait, Laws::NO_SKID, omega_rad_s)
}

fn met(branch: &Branch, bifurcation: Bifurcation) -> Vec<&BranchPoint> {
    branch.points.iter().filter(|point| point.bifurcation == Some(bifurcation)).collect()
}

fn near(found: f64, known: f64, relative: f64) -> bool {
    (found - known).abs() <= relative * known.abs()
}

#[test]
fn a_branch_without_symmetry_begins_where_the_symmetric_motion_loses_its_stability() {
    let found = branches(&semi_passive, [11.0, 12.0], &|| false).unwrap();
    let [symmetric, broken] = &found[..] else { panic!("{} branches", found.len()) };
    assert_eq!((symmetric.kind, symmetric.parent), (BranchKind::Symmetric, None));
    assert_eq!((broken.kind, broken.parent), (BranchKind::SymmetryBroken, Some(0)));
    let [point] = met(symmetric, Bifurcation::SymmetryBreaking)[..] else { panic!("{found:?}") };
    assert!((point.floquet - 1.0).abs() < 1e-6 && (11.4..11.5).contains(&point.value), "{point:?}");
    for point in symmetric.points.iter().filter(|of| of.bifurcation.is_none()) {
        let is_stable = point.value < met(symmetric, Bifurcation::SymmetryBreaking)[0].value;
        assert_eq!(point.status.is_stable(), is_stable, "{point:?}");
        assert!(point.metrics.dtheta_rad.abs() < 1e-12, "{point:?}");
    }
    // Each motion of the branch, or its mirror image, is the one that the robot reaches from rest.
    let far = broken.points.iter().filter(|of| of.value > 11.46);
    let chosen: Vec<_> = far.step_by(5).collect();
    assert!(chosen.len() > 2, "{} points", broken.points.len());
    for point in chosen {
        let mut solver = Solver::default();
        let metrics = solver.solve(&semi_passive(point.value), REFERENCE_ACCURACY).unwrap();
        assert_eq!(solver.status(), Ok(MotionStatus::SymmetryBroken));
        assert_eq!(point.status, MotionStatus::SymmetryBroken);
        let BranchPoint { metrics: of_point, floquet, .. } = point;
        assert!(near(of_point.d_m, metrics.d_m, 1e-7), "{point:?} {metrics:?}");
        assert!(near(of_point.v_m_s, metrics.v_m_s, 1e-7), "{point:?} {metrics:?}");
        let turns = [of_point.dtheta_rad.abs(), metrics.dtheta_rad.abs()];
        assert!(near(turns[0], turns[1], 1e-6), "{point:?} {metrics:?}");
        assert!(near(*floquet, solver.floquet().unwrap().unwrap(), 1e-5), "{point:?}");
    }
}

#[test]
fn a_branch_is_followed_through_folds() {
    let found = branches(&without_roll_resistance, [0.345, 0.365], &|| false).unwrap();
    let [branch] = &found[..] else { panic!("{} branches", found.len()) };
    assert_eq!((branch.kind, branch.end.as_str()), (BranchKind::Symmetric, "the end of the range"));
    let folds = met(branch, Bifurcation::Fold);
    let values: Vec<f64> = folds.iter().map(|fold| fold.value).collect();
    assert!(values.len() == 2 && values[0] > values[1] + 0.005, "{values:?}");
    for fold in &folds {
        assert!((fold.floquet - 1.0).abs() < 1e-5, "{fold:?}");
    }
    // Between the folds there are three motions. The middle one is unstable; which of the other two the robot reaches
    // depends on its history.
    let crosses = |pair: &[BranchPoint]| (pair[0].value < 0.356) != (pair[1].value < 0.356);
    let crossings: Vec<_> = branch.points.windows(2).filter(|pair| crosses(pair)).collect();
    let stable = crossings.iter().map(|pair| pair[0].status.is_stable());
    assert_eq!(stable.collect::<Vec<_>>(), [true, false, true], "{crossings:?}");
    for (from, crossing) in [(0.345, crossings[0]), (0.365, crossings[2])] {
        let mut solver = Solver::default();
        let steps = (0..=20).map(|i| from + (0.356 - from) * f64::from(i) / 20.0);
        let last = steps.map(|omega_rad_s| {
            solver.solve(&without_roll_resistance(omega_rad_s), REFERENCE_ACCURACY).unwrap()
        });
        let metrics = last.last().unwrap();
        let part = (0.356 - crossing[0].value) / (crossing[1].value - crossing[0].value);
        let [from_m, to_m] = [crossing[0].metrics.d_m, crossing[1].metrics.d_m];
        let d_m = from_m + part * (to_m - from_m);
        assert!(near(d_m, metrics.d_m, 0.01), "{from}: {d_m} {metrics:?}");
    }
}

#[test]
fn a_period_doubles_where_a_multiplier_is_minus_one_and_the_doubled_motion_is_followed() {
    let found = branches(&doubling, [1.9, 4.5], &|| false).unwrap();
    let doublings = met(&found[0], Bifurcation::PeriodDoubling);
    assert!(!doublings.is_empty(), "{:?}", found[0].points);
    for point in doublings {
        assert!((point.floquet - 1.0).abs() < 1e-6, "{point:?}");
        let modulus = doubling(point.value).solve(REFERENCE_ACCURACY).unwrap().floquet.unwrap();
        assert!((modulus - 1.0).abs() < 1e-5, "{point:?} {modulus}");
    }
    let doubled = found.iter().find(|of| of.kind == BranchKind::PeriodDoubled).unwrap();
    let near_it =
        |point: &&BranchPoint| point.status == MotionStatus::Stable && point.floquet < 0.9;
    let point = doubled.points.iter().find(near_it).unwrap();
    // Simulated from rest, the robot travels twice the d of the branch in two cycles.
    let problem = doubling(point.value);
    let period_s = TAU / problem.omega_rad_s;
    let path = problem.varied_transient(&[], 600.5 * period_s, 1.0 / period_s, 1e-9).unwrap();
    let way = |from: usize, to: usize| {
        let [from, to] = [path[from].0, path[to].0];
        ((to.x_m - from.x_m).hypot(to.y_m - from.y_m), to.theta_rad - from.theta_rad)
    };
    // A pair of cycles can start from either of two poses.
    let (ways, dtheta_rad) = ([way(596, 598).0, way(597, 599).0], way(596, 598).1);
    assert!(ways.iter().any(|d_m| near(0.5 * d_m, point.metrics.d_m, 1e-5)), "{ways:?} {point:?}");
    assert!((0.5 * dtheta_rad - point.metrics.dtheta_rad).abs() < 1e-6, "{dtheta_rad} {point:?}");
    assert!(!near(way(596, 597).0, way(597, 598).0, 1e-3));
}

#[test]
fn branches_of_chains_begin_and_end_at_motions_that_simulate_finds() {
    let folder = tempfile::tempdir().unwrap();
    let settings = include_str!("../../docs/robots/passive-snake.toml");
    std::fs::write(folder.path().join("pipeline.toml"), settings).unwrap();
    for (key, [low, high]) in [
        ("omega_rad_s", ["3", "3.5"]),
        ("joint2.stiffness_nm_rad", ["0.3", "0.4"]),
        ("joint1.amplitude_deg", ["20", "30"]),
    ] {
        let over = format!("{key}={low}..{high}");
        let mut line = vec!["branches", "passive", "--json", "--over", &over];
        let is_omega = key == "omega_rad_s";
        line.extend(["--omega", "3"].into_iter().filter(|_| !is_omega));
        let points: Vec<Value> = serde_json::from_str(&succeed(folder.path(), &line)).unwrap();
        for (point, value) in [(points.first(), low), (points.last(), high)] {
            let set = format!("{key}={value}");
            let mut line = vec!["simulate", "passive", "--model", "skid-roll", "--json"];
            line.extend(if is_omega { ["--omega", value] } else { ["--set", &set] });
            line.extend(["--omega", "3"].into_iter().filter(|_| !is_omega));
            let answer: Vec<Value> = serde_json::from_str(&succeed(folder.path(), &line)).unwrap();
            let [one, other] = [point.unwrap(), &answer[0]].map(|of| of["d_m"].as_f64().unwrap());
            assert!(near(one, other, 1e-6), "{set}: {one} {other}");
        }
    }
    let line = ["branches", "passive", "--over", "joint2.stiffness=1..2", "--omega", "3"];
    let output = trilink(folder.path(), &line);
    let stderr = text(&output.stderr);
    assert!(stderr.contains("did you mean `joint2.stiffness_nm_rad`?"), "{stderr}");
}

#[test]
fn a_branch_ends_where_its_work_is_cancelled() {
    let asked = Cell::new(0);
    let is_third = || {
        asked.set(asked.get() + 1);
        asked.get() == 3
    };
    assert_eq!(branches(&semi_passive, [11.0, 12.0], &is_third), Err(MotionError::Cancelled));
    assert_eq!(asked.get(), 3);
}

#[test]
fn what_eq_3_gives_has_no_branches() {
    let problem = |omega_rad_s: f64| {
        Problem::new(Robot::kinematic(), Gait::skewed(), Laws::NO_SKID, omega_rad_s)
    };
    assert_eq!(branches(&problem, [1.0, 2.0], &|| false), Err(MotionError::Determined));
}

#[test]
fn branches_prints_what_it_meets_and_writes_all_points_and_a_figure() {
    let folder = tempfile::tempdir().unwrap();
    let arguments =
        ["branches", "semi-passive-symmetric", "--over", "damping_nm_s_rad=0.0005..0.007"];
    let others = ["--omega", "11.5", "--set", "stiffness_nm_rad=0.188"];
    let files = ["--table", "branches.parquet", "--figure", "branches.svg"];
    let table = succeed(folder.path(), &[&arguments[..], &others, &files].concat());
    for part in ["damping_nm_s_rad", "first motion", "symmetry-breaking", "the end of the range"] {
        assert!(table.contains(part), "{part}: {table}");
    }
    let svg = std::fs::read_to_string(folder.path().join("branches.svg")).unwrap();
    assert!(svg.contains("symmetry-breaking") && svg.contains("unstable"));
    let rows = succeed(folder.path(), &["inspect", "branches.parquet", "--json"]);
    let json = succeed(folder.path(), &[&arguments[..], &others, &["--json"]].concat());
    let [rows, json]: [Value; 2] = [rows, json].map(|text| serde_json::from_str(&text).unwrap());
    assert_eq!(rows, json);
    let csv = succeed(folder.path(), &[&arguments[..], &others, &["--csv"]].concat());
    assert_eq!(csv.lines().count(), json.as_array().unwrap().len() + 1);
    let is_met = |row: &&Value| row["bifurcation"] == "symmetry-breaking";
    let met: Vec<_> = json.as_array().unwrap().iter().filter(is_met).collect();
    let value = met[0]["value"].as_f64().unwrap();
    assert!((0.0023..0.0024).contains(&value), "{met:?}");
}

#[test]
fn numbers_of_the_gait_and_sums_can_vary_as_settings_set_them() {
    let folder = tempfile::tempdir().unwrap();
    for (key, [low, high]) in [
        ("amplitude2_deg", ["25", "35"]),
        ("offset2_deg", ["5", "10"]),
        ("mass0_kg", ["1", "1.1"]),
        ("roll_sum_kg_s", ["1", "1.5"]),
    ] {
        let over = format!("{key}={low}..{high}");
        let line =
            ["branches", "semi-passive-symmetric", "--omega", "3", "--json", "--over", &over];
        let points: Vec<Value> = serde_json::from_str(&succeed(folder.path(), &line)).unwrap();
        for (point, value) in [(points.first(), low), (points.last(), high)] {
            let set = format!("{key}={value}");
            let line =
                ["simulate", "semi-passive-symmetric", "--model", "skid-roll", "--omega", "3"];
            let line = [&line[..], &["--json", "--set", &set]].concat();
            let answer: Vec<Value> = serde_json::from_str(&succeed(folder.path(), &line)).unwrap();
            let [one, other] = [point.unwrap(), &answer[0]].map(|of| of["d_m"].as_f64().unwrap());
            assert!(near(one, other, 1e-6), "{set}: {one} {other}");
        }
    }
}

#[test]
fn invalid_parameters_of_branches_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    for (over, named) in [
        (vec!["omega_rad=1..2"], "found `omega_rad`, needed `omega_rad_s` or one of"),
        (
            vec!["skid1_kg_s=1..2"],
            "--omega: this option is required, because `--over` varies `skid1_kg_s`",
        ),
        (vec!["omega_rad_s=-1..2"], "found -1, needed a frequency above 0"),
        (
            vec!["omega_rad_s=1..2", "--omega", "3"],
            "the frequency cannot be fixed, because `--over omega_rad_s` varies it",
        ),
        (vec!["h_m=-0.1..0.2", "--omega", "3"], "h_m"),
        (vec!["offset2_deg=0..10", "--omega", "3"], "the motion at offset2_deg=0 is symmetric"),
        (vec!["rest_angle_deg=0..10", "--omega", "3"], "start the range at another value"),
        (vec!["offset1_deg=1..10", "--omega", "3"], "found `offset1_deg`, needed"),
    ] {
        let mut arguments = vec!["branches", "semi-passive-symmetric", "--over"];
        arguments.extend(&over);
        if over[0].starts_with("omega_rad=") {
            arguments.extend(["--omega", "3"]);
        }
        let output = trilink(folder.path(), &arguments);
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{over:?}: {stderr}");
        assert!(stderr.contains(named), "{over:?}: {stderr}");
    }
}
