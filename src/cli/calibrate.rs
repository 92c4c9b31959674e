//! `trilink ingest --calibrate`: marker layouts estimated from a trial, as TOML.

use serde_json::json;
use trilink_base::body;
use trilink_ingest::calibrate::{Direction, layout_entries};
use trilink_ingest::{Calibration, MarkerPosition, calibrate};
use trilink_tables::config::toml_key;
use trilink_tables::trial::{TrialFolder, TrialFolders};

use super::output::write_data;
use super::{Context, Failure, Outcome};
use crate::template::fill;

/// Estimates the marker layouts from one trial and prints them.
pub(super) fn run(context: &Context, trial: &str) -> Result<Outcome, Failure> {
    let TrialFolders { folders, trials, .. } = TrialFolders::load(&context.config.paths)?;
    let listed = trials.iter().find(|listed| listed.trial.id == trial);
    let (folder, id) = match (listed, &folders[..]) {
        (Some(listed), _) => (&folders[listed.folder], listed.id.as_str()),
        // The error of the calibration suggests similar names.
        (None, [folder]) => (folder, trial),
        (None, folders) => {
            let folders = folders.iter().map(|TrialFolder { name, .. }| name.as_str());
            let folders = folders.collect::<Vec<_>>().join(", ");
            return Err(format!(
                "{folders}: trial `{trial}` is not in the trials.toml of any of these folders"
            )
            .into());
        }
    };
    let text = to_toml(&calibrate(&context.config, &folder.path, id)?)?;
    write_data(text.trim_end());
    Ok(Outcome::Well)
}

/// Returns the measured layout as TOML.
fn to_toml(found: &Calibration) -> Result<String, Failure> {
    let Calibration { layout, places, tables, .. } = found;
    let links = layout.links.iter().zip(tables).zip(places).map(|((link, table), places)| {
        let configured_mm = [places.front_joint_mm, places.rear_joint_mm];
        let keys =
            if found.is_three_links { ["l_m"; 2] } else { ["front_joint_m", "rear_joint_m"] };
        let joints = keys.iter().zip(link.joints_mm).zip(configured_mm);
        let joints = joints.filter_map(|((key, found_mm), configured_mm)| {
            let found_mm = found_mm?;
            let [value, se, configured] =
                [found_mm.value, found_mm.se, configured_mm].map(|mm| mm / 1e3);
            match se.is_finite() {
                true if found.is_three_links => None,
                true => {
                    Some(format!("{key} = {value:.5} +- {se:.5}; {configured:.5} is configured"))
                }
                false => Some(format!("Assumed: {key} = {configured:.5} as configured")),
            }
        });
        json!({
            "table": table,
            "joints": joints.collect::<Vec<_>>(),
            "direction": match link.direction {
                Direction::Joints => "joints",
                Direction::Wheel => "wheel",
                Direction::MeanAngle => "mean angle",
            },
            "direction_se_deg": link.direction_se_deg,
            "skid_deg": link.skid_deg,
            "least_skid_mm": link.least_skid_mm.map(|found_mm| [found_mm.value, found_mm.se]),
            "markers": lines(&link.markers),
        })
    });
    let h_mm = layout.h_mm().filter(|_| found.is_three_links);
    let h_m = h_mm.map(|h_mm| {
        let configured_mm = 0.5 * (places[1].front_joint_mm + places[1].rear_joint_mm);
        [h_mm.value, h_mm.se, configured_mm].map(|mm| mm / 1e3)
    });
    let values = json!({
        "trial": found.trial,
        "frames": layout.frames,
        "h_m": h_m,
        "joint_residuals_mm": layout.joint_residuals_mm,
        "is_grouped": found.is_grouped,
        "left_out": found.left_out,
        "links": links.collect::<Vec<_>>(),
    });
    Ok(fill(include_str!("text/calibration.txt"), &values)?)
}

/// Formats the markers and rigid bodies of a link as lines of TOML.
fn lines(markers: &[MarkerPosition]) -> Vec<String> {
    let bodies = layout_entries(markers).into_iter().filter(|(_, numbers)| numbers.len() > 3);
    let bodies = bodies.map(|(name, numbers)| body_line(&name, &numbers));
    let markers = markers.iter().filter(|marker| body::of_point(&marker.label).is_none());
    bodies.chain(markers.map(line)).collect()
}

/// Formats the pose of a rigid body as a line of TOML.
fn body_line(name: &str, numbers: &[f64]) -> String {
    let pose = numbers.iter().map(|x| format!("{x:.3}")).collect::<Vec<_>>().join(", ");
    format!("{} = [{pose}]  # x, y, z, mm; roll, pitch, yaw, degrees", toml_key(name))
}

/// Formats a marker as a line of TOML, with standard errors and the deviation from the configuration in a comment.
fn line(marker: &MarkerPosition) -> String {
    let position_mm = marker.position_mm.map(|estimate| estimate.value);
    let deviation = match marker.configured_mm {
        Some(configured) => {
            let deviation =
                [0, 1, 2].map(|axis| format!("{:+.2}", position_mm[axis] - configured[axis]));
            format!("; off by {}", deviation.join(", "))
        }
        None => String::new(),
    };
    let position = position_mm.map(|x| format!("{x:.2}")).join(", ");
    let errors = marker.position_mm.map(|estimate| format!("{:.2}", estimate.se)).join(", ");
    format!("{} = [{position}]  # +- {errors}{deviation}", toml_key(&marker.label))
}
