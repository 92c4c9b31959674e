//! Replay of a simulated motion from rest, with the forces on the wheels.

use minijinja::context;
use minijinja::value::Serde;
use serde::Serialize;
use trilink_base::numbers::as_configured;
use trilink_mechanics::{MotionError, Problem, Sample};
use trilink_plot::{Figure, Layer, Layout, Panel};
use trilink_robot::ContactForces;
use trilink_robot::metrics::padded;

use super::{Cycles, Direction, MAX_FRAMES, Motion, Quantity, Replay};
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
    let figures = figures(&samples);
    let figures = figures
        .iter()
        .map(page::image)
        .collect::<Result<Vec<_>, _>>()
        .map_err(ReportError::from)?;
    let replay = replay.value(&format!("Motion of {title}"));
    let values = context! {
        version => env!("CARGO_PKG_VERSION"),
        synthetic => "",
        title,
        answer => Serde(answer),
        replay => replay,
        figures,
    };
    let html = page::fill("simulation.html", include_str!("../page/simulation.html"), &values);
    Ok(html.map_err(ReportError::Page)?)
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
    let of_wheels = |values: fn(&Sample) -> [f64; 3]| {
        [0, 1, 2].map(|wheel| shown().map(|sample| values(sample)[wheel]).collect()).to_vec()
    };
    let [done_j, lost_j] = [|of: &ContactForces| of.power_w, |of: &ContactForces| of.loss_w]
        .map(|power_w| integrated(samples, power_w).into_iter().step_by(stride).collect());
    let quantity = |name, unit, units, decimals, values| Quantity {
        name,
        unit,
        units,
        decimals,
        values,
        arrow: None,
        full_scale: None,
    };
    let across = if problem.laws.skids() { "Skid friction" } else { "Constraint force" };
    let skid = quantity("Skid velocity", "mm/s", 1e3, 1, of_wheels(|sample| sample.skid_m_s));
    let lateral = quantity(across, "N", 1.0, 3, of_wheels(|sample| sample.forces.lateral_n));
    let roll = quantity("Roll friction", "N", 1.0, 3, of_wheels(|sample| sample.forces.roll_n));
    let torques =
        [0, 1].map(|joint| shown().map(|sample| sample.forces.torque_nm[joint]).collect());
    let power = shown().map(|sample| sample.forces.power_w).collect();
    let quantities = vec![
        skid,
        Quantity { arrow: Some(Direction::Across), ..lateral },
        Quantity { arrow: Some(Direction::Along), ..roll },
        quantity("Torque of joints 1, 2", "N m", 1.0, 3, torques.to_vec()),
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
        robot: problem.robot.clone().into(),
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
fn integrated(samples: &[Sample], power_w: fn(&ContactForces) -> f64) -> Vec<f64> {
    let mut sums = vec![0.0];
    for pair in samples.windows(2) {
        let mean_w = 0.5 * (power_w(&pair[0].forces) + power_w(&pair[1].forces));
        sums.push(sums[sums.len() - 1] + mean_w * (pair[1].time_s - pair[0].time_s));
    }
    sums
}

/// Returns the figures that show the quantities of the replay against time.
fn figures(samples: &[Sample]) -> Vec<Figure> {
    const WHEELS: [&str; 3] = ["wheel 0", "wheel 1", "wheel 2"];
    let panel = |title: &str, y_label: &str, names: &[&str], of: &dyn Fn(&Sample, usize) -> f64| {
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
    let joints = ["joint 1", "joint 2"];
    let panels = vec![
        panel("Joint angles", "φ (deg)", &joints, &|of, i| of.phi_rad[i].to_degrees()),
        panel("Torques", "Torque (N m)", &joints, &|of, i| of.forces.torque_nm[i]),
        panel("Power", "Power (W)", &["actuators", "friction"], &|of, i| {
            [of.forces.power_w, of.forces.loss_w][i]
        }),
        panel("Skid velocities", "Skid (mm/s)", &WHEELS, &|of, i| 1e3 * of.skid_m_s[i]),
        panel("Lateral forces", "Force (N)", &WHEELS, &|of, i| of.forces.lateral_n[i]),
        panel("Rolling forces", "Force (N)", &WHEELS, &|of, i| of.forces.roll_n[i]),
    ];
    let panels: Vec<Panel> = panels.into_iter().filter(|panel| !panel.is_empty()).collect();
    let title = "Joint angles, torques, power, skid velocities and forces in a motion that starts from rest";
    let texts = [title.to_owned(), String::new()];
    vec![Figure::new("simulation", texts, &[], Layout::Grid, panels)]
}
