//! Virtual laboratory that shares no code with the solver. It simulates trials of the kinematic robot by the
//! Newton-Euler equations of the robot's three links, integrated from rest with explicit Runge-Kutta steps, on floors
//! whose friction varies from day to day and from trial to trial.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector2, Vector3};
use trilink_robot::metrics::{GaitMetrics, padded};
use trilink_robot::{Gait, Robot};

/// Maximum step of the integrator, s: two thirds of the fastest decay time of a skid velocity.
const MAX_STEP_S: f64 = 4e-3;
const MIN_STEPS_PER_CYCLE: usize = 500;
const MAX_CYCLES: usize = 200;
/// Relative change in the displacement from one cycle to the next below which the robot is in its steady state.
const SETTLED: f64 = 1e-9;

/// Joint angles (rad), rates (rad/s) and accelerations (rad/s^2).
struct Joints {
    angle: [f64; 2],
    rate: [f64; 2],
    acceleration: [f64; 2],
}

impl Joints {
    fn at(gait: &Gait, omega_rad_s: f64, time_s: f64) -> Self {
        let commands = gait.joints.map(|joint| joint.expect("both joints are driven"));
        let phase = commands.map(|command| omega_rad_s * time_s + command.phase_rad);
        let amplitude = commands.map(|command| command.amplitude_rad);
        Self {
            angle: [0, 1].map(|j| commands[j].offset_rad + amplitude[j] * phase[j].cos()),
            rate: [0, 1].map(|j| -amplitude[j] * omega_rad_s * phase[j].sin()),
            acceleration: [0, 1].map(|j| -amplitude[j] * omega_rad_s.powi(2) * phase[j].cos()),
        }
    }
}

/// Geometry and motion of a link, in the frame of the middle link.
struct Link {
    /// Unit vector along the link.
    along: Vector2<f64>,
    /// Unit vector across the link.
    across: Vector2<f64>,
    /// Position of the joint between this link and the middle link, m; the origin for the middle link itself.
    joint: Vector2<f64>,
    /// Position of the centre of mass, m.
    centre: Vector2<f64>,
    /// Position of the wheel, m.
    wheel: Vector2<f64>,
    /// Rate of rotation relative to the middle link, rad/s.
    rate: f64,
    /// Angular acceleration relative to the middle link, rad/s^2.
    acceleration: f64,
}

fn links(robot: &Robot, joints: &Joints) -> [Link; 3] {
    let link = |angle: f64, h: f64, b: f64, l: f64, rate: f64, acceleration: f64| {
        let along = Vector2::new(angle.cos(), angle.sin());
        let joint = Vector2::new(h, 0.0);
        Link {
            along,
            across: Vector2::new(-angle.sin(), angle.cos()),
            joint,
            centre: joint + b * along,
            wheel: joint + l * along,
            rate,
            acceleration,
        }
    };
    let [phi1, phi2] = joints.angle;
    let [rate1, rate2] = joints.rate;
    let [acceleration1, acceleration2] = joints.acceleration;
    let [h1, h2] = robot.h_m;
    let [b1, b2] = robot.b_m;
    let [l1, l2] = robot.l_m;
    [
        link(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        link(-phi1, h1, b1, l1, -rate1, -acceleration1),
        link(phi2, -h2, -b2, -l2, rate2, acceleration2),
    ]
}

/// Returns the cross product of an angular velocity about the vertical axis and a vector in the plane.
fn turned(rate: f64, vector: Vector2<f64>) -> Vector2<f64> {
    rate * Vector2::new(-vector.y, vector.x)
}

fn moment(lever: Vector2<f64>, force: Vector2<f64>) -> f64 {
    lever.x * force.y - lever.y * force.x
}

impl Link {
    /// Returns the velocity of a point of the link, m/s; `state` is the velocity `(u, v, yaw rate)` of the middle link.
    fn velocity(&self, point: Vector2<f64>, state: &Vector3<f64>) -> Vector2<f64> {
        let [u, v, turning] = [state.x, state.y, state.z];
        Vector2::new(u, v) + turned(turning, point) + turned(self.rate, point - self.joint)
    }

    /// Returns the velocities of the link's wheel along and across the link, m/s.
    fn wheel_velocities(&self, state: &Vector3<f64>) -> [f64; 2] {
        let velocity = self.velocity(self.wheel, state);
        [velocity.dot(&self.along), velocity.dot(&self.across)]
    }

    /// Returns the acceleration of the link's centre of mass, m/s^2; `change` is the time derivative of `state`.
    fn acceleration(&self, state: &Vector3<f64>, change: &Vector3<f64>) -> Vector2<f64> {
        let turning = state.z;
        let of_middle = Vector2::new(change.x - turning * state.y, change.y + turning * state.x);
        let at_joint = turned(change.z, self.joint) - turning.powi(2) * self.joint;
        let arm = self.centre - self.joint;
        let own = turned(change.z + self.acceleration, arm) - (turning + self.rate).powi(2) * arm;
        of_middle + at_joint + own
    }
}

/// Resistance of the wheels to skidding, as a function of the skid velocity v.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Floor {
    /// `c v`
    Viscous,
    /// `c s tanh(v / s)`, with the speed s in m/s.
    Saturating { speed_m_s: f64 },
    /// `c |v|^p s^(1 - p) sign v`, with the speed s in m/s at which the law equals the viscous one.
    Power { exponent: f64, speed_m_s: f64 },
}

