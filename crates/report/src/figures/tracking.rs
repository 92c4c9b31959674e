//! Figures of a trial's measured motion compared with simulated motions (Figs. 9, 11, 12 and 14 of the paper).

use minijinja::context;
use trilink_base::numbers::with_error;
use trilink_mechanics::{Model, MotionError, Pose, Problem, Sample};
use trilink_plot::{Figure, Layer, Layout, Look, Panel, Range};
use trilink_robot::{AnyGait, AnyRobot, Gait, Quantity, rotated};
use trilink_statistics::wrap;
use trilink_tables::TrialRow;

use super::common::{
    self, DEG, angle, links, links_at_start, map, over_time, shape, time_course, travel,
};
use super::texts::texts;
use super::trial::path_title;
use crate::ReportInput;
use crate::looks;
use crate::recording::{Recording, Shown};
use crate::simulated;
use crate::tables::Tables;

/// Maximum number of gait cycles shown in a figure.
const CYCLES: usize = 4;
/// Factor by which the skid coefficients are multiplied to simulate a robot that hardly skids. This robot replaces one
/// without skid if the latter cannot follow the measured gait, because the gait passes through a singular shape.
const STIFF: f64 = 100.0;
const STIFF_NAME: &str = "skid-roll, 100 c_S, measured elliptic gait";

/// Returns the figure of a trial's measured gait, heading and path, with simulated motions drawn over them.
///
/// The result is `None` if the trial has no cycle in use (cycle that enters the trial means), if the pose at the start
/// of the cycles shown is unknown, or if the campaign is not configured. For each model that has no motion, a sentence
/// is added to `missing`.
pub(super) fn figure(
    stem: &str,
    trial: &TrialRow,
    recording: &Recording,
    (tables, config): (&Tables, &ReportInput),
    missing: &mut Vec<String>,
) -> Option<Figure> {
    let (robot, commanded_gait) = config.setup(&trial.campaign)?;
    let Shown { start_s, end_s, cycles, frames: shown } =
        recording.shown(trial.omega_rad_s, CYCLES)?;
    let start = recording.pose_at(start_s)?;
    let measured = |point: &dyn Fn(usize) -> (f64, f64)| {
        Layer::new("measured", shown.clone().map(point), looks::BENEATH)
    };
    // Positions and headings are relative to the start and to the direction of travel, along which the x axis points.
    let end = recording.pose_at(end_s).unwrap_or(start);
    let travel_rad = (end.y_m - start.y_m).atan2(end.x_m - start.x_m);
    let turned = start.theta_rad - travel_rad;
    let turns_rad = turned - wrap(turned);
    let heading_deg = |theta_rad: f64| DEG * (theta_rad - travel_rad - turns_rad);
    let mut heading =
        vec![measured(&|i| (recording.time_s[i] - start_s, heading_deg(recording.theta_rad[i])))];
    let position = |(x, y): (f64, f64)| {
        let [along, aside] = rotated(-travel_rad, [x - start.x_m, y - start.y_m]);
        (along, aside)
    };
    let seen = |i: usize| position((recording.x_m[i], recording.y_m[i]));
    let first = shown.start.min(recording.time_s.len().saturating_sub(1));
    let at_start: Vec<f64> = recording.phi_rad.iter().map(|phi_rad| phi_rad[first]).collect();
    let at_start: Vec<(f64, f64)> =
        links(&robot, start, &at_start)?.into_iter().map(position).collect();
    // Chains can be longer than their paths and travel with their rear link ahead.
    let beside = if config.is_chain(&trial.campaign) { &at_start[..] } else { &[] };
    let positions = shown.clone().map(seen).filter(|(x, y)| (x + y).is_finite());
    let mut path = vec![
        links_at_start(at_start.iter().copied()),
        travel(&positions.collect::<Vec<_>>(), beside),
        measured(&seen),
    ];
    let mut add = |name: &str, look: Look, poses: Vec<(f64, Pose)>| {
        let courses = poses.iter().map(|(time_s, pose)| (*time_s, heading_deg(pose.theta_rad)));
        heading.push(Layer::new(name, courses, look));
        let positions = poses.iter().map(|(_, pose)| position((pose.x_m, pose.y_m)));
        path.push(Layer::new(name, positions, look));
    };
    let overlays = overlays(stem, trial, (tables, config), missing);
    for Overlay { name, look, cycle, .. } in &overlays {
        add(name, *look, simulated::repeat(cycle, cycles, start));
    }
    let is_stiff = overlays.iter().any(|overlay| overlay.name == STIFF_NAME);
    let is_simulated = !overlays.is_empty();
    let gait = match robot {
        AnyRobot::ThreeLinks(_) => {
            let [phi1, phi2] = recording.phi_rad.as_slice() else { return None };
            let mut gait = vec![measured(&|i| (DEG * phi1[i], DEG * phi2[i]))];
            // The commanded gait is shown only if both joints are commanded.
            let three_links = Gait::from(commanded_gait);
            let is_whole = three_links.passive_joint().is_none();
            gait.extend(is_whole.then(|| commanded(&three_links)));
            let shown = overlays.iter().filter(|of| !is_whole || of.gait != commanded_gait);
            gait.extend(shown.map(|of| Layer::new(&of.name, shape(&of.cycle), of.look)));
            vec![common::gait("Gait", gait)]
        }
        AnyRobot::Chain(_) => {
            let panel = |(joint, phi_rad): (usize, &Vec<f64>)| {
                let symbol = angle(joint);
                let mut layers =
                    vec![measured(&|i| (recording.time_s[i] - start_s, DEG * phi_rad[i]))];
                layers.extend(overlays.iter().map(|Overlay { name, look, cycle, .. }| {
                    let course = over_time(cycle, cycles, |sample| DEG * sample.phi_rad[joint]);
                    Layer::new(name, course, *look)
                }));
                time_course(&format!("Joint angle {symbol}"), &format!("{symbol} (deg)"), layers)
            };
            recording.phi_rad.iter().enumerate().map(panel).collect()
        }
    };
    let d = with_error(1e3 * trial.metrics.d_m, 1e3 * trial.metrics_se.d_m);
    let title = path_title(trial, config);
    let is_chain = config.is_chain(&trial.campaign);
    let TrialRow { trial, campaign, omega_rad_s, .. } = trial;
    let omega = format!("{omega_rad_s:.1}");
    let mut panels = gait;
    panels.extend([
        time_course("Heading θ", "θ (deg)", heading),
        map(format!("{title}, d = {d} mm"), path),
    ]);
    let values = context! { campaign, omega, cycles, trial, is_stiff, is_chain, is_simulated };
    let texts = texts("tracking", values);
    Some(Figure::new(stem, texts, &[campaign], Layout::Pairs, panels))
}

