//! Coast-downs on a tilted floor. The motions are integrated explicitly in small steps: a body on an inclined plane
//! with viscous resistance and dry friction. White noise is added to the poses.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use trilink_robot::decay::DecayLaw;
use trilink_tables::{Columns as _, LawStatus, SlopeStatus};

use super::*;
use crate::identification::floor::{estimate_slopes, forget_slopes};
use crate::identification::{against_configured, coast};

const RATE_HZ: f64 = 120.0;
const STEPS: usize = 50;
const NOISE_M: f64 = 2e-4;

fn robot() -> Robot {
    Config::default().robot["semi-passive"].three_links().unwrap().to_robot()
}

/// A coast-down on a plane that rises by `slope_deg` along x and y.
#[derive(Clone, Copy)]
struct Push {
    slope_deg: [f64; 2],
    viscous_kg_s: f64,
    dry_n: f64,
    /// Direction of travel, degrees from x.
    heading_deg: f64,
    is_backward: bool,
    seed: u64,
}

impl Push {
    const VISCOUS: Self = Self {
        slope_deg: [0.3, 0.0],
        viscous_kg_s: 1.2,
        dry_n: 0.0,
        heading_deg: 0.0,
        is_backward: false,
        seed: 0,
    };

    /// Returns the distance travelled in every frame, m: half a second at rest, a push to 0.8 m/s, and the coasting.
    fn path_m(&self) -> Vec<f64> {
        let mass_kg: f64 = robot().mass_kg.iter().sum();
        let (sin, cos) = self.heading_deg.to_radians().sin_cos();
        let [x, y] = self.slope_deg.map(f64::to_radians).map(f64::tan);
        // Sine of the angle at which the path rises.
        let rise = (x * cos + y * sin).atan().sin();
        let [mut path, mut v] = [0.0, 0.0];
        let h = 1.0 / RATE_HZ / STEPS as f64;
        let mut positions = Vec::new();
        for frame in 0..(6.5 * RATE_HZ) as usize {
            positions.push(path);
            let t = frame as f64 / RATE_HZ;
            for _ in 0..STEPS {
                if t < 0.5 {
                    continue;
                }
                if t < 1.0 {
                    v += h * 1.6;
                    path += h * (v - 0.5 * h * 1.6);
                    continue;
                }
                let pull = -9.80665 * rise - self.viscous_kg_s * v / mass_kg;
                let half = v + 0.5 * h * pull;
                let pull = -9.80665 * rise - self.viscous_kg_s * half / mass_kg;
                let free = v + h * pull;
                let next = free.signum() * (free.abs() - h * self.dry_n / mass_kg).max(0.0);
                path += 0.5 * h * (v + next);
                v = next;
            }
        }
        positions
    }

    fn measure(&self) -> (RobotParameterRow, Vec<Finding>) {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut noise = || {
            let normal: f64 = StandardNormal.sample(&mut random);
            NOISE_M * normal
        };
        let path_m = self.path_m();
        let (sin, cos) = self.heading_deg.to_radians().sin_cos();
        let x_m: Vec<f64> = path_m.iter().map(|s| s * cos + noise()).collect();
        let y_m: Vec<f64> = path_m.iter().map(|s| s * sin + noise()).collect();
        let turn_deg = if self.is_backward { 180.0 } else { 0.0 };
        let theta = (self.heading_deg + turn_deg).to_radians();
        let along: Vec<f64> =
            x_m.iter().zip(&y_m).map(|(x, y)| x * theta.cos() + y * theta.sin()).collect();
        let speed = signals::derivative(&signals::moving_average(&along, 9), RATE_HZ);
        let still = vec![0.0; x_m.len()];
        let theta_rad = vec![theta; x_m.len()];
        let phi_rad = [still.clone(), still].into();
        let coordinates = Coordinates { x_m, y_m, theta_rad, phi_rad };
        let (row, mut findings) =
            coast::measure(&robot().into(), &coordinates, &speed, RATE_HZ).expect("it coasts");
        findings.push(against_configured(&row));
        (row, findings)
    }
}

/// Returns the rows of coast-downs of one folder before they are compared with each other.
fn recorded(pushes: &[Push]) -> Ingested {
    let mut rows = Ingested::default();
    for (number, push) in pushes.iter().enumerate() {
        let trial = format!("push-{number}");
        let (row, findings) = push.measure();
        rows.parameters.push(RobotParameterRow {
            trial: trial.clone(),
            kind: TrialKind::CoastDown,
            robot: "ours".to_owned(),
            ..row
        });
        rows.checks.extend(findings.iter().map(|finding| finding.row(&trial)));
        rows.trials.push(TrialRow {
            trial,
            folder: "raw/day1".to_owned(),
            kind: TrialKind::CoastDown,
            status: TrialStatus::Ok,
            ..TrialRow::blank()
        });
    }
    rows
}