impl Floor {
    /// Returns the skid velocity of a viscous floor with the same force, m/s.
    fn equivalent_m_s(self, skid_m_s: f64) -> f64 {
        match self {
            Self::Viscous => skid_m_s,
            Self::Saturating { speed_m_s } => speed_m_s * (skid_m_s / speed_m_s).tanh(),
            Self::Power { exponent, speed_m_s } => {
                let size = (skid_m_s / speed_m_s).hypot(1e-3).powf(exponent - 1.0);
                skid_m_s * size
            }
        }
    }
}

/// Returns the imbalance between inertia and friction: the force (N) along and across the middle link, and the moment
/// about its wheel (N m). All are zero if `change` is the time derivative of `state`.
fn imbalance(
    robot: &Robot,
    floor: Floor,
    links: &[Link; 3],
    state: &Vector3<f64>,
    change: &Vector3<f64>,
) -> Vector3<f64> {
    let mut missing = Vector3::zeros();
    for (i, link) in links.iter().enumerate() {
        let inertial = robot.mass_kg[i] * link.acceleration(state, change);
        let spin = robot.inertia_kg_m2[i] * (change.z + link.acceleration);
        let [roll, skid] = link.wheel_velocities(state);
        let across = robot.skid_kg_s[i] * floor.equivalent_m_s(skid);
        let friction = -robot.roll_kg_s[i] * roll * link.along - across * link.across;
        let force = inertial - friction;
        let moments = moment(link.centre, inertial) + spin - moment(link.wheel, friction);
        missing += Vector3::new(force.x, force.y, moments);
    }
    missing
}

/// Returns the time derivative of `state`, the velocity `(u, v, yaw rate)` of the middle link.
fn derivative(robot: &Robot, floor: Floor, joints: &Joints, state: &Vector3<f64>) -> Vector3<f64> {
    let links = links(robot, joints);
    let at_rest = imbalance(robot, floor, &links, state, &Vector3::zeros());
    let column = |i: usize| {
        let mut unit = Vector3::zeros();
        unit[i] = 1.0;
        imbalance(robot, floor, &links, state, &unit) - at_rest
    };
    let mass = Matrix3::from_columns(&[column(0), column(1), column(2)]);
    mass.lu().solve(&-at_rest).expect("masses are above 0")
}

/// Returns the metrics of the steady-state motion, simulated from rest.
pub fn steady_metrics(robot: &Robot, floor: Floor, gait: &Gait, omega_rad_s: f64) -> GaitMetrics {
    let period_s = TAU / omega_rad_s;
    let steps = MIN_STEPS_PER_CYCLE.max((period_s / MAX_STEP_S).ceil() as usize);
    let mut state = Vector3::zeros();
    let mut last = GaitMetrics::MISSING;
    for _ in 0..MAX_CYCLES {
        let (end, metrics) = cycle(robot, floor, gait, omega_rad_s, state, steps);
        if (metrics.d_m / last.d_m - 1.0).abs() < SETTLED {
            return metrics;
        }
        state = end;
        last = metrics;
    }
    panic!("not steady after {MAX_CYCLES} cycles at {omega_rad_s} rad/s")
}

