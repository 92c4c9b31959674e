//! Fig. 6: the kinematic robot that skids, simulated.

use super::SYMMETRIC;
use super::common::{DEG, lines, over_time, time_course};
use crate::motion::{Model, Sample};
use crate::report::ReportInput;
use crate::report::drawing::{Figure, Layout};
use crate::report::simulated::{self, Steady};

const OMEGA_RAD_S: f64 = 4.0;
const MODEL: Model = Model::SkidRoll;

/// The figure, or a sentence on why there is none.
pub fn figure(config: &ReportInput) -> Result<Figure, String> {
    let none = |why: String| format!("Fig. 6 is not drawn, because {why}.");
    let problem = simulated::configured(config, SYMMETRIC, MODEL, OMEGA_RAD_S)
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
        format!("Simulated motion of campaign {SYMMETRIC}, {MODEL}, {OMEGA_RAD_S} rad/s"),
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
