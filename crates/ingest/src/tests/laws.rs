//! Coast-downs and joint-releases that follow their law, and others.

use trilink_robot::decay::DecayLaw;

use super::*;

const RATE_HZ: f64 = 120.0;
const STEPS: usize = 20;
/// Of the semi-passive robot.
const MASS_KG: f64 = 1.72;
const ROLL_KG_S: f64 = 1.2;
const STIFFNESS_NM_RAD: f64 = 0.137;
const DAMPING_NM_S_RAD: f64 = 0.006;
const INERTIA_KG_M2: f64 = 5.9e-4 + 0.34 * 0.058 * 0.058;

/// Positions in every frame of what begins at a position with a velocity, and stops where friction
/// of `dry` holds it; `force` is per unit of mass.
fn motion(
    [mut x, mut v]: [f64; 2],
    dry: f64,
    duration_s: f64,
    force: impl Fn(f64, f64) -> f64,
) -> Vec<f64> {
    let h = 1.0 / RATE_HZ / STEPS as f64;
    let frame = |_| {
        let now = x;
        for _ in 0..STEPS {
            // The midpoint rule.
            let slope = |x: f64, v: f64| force(x, v);
            let middle = [x + 0.5 * h * v, v + 0.5 * h * slope(x, v)];
            let free = v + h * slope(middle[0], middle[1]);
            // Dry friction takes from the velocity what it can.
            let next = free.signum() * (free.abs() - h * dry).max(0.0);
            x += 0.5 * h * (v + next);
            v = next;
        }
        now
    };
    (0..(duration_s * RATE_HZ) as usize).map(frame).collect()
}

/// A robot that is pushed to 0.8 m/s and rolls against its viscous resistance and another of
/// `dry_n`.
fn coasting(roll_kg_s: f64, dry_n: f64) -> Vec<[f64; 5]> {
    let rate_1_s = roll_kg_s / MASS_KG;
    let coasted = motion([0.2, 0.8], dry_n / MASS_KG, 5.2, |_, v| -rate_1_s * v);
    let pushed = (0..108).map(|i| {
        let t = (f64::from(i) / RATE_HZ - 0.4).max(0.0);
        0.8 * t * t
    });
    pushed.chain(coasted).map(|x| [x, 0.0, 0.0, 0.0, 0.0]).collect()
}

/// Joint 1 let go at 0.5 rad: its stiffness grows by a part at 1 rad, and its friction is `dry_nm`
/// besides the damping.
fn released(stiffening: f64, dry_nm: f64) -> Vec<[f64; 5]> {
    let torque = |phi: f64, rate: f64| {
        -STIFFNESS_NM_RAD * phi * (1.0 + stiffening * phi * phi) - DAMPING_NM_S_RAD * rate
    };
    let force = |phi, rate| torque(phi, rate) / INERTIA_KG_M2;
    let swing = motion([0.5, 0.0], dry_nm / INERTIA_KG_M2, 3.6, force);
    let held = std::iter::repeat_n(0.5, 60);
    held.chain(swing).map(|phi| [0.0, 0.0, 0.0, phi, 0.0]).collect()
}

fn measured(
    kind: TrialKind,
    coordinates: &[[f64; 5]],
    seed: u64,
) -> Result<ProcessedTrial, TrialFailure> {
    measured_with(&Config::default(), kind, coordinates, seed)
}

fn measured_with(
    config: &Config,
    kind: TrialKind,
    coordinates: &[[f64; 5]],
    seed: u64,
) -> Result<ProcessedTrial, TrialFailure> {
    let robot = "semi-passive";
    let bytes = trilink_synth::export(config, &config.robot[robot].to_robot(), coordinates, seed);
    let trial = Trial {
        kind,
        campaign: None,
        omega_rad_s: None,
        robot: Some(robot.to_owned()),
        ..gait_trial("a", "", 1.0)
    };
    let input = IngestInput::new(config, &trial)?;
    process(Path::new("a.csv"), &bytes, &trial, &input, &mut Known::new(&trial))
}

