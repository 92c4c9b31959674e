//! Figures of simulated motions (Figs. 3 to 6 of the paper): a robot with a passive joint and no skid, a fully actuated
//! robot with skid, and chains with the preferred model.

use minijinja::context;
use rayon::prelude::*;
use trilink_mechanics::{FIT_ACCURACY, Model, MotionError, Pose, Problem, Sample};
use trilink_plot::{Figure, Layer, Layout, Look, Panel, number};
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_robot::{Gait, Robot};
use trilink_statistics::extremes;
use trilink_tables::config::{Config, Models};

use super::common::{
    DEG, FREQUENCY, angle, gait, lines, link_noun, links, links_at_start, map, over_time, shape,
    time_course, travel, wheels,
};
use super::texts::texts;
use super::{SEMI_PASSIVE, not_drawn};
use crate::ReportInput;
use crate::looks::{self, ModelLook};
use crate::series::{DISPLACEMENT, Quantity, SPEED};
use crate::simulated::{self, OMEGAS_RAD_S, SAMPLES, Steady};
use crate::tables::Tables;

/// Model with which the robot with skid is simulated.
const SKIDDING: Model = Model::SKID_ROLL;
/// Number of steady-state cycles in the time courses.
const CYCLES: usize = 2;
/// Number of steady-state cycles in the plotted path.
const PATH_CYCLES: usize = 3;
/// Maximum number of cycles shown for a motion from rest.
const MAX_FROM_REST: usize = 40;
/// Number of frequencies of the frequency sweep.
const FREQUENCIES: i32 = 91;
/// Factor by which the frequency sweep extends beyond the trials on both sides.
const MARGIN: f64 = 1.5;

/// Frequencies for which the motion of a campaign is simulated.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Frequencies {
    /// Frequency of time courses, rad/s.
    shown_rad_s: f64,
    /// First and last frequency of the frequency sweep, rad/s.
    sweep_rad_s: [f64; 2],
}

impl Frequencies {
    /// Frequencies of robots with three links, which are those of the paper, and of campaigns without trials.
    const DEFAULT: Self = Self { shown_rad_s: 4.0, sweep_rad_s: [0.5, 8.0] };

    /// Returns the frequencies for a campaign of a chain, which are in the range of its trials.
    fn of_chain(campaign: &str, (tables, input): (&Tables, &ReportInput)) -> Self {
        let trials = tables.source(input).measured_trials(campaign).map(|trial| trial.omega_rad_s);
        let [low, high] = extremes(trials.filter(|omega| OMEGAS_RAD_S.contains(omega)));
        if low > high {
            return Self::DEFAULT;
        }
        let nearest_rad_s = Self::DEFAULT.shown_rad_s.clamp(low, high);
        // Captions state the frequency that is simulated, with three digits.
        let shown_rad_s = format!("{nearest_rad_s:.2e}").parse().unwrap_or(nearest_rad_s);
        Self { shown_rad_s, sweep_rad_s: [low / MARGIN, high * MARGIN] }
    }
}

/// Campaign and model whose motion is drawn from rest and over frequency.
struct Shown<'s> {
    campaign: &'s str,
    model: Model,
    look: ModelLook,
    /// Values of the simulation, as the end of a sentence.
    values: String,
    /// First and last frequency of the frequency sweep, rad/s.
    sweep_rad_s: [f64; 2],
    /// Name of link 0.
    link: String,
    /// Joints of a chain whose angles are not commanded; `None` for three links, whose joints are drawn as a gait.
    free_joints: Option<Vec<usize>>,
}