fn compared(pushes: &[Push]) -> Ingested {
    let mut rows = recorded(pushes);
    estimate_slopes(&mut rows, &shares());
    rows
}

fn shares() -> BTreeMap<String, Vec<f64>> {
    BTreeMap::from([("ours".to_owned(), robot().roll_kg_s.to_vec())])
}

fn there_and_back(push: Push, seed: u64) -> [Push; 2] {
    let heading_deg = push.heading_deg + 180.0;
    [Push { seed: 2 * seed, ..push }, Push { seed: 2 * seed + 1, heading_deg, ..push }]
}

/// Returns the deviation of an estimate from the truth in standard errors.
fn deviation(Estimate { value, se }: Estimate, truth: f64) -> f64 {
    (value - truth) / se
}

fn message_of<'r>(rows: &'r Ingested, trial: &str, check: Check) -> &'r CheckRow {
    let name = check.to_string();
    let found = rows.checks.iter().find(|row| row.trial == trial && row.check == name);
    found.expect("it is checked")
}

#[test]
fn viscous_coast_downs_up_and_down_a_slope_show_no_dry_friction_and_the_slope() {
    let slope_rad = 0.3_f64.to_radians();
    let mut worst: [f64; 2] = [0.0; 2];
    for seed in 0..20 {
        let mut pushes = there_and_back(Push::VISCOUS, seed);
        // Half of the robots are pushed backwards instead of turned round.
        pushes[1].is_backward = seed % 2 == 0;
        let rows = compared(&pushes);
        for (row, sign) in rows.parameters.iter().zip([1.0, -1.0]) {
            assert_eq!((row.law, row.status), (Some(DecayLaw::Viscous), LawStatus::Ok), "{seed}");
            assert_eq!((row.slope_status, row.pooled_trials), (Some(SlopeStatus::Ok), 2));
            assert!(row.roll_dry_sum_n.value.is_nan() && row.slope_y_rad.value.is_nan());
            let along = row.slope_along_rad;
            assert!(along.se < 1e-4 && (along.value - sign * slope_rad).abs() < 3e-4, "{along:?}");
            worst[0] = worst[0].max(deviation(along, sign * slope_rad).abs());
            worst[1] = worst[1].max(deviation(row.roll_sum_kg_s, 1.2).abs());
            assert!((row.slope_x_rad.value - slope_rad).abs() < 3e-4);
            assert_eq!(message_of(&rows, &row.trial, Check::DecayLaw).severity, Severity::Ok);
            let slope = message_of(&rows, &row.trial, Check::FloorSlope);
            assert_eq!(slope.severity, Severity::Warning, "{}", slope.message);
        }
        assert!(rows.trials.iter().all(|trial| trial.status == TrialStatus::Flagged));
    }
    println!("worst deviation in standard errors: slope {:.2}, c {:.2}", worst[0], worst[1]);
    assert!(worst.iter().all(|worst| *worst < 4.0), "{worst:?}");
}

#[test]
fn dry_friction_and_an_oblique_slope_are_separated_by_four_directions() {
    for seed in 0..10 {
        let push = Push {
            slope_deg: [0.2, -0.1],
            viscous_kg_s: 0.6,
            dry_n: 0.24,
            heading_deg: 20.0,
            ..Push::VISCOUS
        };
        let across = there_and_back(Push { heading_deg: 110.0, ..push }, seed + 100);
        let rows = compared(&[there_and_back(push, seed), across].concat());
        for row in &rows.parameters {
            assert_eq!(row.law, Some(DecayLaw::CoulombViscous), "{}", row.status);
            let [x, y] = [0.2_f64, -0.1].map(f64::to_radians);
            for (found, truth) in [
                (row.slope_x_rad, x),
                (row.slope_y_rad, y),
                (row.roll_dry_sum_n, 0.24),
                (row.roll_sum_kg_s, 0.6),
            ] {
                assert!(deviation(found, truth).abs() < 4.0, "{seed}: {found:?} for {truth}");
            }
            assert!(row.slope_x_rad.se < 1e-4 && row.roll_dry_sum_n.se < 2e-3);
        }
    }
}

