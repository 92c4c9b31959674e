//! Replay of a simulated motion from rest, with the forces on the wheels.

use minijinja::context;
use minijinja::value::Serde;
use serde::Serialize;
use trilink_base::numbers::as_configured;
use trilink_mechanics::{MotionError, Problem, Sample};
use trilink_plot::{Figure, Layer, Layout, Panel};
use trilink_robot::metrics::padded;
use trilink_robot::{AnyRobot, Chain};

use super::{Cycles, Direction, MAX_FRAMES, Motion, Quantity, Replay};
use crate::figures::{subscripted, wheels};
use crate::{ReportError, looks, page};

/// Minimum number of samples per cycle for integrating the work.
const SAMPLES_OF_CYCLE: usize = 240;
/// Minimum number of frames per cycle.
const MIN_FRAMES_OF_CYCLE: usize = 8;

/// Reason why the page on a simulated motion cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    #[error(transparent)]
    Motion(#[from] MotionError),
    #[error(transparent)]
    Report(#[from] ReportError),
}

/// Renders the page on a simulated motion from rest, for a campaign and model. `cycles_to_settle` is the number of
/// cycles in the transient, `None` if it does not end; `answer` contains the results of the command `simulate`.
///
/// The page shows the motion until two cycles after the transient. If the transient does not end or is too long for the
/// maximum number of frames, the page shows as many cycles as this number allows.
///
/// # Errors
/// Returns an error if the motion does not exist or the template cannot be rendered.
pub fn page(
    (campaign, model): (&str, &str),
    problem: &Problem,
    cycles_to_settle: Option<usize>,
    answer: &impl Serialize,
) -> Result<String, SimulationError> {
    let max_cycles = (MAX_FRAMES - 1) / MIN_FRAMES_OF_CYCLE;
    let cycles = cycles_to_settle.map_or(max_cycles, |cycles| max_cycles.min(cycles + 2));
    let frames = (MAX_FRAMES - 1) / cycles;
    let stride = SAMPLES_OF_CYCLE.div_ceil(frames);
    let samples = problem.cycles_from_rest(cycles, frames * stride)?;
    let title = format!("{campaign}, {model}, {} rad/s", as_configured(problem.omega_rad_s));
    let settles = match cycles_to_settle {
        Some(0) => "the robot is in its steady motion from the start".to_owned(),
        Some(1) => "after 1 cycle, the robot is within 1 % of its steady motion".to_owned(),
        Some(after) => {
            format!("after {after} cycles, the robot is within 1 % of its steady motion")
        }
        None => "the robot does not reach a steady motion".to_owned(),
    };
    let notes = vec![
        format!(
            "The motion starts from rest at phase 0; {settles}. The replay shows {cycles} cycles \
             of {frames} frames each."
        ),
        "Positions are given to 0.1 mm, angles to 0.1 mrad and forces to 0.1 mN.".to_owned(),
    ];
    let replay = replay(model, problem, &samples, stride, notes);
    let figures = figures(&problem.robot, &samples);
    let figures = figures
        .iter()
        .map(page::image)
        .collect::<Result<Vec<_>, _>>()
        .map_err(ReportError::from)?;
    let replay = replay.value(&format!("Motion of {title}"));
    let is_chain = matches!(problem.robot, AnyRobot::Chain(_));
    let sigma = wheels(&problem.robot).into_iter().map(|(number, wheel)| {
        let symbol = subscripted('σ', number);
        (number, if is_chain { format!("{symbol}, {wheel}") } else { symbol })
    });
    let alpha = (1..=problem.robot.joints())
        .map(|number| (format!("alpha{number}_rad"), subscripted('α', number)));
    let numbers = problem.robot.clone().chain().map_or(Vec::new(), numbers);
    let values = context! {
        version => env!("CARGO_PKG_VERSION"),
        synthetic => "",
        title,
        answer => Serde(answer),
        sigma => sigma.collect::<Vec<_>>(),
        alpha => alpha.collect::<Vec<_>>(),
        numbers,
        replay => replay,
        figures,
    };
    let html = page::fill("simulation.html", include_str!("../page/simulation.html"), &values);
    Ok(html.map_err(ReportError::Page)?)
}

/// Returns the names of the numbers of a chain that are not zero, as in the option `--set` of `simulate`, with their
/// values in the units of the names.
fn numbers(chain: Chain) -> Vec<(String, f64)> {
    let known = chain.numbers().into_iter().filter_map(|number| {
        let value = chain.number(number).filter(|value| *value != 0.0)?;
        Some((chain.number_name(number), value / number.in_si()))
    });
    known.collect()
}

/// Returns the replay of a simulated motion, with every `stride`-th sample as a frame.
fn replay(
    model: &str,
    problem: &Problem,
    samples: &[Sample],
    stride: usize,
    notes: Vec<String>,
) -> Replay {
    let shown = || samples.iter().step_by(stride);
    let joints = problem.robot.joints();
    // A robot has one joint fewer than links.
    let each = |count: usize, values: fn(&Sample) -> &[f64]| {
        (0..count).map(|i| shown().map(|sample| values(sample)[i]).collect()).collect()
    };
    let of_wheels = |values| each(joints + 1, values);
    let [done_j, lost_j] = [|of: &Sample| of.power_w, |of: &Sample| of.loss_w]
        .map(|power_w| integrated(samples, power_w).into_iter().step_by(stride).collect());
    let quantity = |name: &str, unit, units, decimals, values| Quantity {
        name: name.to_owned(),
        unit,
        units,
        decimals,
        values,
        arrow: None,
        full_scale: None,
    };
    let across = if problem.laws.skids() { "Skid friction" } else { "Constraint force" };
    let skid = quantity("Skid velocity", "mm/s", 1e3, 1, of_wheels(|sample| &sample.skid_m_s));
    let lateral = quantity(across, "N", 1.0, 3, of_wheels(|sample| &sample.lateral_n));
    let roll = quantity("Roll friction", "N", 1.0, 3, of_wheels(|sample| &sample.roll_n));
    let torques = each(joints, |sample| &sample.torque_nm);
    let power = shown().map(|sample| sample.power_w).collect();
    let torque = match joints {
        1 => "Torque of joint 1".to_owned(),
        2 => "Torque of joints 1, 2".to_owned(),
        _ => format!("Torque of joints 1 to {joints}"),
    };
    let quantities = vec![
        skid,
        Quantity { arrow: Some(Direction::Across), ..lateral },
        Quantity { arrow: Some(Direction::Along), ..roll },
        quantity(&torque, "N m", 1.0, 3, torques),
        quantity("Power of the actuators", "W", 1.0, 3, vec![power]),
        quantity("Work of the actuators", "J", 1.0, 3, vec![done_j]),
        quantity("Lost to friction", "J", 1.0, 3, vec![lost_j]),
    ];
    let motion = Motion {
        name: model.to_owned(),
        colour: None,
        poses: shown().map(|sample| Some((sample.pose, padded(&sample.phi_rad)))).collect(),
    };
    let period_s = std::f64::consts::TAU / problem.omega_rad_s;
    Replay {
        robot: problem.robot.to_chain(&problem.gait),
        time_s: shown().map(|sample| sample.time_s).collect(),
        motions: vec![motion],
        quantities,
        markers: Vec::new(),
        marks: Vec::new(),
        cycles: Some(Cycles { number: 0, start_s: 0.0, period_s }),
        notes,
    }
}

/// Integrates a power (W) over time by the trapezoidal rule; returns the energy (J) from the first sample up to each
/// sample.
fn integrated(samples: &[Sample], power_w: fn(&Sample) -> f64) -> Vec<f64> {
    let mut sums = vec![0.0];
    for pair in samples.windows(2) {
        let mean_w = 0.5 * (power_w(&pair[0]) + power_w(&pair[1]));
        sums.push(sums[sums.len() - 1] + mean_w * (pair[1].time_s - pair[0].time_s));
    }
    sums
}

/// Returns the figures that show the quantities of the replay against time.
fn figures(robot: &AnyRobot, samples: &[Sample]) -> Vec<Figure> {
    let panel =
        |title: &str, y_label: &str, names: &[String], of: &dyn Fn(&Sample, usize) -> f64| {
            Panel::new(
                title,
                "Time (s)",
                y_label,
                names
                    .iter()
                    .enumerate()
                    .map(|(nth, name)| {
                        let points = samples.iter().map(|sample| (sample.time_s, of(sample, nth)));
                        Layer::new(name, points, looks::component(nth))
                    })
                    .collect(),
            )
        };
    let joints: Vec<String> =
        (1..=robot.joints()).map(|number| format!("joint {number}")).collect();
    let (numbers, wheels): (Vec<usize>, Vec<String>) = wheels(robot).into_iter().unzip();
    let powers = ["actuators", "friction"].map(str::to_owned);
    let panels = vec![
        panel("Joint angles", "φ (deg)", &joints, &|of, i| of.phi_rad[i].to_degrees()),
        panel("Torques", "Torque (N m)", &joints, &|of, i| of.torque_nm[i]),
        panel("Power", "Power (W)", &powers, &|of, i| [of.power_w, of.loss_w][i]),
        panel("Skid velocities", "Skid (mm/s)", &wheels, &|of, i| 1e3 * of.skid_m_s[numbers[i]]),
        panel("Lateral forces", "Force (N)", &wheels, &|of, i| of.lateral_n[numbers[i]]),
        panel("Rolling forces", "Force (N)", &wheels, &|of, i| of.roll_n[numbers[i]]),
    ];
    let panels: Vec<Panel> = panels.into_iter().filter(|panel| !panel.is_empty()).collect();
    let title = "Joint angles, torques, power, skid velocities and forces in a motion that starts from rest";
    let texts = [title.to_owned(), String::new()];
    vec![Figure::new("simulation", texts, &[], Layout::Grid, panels)]
}