/// Returns the figures of the simulated motion of a robot with a passive joint (Figs. 3, 4 and 5 of the paper), or
/// sentences that explain why they are not drawn.
pub(super) fn passive(
    [courses, from_rest, sweep]: [String; 3],
    campaign: &str,
    (tables, config): (&Tables, &ReportInput),
) -> Vec<Result<Figure, String>> {
    // For the paper's robot, the joint parameters are those of the paper's simulations.
    let [default, simulated] = [Config::default(), Config::of_simulations()]
        .map(|setup| Some(setup.campaign_setup(SEMI_PASSIVE)?.0));
    let is_papers = config.campaign_setup(campaign).map(|(robot, _)| robot) == default;
    let problem_at = |omega_rad_s| {
        let inputs = (tables, config);
        let known = simulated::best_known(inputs, campaign, Model::NO_SKID, omega_rad_s);
        let (mut problem, is_fitted) = known?;
        if is_papers {
            problem.robot = simulated.clone()?.into();
        }
        Some((problem, is_fitted))
    };
    let Frequencies { shown_rad_s, sweep_rad_s } = Frequencies::DEFAULT;
    let problem =
        problem_at(shown_rad_s).ok_or_else(|| format!("campaign {campaign} is not configured"));
    let problem_at = |omega_rad_s| problem_at(omega_rad_s).map(|(problem, _)| problem);
    let with_motion = || -> Result<_, String> {
        let (problem, is_fitted) = problem?;
        let no_motion = |error: MotionError| no_motion(shown_rad_s, &error);
        let steady = simulated::steady(&problem).map_err(no_motion)?;
        let origin = if is_papers {
            "the values of the paper's simulations (Table II); all other values are as configured"
        } else if is_fitted {
            "as in the fit of this model"
        } else {
            "as configured"
        };
        let robot = problem.robot.three_links().ok_or("its robot is a chain")?;
        let joint = values(robot, &problem.gait.into(), origin);
        let named = (campaign, joint.as_str(), shown_rad_s);
        let courses = time_courses(&courses, named, robot, &steady.cycle);
        let shown = Shown {
            campaign,
            model: Model::NO_SKID,
            look: ModelLook::new(Model::NO_SKID, &Models::new()),
            values: format!("without skid and roll resistance, {joint}"),
            sweep_rad_s,
            link: "middle".to_owned(),
            free_joints: None,
        };
        let from_rest = self::from_rest(&from_rest, &shown, &problem, &steady);
        Ok(vec![Ok(courses), from_rest, Ok(self::sweep(&sweep, &shown, problem_at))])
    };
    with_motion().unwrap_or_else(|why| vec![Err(not_drawn(&courses, &why))])
}

/// Describes the values of a simulation without skid; `origin` says where those of the passive joint come from.
fn values(robot: &Robot, gait: &Gait, origin: &str) -> String {
    let Robot { stiffness_nm_rad, damping_nm_s_rad, rest_angle_rad, .. } = robot;
    let [free, driven] =
        if gait.passive_joint() == Some(1) { ["₂", "₁"] } else { ["₁", "₂"] };
    let list = |values: &[f64]| {
        let are_equal = values.windows(2).all(|two| two[0] == two[1]);
        let values = if are_equal { &values[..1] } else { values };
        values.iter().map(|value| number(*value)).collect::<Vec<_>>().join(", ")
    };
    let commands = gait.joints.iter().flatten().map(|command| {
        let offset = if command.offset_rad == 0.0 {
            String::new()
        } else {
            format!(", γ{driven} = {}°", list(&[DEG * command.offset_rad]))
        };
        format!("α{driven} = {}°{offset}", list(&[DEG * command.amplitude_rad]))
    });
    format!(
        "with k_τ = {} N m/rad and c_τ = {} N m s/rad, {origin}: {}, γ{free} = {}°; h = {} m, l = {} m, b = {} m; links 0, 1, 2: m = {} kg, I = {} kg m²",
        number(*stiffness_nm_rad),
        number(*damping_nm_s_rad),
        commands.collect::<Vec<_>>().join(", "),
        list(&[DEG * rest_angle_rad]),
        list(&robot.h_m),
        list(&robot.l_m),
        list(&robot.b_m),
        list(&robot.mass_kg),
        list(&robot.inertia_kg_m2),
    )
}