#[test]
fn one_direction_tells_neither_dry_friction_nor_the_slope() {
    for (heading_deg, words) in
        [(0.0, "dry friction, or a floor that rises by 0."), (180.0, "drives the robot")]
    {
        let push = Push { heading_deg, ..Push::VISCOUS };
        for pushes in [vec![push], vec![push, Push { seed: 1, ..push }]] {
            let rows = compared(&pushes);
            for row in &rows.parameters {
                assert_eq!((row.law, row.status), (None, LawStatus::DryOrSlope));
                assert_eq!(row.slope_status, Some(SlopeStatus::OneDirection));
                let missing = [row.roll_dry_sum_n, row.slope_along_rad, row.slope_x_rad];
                assert!(missing.iter().all(|missing| missing.value.is_nan()), "{missing:?}");
                assert!((row.roll_sum_kg_s.value - 1.2).abs() < 0.05, "{:?}", row.roll_sum_kg_s);
                let law = message_of(&rows, &row.trial, Check::DecayLaw);
                assert!(
                    law.severity == Severity::Warning && law.message.contains(words),
                    "{law:?}"
                );
                assert!(law.message.contains("in the opposite direction"), "{}", law.message);
                assert_eq!(row.repeats, pushes.len() as i64);
            }
            assert!(rows.checks.iter().all(|check| !check.check.starts_with("W029")));
        }
    }
}

#[test]
fn the_limits_of_a_level_floor_s_slope_hold_zero() {
    let level = Push { slope_deg: [0.0, 0.0], heading_deg: 70.0, ..Push::VISCOUS };
    let mut held = 0;
    let mut squares = 0.0;
    for seed in 0..100 {
        let rows = compared(&there_and_back(level, 1000 + seed));
        let row = &rows.parameters[0];
        assert_eq!(row.law, Some(DecayLaw::Viscous), "{seed}");
        let z = deviation(row.slope_along_rad, 0.0);
        held += usize::from(z.abs() < 1.96);
        squares += z * z / 100.0;
        let slope = message_of(&rows, "push-0", Check::FloorSlope);
        assert_eq!(slope.severity, Severity::Ok, "{}", slope.message);
    }
    println!("95 % limits hold zero in {held} of 100; mean square of z {squares:.2}");
    assert!(held >= 90 && squares > 0.2, "{held} {squares}");
}

#[test]
fn a_coast_down_that_is_taken_away_leaves_what_the_others_show_alone() {
    let pushes = there_and_back(Push { dry_n: 0.1, ..Push::VISCOUS }, 5);
    let mut both = compared(&pushes);
    both.trials.pop();
    both.parameters.pop();
    both.checks.retain(|check| check.trial == "push-0");
    both.checks.retain(|check| !check.check.starts_with("W029"));
    forget_slopes(&mut both);
    estimate_slopes(&mut both, &shares());
    let mut alone = recorded(&pushes[..1]);
    estimate_slopes(&mut alone, &shares());
    // NaN differs from itself.
    assert_eq!(format!("{both:?}"), format!("{alone:?}"));
}

#[test]
fn standard_errors_include_the_scatter_between_repeats() {
    let push = Push { slope_deg: [0.0, 0.0], ..Push::VISCOUS };
    let factors = [1.0, 1.03, 0.96, 1.02];
    let pushes = factors.map(|factor| Push { viscous_kg_s: 1.2 * factor, ..push });
    let rows = compared(&pushes);
    // Standard deviation of the four factors times 1.2 kg/s over c4 of three degrees of freedom.
    let known = 1.2 * 0.030957 / 0.921318;
    for row in &rows.parameters {
        assert_eq!((row.law, row.repeats), (Some(DecayLaw::Viscous), 4));
        assert!((row.roll_sum_kg_s.se / known - 1.0).abs() < 0.05, "{:?}", row.roll_sum_kg_s);
        assert!((row.decay_1_s.se / row.roll_sum_kg_s.se * row.mass_kg - 1.0).abs() < 1e-12);
        assert!(row.basis().starts_with("scatter of 4 repeats"), "{}", row.basis());
    }
    let one = compared(&pushes[..1]);
    let row = &one.parameters[0];
    assert!(row.repeats == 1 && row.roll_sum_kg_s.se < 0.1 * known);
    assert!(row.basis().contains("no repeats"), "{}", row.basis());
    // The same scatter in coast-downs both ways widens the joint estimate.
    let back = pushes.map(|push| Push { heading_deg: 180.0, seed: 9, ..push });
    let rows = compared(&[&pushes[..2], &back[2..]].concat());
    let row = &rows.parameters[0];
    assert_eq!(row.pooled_trials, 4);
    assert!((row.roll_sum_kg_s.se / known - 0.5).abs() < 0.05, "{:?}", row.roll_sum_kg_s);
}