/// The row of a trial whose viscous law is refused.
fn refused(kind: TrialKind, coordinates: &[[f64; 5]], seed: u64) -> RobotParameterRow {
    let ProcessedTrial { row, checks, parameters, .. } =
        measured(kind, coordinates, seed).expect("it can be measured");
    let parameters = parameters.expect("it is no gait");
    assert_eq!(parameters.viscous.adequate, Some(false), "{parameters:?}");
    let check = checks.iter().find(|check| check.check == "W021 decay-law").expect("it is checked");
    assert_eq!(check.severity, Severity::Warning);
    assert_eq!(row.status, TrialStatus::Flagged);
    assert!(row.message.contains(&check.message), "{}", row.message);
    match parameters.law {
        Some(law) => {
            assert!(law != DecayLaw::Viscous && parameters.status.is_ok());
            assert!(check.value > check.limit, "{check:?}");
            assert!(check.message.contains(", needed at most "), "{}", check.message);
        }
        None => {
            assert_eq!(parameters.status.to_string(), check.message);
            assert_eq!(parameters.quantities().count(), 0);
        }
    }
    let slow = checks.iter().find(|check| check.check == "W015 decay").expect("it is checked");
    assert_eq!(slow.severity == Severity::Warning, slow.value > slow.limit);
    parameters
}

#[test]
fn dry_rolling_is_refused_however_small_its_part() {
    // Of the resistance at 0.4 m/s.
    for part in [1.0, 0.5, 0.05, 0.01] {
        let [roll_kg_s, dry_n] = [(1.0 - part) * ROLL_KG_S, part * ROLL_KG_S * 0.4];
        for seed in 0..3 {
            let row = refused(TrialKind::CoastDown, &coasting(roll_kg_s, dry_n), seed);
            let law = if part == 1.0 { DecayLaw::Coulomb } else { DecayLaw::CoulombViscous };
            assert_eq!(row.law, Some(law), "{part}");
            let (found, times) = (row.roll_dry_sum_n, row.viscous.misfit_over_noise);
            println!("dry part {part}: {times:.1} times the noise, {found:?} for {dry_n}");
            assert!((found.value - dry_n).abs() < (4.0 * found.se).max(0.002 * dry_n), "{found:?}");
            assert!(part < 0.02 || times > 5.0, "{part} {times}");
            assert_eq!(row.roll_sum_kg_s.value.is_nan(), part == 1.0);
        }
    }
}

#[test]
fn rolling_is_judged_by_the_law_that_the_robot_is_configured_with() {
    let law_check = |roll_kg_s: [f64; 3], roll_dry_n: [f64; 3], coasting: &[[f64; 5]]| {
        let mut config = Config::default();
        let robot = config.robot.get_mut("semi-passive").expect("the paper's");
        robot.set(Quantity::Roll, roll_kg_s);
        robot.set(Quantity::RollDry, roll_dry_n);
        let ProcessedTrial { row, checks, .. } =
            measured_with(&config, TrialKind::CoastDown, coasting, 1).expect("it can be measured");
        let check = checks.into_iter().find(|check| check.check == "W021 decay-law");
        (row.status, check.expect("it is checked").message)
    };
    let (roll_kg_s, roll_dry_n) = ([0.3, 0.15, 0.15], [0.12, 0.06, 0.06]);
    let (viscous, both) = (coasting(ROLL_KG_S, 0.0), coasting(0.6, 0.24));
    let dry = coasting(0.0, 0.48);
    for (roll_kg_s, roll_dry_n, coasting, expected) in [
        (roll_kg_s, roll_dry_n, &both, "the recording follows rolling with"),
        ([0.0; 3], roll_dry_n, &dry, "viscous resistance adds nothing to dry rolling"),
        (roll_kg_s, [0.0; 3], &viscous, "dry friction adds nothing to viscous rolling"),
    ] {
        let (status, message) = law_check(roll_kg_s, roll_dry_n, coasting);
        assert!(status == TrialStatus::Ok && message.starts_with(expected), "{status} {message}");
    }
    for (roll_kg_s, roll_dry_n, coasting, expected) in [
        (
            roll_kg_s,
            roll_dry_n,
            &viscous,
            "the recording follows viscous rolling: dry friction adds",
        ),
        ([0.0; 3], roll_dry_n, &viscous, "the recording refuses dry rolling"),
        ([0.0; 3], roll_dry_n, &both, "the recording refuses dry rolling"),
        (roll_kg_s, [0.0; 3], &dry, "the recording refuses viscous rolling"),
    ] {
        let (status, message) = law_check(roll_kg_s, roll_dry_n, coasting);
        assert_eq!(status, TrialStatus::Flagged, "{message}");
        assert!(message.starts_with(expected), "{message}");
    }
}