fn no_motion(omega_rad_s: f64, error: &MotionError) -> String {
    format!("no steady motion was found at {} rad/s: {error}", number(omega_rad_s))
}

/// Returns the panel with the time courses of a quantity's components over a cycle that is repeated `cycles` times.
/// `names` are the names of the components; `of` returns the component with a given index.
fn course(
    (title, y_label): (&str, &str),
    names: &[impl AsRef<str>],
    (cycle, cycles): (&[Sample], usize),
    of: impl Fn(&Sample, usize) -> f64,
) -> Panel {
    let lines = lines(names, |i| over_time(cycle, cycles, |sample| of(sample, i)));
    time_course(title, y_label, lines)
}

/// Panel title and axis label for joint angles.
const JOINTS: (&str, &str) = ("Joint angles", "Angle (deg)");

fn time_courses(
    stem: &str,
    (campaign, joint, omega_rad_s): (&str, &str, f64),
    robot: &Robot,
    cycle: &[Sample],
) -> Figure {
    let shown = (cycle, CYCLES);
    let joints = course(JOINTS, &["φ₁", "φ₂"], shown, |s, i| DEG * s.phi_rad[i]);
    let rates = ["dx/dt", "dy/dt", "h dθ/dt"];
    let velocities = course(("Middle link", "Velocity (mm/s)"), &rates, shown, |sample, i| {
        let factor = if i == 2 { robot.h_m[0] } else { 1.0 };
        1e3 * factor * sample.pose_rates[i]
    });
    let forces = ("Constraint forces", "Force (N)");
    let lambdas = ["λ₀", "λ₁", "λ₂"];
    let mut forces = course(forces, &lambdas, shown, |s, i| s.lateral_n[i]);
    let difference = over_time(cycle, CYCLES, |sample| sample.phi_rad[0] - sample.phi_rad[1]);
    let crossings = crossings(&difference).into_iter().map(|time_s| (time_s, f64::NAN));
    forces.layers.push(Layer::new("φ₁ = φ₂", crossings, Look::Guides));
    let texts = texts("passive", context! { campaign, joint, omega => number(omega_rad_s) });
    let panels = vec![joints, velocities, forces];
    Figure::new(stem, texts, &[campaign], Layout::Stack, panels)
}

/// Returns the figure of the simulated motion of a robot with skid and without a passive joint (Fig. 6 of the paper).
///
/// # Errors
/// Returns a sentence that explains why the figure is not drawn.
pub(super) fn skidding(
    stem: &str,
    campaign: &str,
    inputs: (&Tables, &ReportInput),
) -> Result<Figure, String> {
    let Frequencies { shown_rad_s, .. } = Frequencies::DEFAULT;
    let known = simulated::best_known(inputs, campaign, SKIDDING, shown_rad_s);
    let (problem, is_fitted) =
        known.ok_or_else(|| not_drawn(stem, &format!("campaign {campaign} is not configured")))?;
    let steady = simulated::steady(&problem);
    let steady = steady.map_err(|error| not_drawn(stem, &no_motion(shown_rad_s, &error)))?;
    Ok(joints_and_forces(stem, (campaign, SKIDDING), (&problem, is_fitted), &steady))
}

