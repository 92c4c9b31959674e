//! Figs. 9, 11, 12 and 14: one trial as it was tracked, and what models make of its gait.

use super::common::{self, DEG, links, links_at_start, map, shape, time_course, travel};
use super::{SEMI_PASSIVE, SKEWED, SYMMETRIC};
use crate::motion::{Model, Problem};
use crate::report::ReportInput;
use crate::report::drawing::{Figure, Layer, Layout, Look};
use crate::report::looks;
use crate::report::numbers::with_error;
use crate::report::recording::{Recording, Shown};
use crate::report::simulated;
use crate::robot::{Gait, rotated};
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

/// The figure of a trial of one of the paper's campaigns; `None` without a used cycle. Adds
/// sentences on models that have no motion.
pub fn figure(
    stem: &str,
    trial: &TrialRow,
    recording: &Recording,
    config: &ReportInput,
    missing: &mut Vec<String>,
) -> Option<Figure> {
    let (robot, commanded_gait) = config.campaign_setup(&trial.campaign)?;
    let Shown { start_s, end_s, cycles, frames: shown } =
        recording.shown(trial.omega_rad_s, CYCLES)?;
    let start = recording.pose_at(start_s)?;
    let measured = |point: &dyn Fn(usize) -> (f64, f64)| {
        Layer::new("measured", shown.clone().map(point), looks::RECORDED)
    };
    let [phi1, phi2] = recording.phi_rad.each_ref();
    let mut gait = vec![measured(&|i| (DEG * phi1[i], DEG * phi2[i]))];
    let mut heading =
        vec![measured(&|i| (recording.time_s[i] - start_s, DEG * recording.theta_rad[i]))];
    // In a frame that starts where the motion does, with x along its travel.
    let end = recording.pose_at(end_s).unwrap_or(start);
    let travel_rad = (end.y_m - start.y_m).atan2(end.x_m - start.x_m);
    let position = |(x, y): (f64, f64)| {
        let [along, aside] = rotated(-travel_rad, [x - start.x_m, y - start.y_m]);
        (along, aside)
    };
    let seen = |i: usize| position((recording.x_m[i], recording.y_m[i]));
    let first = shown.start.min(phi1.len().saturating_sub(1));
    let at_start = links(&robot, start, [phi1[first], phi2[first]]);
    let positions = shown.clone().map(seen).filter(|(x, y)| (x + y).is_finite());
    let mut path = vec![
        links_at_start(at_start.into_iter().map(position)),
        travel(&positions.collect::<Vec<_>>()),
        measured(&seen),
    ];
    // What is wholly commanded is shown as such.
    let is_whole = commanded_gait.passive_joint().is_none();
    gait.extend(is_whole.then(|| commanded(&commanded_gait)));
    for Overlay { name, problem, look } in overlays(trial, config) {
        let is_commanded = is_whole && problem.gait == commanded_gait;
        let cycle = match simulated::steady(&problem) {
            Ok(steady) => steady.cycle,
            Err(error) => {
                let (figure, trial) = (super::number(stem), &trial.trial);
                missing.push(format!("{figure}: {name} is not drawn over trial {trial}: {error}."));
                continue;
            }
        };
        let curve = |points: Vec<(f64, f64)>| Layer::new(name, points, look);
        if !is_commanded {
            gait.push(curve(shape(&cycle)));
        }
        let poses = simulated::repeat(&cycle, cycles, start);
        heading.push(curve(poses.iter().map(|(t, pose)| (*t, DEG * pose.theta_rad)).collect()));
        let positions = poses.iter().map(|(_, pose)| position((pose.x_m, pose.y_m)));
        path.push(curve(positions.collect()));
    }
    let d = with_error(1e3 * trial.metrics.d_m, 1e3 * trial.metrics_se.d_m);
    let TrialRow { trial, campaign, omega_rad_s, .. } = trial;
    Some(Figure::new(
        stem,
        format!("Measured and simulated motion of campaign {campaign}, {omega_rad_s:.1} rad/s"),
        format!(
            "{cycles} cycles of trial {trial}. The simulated motions are steady and start where \
             the measured one does. The map is turned so that the measured path goes along x. \
             Thick: the robot's links at the start; arrow: direction of travel; d: mean over the \
             trial's used cycles with its standard error."
        ),
        &[campaign],
        Layout::Pairs,
        vec![
            common::gait("Gait", gait),
            time_course("Heading θ", "θ (deg)", heading),
            map(format!("Path of the middle link, d = {d} mm"), path),
        ],
    ))
}

