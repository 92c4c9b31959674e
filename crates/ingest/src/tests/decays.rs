//! Coast-downs and joint releases with viscous resistance, dry friction and both: which law the recording identifies.
//! The motions are integrated numerically, with friction `F tanh(v / v_t)`.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use trilink_robot::decay::DecayLaw::{self, Coulomb, CoulombViscous, Viscous};
use trilink_tables::LawStatus;

use super::*;
use crate::identification::{coast, release};

const RATE_HZ: f64 = 120.0;
const STEPS: usize = 400;

fn robot() -> Robot {
    Config::default().robot["semi-passive"].three_links().unwrap().to_robot()
}

/// Integrates a motion from `begin`, a position and a velocity, by the classical Runge-Kutta method and returns the
/// position in every frame. `acceleration` is a function of position and velocity.
fn positions(begin: [f64; 2], duration_s: f64, acceleration: impl Fn([f64; 2]) -> f64) -> Vec<f64> {
    let h = 1.0 / RATE_HZ / STEPS as f64;
    let slope = |state: [f64; 2]| [state[1], acceleration(state)];
    let mut state = begin;
    let frame = |_| {
        let now = state[0];
        for _ in 0..STEPS {
            let step = |by: f64, k: [f64; 2]| [state[0] + by * k[0], state[1] + by * k[1]];
            let k1 = slope(state);
            let k2 = slope(step(0.5 * h, k1));
            let k3 = slope(step(0.5 * h, k2));
            let k4 = slope(step(h, k3));
            let mean = |i: usize| (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0;
            state = step(h, [mean(0), mean(1)]);
        }
        now
    };
    (0..(duration_s * RATE_HZ) as usize).map(frame).collect()
}

fn noisy(series: Vec<f64>, noise: f64, random: &mut ChaCha8Rng) -> Vec<f64> {
    let noisy = series.into_iter().map(|x| {
        let normal: f64 = StandardNormal.sample(random);
        x + noise * normal
    });
    noisy.collect()
}

/// Measured robot parameters and findings.
type Measured = (RobotParameterRow, Vec<Finding>);

/// Measures a coast-down of a robot that is pushed to a speed and rolls against the resistance
/// `roll_kg_s v + dry_n tanh(v / v_t)`.
fn coasting([roll_kg_s, dry_n]: [f64; 2], speed_m_s: f64, noise_m: f64, seed: u64) -> Measured {
    let robot = robot();
    let mass_kg: f64 = robot.mass_kg.iter().sum();
    let slowed = |v: f64| -(roll_kg_s * v + dry_n * (v / 0.005).tanh()) / mass_kg;
    let stops_s = 4.0 * speed_m_s * mass_kg / (roll_kg_s * speed_m_s + dry_n);
    let coasted = positions([0.25 * speed_m_s, speed_m_s], stops_s.max(0.6), |[_, v]| slowed(v));
    let pushed = (0..108).map(|i| {
        let t = (f64::from(i) / RATE_HZ - 0.4).max(0.0);
        speed_m_s * t * t
    });
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let x_m = noisy(pushed.chain(coasted).collect(), noise_m, &mut random);
    let still = vec![0.0; x_m.len()];
    let speed = signals::derivative(&signals::moving_average(&x_m, 9), RATE_HZ);
    let phi_rad = [still.clone(), still.clone()].into();
    let coordinates = Coordinates { y_m: still.clone(), theta_rad: still, phi_rad, x_m };
    coast::measure(&robot.into(), &coordinates, &speed, RATE_HZ)
        .unwrap_or_else(|e| panic!("{roll_kg_s} {dry_n} {speed_m_s} {e}"))
}

/// Measures a release of joint 1 at an angle, with the torque `-k phi - c phi' - T tanh(phi' / w_t)`, where c is
/// `damping_nm_s_rad` and T is `dry_nm`.
fn released(
    [damping_nm_s_rad, dry_nm]: [f64; 2],
    angle_rad: f64,
    noise_rad: f64,
    seed: u64,
) -> Measured {
    let robot = robot();
    let inertia_kg_m2 = robot.inertia_about_joint_kg_m2(1);
    let torque = |[phi, rate]: [f64; 2]| {
        -robot.stiffness_nm_rad * phi - damping_nm_s_rad * rate - dry_nm * (rate / 0.01).tanh()
    };
    let swing = positions([angle_rad, 0.0], 4.0, |state| torque(state) / inertia_kg_m2);
    let phi = std::iter::repeat_n(angle_rad, 60).chain(swing).collect();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let phi = noisy(phi, noise_rad, &mut random);
    let still = vec![0.0; phi.len()];
    let coordinates = Coordinates {
        x_m: still.clone(),
        y_m: still.clone(),
        theta_rad: still.clone(),
        phi_rad: [phi, still].into(),
    };
    release::measure(&robot.into(), &coordinates, RATE_HZ).expect("it swings")
}

const COASTS: [(DecayLaw, [f64; 2]); 3] =
    [(Viscous, [1.2, 0.0]), (Coulomb, [0.0, 0.48]), (CoulombViscous, [0.6, 0.24])];
const RELEASES: [(DecayLaw, [f64; 2]); 3] =
    [(Viscous, [0.006, 0.0]), (Coulomb, [0.0, 0.003]), (CoulombViscous, [0.003, 0.0015])];

/// Asserts that the viscous and the dry coefficient are within 0.1 % of the true values, or NaN where the true value is
/// zero because `law` has no such coefficient.
fn assert_coefficients([viscous, dry]: [Estimate; 2], truth: [f64; 2], law: DecayLaw) {
    for (found, truth) in [(viscous, truth[0]), (dry, truth[1])] {
        if truth == 0.0 {
            assert!(found.value.is_nan(), "{law}: {found:?}");
        } else {
            assert!((found.value / truth - 1.0).abs() < 1e-3, "{law}: {found:?} {truth}");
        }
    }
}

#[test]
fn motions_without_noise_give_the_coefficients_of_each_law() {
    for (law, truth) in COASTS {
        for speed_m_s in [0.8, 0.3, 0.1] {
            let (row, _) = coasting(truth, speed_m_s, 0.0, 0);
            assert_eq!(
                (row.law, row.status.to_string().as_str()),
                (Some(law), "ok"),
                "{speed_m_s}"
            );
            assert_coefficients([row.roll_sum_kg_s, row.roll_dry_sum_n], truth, law);
            assert_eq!(row.laws()[law as usize].1.adequate, Some(true));
        }
    }
    for (law, truth) in RELEASES {
        let (row, _) = released(truth, 0.5, 0.0, 0);
        assert_eq!((row.law, row.status.to_string().as_str()), (Some(law), "ok"));
        assert_coefficients([row.damping_nm_s_rad, row.joint_dry_nm], truth, law);
        let stiffness = row.stiffness_nm_rad.value;
        assert!((stiffness / row.stiffness_configured_nm_rad - 1.0).abs() < 1e-3, "{stiffness}");
        assert!(row.rest_angle_rad.value.abs() < 1e-4, "{law} {:?}", row.rest_angle_rad);
    }
}

/// Returns the fractions of recordings in which the true law is preferred, the viscous law is rejected, and the dry law
/// is rejected.
fn preferred(law: DecayLaw, rows: impl Iterator<Item = Measured>) -> [f64; 3] {
    let rows: Vec<RobotParameterRow> = rows.map(|(row, _)| row).collect();
    let is_preferred = |row: &&RobotParameterRow| {
        row.law == Some(law) && row.laws()[law as usize].1.adequate == Some(true)
    };
    [
        rows.iter().filter(is_preferred).count(),
        rows.iter().filter(|row| row.viscous.adequate == Some(false)).count(),
        rows.iter().filter(|row| row.coulomb.adequate == Some(false)).count(),
    ]
    .map(|count| count as f64 / rows.len() as f64)
}

#[test]
fn for_noisy_motions_the_true_law_is_preferred_and_wrong_ones_are_rejected() {
    let check = |law: DecayLaw, [right, viscous, coulomb]: [f64; 3]| {
        println!("{law}: preferred {right}, viscous rejected {viscous}, coulomb {coulomb}");
        assert!(right >= 0.9, "{law}: {right}");
        assert!(if law == Viscous { viscous <= 0.1 } else { viscous == 1.0 }, "{law}: {viscous}");
        assert!(if law == Coulomb { coulomb <= 0.1 } else { coulomb == 1.0 }, "{law}: {coulomb}");
    };
    for (law, truth) in COASTS {
        check(law, preferred(law, (0..40).map(|seed| coasting(truth, 0.7, 3e-4, seed))));
    }
    for (law, truth) in RELEASES {
        check(law, preferred(law, (0..40).map(|seed| released(truth, 0.5, 3e-3, seed))));
    }
}

#[test]
fn the_viscous_law_is_rejected_for_a_dry_roll_that_deviates_by_a_hundredth_of_its_path() {
    let path_m =
        0.5 * 0.7 * 0.7 / (0.48 / robot().mass_kg.iter().sum::<f64>()) * (0.95 * 0.95 - 0.01);
    for noise_m in [0.0, 1e-4, 1e-3] {
        let (row, findings) = coasting([0.0, 0.48], 0.7, noise_m, 3);
        let relative = row.viscous.misfit_m / path_m;
        assert!((0.0075..0.0095).contains(&relative), "{relative}");
        assert_eq!((row.law, row.viscous.adequate), (Some(Coulomb), Some(false)), "{noise_m}");
        assert!(row.roll_sum_kg_s.value.is_nan() && row.roll_kg_s[0].value.is_nan());
        for check in [Check::Decay, Check::DecayLaw] {
            let found = findings.iter().find(|found| found.check == check).expect("a finding");
            assert!(found.severity == Severity::Warning && found.value > found.limit, "{found:?}");
            assert!(found.message.contains(", above the limit "), "{}", found.message);
        }
    }
}

/// Asserts that the recording does not identify its law, that the last finding names `laws` as not distinguished, and
/// that the row has no parameters.
fn assert_undecided((row, findings): Measured, laws: [&str; 2]) {
    assert_eq!((row.law, row.quantities().count()), (None, 0), "{} {:?}", row.status, row.laws());
    let [viscous, coulomb, _] = row.laws().map(|(_, fit)| *fit);
    // Adequate, or not fitted.
    assert!(viscous.adequate != Some(false) && coulomb.adequate != Some(false));
    assert!(!(viscous.f > row.f_limit || coulomb.f > row.f_limit), "{:?}", row.laws());
    let found = &findings[findings.len() - 1];
    assert_eq!((found.check, found.severity), (Check::DecayLaw, Severity::Warning));
    let message = format!("the recording does not distinguish {} from {}: ", laws[0], laws[1]);
    assert!(found.message.starts_with(&message), "{}", found.message);
    assert!(found.message.contains(" would have to exceed "), "{}", found.message);
    assert_eq!(row.status, LawStatus::NotDistinguished);
}

#[test]
fn slow_short_or_noisy_recordings_do_not_identify_the_law_and_report_so() {
    for (_, [viscous, dry]) in COASTS {
        let short = coasting([2.0 * viscous, 2.0 * dry], 0.06, 2e-4, 1);
        assert_undecided(short, ["viscous rolling", "dry rolling"]);
    }
}