/// Returns the figures of the simulated motion of a chain with the preferred model of its campaign, the counterparts of
/// Figs. 6, 4 and 5 of the paper, or sentences that explain why they are not drawn.
pub(super) fn of_chain(
    [courses, from_rest, sweep]: [String; 3],
    campaign: &str,
    inputs: (&Tables, &ReportInput),
) -> Vec<Result<Figure, String>> {
    let (tables, config) = inputs;
    let drawn = || -> Result<_, String> {
        let preferred = tables.preferred(campaign).ok_or("the campaign has no preferred model")?;
        let model = preferred.model;
        let known = |omega_rad_s| simulated::best_known(inputs, campaign, model, omega_rad_s);
        let Frequencies { shown_rad_s, sweep_rad_s } = Frequencies::of_chain(campaign, inputs);
        let (problem, is_fitted) =
            known(shown_rad_s).ok_or_else(|| format!("campaign {campaign} is not configured"))?;
        let no_motion = |error: MotionError| no_motion(shown_rad_s, &error);
        let steady = simulated::steady(&problem).map_err(no_motion)?;
        let origin = if is_fitted { "fitted" } else { "configured" };
        let shown = Shown {
            campaign,
            model,
            look: config.look(model),
            values: format!("with the robot's {origin} coefficients"),
            sweep_rad_s,
            link: config.links(campaign).swap_remove(0),
            free_joints: Some(config.free_joints(campaign)),
        };
        let courses =
            joints_and_forces(&courses, (campaign, model), (&problem, is_fitted), &steady);
        let from_rest = self::from_rest(&from_rest, &shown, &problem, &steady);
        let sweep = self::sweep(&sweep, &shown, |omega_rad_s| Some(known(omega_rad_s)?.0));
        Ok(vec![Ok(courses), from_rest, Ok(sweep)])
    };
    drawn().unwrap_or_else(|why| vec![Err(not_drawn(&courses, &why))])
}

fn joints_and_forces(
    stem: &str,
    (campaign, model): (&str, Model),
    (problem, is_fitted): (&Problem, bool),
    Steady { metrics, cycle, .. }: &Steady,
) -> Figure {
    let shown = (cycle.as_slice(), 1);
    let joints: Vec<String> = (0..problem.robot.joints()).map(angle).collect();
    let (numbers, wheels): (Vec<usize>, Vec<String>) = wheels(&problem.robot).into_iter().unzip();
    let forces = ("Ground forces", "Force (N)");
    let skid = ("Skid speeds", "Skid speed (mm/s)");
    let roll_n = cycle.iter().flat_map(|sample| &sample.roll_n);
    let panels = vec![
        course(JOINTS, &joints, shown, |sample, i| DEG * sample.phi_rad[i]),
        course(forces, &wheels, shown, |sample, i| sample.lateral_n[numbers[i]]),
        course(skid, &wheels, shown, |sample, i| 1e3 * sample.skid_m_s[numbers[i]]),
    ];
    let max_n = roll_n.fold(0.0, |max: f64, force| max.max(force.abs()));
    let values = context! {
        campaign,
        model => model.name(),
        is_fitted,
        is_chain => problem.robot.three_links().is_none(),
        omega => number(problem.omega_rad_s),
        v_mm_s => format!("{:.1}", 1e3 * metrics.v_m_s),
        roll_n => format!("{max_n:.2}"),
    };
    Figure::new(stem, texts("skidding", values), &[campaign], Layout::Stack, panels)
}

/// Returns the x coordinates at which a line crosses zero.
fn crossings(line: &[(f64, f64)]) -> Vec<f64> {
    let pairs = line.windows(2).filter(|pair| (pair[0].1 < 0.0) != (pair[1].1 < 0.0));
    pairs
        .map(|pair| {
            let [(x0, y0), (x1, y1)] = [pair[0], pair[1]];
            x0 + (x1 - x0) * y0 / (y0 - y1)
        })
        .collect()
}

