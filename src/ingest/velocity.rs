//! From smoothed coordinates to the wheels' roll and skid velocities.

use super::links::Coordinates;
use super::smooth::runs;
use crate::robot::{Robot, Trig, Velocity, dot, roll_rows, rotated, skid_rows};

/// Velocities of wheels 0, 1, 2 over time, m/s; NaN where missing.
#[derive(Debug, Clone)]
pub(super) struct WheelVelocities {
    pub roll_m_s: [Vec<f64>; 3],
    pub skid_m_s: [Vec<f64>; 3],
}

/// Differentiates the coordinates and applies eq. 1 in link 0's frame.
pub(super) fn wheel_velocities(
    robot: &Robot,
    coordinates: &Coordinates,
    rate_hz: f64,
) -> WheelVelocities {
    let frames = coordinates.len();
    let rates = coordinates.map(|series| derivative(series, rate_hz));
    let missing = || [(); 3].map(|()| vec![f64::NAN; frames]);
    let (mut roll_m_s, mut skid_m_s) = (missing(), missing());
    for i in 0..frames {
        let [u, v] = rotated(-coordinates.theta_rad[i], [rates.x_m[i], rates.y_m[i]]);
        let [w1, w2] = [0, 1].map(|joint| rates.phi_rad[joint][i]);
        let velocity = [u, v, rates.theta_rad[i], w1, w2];
        let trig = Trig::new([coordinates.phi_rad[0][i], coordinates.phi_rad[1][i]]);
        let (roll, skid) = (roll_rows(robot, &trig), skid_rows(robot, &trig));
        for wheel in 0..3 {
            roll_m_s[wheel][i] = apply(&roll[wheel], &velocity);
            skid_m_s[wheel][i] = apply(&skid[wheel], &velocity);
        }
    }
    WheelVelocities { roll_m_s, skid_m_s }
}

/// A row times a velocity in which what the row does not need may be missing: a wheel's
/// velocity is known without the other side link.
fn apply(row: &[f64; 5], velocity: &Velocity) -> f64 {
    let mut needed = *velocity;
    for (rate, weight) in needed.iter_mut().zip(row) {
        if *weight == 0.0 {
            *rate = 0.0;
        }
    }
    dot(row, &needed)
}

/// Weights of samples -2 to 2 of the central difference of fourth order.
pub(super) fn derivative_weights() -> [f64; 5] {
    [1.0, -8.0, 0.0, 8.0, -1.0].map(|weight| weight / 12.0)
}

/// Time derivative, per second: central differences of fourth order, of second order next to
/// an end of a stretch without gaps, and one-sided ones at the end. A lone sample has none.
pub(super) fn derivative(series: &[f64], rate_hz: f64) -> Vec<f64> {
    let mut rates = vec![f64::NAN; series.len()];
    for (start, end) in runs(series) {
        let (run, rates) = (&series[start..end], &mut rates[start..end]);
        let last = run.len() - 1;
        for i in 0..=last {
            let from_end = i.min(last - i);
            let per_frame = if from_end >= 2 {
                (run[i - 2] - run[i + 2] + 8.0 * (run[i + 1] - run[i - 1])) / 12.0
            } else if from_end == 1 {
                0.5 * (run[i + 1] - run[i - 1])
            } else {
                match run.len() {
                    1 => f64::NAN,
                    2 => run[1] - run[0],
                    _ if i == 0 => 2.0 * run[1] - 1.5 * run[0] - 0.5 * run[2],
                    _ => 1.5 * run[last] - 2.0 * run[last - 1] + 0.5 * run[last - 2],
                }
            };
            rates[i] = per_frame * rate_hz;
        }
    }
    rates
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polynomial(degree: i32, t: f64) -> [f64; 2] {
        [t.powi(degree), f64::from(degree) * t.powi(degree - 1)]
    }

    #[test]
    fn polynomials_are_differentiated_exactly_up_to_the_order() {
        for degree in 1..=4 {
            let series: Vec<f64> =
                (0..20).map(|i| polynomial(degree, f64::from(i) / 10.0)[0]).collect();
            for (i, rate) in derivative(&series, 10.0).iter().enumerate() {
                let truth = polynomial(degree, i as f64 / 10.0)[1];
                let is_exact = degree <= 2 || (2..18).contains(&i);
                assert!((rate - truth).abs() < 1e-12 || !is_exact, "{degree} {i}");
            }
        }
    }

    #[test]
    fn stretches_between_gaps_are_differentiated_by_themselves() {
        let nan = f64::NAN;
        let series = [0.0, 2.0, nan, 5.0, nan, 1.0, 2.0, 3.0];
        let expected = [2.0, 2.0, nan, nan, nan, 1.0, 1.0, 1.0];
        for (rate, expected) in derivative(&series, 1.0).iter().zip(expected) {
            assert!(rate.is_nan() && expected.is_nan() || (rate - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn a_turning_robot_has_the_velocities_of_its_wheels_paths() {
        // Straight robot turning about the middle of link 0: the side wheels are h + l away.
        let (robot, rate, turn) = (Robot::kinematic(), 120.0, 0.7);
        let frames = 30;
        let coordinates = Coordinates {
            x_m: vec![0.0; frames],
            y_m: vec![0.0; frames],
            theta_rad: (0..frames).map(|i| turn * i as f64 / rate).collect(),
            phi_rad: [vec![0.0; frames], vec![0.0; frames]],
        };
        let wheels = wheel_velocities(&robot, &coordinates, rate);
        let arm = robot.h_m + robot.l_m;
        for i in 0..frames {
            for (wheel, truth) in [0.0, arm * turn, -arm * turn].into_iter().enumerate() {
                assert!((wheels.skid_m_s[wheel][i] - truth).abs() < 1e-12);
                assert!(wheels.roll_m_s[wheel][i].abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_link_out_of_sight_hides_only_its_own_wheel() {
        let frames = 10;
        let coordinates = Coordinates {
            x_m: vec![0.0; frames],
            y_m: vec![0.0; frames],
            theta_rad: vec![0.0; frames],
            phi_rad: [vec![f64::NAN; frames], vec![0.1; frames]],
        };
        let wheels = wheel_velocities(&Robot::kinematic(), &coordinates, 120.0);
        let missing = |series: &[f64]| series.iter().all(|x| x.is_nan());
        assert_eq!([0, 1, 2].map(|i| missing(&wheels.skid_m_s[i])), [false, true, false]);
        assert_eq!([0, 1, 2].map(|i| missing(&wheels.roll_m_s[i])), [false, true, false]);
    }
}
