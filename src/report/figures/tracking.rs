//! Figs. 9, 11 and 14: one trial as it was tracked, and what models make of its gait.

use super::common::{self, DEG, links, links_at_start, map, time_course, travel};
use super::{SEMI_PASSIVE, SKEWED, SYMMETRIC};
use crate::motion::{Model, Pose, Problem, Sample};
use crate::report::ReportInput;
use crate::report::drawing::{Figure, Layer, Layout, Look};
use crate::report::looks;
use crate::report::numbers::with_error;
use crate::report::recording::{Recording, Shown};
use crate::report::simulated;
use crate::robot::Gait;
use crate::store::TrialRow;

/// Cycles that are shown.
const CYCLES: usize = 4;
/// How much harder skidding is where the measured ellipse meets a singularity: without skid
/// there would be no motion.
const STIFF: f64 = 100.0;

/// A model that is drawn over the recording.
struct Overlay {
    name: &'static str,
    problem: Problem,
    look: Look,
}

/// The figure of a trial of one of the paper's campaigns, and sentences on models that have no
/// motion; `None` without a used cycle.
pub fn figure(
    stem: &str,
    trial: &TrialRow,
    recording: &Recording,
    config: &ReportInput,
) -> (Option<Figure>, Vec<String>) {
    let overlays = overlays(trial, config);
    let Some((robot, commanded_gait)) = config.campaign_setup(&trial.campaign) else {
        return (None, vec![]);
    };
    let Some(window) = recording.shown(trial.omega_rad_s, CYCLES) else { return (None, vec![]) };
    let Shown { start_s, end_s, cycles, frames: shown } = window;
    let Some(start) = recording.pose_at(start_s) else { return (None, vec![]) };
    let measured = |point: &dyn Fn(usize) -> (f64, f64)| {
        Layer::new("measured", shown.clone().map(point), looks::RECORDED)
    };
    let [phi1, phi2] = recording.phi_rad.each_ref();
    let mut gait = vec![measured(&|i| (DEG * phi1[i], DEG * phi2[i]))];
    let mut heading =
        vec![measured(&|i| (recording.time_s[i] - start_s, DEG * recording.theta_rad[i]))];
    let frame = Travel::new(start, recording.pose_at(end_s).unwrap_or(start));
    let position = |i: usize| frame.position((recording.x_m[i], recording.y_m[i]));
    let first = shown.start.min(phi1.len().saturating_sub(1));
    let at_start = links(&robot, start, [phi1[first], phi2[first]]);
    let positions = shown.clone().map(position).filter(|(x, y)| (x + y).is_finite());
    let mut path = vec![
        links_at_start(at_start.into_iter().map(|at| frame.position(at))),
        travel(&positions.collect::<Vec<_>>()),
        measured(&position),
    ];
    let mut missing = Vec::new();
    // What is wholly commanded is shown as such.
    let is_whole = commanded_gait.passive_joint().is_none();
    gait.extend(is_whole.then(|| commanded(&commanded_gait)));
    for Overlay { name, problem, look } in overlays {
        let is_commanded = is_whole && problem.gait == commanded_gait;
        let cycle = match simulated::steady(&problem) {
            Ok(steady) => steady.cycle,
            Err(error) => {
                let figure = super::number(stem);
                missing.push(format!(
                    "{figure}: {name} is not drawn over trial {}: {error}.",
                    trial.trial
                ));
                continue;
            }
        };
        let curve = |points| Layer::new(name, points, look);
        if !is_commanded {
            gait.push(curve(shape(&cycle)));
        }
        let poses = simulated::repeat(&cycle, cycles, start);
        heading.push(curve(poses.iter().map(|(t, pose)| (*t, DEG * pose.theta_rad)).collect()));
        let positions = poses.iter().map(|(_, pose)| frame.position((pose.x_m, pose.y_m)));
        path.push(curve(positions.collect::<Vec<_>>()));
    }
    let d = with_error(1e3 * trial.metrics.d_m, 1e3 * trial.metrics_se.d_m);
    let panels = vec![
        common::gait("Gait", gait),
        time_course("Heading θ", "θ (deg)", heading),
        map(format!("Path of the middle link, d = {d} mm"), path),
    ];
    let figure = Figure {
        caption: format!(
            "{cycles} cycles of trial {}. The simulated motions are steady and start where the \
             measured one does. The map is turned so that the measured path goes along x. Thick: the robot's links at the start; arrow: direction of \
             travel; d: mean over the trial's used cycles with its standard error.",
            trial.trial
        ),
        layout: Layout::Pairs,
        ..Figure::new(
            stem,
            format!(
                "Measured and simulated motion of campaign {}, {:.1} rad/s",
                trial.campaign, trial.omega_rad_s
            ),
            &[&trial.campaign],
            panels,
        )
    };
    (Some(figure), missing)
}