/// Returns the figure of the transient from rest and of the path of the steady motion (Fig. 4 of the paper).
///
/// # Errors
/// Returns a sentence that explains why the figure is not drawn.
fn from_rest(
    stem: &str,
    shown: &Shown,
    problem: &Problem,
    steady: &Steady,
) -> Result<Figure, String> {
    let Shown { campaign, model, look, values, link, free_joints, .. } = shown;
    let cycle = steady.cycle.as_slice();
    let d_m = steady.metrics.d_m;
    let settled = steady.cycles_to_settle.map(|cycles| cycles.max(1));
    let drawn = settled.unwrap_or(MAX_FROM_REST).min(MAX_FROM_REST);
    let transient = problem.cycles_from_rest(drawn, SAMPLES).map_err(|error| {
        let omega_rad_s = number(problem.omega_rad_s);
        not_drawn(
            stem,
            &format!("the motion from rest at {omega_rad_s} rad/s was not found: {error}"),
        )
    })?;
    let steady = |points| Layer::new(&format!("{}, steady", model.name()), points, look.thick());
    let from_rest = |points| Layer::new("from rest", points, looks::TRANSIENT);
    let mut panels = match free_joints {
        None => {
            let layers = vec![from_rest(shape(&transient)), steady(shape(cycle))];
            vec![gait("Gait from rest", layers)]
        }
        Some(joints) => {
            // The steady motion follows the transient.
            let from_s = transient.last().map_or(0.0, |last| last.time_s);
            let panel = |title: &str, y_label: &str, quantity: &dyn Fn(&Sample) -> f64| {
                let after = over_time(cycle, CYCLES, quantity);
                let after = after.into_iter().map(|(time_s, value)| (from_s + time_s, value));
                let before = over_time(&transient, 1, quantity);
                time_course(title, y_label, vec![from_rest(before), steady(after.collect())])
            };
            let speed = |sample: &Sample| 1e3 * sample.pose_rates[0].hypot(sample.pose_rates[1]);
            let title = format!("Speed of {} from rest", link_noun(link));
            let speed = panel(&title, "Speed (mm/s)", &speed);
            let joints = joints.iter().map(|joint| {
                let symbol = angle(*joint);
                let title = format!("Joint angle {symbol} from rest");
                panel(&title, &format!("{symbol} (deg)"), &|of| DEG * of.phi_rad[*joint])
            });
            joints.chain([speed]).collect()
        }
    };
    // The path runs along the x axis.
    let unturned = simulated::repeat(cycle, PATH_CYCLES, Pose::default());
    let end = unturned.last().map_or(Pose::default(), |(_, end)| *end);
    let start = Pose { theta_rad: -end.y_m.atan2(end.x_m), ..Pose::default() };
    let path = simulated::repeat(cycle, PATH_CYCLES, start);
    let path: Vec<_> = path.iter().map(|(_, pose)| (pose.x_m, pose.y_m)).collect();
    let at_start = links(&problem.robot, start, &cycle[0].phi_rad).unwrap_or_default();
    // Chains can be longer than their paths and travel with their rear link ahead.
    let beside = if free_joints.is_some() { &at_start[..] } else { &[] };
    let arrow = travel(&path, beside);
    let title = format!("Path of {}, d = {:.1} mm", link_noun(link), 1e3 * d_m);
    panels.push(map(title, vec![links_at_start(at_start), arrow, steady(path)]));
    let values = context! {
        campaign => *campaign,
        model => model.name(),
        values,
        omega => number(problem.omega_rad_s),
        settled,
        drawn,
        cycles => free_joints.as_ref().map(|_| CYCLES),
        path_cycles => PATH_CYCLES,
    };
    Ok(Figure::new(stem, texts("from-rest", values), &[campaign], Layout::Stack, panels))
}

