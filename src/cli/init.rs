//! `trilink init`.

use std::path::PathBuf;

use trilink_base::Named as _;
use trilink_mocap::LengthUnit;
use trilink_tables::config::CONFIG_FILE;

use super::output::{say, write_data};
use super::{Failure, Outcome, table};
use crate::init::{Findings, FoundFile, InitError, JointSwing, Request, init};
use crate::interrupt;

/// Lengths that may be a robot's, m.
const LENGTHS_M: std::ops::RangeInclusive<f64> = 1e-3..=100.0;

#[derive(clap::Args)]
pub(super) struct Init {
    /// Folders of marker files.
    #[arg(value_name = "FOLDER", required = true)]
    folders: Vec<PathBuf>,
    /// Folder of pipeline.toml; lists of trials are beside their files.
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Length from joint to wheel of the side links, m, by which their markers are placed [default: as
    /// far as the wheels show it].
    #[arg(long, value_name = "M", value_parser = parse_length)]
    l_m: Option<f64>,
    /// A marker of the front link [default: by their names, or where the robot moves].
    #[arg(long, value_name = "LABEL")]
    front: Option<String>,
    /// Unit of files that do not say theirs: mm, cm, m or in.
    #[arg(long, value_name = "UNIT", default_value = "mm", value_parser = parse_unit)]
    unit: LengthUnit,
    /// Replace files that are there.
    #[arg(long)]
    force: bool,
    /// Print one JSON object of all that was found.
    #[arg(long)]
    json: bool,
}

impl Init {
    /// `progress` shows which file is read.
    pub(super) fn run(self, progress: super::Progress) -> Result<Outcome, Failure> {
        let Self { folders, out, l_m, front, unit, force, json } = self;
        let out = if out.as_os_str() == "." { PathBuf::new() } else { out };
        let request = Request { folders, out, l_m, front, unit, force };
        let listed =
            |folder: &PathBuf| trilink_mocap::marker_files(folder).map_or(0, |of| of.len());
        let stage = progress.stage("init", request.folders.iter().map(listed).sum());
        let on_file = |file: &str| {
            stage.step(file);
            interrupt::token().check()
        };
        let found = match init(&request, &on_file) {
            Err(InitError::Cancelled(_)) => return Err(stage.interrupted("files").into()),
            found => found?,
        };
        drop(stage);
        match json {
            true => write_data(&serde_json::to_string_pretty(&found)?),
            false => say_findings(&found, &request),
        }
        Ok(if found.is_lacking() { Outcome::NeedsAttention } else { Outcome::Well })
    }
}

fn parse_length(text: &str) -> Result<f64, String> {
    let needed = || format!("found `{text}`, needed a number from 0.001 to 100 m");
    text.parse().ok().filter(|length| LENGTHS_M.contains(length)).ok_or_else(needed)
}

fn parse_unit(text: &str) -> Result<LengthUnit, String> {
    let needed = || format!("found `{text}`, needed mm, cm, m or in");
    LengthUnit::of_name(text).ok_or_else(needed)
}

fn say_findings(found: &Findings, request: &Request) {
    let headings = [
        ("file", false),
        ("subject", false),
        ("labels", true),
        ("rate_hz", true),
        ("frames", true),
        ("kind", false),
        ("omega_rad_s", true),
        ("joint1_deg", false),
        ("joint2_deg", false),
        ("campaign", false),
    ];
    let rows: Vec<Vec<String>> = found.files.iter().map(cells).collect();
    table::print(&headings, &rows, None);
    for file in &found.files {
        if let Some(problem) = &file.problem {
            say!("left out: {}: {problem}", file.folder.join(&file.file).display());
        }
    }
    found.empty.iter().for_each(|folder| say!("left out: {}: no trial", folder.display()));
    for (name, markers) in ["middle", "front", "rear"].iter().zip(&found.links) {
        say!("{name} link: {}", markers.join(", "));
    }
    if !found.elsewhere.is_empty() {
        say!("on no link: {}", found.elsewhere.join(", "));
    }
    found.kept.iter().for_each(|path| say!("left as it is: {}", path.display()));
    found.written.iter().for_each(|path| say!("written: {}", path.display()));
    for mark in &found.marks {
        let of = if mark.of.is_empty() { String::new() } else { format!("{}: ", mark.of) };
        say!("{}:{}: {of}{}", mark.file.display(), mark.line, mark.text);
    }
    let config = match request.out.as_os_str().is_empty() {
        true => String::new(),
        false => format!(" -c {}", request.out.join(CONFIG_FILE).display()),
    };
    say!("{} lines to look at, marked CHECK; then: trilink check{config}", found.marks.len());
}

fn cells(file: &FoundFile) -> Vec<String> {
    let none = || "-".to_owned();
    let joint = |of: Option<JointSwing>| match of {
        Some(JointSwing { offset_deg, amplitude_deg, phase_deg }) => {
            format!("{offset_deg:.1} +- {amplitude_deg:.1} at {phase_deg:.0}")
        }
        None => none(),
    };
    let [first, second] = [0, 1].map(|i| joint(file.joints.map(|joints| joints[i])));
    let subjects = file.subjects.join(", ");
    vec![
        file.folder.join(&file.file).display().to_string(),
        if subjects.is_empty() { none() } else { subjects },
        file.labels.to_string(),
        file.rate_hz.map_or_else(none, |rate_hz| rate_hz.to_string()),
        file.frames.to_string(),
        file.kind.map_or_else(none, |kind| kind.to_string()),
        file.omega_rad_s.map_or_else(none, |omega| format!("{omega:.4}")),
        first,
        second,
        file.campaign.clone().unwrap_or_else(none),
    ]
}
