//! The replay of a model's motion from rest, with the forces at its wheels.

use minijinja::context;
use minijinja::value::Serde;
use serde::Serialize;
use trilink_base::numbers::as_configured;
use trilink_mechanics::{MotionError, Problem, Sample};
use trilink_plot::{Figure, Layer, Layout, Panel};
use trilink_robot::ContactForces;

use super::{Cycles, Direction, MOST_FRAMES, Motion, Quantity, Replay};
use crate::{ReportError, looks, page};

/// Samples of a cycle at least, from which work is summed up, and frames of a cycle at least.
const SAMPLES_OF_CYCLE: usize = 240;
const LEAST_FRAMES_OF_CYCLE: usize = 8;

/// Why there is no page of a motion.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    #[error(transparent)]
    Motion(#[from] MotionError),
    #[error(transparent)]
    Report(#[from] ReportError),
}

/// The page of a campaign's motion from rest until two cycles after it has settled, or where it does
/// not settle, or not soon, as many cycles as there is room for. `answer` is what `simulate` answers.
///
/// # Errors
/// There is no such motion, or the page cannot be filled in.
pub fn page(
    (campaign, model): (&str, &str),
    problem: &Problem,
    cycles_to_settle: Option<usize>,
    answer: &impl Serialize,
) -> Result<String, SimulationError> {
    let most = (MOST_FRAMES - 1) / LEAST_FRAMES_OF_CYCLE;
    let cycles = cycles_to_settle.map_or(most, |cycles| most.min(cycles + 2));
    let frames = (MOST_FRAMES - 1) / cycles;
    let stride = SAMPLES_OF_CYCLE.div_ceil(frames);
    let samples = problem.cycles_from_rest(cycles, frames * stride)?;
    let title = format!("{campaign}, {model}, {} rad/s", as_configured(problem.omega_rad_s));
    let settles = match cycles_to_settle {
        Some(0) => "it is in its steady motion at once".to_owned(),
        Some(1) => "after 1 cycle it is within 1 % of its steady motion".to_owned(),
        Some(after) => format!("after {after} cycles it is within 1 % of its steady motion"),
        None => "it does not settle".to_owned(),
    };
    let notes = vec![
        format!(
            "From rest at phase 0: {settles}; shown are {cycles} cycles, {frames} frames each."
        ),
        "Positions to 0.1 mm, angles to 0.1 mrad, forces to 0.1 mN.".to_owned(),
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

/// Every so many of the samples of a motion.
fn replay(
    model: &str,
    problem: &Problem,
    samples: &[Sample],
    stride: usize,
    notes: Vec<String>,
) -> Replay {
    let shown = || samples.iter().step_by(stride);
    let three = |of: fn(&Sample) -> [f64; 3]| {
        [0, 1, 2].map(|wheel| shown().map(|sample| of(sample)[wheel]).collect()).to_vec()
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
    };
    let across = match problem.laws.skids() {
        true => "Skid friction",
        false => "Constraint force",
    };
    let skid = quantity("Skid velocity", "mm/s", 1e3, 1, three(|sample| sample.skid_m_s));
    let lateral = quantity(across, "N", 1.0, 3, three(|sample| sample.forces.lateral_n));
    let roll = quantity("Roll friction", "N", 1.0, 3, three(|sample| sample.forces.roll_n));
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
        poses: shown().map(|sample| Some((sample.pose, sample.phi_rad))).collect(),
    };
    let period_s = std::f64::consts::TAU / problem.omega_rad_s;
    Replay {
        robot: problem.robot.clone(),
        time_s: shown().map(|sample| sample.time_s).collect(),
        motions: vec![motion],
        quantities,
        markers: Vec::new(),
        marks: Vec::new(),
        cycles: Some(Cycles { number: 0, start_s: 0.0, period_s }),
        notes,
    }
}

/// A power's integral since the start at every sample, J, by trapezoids.
fn integrated(samples: &[Sample], power_w: fn(&ContactForces) -> f64) -> Vec<f64> {
    let mut sums = vec![0.0];
    for pair in samples.windows(2) {
        let mean_w = 0.5 * (power_w(&pair[0].forces) + power_w(&pair[1].forces));
        sums.push(sums[sums.len() - 1] + mean_w * (pair[1].time_s - pair[0].time_s));
    }
    sums
}

/// What the replay writes in numbers, over time.
fn figures(samples: &[Sample]) -> Vec<Figure> {
    const WHEELS: [&str; 3] = ["wheel 0", "wheel 1", "wheel 2"];
    let panel = |title: &str, y_label: &str, names: &[&str], of: &dyn Fn(&Sample, usize) -> f64| {
        let line = |(nth, name): (usize, &&str)| {
            let points = samples.iter().map(|sample| (sample.time_s, of(sample, nth)));
            Layer::new(name, points, looks::component(nth))
        };
        Panel::new(title, "Time (s)", y_label, names.iter().enumerate().map(line).collect())
    };
    let joints = ["joint 1", "joint 2"];
    let panels = vec![
        panel("Joint angles", "φ (deg)", &joints, &|of, i| of.phi_rad[i].to_degrees()),
        panel("Torques", "Torque (N m)", &joints, &|of, i| of.forces.torque_nm[i]),
        panel("Power", "Power (W)", &["actuators", "friction"], &|of, i| {
            [of.forces.power_w, of.forces.loss_w][i]
        }),
        panel("Skid velocities", "Skid (mm/s)", &WHEELS, &|of, i| 1e3 * of.skid_m_s[i]),
        panel("Forces across", "Force (N)", &WHEELS, &|of, i| of.forces.lateral_n[i]),
        panel("Forces along", "Force (N)", &WHEELS, &|of, i| of.forces.roll_n[i]),
    ];
    let panels: Vec<Panel> = panels.into_iter().filter(|panel| !panel.is_empty()).collect();
    let texts = ["Joints, wheels and forces from rest".to_owned(), String::new()];
    vec![Figure::new("simulation", texts, &[], Layout::Grid, panels)]
}