/// Integrates one cycle from phase 0; returns the final state and the metrics of the cycle.
fn cycle(
    robot: &Robot,
    floor: Floor,
    gait: &Gait,
    omega_rad_s: f64,
    start: Vector3<f64>,
    steps: usize,
) -> (Vector3<f64>, GaitMetrics) {
    let step_s = TAU / omega_rad_s / steps as f64;
    let skid_velocities = |time_s: f64, state: &Vector3<f64>| {
        let links = links(robot, &Joints::at(gait, omega_rad_s, time_s));
        links.map(|link| link.wheel_velocities(state)[1])
    };
    // Rates of the pose (x, y, heading), which is integrated with the same Runge-Kutta stages as the velocities.
    let rates = |time_s: f64, state: &Vector3<f64>, heading: f64| {
        let joints = Joints::at(gait, omega_rad_s, time_s);
        let (sin, cos) = heading.sin_cos();
        let pose =
            Vector3::new(cos * state.x - sin * state.y, sin * state.x + cos * state.y, state.z);
        (derivative(robot, floor, &joints, state), pose)
    };
    let mut state = start;
    let mut pose = Vector3::zeros();
    let mut squares = [0.0; 3];
    for i in 0..steps {
        let time_s = i as f64 * step_s;
        // Trapezoidal rule over a whole period.
        for (sum, skid) in squares.iter_mut().zip(skid_velocities(time_s, &state)) {
            *sum += skid * skid / steps as f64;
        }
        let half_s = 0.5 * step_s;
        let (k1, p1) = rates(time_s, &state, pose.z);
        let (k2, p2) = rates(time_s + half_s, &(state + half_s * k1), pose.z + half_s * p1.z);
        let (k3, p3) = rates(time_s + half_s, &(state + half_s * k2), pose.z + half_s * p2.z);
        let (k4, p4) = rates(time_s + step_s, &(state + step_s * k3), pose.z + step_s * p3.z);
        state += step_s / 6.0 * (k1 + 2.0 * (k2 + k3) + k4);
        pose += step_s / 6.0 * (p1 + 2.0 * (p2 + p3) + p4);
    }
    let d_m = pose.xy().norm();
    let metrics = GaitMetrics {
        d_m,
        v_m_s: d_m * omega_rad_s / TAU,
        sigma: padded(&squares.map(|square| square.sqrt() / (robot.skid_length_m() * omega_rad_s))),
        alpha_rad: padded(&[gait.joints[0].map_or(f64::NAN, |joint| joint.amplitude_rad)]),
        dtheta_rad: pose.z,
    };
    (state, metrics)
}

mod tests {
    use trilink_mechanics::{Laws, Problem, REFERENCE_ACCURACY};

    use super::*;

    #[test]
    fn the_solver_and_the_laboratory_agree_on_steady_motions() {
        let robot = Robot { l_m: [0.112, 0.1], h_m: [0.144, 0.15], ..Robot::kinematic() };
        for gait in [Gait::symmetric(), Gait::skewed()] {
            for omega_rad_s in [0.5, 2.0, 6.0] {
                let found = steady_metrics(&robot, Floor::Viscous, &gait, omega_rad_s).to_array();
                let problem = Problem::new(robot.clone(), gait, Laws::SKID_ROLL, omega_rad_s);
                let solved =
                    problem.solve(REFERENCE_ACCURACY).expect("a motion").metrics.to_array();
                for (found, solved) in found.into_iter().zip(solved) {
                    let difference = (found - solved).abs();
                    assert!(
                        difference < 1e-5 * solved.abs() + 1e-9,
                        "{omega_rad_s}: {found} {solved}"
                    );
                }
            }
        }
    }
}