/// Returns the figure of the steady motion over frequency (Fig. 5 of the paper).
fn sweep(stem: &str, shown: &Shown, problem_at: impl Fn(f64) -> Option<Problem> + Sync) -> Figure {
    let &Shown {
        campaign, model, ref look, ref values, sweep_rad_s: [low, high], ref link, ..
    } = shown;
    let solve = |i: i32| {
        // The frequencies are spaced by equal ratios, because the motion changes fastest at low frequencies.
        let omega_rad_s = low * (high / low).powf(f64::from(i) / f64::from(FREQUENCIES - 1));
        let settled = problem_at(omega_rad_s).and_then(|problem| problem.settle(FIT_ACCURACY).ok());
        (omega_rad_s, settled.map_or(GaitMetrics::MISSING, |settled| settled.motion.metrics))
    };
    let motions: Vec<(f64, GaitMetrics)> = (0..FREQUENCIES).into_par_iter().map(solve).collect();
    let d_m: Vec<(f64, f64)> =
        motions.iter().map(|(omega, metrics)| (*omega, metrics.d_m)).collect();
    let reversals = reversals(&d_m, |omega_rad_s| Advance::of(&problem_at(omega_rad_s)?));
    let stopped = GaitMetrics { d_m: 0.0, v_m_s: 0.0, ..GaitMetrics::MISSING };
    let mut has_maxima = false;
    let mut exceeded = Vec::new();
    let amplitudes = shown.free_joints.iter().flatten();
    let amplitudes = amplitudes.map(|joint| Quantity::new(Metric::ALPHA[*joint]));
    let panels = [DISPLACEMENT, SPEED]
        .into_iter()
        .chain(amplitudes)
        .map(|quantity| {
            let mut points: Vec<(f64, f64)> = motions
                .iter()
                .map(|(omega_rad_s, metrics)| (*omega_rad_s, quantity.of(metrics)))
                .collect();
            let value = quantity.of(&stopped);
            for &(omega_rad_s, _) in reversals.iter().filter(|_| value.is_finite()) {
                let after = points.partition_point(|(omega, _)| *omega < omega_rad_s);
                points.insert(after, (omega_rad_s, value));
            }
            let peak = peak(&points);
            has_maxima |= peak.is_some();
            let unit = quantity.after_number();
            let ends = [points.first(), points.last()].into_iter().flatten();
            let higher = ends.filter(|(_, end)| peak.is_some_and(|(_, peak)| *end > peak));
            let higher = higher.max_by(|a, b| a.1.total_cmp(&b.1));
            exceeded.extend(higher.map(|(x, y)| {
                format!(
                    "{} reaches {y:.0}{unit} at the edge of the range, {x:.2} rad/s",
                    quantity.symbol
                )
            }));
            let kind = if higher.is_some() { "local maximum" } else { "maximum" };
            let note = peak.map(|(x, y)| format!(": {kind} {y:.0}{unit} at {x:.2} rad/s"));
            let definition = quantity.metric.definition();
            let title =
                format!("{} {}{}", definition.label, quantity.symbol, note.unwrap_or_default());
            let layers = vec![
                Layer::new(model.name(), points, look.solid()),
                Layer::new("maximum", peak, Look::Rings),
            ];
            Panel::new(title, FREQUENCY, quantity.axis_label(), layers)
        })
        .collect();
    let values = context! {
        campaign,
        model => model.name(),
        values,
        link => link_noun(link),
        has_maxima,
        exceeded,
        reversals => reversals.iter().map(|(omega, _)| format!("{omega:.2}")).collect::<Vec<_>>(),
        swings => reversals.iter().map(|(_, rad)| format!("±{:.0}°", DEG * rad)).collect::<Vec<_>>(),
    };
    Figure::new(stem, texts("sweep", values), &[campaign], Layout::Stack, panels)
}

/// Displacement per cycle (m) along the mean heading of link 0, negative for a robot that travels with its rear
/// link ahead, and half the range of the heading (rad).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Advance {
    m: f64,
    swing_rad: f64,
}

impl Advance {
    fn of(problem: &Problem) -> Option<Self> {
        let (_, cycle) = problem.settled_cycle(FIT_ACCURACY, SAMPLES).ok()?;
        let Pose { x_m, y_m, .. } = cycle.last()?.pose;
        let headings = cycle.iter().map(|sample| sample.pose.theta_rad);
        let [low, high] = extremes(headings.clone());
        let (sine, cosine) = (headings.sum::<f64>() / cycle.len() as f64).sin_cos();
        Some(Self { m: x_m * cosine + y_m * sine, swing_rad: 0.5 * (high - low) })
    }
}