/// Returns the figure of the roll and skid velocities of the wheels (Fig. 12 of the paper); `None` if the trial has no
/// cycle in use (cycle that enters the trial means).
pub(super) fn wheels(
    stem: &str,
    trial: &TrialRow,
    recording: &Recording,
    config: &ReportInput,
) -> Option<Figure> {
    let Shown { start_s, cycles, frames, .. } = recording.shown(trial.omega_rad_s, CYCLES)?;
    let course = |values: &[f64]| {
        let points = frames.clone().map(|i| (recording.time_s[i] - start_s, 1e3 * values[i]));
        points.collect::<Vec<_>>()
    };
    let all = recording.roll_m_s.iter().chain(&recording.skid_m_s).flat_map(|of| course(of));
    let covered = Range::enclosing(all.map(|(_, mm_s)| mm_s));
    let wheels = config.links(&trial.campaign).into_iter().enumerate();
    let wheels = wheels.zip(recording.roll_m_s.iter().zip(&recording.skid_m_s));
    let wheels = wheels.filter(|((number, _), _)| config.has_wheel(&trial.campaign, *number));
    let panels = wheels.map(|((number, link), (roll_m_s, skid_m_s))| {
        let layers = vec![
            Layer::new("roll", course(roll_m_s), looks::ROLL),
            Layer::new("skid", course(skid_m_s), looks::SKID),
        ];
        let title = format!("Wheel {number} ({link})");
        Panel { covered, ..time_course(&title, "Velocity (mm/s)", layers) }
    });
    let TrialRow { trial, campaign, omega_rad_s, smoothing_window, .. } = trial;
    let omega = format!("{omega_rad_s:.1}");
    let values = context! { campaign, omega, cycles, trial, smoothing_window => *smoothing_window };
    Some(Figure::new(stem, texts("wheels", values), &[campaign], Layout::Stack, panels.collect()))
}