/// Fig. 12: how the wheels rolled and skidded; `None` without a used cycle.
pub fn wheels(stem: &str, trial: &TrialRow, recording: &Recording) -> Option<Figure> {
    let Shown { start_s, cycles, frames, .. } = recording.shown(trial.omega_rad_s, CYCLES)?;
    let panel = |title: String, y_label: &str, values: &[f64]| {
        let points = frames.clone().map(|i| (recording.time_s[i] - start_s, 1e3 * values[i]));
        time_course(&title, y_label, vec![Layer::new("measured", points, looks::RECORDED)])
    };
    let panels = ["wheel 0 (middle)", "wheel 1 (front)", "wheel 2 (rear)"]
        .iter()
        .enumerate()
        .flat_map(|(i, wheel)| {
            let [roll_m_s, skid_m_s] = [&recording.roll_m_s[i], &recording.skid_m_s[i]];
            [
                panel(format!("Roll velocity of {wheel}"), "Roll (mm/s)", roll_m_s),
                panel(format!("Skid velocity of {wheel}"), "Skid (mm/s)", skid_m_s),
            ]
        });
    let TrialRow { trial, campaign, omega_rad_s, smoothing_window, .. } = trial;
    Some(Figure::new(
        stem,
        format!(
            "Roll and skid velocities of the wheels, campaign {campaign}, {omega_rad_s:.1} rad/s"
        ),
        format!(
            "{cycles} cycles of trial {trial}, smoothed by a moving average over \
             {smoothing_window} samples."
        ),
        &[campaign],
        Layout::Pairs,
        panels.collect(),
    ))
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

/// What the paper draws over its campaigns' trials.
fn overlays(trial: &TrialRow, config: &ReportInput) -> Vec<Overlay> {
    use Model::{NoSkid, NoSkidMeasured, NoSkidRoll, SkidRoll};
    type Change = fn(&mut Problem, &TrialRow);
    const AS_CONFIGURED: Change = |_, _| ();
    /// The ellipse that fits the measured gait best.
    const MEASURED: Change = |problem, trial| {
        problem.gait.joints = trial.gait.map(|joint| Some(joint.command()));
    };
    const STIFF_MEASURED: Change = |problem, trial| {
        MEASURED(problem, trial);
        problem.robot.skid_kg_s = problem.robot.skid_kg_s.map(|skid| STIFF * skid);
    };
    let overlay = |name, model, shown_as, change: Change| {
        let mut problem = simulated::configured(config, &trial.campaign, model, trial.omega_rad_s)?;
        change(&mut problem, trial);
        Some(Overlay { name, problem, look: looks::model_line(shown_as) })
    };
    let no_skid = overlay("no-skid", NoSkid, NoSkid, AS_CONFIGURED);
    let other = match trial.campaign.as_str() {
        SKEWED => overlay("no-skid, measured ellipse", NoSkid, NoSkidMeasured, MEASURED),
        SYMMETRIC => overlay(
            "skid-roll, measured ellipse, 100 times the skid coefficients",
            SkidRoll,
            SkidRoll,
            STIFF_MEASURED,
        ),
        SEMI_PASSIVE => overlay("no-skid-roll", NoSkidRoll, NoSkidRoll, AS_CONFIGURED),
        _ => return Vec::new(),
    };
    no_skid.into_iter().chain(other).collect()
}