/// Returns the frequencies (rad/s) at which the direction of travel changes, each with half the range of the heading
/// there (rad). `d_m` is the displacement against frequency, which is zero there and therefore has a minimum nearby.
fn reversals(d_m: &[(f64, f64)], advance: impl Fn(f64) -> Option<Advance>) -> Vec<(f64, f64)> {
    let minima = d_m.windows(3).filter(|three| three[1].1 < three[0].1.min(three[2].1));
    let around = minima.flat_map(|three| [[three[0].0, three[1].0], [three[1].0, three[2].0]]);
    let reversals = around.filter_map(|[from, to]| {
        let [before, after] = [advance(from)?, advance(to)?];
        let part = before.m / (before.m - after.m);
        let between = |from: f64, to: f64| from + part * (to - from);
        ((before.m < 0.0) != (after.m < 0.0))
            .then(|| (between(from, to), between(before.swing_rad, after.swing_rad)))
    });
    reversals.collect()
}

/// Returns the position and value of the highest local maximum of a line, interpolated by a parabola through three
/// points; `None` if there is no maximum between the end points, or if the line is nearly flat.
fn peak(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    /// Range of the values, relative to the largest, below which the line counts as flat.
    const MIN_RANGE: f64 = 1e-4;
    let [low, high] = extremes(points.iter().map(|(_, value)| *value));
    let is_flat = high - low <= MIN_RANGE * high.abs();
    let inside = points
        .windows(3)
        .filter(|three| !is_flat && three[1].1 >= three[0].1 && three[1].1 >= three[2].1);
    let three = inside.max_by(|a, b| a[1].1.total_cmp(&b[1].1))?;
    let [(x0, y0), (x1, y1), (x2, y2)] = [three[0], three[1], three[2]];
    let slope = (y2 - y0) / 2.0;
    let bend = y2 - 2.0 * y1 + y0;
    let shift = if bend < 0.0 { -slope / bend } else { 0.0 };
    Some((x1 + shift * (x2 - x0) / 2.0, y1 + 0.5 * slope * shift))
}

#[cfg(test)]
mod tests {
    use trilink_tables::trial::TrialKind;
    use trilink_tables::{Columns as _, TrialRow, TrialStatus};

    use super::*;

    #[test]
    fn captions_give_the_joint_parameters_and_their_origin() {
        let mut config = Config::default();
        config
            .robot
            .get_mut("semi-passive")
            .and_then(trilink_tables::config::RobotConfig::three_links_mut)
            .expect("the paper's")
            .set(trilink_robot::Quantity::Stiffness, [0.2]);
        for (config, joint) in [
            (
                Config::default(),
                "with k_τ = 0.188 N m/rad and c_τ = 0.007 N m s/rad, the values of the paper's simulations \
                 (Table II); all other values are as configured: α₂ = 30°, γ₁ = 0°; h = 0.144 m, \
                 l = 0.112 m, b = 0.058 m; links 0, 1, 2: m = 1.04, 0.34, 0.34 kg, I = 0.0086, 0.00059, 0.00059 kg m²",
            ),
            (config, "with k_τ = 0.2 N m/rad and c_τ = 0.006 N m s/rad, as configured"),
        ] {
            let input = ReportInput::new(&config, Default::default());
            let stems = ["a", "b", "c"].map(str::to_owned);
            let tables = Tables::default();
            let figures = passive(stems, SEMI_PASSIVE, (&tables, &input));
            assert_eq!(figures.len(), 3);
            for figure in figures {
                let Figure { caption, .. } = figure.expect("there are motions");
                assert!(caption.contains(joint), "{caption}");
            }
        }
    }

