//! Figures of a trial's measured motion compared with simulated motions (Figs. 9, 11, 12 and 14 of the paper).

use minijinja::context;
use trilink_base::numbers::with_error;
use trilink_mechanics::{ChainSample, FIT_ACCURACY, Model, MotionError, Pose, Problem, Sample};
use trilink_plot::{Figure, Layer, Layout, Look, Panel, Range};
use trilink_robot::{Gait, rotated};
use trilink_statistics::wrap;
use trilink_tables::TrialRow;

use super::common::{self, DEG, angle, links_at_start, links_of, map, shape, time_course, travel};
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
    let (robot, _) = config.setup(&trial.campaign)?;
    let three_links = config.campaign_setup(&trial.campaign);
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
    let at_start = links_of(&robot, start, &at_start)?;
    let positions = shown.clone().map(seen).filter(|(x, y)| (x + y).is_finite());
    let mut path = vec![
        links_at_start(at_start.into_iter().map(position)),
        travel(&positions.collect::<Vec<_>>()),
        measured(&seen),
    ];
    let mut add = |name: &str, look: Look, poses: Vec<(f64, Pose)>| {
        let courses = poses.iter().map(|(time_s, pose)| (*time_s, heading_deg(pose.theta_rad)));
        heading.push(Layer::new(name, courses, look));
        let positions = poses.iter().map(|(_, pose)| position((pose.x_m, pose.y_m)));
        path.push(Layer::new(name, positions, look));
    };
    let mut is_stiff = false;
    let mut is_simulated = true;
    let gait = match three_links {
        Some((_, commanded_gait)) => {
            let [phi1, phi2] = recording.phi_rad.as_slice() else { return None };
            let mut gait = vec![measured(&|i| (DEG * phi1[i], DEG * phi2[i]))];
            // The commanded gait is shown only if both joints are commanded.
            let is_whole = commanded_gait.passive_joint().is_none();
            gait.extend(is_whole.then(|| commanded(&commanded_gait)));
            let overlays = overlays(stem, trial, (tables, config), missing);
            is_stiff = overlays.iter().any(|overlay| overlay.name == STIFF_NAME);
            for Overlay { name, problem, look, cycle } in overlays {
                let is_commanded = is_whole && problem.gait == commanded_gait;
                if !is_commanded {
                    gait.push(Layer::new(&name, shape(&cycle), look));
                }
                add(&name, look, simulated::repeat(&cycle, cycles, start));
            }
            vec![common::gait("Gait", gait)]
        }
        None => {
            let mut joints: Vec<Vec<Layer>> = recording
                .phi_rad
                .iter()
                .map(|phi_rad| {
                    vec![measured(&|i| (recording.time_s[i] - start_s, DEG * phi_rad[i]))]
                })
                .collect();
            let overlay = chain_overlay(stem, trial, (tables, config), missing);
            is_simulated = overlay.is_some();
            if let Some((name, look, cycle)) = overlay {
                for (joint, layers) in joints.iter_mut().enumerate() {
                    let course = repeated_angle(&cycle, cycles, joint);
                    layers.push(Layer::new(&name, course, look));
                }
                add(&name, look, simulated::repeat(&cycle, cycles, start));
            }
            let panel = |(joint, layers)| {
                let symbol = angle(joint);
                time_course(&format!("Joint angle {symbol}"), &format!("{symbol} (deg)"), layers)
            };
            joints.into_iter().enumerate().map(panel).collect()
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

/// Returns the name and look of the preferred fitted model of a chain, with a cycle of its motion under the conditions of
/// a trial; `None` if there is no such model. If the model has no motion, a sentence is added to `missing`.
fn chain_overlay(
    stem: &str,
    trial: &TrialRow,
    (tables, config): (&Tables, &ReportInput),
    missing: &mut Vec<String>,
) -> Option<(String, Look, Vec<ChainSample>)> {
    let fit = tables.preferred(&trial.campaign)?;
    let problem = simulated::chain_fitted_to(config, fit, trial)?;
    let name = format!("{}, fitted", fit.model.name());
    match problem.cycle(FIT_ACCURACY, simulated::SAMPLES) {
        Ok(cycle) => Some((name, config.look(fit.model).over_recorded(), cycle)),
        Err(error) => {
            missing.push(not_overlaid(stem, &name, trial, &error));
            None
        }
    }
}

/// Returns the sentence that says why a model is not drawn over the measurements of a trial.
fn not_overlaid(stem: &str, name: &str, trial: &TrialRow, error: &MotionError) -> String {
    let figure = super::called(stem);
    let trial = &trial.trial;
    format!("{figure}: model {name} is not drawn over the measurements of trial {trial}: {error}.")
}

/// Returns the time course of a joint's angle (deg) for a cycle that is repeated `cycles` times.
fn repeated_angle(cycle: &[ChainSample], cycles: usize, joint: usize) -> Vec<(f64, f64)> {
    let period_s = cycle.last().map_or(0.0, |last| last.time_s);
    let repeated = (0..cycles).flat_map(|nth| cycle.iter().map(move |sample| (nth, sample)));
    repeated
        .map(|(nth, sample)| {
            let phi_rad = sample.phi_rad.get(joint).copied().unwrap_or(f64::NAN);
            (nth as f64 * period_s + sample.time_s, DEG * phi_rad)
        })
        .collect()
}

/// Returns the layer with the commanded gait as a closed curve in the plane of the two joint angles (deg).
fn commanded(gait: &Gait) -> Layer {
    let points = (0..=simulated::SAMPLES).map(|i| {
        let phase = std::f64::consts::TAU * i as f64 / simulated::SAMPLES as f64;
        let [phi1, phi2] = gait.at(phase, 1.0).phi_rad;
        (DEG * phi1, DEG * phi2)
    });
    Layer::new("commanded", points, looks::COMMANDED)
}

/// Simulated motion drawn over the measured motion of a trial.
struct Overlay {
    name: String,
    problem: Problem,
    look: Look,
    cycle: Vec<Sample>,
}

/// Returns the simulated motions to be drawn over the measured motion of a trial.
///
/// The first two are motions without skid, with fitted parameters if there is a fit; the second has roll resistance if
/// a joint is passive, and otherwise follows the ellipse fitted to the measured gait (with little skid if no motion
/// without skid exists). The last is that of the preferred fitted model. For each missing motion, a sentence is added to
/// `missing`.
fn overlays(
    stem: &str,
    trial: &TrialRow,
    (tables, config): (&Tables, &ReportInput),
    missing: &mut Vec<String>,
) -> Vec<Overlay> {
    let line = |model| config.look(model).line();
    let solve = |name: &str, look: Look, problem: Problem| {
        let cycle = simulated::stable_cycle(&problem);
        cycle.map(|cycle| Overlay { name: name.to_owned(), problem, look, cycle })
    };
    let mut found = Vec::new();
    let mut add = |name: &str, solved: Result<Overlay, MotionError>| match solved {
        Ok(overlay) => found.push(overlay),
        Err(error) => missing.push(not_overlaid(stem, name, trial, &error)),
    };
    let best_known = |model| {
        let inputs = (tables, config);
        let known = simulated::best_known(inputs, &trial.campaign, model, trial.omega_rad_s);
        known.map(|(problem, _)| problem)
    };
    let Some(no_skid) = best_known(Model::NO_SKID) else { return found };
    let is_passive = no_skid.gait.passive_joint().is_some();
    let ellipse = |problem| simulated::under_gait_of(trial, problem);
    let of_ellipse = ellipse(no_skid.clone());
    add("no-skid", solve("no-skid", line(Model::NO_SKID), no_skid));
    let (name, solved) = if is_passive {
        let model = Model::NO_SKID_ROLL;
        let name = Model::NO_SKID_ROLL.name();
        (name, best_known(model).map(|of| solve(name, line(model), of)))
    } else {
        let name = "no-skid, measured elliptic gait";
        match solve(name, line(Model::NO_SKID_MEASURED), of_ellipse) {
            Err(MotionError::Singular { .. }) => {
                let name = STIFF_NAME;
                (
                    name,
                    best_known(Model::SKID_ROLL).map(|mut problem| {
                        problem.robot.skid_kg_s = problem.robot.skid_kg_s.map(|skid| STIFF * skid);
                        solve(name, looks::STIFF, ellipse(problem))
                    }),
                )
            }
            solved => (name, Some(solved)),
        }
    };
    solved.into_iter().for_each(|solved| add(name, solved));
    let preferred = tables.preferred(&trial.campaign).and_then(|fit| {
        let name = format!("{}, fitted", fit.model.name());
        let problem = simulated::fitted_to(config, fit, trial)?;
        Some((solve(&name, config.look(fit.model).over_recorded(), problem), name))
    });
    preferred.into_iter().for_each(|(solved, name)| add(&name, solved));
    found
}
