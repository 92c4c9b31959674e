//! `trilink ingest --calibrate`: the marker layouts that a trial shows, as TOML.

use std::path::Path;

use super::output::say;
use super::{Context, Failure, Outcome};
use crate::ingest::{Calibration, MarkerPosition, calibrate};
use crate::metrics::Estimate;

/// Estimates the layouts from one trial and prints them.
pub(super) fn run(context: &Context, folder: &Path, trial: &str) -> Result<Outcome, Failure> {
    print(&calibrate(&context.config, folder, trial)?);
    Ok(Outcome::Well)
}

fn print(found: &Calibration) {
    let Calibration { trial, frames, h_mm, h_configured_mm, l_mm, l_configured_mm, .. } = found;
    say!("# Marker layouts from trial {trial}, {frames} frames: the [markers] of pipeline.toml.");
    say!("# Places in mm, with standard errors and the difference from the configured place.");
    say!(
        "# h_m = {:.5} +- {:.5}; {:.5} is configured. The joints close to {:.2} and {:.2} mm (RMS).",
        h_mm.value / 1e3,
        h_mm.se / 1e3,
        h_configured_mm / 1e3,
        found.joint_residual_mm[0],
        found.joint_residual_mm[1]
    );
    say!(
        "# Assumed: l_m = {:.5} as configured. A trial does not show it well: the wheels skid least \
         at {} and {} mm from",
        l_configured_mm / 1e3,
        with_error(&l_mm[0], 1),
        with_error(&l_mm[1], 1)
    );
    say!("# their joints, where every wheel that skids is off by much more than that error.");
    say!(
        "# Assumed: the wheels of links 1 and 2 roll along their links on average, which gives the \
         links' directions"
    );
    say!(
        "# to {:.2} and {:.2} degrees. {}",
        found.direction_se_deg[0],
        found.direction_se_deg[1],
        match found.is_symmetric {
            true => "The middle axle is half way between the joints.",
            false =>
                "But this gait swings about bent links: wheels that skid to one side turn \
                      them by degrees. Take a symmetric gait.",
        }
    );
    if found.is_grouped {
        say!(
            "# The file does not have the configured labels: the links are the markers that move \
             together, and the front is"
        );
        say!("# where the commanded gait has it.");
    }
    if !found.left_out.is_empty() {
        say!("# On no link: {}", found.left_out.join(", "));
    }
    for (link, markers) in found.links.iter().enumerate() {
        say!("");
        say!("[markers.link{link}]");
        markers.iter().for_each(|marker| say!("{}", line(marker)));
    }
}

fn line(marker: &MarkerPosition) -> String {
    let all = |numbers: [f64; 3]| numbers.map(|x| format!("{x:.2}")).join(", ");
    let position = marker.position_mm.map(|estimate| estimate.value);
    let off = match marker.configured_mm {
        Some(configured) => {
            let off = [0, 1, 2].map(|axis| format!("{:+.2}", position[axis] - configured[axis]));
            format!("; off by {}", off.join(", "))
        }
        None => String::new(),
    };
    let errors = all(marker.position_mm.map(|estimate| estimate.se));
    format!("{} = [{}]  # +- {errors}{off}", key(&marker.label), all(position))
}

fn with_error(estimate: &Estimate, digits: usize) -> String {
    format!("{:.digits$} +- {:.digits$}", estimate.value, estimate.se)
}

/// A label as a key of TOML.
fn key(label: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    match !label.is_empty() && label.chars().all(is_plain) {
        true => label.to_owned(),
        false => toml::Value::String(label.to_owned()).to_string(),
    }
}