fn shape(cycle: &[Sample]) -> Vec<(f64, f64)> {
    cycle.iter().map(|sample| (DEG * sample.phi_rad[0], DEG * sample.phi_rad[1])).collect()
}

/// The loop that both joints were commanded.
fn commanded(gait: &Gait) -> Layer {
    let points = (0..=simulated::SAMPLES).map(|i| {
        let phase = std::f64::consts::TAU * i as f64 / simulated::SAMPLES as f64;
        let [phi1, phi2] = gait.at(phase, 1.0).phi_rad;
        (DEG * phi1, DEG * phi2)
    });
    Layer::new("commanded", points, looks::COMMANDED)
}

/// A frame that starts where the motion does, with x along its travel.
struct Travel {
    start: Pose,
    along: (f64, f64),
}

impl Travel {
    fn new(start: Pose, end: Pose) -> Self {
        let (x, y) = (end.x_m - start.x_m, end.y_m - start.y_m);
        let length = x.hypot(y);
        let along = if length > 0.0 { (x / length, y / length) } else { (1.0, 0.0) };
        Self { start, along }
    }

    fn position(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let (x, y) = (x - self.start.x_m, y - self.start.y_m);
        let (cos, sin) = self.along;
        (cos * x + sin * y, cos * y - sin * x)
    }
}

/// What the paper draws over its campaigns' trials.
fn overlays(trial: &TrialRow, config: &ReportInput) -> Vec<Overlay> {
    let of = |model| simulated::configured(config, &trial.campaign, model, trial.omega_rad_s);
    let plain = |name, model: Model| {
        let problem = of(model)?;
        Some(Overlay { name, problem, look: looks::model_line(model) })
    };
    let driven_by_measured = |model| {
        let mut problem: Problem = of(model)?;
        // The ellipse that fits the measured gait best.
        problem.gait.joints = trial.gait.map(|joint| Some(joint.command()));
        Some(problem)
    };
    let overlays = match trial.campaign.as_str() {
        SKEWED => [
            plain("no-skid", Model::NoSkid),
            driven_by_measured(Model::NoSkid).map(|problem| Overlay {
                name: "no-skid, measured ellipse",
                problem,
                look: looks::model_line(Model::NoSkidMeasured),
            }),
        ],
        SYMMETRIC => [
            plain("no-skid", Model::NoSkid),
            driven_by_measured(Model::SkidRoll).map(|mut problem| {
                problem.robot.skid_kg_s = problem.robot.skid_kg_s.map(|skid| STIFF * skid);
                Overlay {
                    name: "skid-roll, measured ellipse, 100 times the skid coefficients",
                    problem,
                    look: looks::model_line(Model::SkidRoll),
                }
            }),
        ],
        SEMI_PASSIVE => [plain("no-skid", Model::NoSkid), plain("no-skid-roll", Model::NoSkidRoll)],
        _ => [None, None],
    };
    overlays.into_iter().flatten().collect()
}