/// Returns the sentence that says why a model is not drawn over the measurements of a trial.
fn not_overlaid(stem: &str, name: &str, trial: &TrialRow, error: &MotionError) -> String {
    let figure = super::called(stem);
    let trial = &trial.trial;
    format!("{figure}: model {name} is not drawn over the measurements of trial {trial}: {error}.")
}

/// Returns the layer with the commanded gait as a closed curve in the plane of the two joint angles (deg).
fn commanded(gait: &Gait) -> Layer {
    let points = (0..=simulated::SAMPLES).map(|i| {
        let phase = std::f64::consts::TAU * i as f64 / simulated::SAMPLES as f64;
        let [phi1, phi2] = gait.joints.map(|joint| joint.map_or(0.0, |of| of.derivative(0, phase)));
        (DEG * phi1, DEG * phi2)
    });
    Layer::new("commanded", points, looks::COMMANDED)
}

/// Simulated motion drawn over the measured motion of a trial.
struct Overlay {
    name: String,
    gait: AnyGait,
    look: Look,
    cycle: Vec<Sample>,
}

impl Overlay {
    fn new(name: &str, look: Look, problem: &Problem) -> Result<Self, MotionError> {
        let cycle = simulated::stable_cycle(problem)?;
        Ok(Self { name: name.to_owned(), gait: problem.gait, look, cycle })
    }
}

/// Returns the simulated motions to be drawn over the measured motion of a trial: for a robot of three links those
/// without skid, and that of the preferred fitted model. For each missing motion, a sentence is added to `missing`.
fn overlays(
    stem: &str,
    trial: &TrialRow,
    (tables, config): (&Tables, &ReportInput),
    missing: &mut Vec<String>,
) -> Vec<Overlay> {
    let mut found = match config.is_chain(&trial.campaign) {
        true => Vec::new(),
        false => without_skid(trial, (tables, config)),
    };
    found.extend(tables.preferred(&trial.campaign).and_then(|fit| {
        let name = format!("{}, fitted", fit.model.name());
        let problem = simulated::fitted_to(config, fit, trial)?;
        let solved = Overlay::new(&name, config.look(fit.model).over_recorded(), &problem);
        Some((name, solved))
    }));
    let mut add = |(name, solved): (String, Result<Overlay, MotionError>)| match solved {
        Ok(overlay) => Some(overlay),
        Err(error) => {
            missing.push(not_overlaid(stem, &name, trial, &error));
            None
        }
    };
    found.into_iter().filter_map(&mut add).collect()
}

/// Returns the names and motions without skid for a trial of a robot of three links, with fitted parameters if there is
/// a fit. The second has roll resistance if a joint is passive, and otherwise follows the ellipse fitted to the measured
/// gait (with little skid if no motion without skid exists).
fn without_skid(
    trial: &TrialRow,
    inputs: (&Tables, &ReportInput),
) -> Vec<(String, Result<Overlay, MotionError>)> {
    let line = |model| inputs.1.look(model).line();
    let best_known = |model| {
        let known = simulated::best_known(inputs, &trial.campaign, model, trial.omega_rad_s);
        known.map(|(problem, _)| problem)
    };
    let Some(no_skid) = best_known(Model::NO_SKID) else { return Vec::new() };
    let solve =
        |name: &str, look, problem: &Problem| (name.to_owned(), Overlay::new(name, look, problem));
    let mut found = vec![solve("no-skid", line(Model::NO_SKID), &no_skid)];
    if Gait::from(no_skid.gait).passive_joint().is_some() {
        let model = Model::NO_SKID_ROLL;
        found.extend(best_known(model).map(|of| solve(model.name(), line(model), &of)));
        return found;
    }
    let ellipse = |problem| simulated::under_gait_of(trial, problem);
    let name = "no-skid, measured elliptic gait";
    let of_ellipse = solve(name, line(Model::NO_SKID_MEASURED), &ellipse(no_skid));
    if !matches!(of_ellipse, (_, Err(MotionError::Singular { .. }))) {
        found.push(of_ellipse);
        return found;
    }
    found.extend(best_known(Model::SKID_ROLL).map(|mut problem| {
        for skid in Quantity::Skid.of_each() {
            let value = STIFF * problem.robot.value(skid);
            problem.robot.set(skid, value);
        }
        solve(STIFF_NAME, looks::STIFF, &ellipse(problem))
    }));
    found
}
