//! Figs. 3 to 6: the semi-passive robot without skid and the kinematic one that skids, simulated.

use rayon::prelude::*;

use super::common::{
    DEG, FREQUENCY, gait, lines, links, links_at_start, map, over_time, shape, time_course, travel,
};
use super::{SEMI_PASSIVE, SYMMETRIC};
use crate::config::Config;
use crate::metrics::GaitMetrics;
use crate::motion::{Model, MotionError, Pose, Problem, REFERENCE_ACCURACY, Sample, Solver};
use crate::report::ReportInput;
use crate::report::drawing::{Figure, Layer, Layout, Look, Panel};
use crate::report::looks;
use crate::report::series::{Description, Quantity};
use crate::report::simulated::{self, SAMPLES, Steady};

const OMEGA_RAD_S: f64 = 4.0;
/// The model of the robot that skids.
const SKIDDING: Model = Model::SkidRoll;
/// Cycles that are shown of the steady motion.
const CYCLES: usize = 2;
const PATH_CYCLES: usize = 3;
/// Most cycles that are shown from rest.
const MOST_FROM_REST: usize = 40;
/// Frequencies of the sweep, rad/s.
const SWEEP: (f64, f64, usize) = (0.5, 8.0, 61);
const NO_SKID: Look = looks::model_line(Model::NoSkid);

/// Figs. 3, 4 and 5, or a sentence on why there are none.
pub fn steady_passive(config: &ReportInput) -> Result<Vec<Figure>, String> {
    // The paper's own robot with the joint of its simulations, any other as it is.
    let joint_of = |setup: Config| Some(setup.campaign_setup(SEMI_PASSIVE)?.0);
    let [default, simulated] = [Config::default(), Config::of_simulations()].map(joint_of);
    let of = |omega_rad_s| {
        let mut problem = simulated::configured(config, SEMI_PASSIVE, Model::NoSkid, omega_rad_s)?;
        if default.as_ref() == Some(&problem.robot) {
            problem.robot = simulated.clone()?;
        }
        Some(problem)
    };
    let problem = of(OMEGA_RAD_S).ok_or_else(|| {
        format!("Figs. 3 to 5 are not drawn, because campaign {SEMI_PASSIVE} is not configured.")
    })?;
    let no_motion = |error: MotionError| {
        format!(
            "Figs. 3 and 4 are not drawn, because there is no motion at {OMEGA_RAD_S} rad/s: {error}."
        )
    };
    let steady = simulated::steady(&problem).map_err(no_motion)?;
    Ok(vec![
        time_courses(&problem, &steady.cycle),
        gait_and_path(&problem, &steady).map_err(no_motion)?,
        sweep(of),
    ])
}

fn time_courses(problem: &Problem, cycle: &[Sample]) -> Figure {
    let joints = lines(["φ₁", "φ₂"], |i| over_time(cycle, CYCLES, |s| DEG * s.phi_rad[i]));
    let velocities = lines(["dx/dt", "dy/dt", "h dθ/dt"], |i| {
        let factor = if i == 2 { problem.robot.h_m } else { 1.0 };
        over_time(cycle, CYCLES, |sample| 1e3 * factor * sample.rates[i])
    });
    let mut forces =
        lines(["λ₀", "λ₁", "λ₂"], |i| over_time(cycle, CYCLES, |s| s.forces.lateral_n[i]));
    let difference = over_time(cycle, CYCLES, |sample| sample.phi_rad[0] - sample.phi_rad[1]);
    let crossings = crossings(&difference).into_iter().map(|time_s| (time_s, f64::NAN));
    forces.push(Layer::new("φ₁ = φ₂", crossings, Look::Guides));
    Figure::new(
        "fig03",
        format!("Simulated motion of campaign {SEMI_PASSIVE}, no-skid, {OMEGA_RAD_S} rad/s"),
        "Without skid and roll resistance, as configured, in steady motion. Dashed uprights: \
         φ₁ = φ₂, where the kinematic robot would be singular.",
        &[SEMI_PASSIVE],
        Layout::Stack,
        vec![
            time_course("Joint angles", "Angle (deg)", joints),
            time_course("Middle link", "Velocity (mm/s)", velocities),
            time_course("Constraint forces", "Force (N)", forces),
        ],
    )
}