#[test]
fn a_joint_with_dry_friction_or_a_stiffening_spring_is_refused() {
    for (stiffening, dry_nm) in [(1.0, 0.0), (0.0, 3e-4), (0.0, 1e-3)] {
        for seed in 0..3 {
            let row = refused(TrialKind::JointRelease, &released(stiffening, dry_nm), seed);
            let found = row.joint_dry_nm;
            println!("stiffening {stiffening}, dry {dry_nm} N m: {:?} {found:?}", row.law);
            let law = Some(DecayLaw::CoulombViscous).filter(|_| stiffening == 0.0);
            assert_eq!(row.law, law, "{stiffening} {dry_nm}");
            assert!(law.is_none() || (found.value - dry_nm).abs() < 4.0 * found.se, "{found:?}");
        }
    }
    // With more it does not swing.
    for dry_nm in [8e-3, 0.012, 0.02] {
        let failed = measured(TrialKind::JointRelease, &released(0.0, dry_nm), 1).unwrap_err();
        assert!(failed.to_string().contains("swing"), "{failed}");
    }
}

/// Value over truth and standard error over truth.
#[derive(Default)]
struct Errors(Vec<[f64; 2]>);

impl Errors {
    fn within(&self) -> f64 {
        let within = self.0.iter().filter(|[off, se]| off.abs() < 1.96 * se);
        within.count() as f64 / self.0.len() as f64
    }

    /// The median standard error over the RMS error.
    fn width(&self) -> f64 {
        let rms = self.0.iter().map(|[off, _]| off * off).sum::<f64>() / self.0.len() as f64;
        let mut errors: Vec<f64> = self.0.iter().map(|[_, se]| *se).collect();
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2] / rms.sqrt()
    }
}

/// What recordings of lawful motions give, and how many of them are refused.
fn lawful(seeds: Range<u64>) -> ([Errors; 4], usize) {
    let (mut found, mut refused): ([Errors; 4], usize) = Default::default();
    let motions = [
        (TrialKind::CoastDown, coasting(ROLL_KG_S, 0.0)),
        (TrialKind::JointRelease, released(0.0, 0.0)),
    ];
    let ratio = DAMPING_NM_S_RAD / (2.0 * (STIFFNESS_NM_RAD * INERTIA_KG_M2).sqrt());
    for seed in seeds {
        for (kind, motion) in &motions {
            let row = measured(*kind, motion, seed).unwrap().parameters.unwrap();
            refused += usize::from(row.law != Some(DecayLaw::Viscous));
            let values = [
                (row.roll_sum_kg_s, ROLL_KG_S),
                (row.stiffness_nm_rad, STIFFNESS_NM_RAD),
                (row.damping_nm_s_rad, DAMPING_NM_S_RAD),
                (row.damping_ratio_decrement, ratio),
            ];
            for (errors, (Estimate { value, se }, truth)) in found.iter_mut().zip(values) {
                let known = Some([value / truth - 1.0, se / truth]);
                errors.0.extend(known.filter(|[off, _]| !off.is_nan()));
            }
        }
    }
    (found, refused)
}

#[test]
#[ignore = "80 recordings"]
fn of_forty_recordings_88_to_99_percent_are_within_errors_that_are_not_too_wide() {
    let (found, refused) = lawful(0..40);
    println!("{refused} of 80 refused");
    let names = ["roll sum", "k_tau", "c_tau", "decrement"];
    for (errors, name) in found.iter().zip(names) {
        println!("{name:10} {:.3} within 1.96, {:.2} of scatter", errors.within(), errors.width());
    }
    assert!(refused <= 2, "{refused}");
    for (errors, name) in found.iter().zip(names) {
        assert!((0.88..=0.99).contains(&errors.within()), "{name}: {}", errors.within());
        assert!((0.7..2.0).contains(&errors.width()), "{name}: {}", errors.width());
    }
}

#[test]
fn a_few_recordings_of_lawful_motions_pass_and_are_within_their_errors() {
    let (found, refused) = lawful(100..106);
    assert_eq!(refused, 0);
    let within: f64 = found.iter().map(Errors::within).sum();
    assert!(within / 4.0 > 0.8, "{within}");
    let widths = found.each_ref().map(Errors::width);
    assert!(widths.iter().all(|width| (0.4..2.5).contains(width)), "{widths:?}");
}