    #[test]
    fn a_failure_of_the_motion_from_rest_is_reported_as_one() {
        let input = ReportInput::new(&Config::default(), Default::default());
        let model = Model::NO_SKID;
        let problem = simulated::configured(&input, SEMI_PASSIVE, model, 3.0);
        let mut problem = problem.expect("a campaign of the paper");
        let steady = simulated::steady(&problem).expect("a motion");
        let shown = Shown {
            campaign: SEMI_PASSIVE,
            model,
            look: ModelLook::new(model, &Models::new()),
            values: String::new(),
            sweep_rad_s: Frequencies::DEFAULT.sweep_rad_s,
            link: "middle".to_owned(),
            free_joints: None,
        };
        problem.gait.joints[1] = Some(trilink_robot::JointCommand::new(0.0, f64::NAN, 0.0));
        let why = from_rest("a-from-rest", &shown, &problem, &steady).expect_err("no motion");
        let expected = "Figure a-from-rest is not drawn, because the motion from rest at 3 rad/s was not found: ";
        assert!(why.starts_with(expected), "{why}");
    }

    #[test]
    fn the_direction_of_travel_changes_where_the_displacement_vanishes() {
        let advance = |omega: f64| {
            let m = 0.2 * (omega - 0.83).min(2.27 - omega);
            Some(Advance { m, swing_rad: 3.0 - omega })
        };
        let d_m: Vec<(f64, f64)> = (5..30)
            .map(|tenth| f64::from(tenth) / 10.0)
            .filter_map(|omega| Some((omega, advance(omega)?.m.abs())))
            .collect();
        let found = reversals(&d_m, advance);
        assert_eq!(found.len(), 2);
        for ((omega_rad_s, swing_rad), expected) in found.into_iter().zip([0.83, 2.27]) {
            assert!((omega_rad_s - expected).abs() < 1e-12, "{omega_rad_s}");
            assert!((swing_rad - (3.0 - expected)).abs() < 1e-12, "{swing_rad}");
        }
        // A minimum that is not zero is no reversal.
        let ahead = |omega: f64| Some(Advance { m: 0.1 + (omega - 0.83).abs(), swing_rad: 1.0 });
        assert_eq!(reversals(&d_m, ahead), []);
    }

    #[test]
    fn chains_are_simulated_at_frequencies_in_the_range_of_their_trials() {
        let config = Config::default();
        let input = ReportInput::new(&config, Default::default());
        let of = |omegas_rad_s: &[f64]| {
            let trials = omegas_rad_s.iter().map(|omega_rad_s| TrialRow {
                campaign: "snake".to_owned(),
                omega_rad_s: *omega_rad_s,
                kind: TrialKind::Gait,
                status: TrialStatus::Ok,
                ..TrialRow::blank()
            });
            let tables = Tables { trials: trials.collect(), ..Tables::default() };
            Frequencies::of_chain("snake", (&tables, &input))
        };
        let frequencies = |shown_rad_s, sweep_rad_s| Frequencies { shown_rad_s, sweep_rad_s };
        assert_eq!(of(&[0.6, 0.3]), frequencies(0.6, [0.3 / MARGIN, 0.6 * MARGIN]));
        assert_eq!(of(&[6.0012, 12.0]), frequencies(6.0, [6.0012 / MARGIN, 18.0]));
        assert_eq!(of(&[3.0, 6.0]), frequencies(4.0, [2.0, 9.0]));
        assert_eq!(of(&[]), Frequencies::DEFAULT);
    }

    #[test]
    fn the_highest_peak_is_interpolated_and_ignores_the_ends() {
        let (x, y) = peak(&[0.0, 1.0, 2.0, 3.0].map(|x: f64| (x, 3.0 - (x - 1.3).powi(2))))
            .expect("there is one");
        assert!((x - 1.3).abs() < 1e-12 && (y - 3.0).abs() < 1e-12);
        assert_eq!(peak(&[(0.0, 3.0), (1.0, 2.0), (2.0, 1.0)]), None);
    }

    #[test]
    fn zero_crossings_lie_between_the_neighbouring_points() {
        assert_eq!(crossings(&[(0.0, 1.0), (1.0, -1.0), (2.0, -3.0), (3.0, 1.0)]), [0.5, 2.75]);
    }
}