/// Fig. 6: the kinematic robot that skids, or a sentence on why there is none.
pub fn skidding(config: &ReportInput) -> Result<Figure, String> {
    let none = |why: String| format!("Fig. 6 is not drawn, because {why}.");
    let problem = simulated::configured(config, SYMMETRIC, SKIDDING, OMEGA_RAD_S)
        .ok_or_else(|| none(format!("campaign {SYMMETRIC} is not configured")))?;
    let Steady { metrics, cycle, .. } = simulated::steady(&problem)
        .map_err(|error| none(format!("there is no motion at {OMEGA_RAD_S} rad/s: {error}")))?;
    let wheels = |of: fn(&Sample, usize) -> f64| {
        lines(["wheel 0", "wheel 1", "wheel 2"], |i| over_time(&cycle, 1, |sample| of(sample, i)))
    };
    let joints =
        lines(["φ₁", "φ₂"], |i| over_time(&cycle, 1, |sample| DEG * sample.phi_rad[i]));
    let most_n = |of: fn(&Sample) -> [f64; 3]| {
        cycle.iter().flat_map(of).fold(0.0, |most: f64, force| most.max(force.abs()))
    };
    let forces = wheels(|sample, i| sample.forces.lateral_n[i]);
    let skid = wheels(|sample, i| 1e3 * sample.skid_m_s[i]);
    Ok(Figure::new(
        "fig06",
        format!("Simulated motion of campaign {SYMMETRIC}, {SKIDDING}, {OMEGA_RAD_S} rad/s"),
        format!(
            "With the robot's configured coefficients, in steady motion; mean forward speed {:.1} \
             mm/s. Wheels 0, 1, 2: middle, front, rear. The forces are those across the wheels; \
             along them roll resistance stays below {:.2} N.",
            1e3 * metrics.v_m_s,
            most_n(|sample| sample.forces.roll_n),
        ),
        &[SYMMETRIC],
        Layout::Stack,
        vec![
            time_course("Joint angles", "Angle (deg)", joints),
            time_course("Ground forces", "Force (N)", forces),
            time_course("Skid speeds", "Skid speed (mm/s)", skid),
        ],
    ))
}

/// Where a line crosses zero.
fn crossings(line: &[(f64, f64)]) -> Vec<f64> {
    let pairs = line.windows(2).filter(|pair| (pair[0].1 < 0.0) != (pair[1].1 < 0.0));
    pairs
        .map(|pair| {
            let [(x0, y0), (x1, y1)] = [pair[0], pair[1]];
            x0 + (x1 - x0) * y0 / (y0 - y1)
        })
        .collect()
}

fn gait_and_path(problem: &Problem, steady: &Steady) -> Result<Figure, MotionError> {
    let (cycle, d_m) = (steady.cycle.as_slice(), steady.metrics.d_m);
    let cycles = steady.cycles_to_settle.unwrap_or(MOST_FROM_REST).clamp(1, MOST_FROM_REST);
    let from_rest = problem.cycles_from_rest(cycles, SAMPLES)?;
    let steady = |points| Layer::new("no-skid, steady", points, NO_SKID);
    let from_rest = Layer::new("from rest", shape(&from_rest), looks::TRANSIENT);
    let gait = gait("Gait from rest", vec![from_rest, steady(shape(cycle))]);
    let path = simulated::repeat(cycle, PATH_CYCLES, Pose::default());
    let path: Vec<_> = path.iter().map(|(_, pose)| (pose.x_m, pose.y_m)).collect();
    let arrow = travel(&path);
    let start = links_at_start(links(&problem.robot, cycle[0].pose, cycle[0].phi_rad));
    let title = format!("Path of the middle link, d = {:.1} mm", 1e3 * d_m);
    Ok(Figure::new(
        "fig04",
        format!("Simulated gait and path of campaign {SEMI_PASSIVE}, no-skid, {OMEGA_RAD_S} rad/s"),
        format!(
            "As Fig. 3. From rest the motion comes within 1 % of the steady one after {cycles} \
             cycles. The path is {PATH_CYCLES} cycles of the steady motion; thick: the robot's \
             links at their start; arrow: direction of travel."
        ),
        &[SEMI_PASSIVE],
        Layout::Pairs,
        vec![gait, map(title, vec![steady(path), start, arrow])],
    ))
}

fn sweep(of: impl Fn(f64) -> Option<Problem> + Sync) -> Figure {
    let (low, high, count) = SWEEP;
    let solve = |i: usize| {
        let omega_rad_s = low + (high - low) * i as f64 / (count - 1) as f64;
        let settled = of(omega_rad_s)
            .and_then(|problem| Solver::default().settle(&problem, REFERENCE_ACCURACY).ok());
        (omega_rad_s, settled.map_or(GaitMetrics::MISSING, |settled| settled.motion.metrics))
    };
    let points: Vec<(f64, GaitMetrics)> = (0..count).into_par_iter().map(solve).collect();
    let panel = |quantity: Quantity| {
        let Description { title, axis_label, unit, .. } = quantity.description();
        let points: Vec<(f64, f64)> = points
            .iter()
            .map(|(omega_rad_s, metrics)| (*omega_rad_s, quantity.of(metrics)))
            .collect();
        let largest = largest(&points);
        let said = largest.map(|(x, y)| format!(", largest {y:.1}{unit} at {x:.2} rad/s"));
        let layers = vec![
            Layer::new("no-skid", points, NO_SKID),
            Layer::new("largest", largest, Look::Rings),
        ];
        Panel::new(title.to_owned() + &said.unwrap_or_default(), FREQUENCY, axis_label, layers)
    };
    Figure::new(
        "fig05",
        format!("Simulated displacement and speed of campaign {SEMI_PASSIVE}, no-skid"),
        "The steady motion that the robot reaches from rest, without skid and roll resistance, as \
         configured. Open circles: the largest values between the ends.",
        &[SEMI_PASSIVE],
        Layout::Stack,
        [Quantity::Displacement, Quantity::Speed].map(panel).into(),
    )
}

/// The largest value of a line that has values on both sides of it, by a parabola through the
/// three points there.
fn largest(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let inside =
        points.windows(3).filter(|three| three[1].1 >= three[0].1 && three[1].1 >= three[2].1);
    let three = inside.max_by(|a, b| a[1].1.total_cmp(&b[1].1))?;
    let [(x0, y0), (x1, y1), (x2, y2)] = [three[0], three[1], three[2]];
    let (slope, bend) = ((y2 - y0) / 2.0, y2 - 2.0 * y1 + y0);
    let shift = if bend < 0.0 { -slope / bend } else { 0.0 };
    Some((x1 + shift * (x2 - x0) / 2.0, y1 + 0.5 * slope * shift))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_value_is_found_between_the_points_and_not_at_an_end() {
        let parabola = |x: f64| (x, 3.0 - (x - 1.3).powi(2));
        let (x, y) = largest(&[0.0, 1.0, 2.0, 3.0].map(parabola)).expect("there is one");
        assert!((x - 1.3).abs() < 1e-12 && (y - 3.0).abs() < 1e-12);
        assert_eq!(largest(&[(0.0, 3.0), (1.0, 2.0), (2.0, 1.0)]), None);
    }

    #[test]
    fn crossings_of_zero_lie_between_the_points_around_them() {
        assert_eq!(crossings(&[(0.0, 1.0), (1.0, -1.0), (2.0, -3.0), (3.0, 1.0)]), [0.5, 2.75]);
    }
}
