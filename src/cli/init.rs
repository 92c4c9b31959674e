//! `trilink init`.

use std::path::PathBuf;

use serde_json::json;
use trilink_tables::config::CONFIG_FILE;

use super::output::{write_json, write_text};
use super::table::Table;
use super::{Failure, Outcome};
use crate::init::{Findings, FoundFile, InitError, JointSwing, Request, init};
use crate::interrupt;

/// Write a first pipeline.toml and trials.toml from marker files alone.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/init.txt").trim_end())]
pub(super) struct Init {
    #[command(flatten)]
    request: Request,
    /// Print one JSON object of all that was found.
    #[arg(long)]
    json: bool,
}

impl Init {
    /// `progress` shows which file is read.
    pub(super) fn run(self, progress: super::Progress) -> Result<Outcome, Failure> {
        let Self { request, json } = self;
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
            true => write_json(&found)?,
            false => say_findings(&found, &request)?,
        }
        Ok(Outcome::well_if(!found.is_lacking()))
    }
}

fn say_findings(found: &Findings, request: &Request) -> Result<(), Failure> {
    let or_none = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
    let joint = |of: &FoundFile, i: usize| {
        or_none(of.joints.map(|joints| {
            let JointSwing { offset_deg, amplitude_deg, phase_deg } = joints[i];
            format!("{offset_deg:.1} +- {amplitude_deg:.1} at {phase_deg:.0}")
        }))
    };
    let subjects = |of: &FoundFile| (!of.subjects.is_empty()).then(|| of.subjects.join(", "));
    Table::of(&found.files)
        .left("file", |of| of.folder.join(&of.file).display().to_string())
        .left("subject", |of| or_none(subjects(of)))
        .right("labels", |of| of.labels.to_string())
        .right("rate_hz", |of| or_none(of.rate_hz.map(|rate_hz| rate_hz.to_string())))
        .right("frames", |of| of.frames.to_string())
        .left("kind", |of| or_none(of.kind.map(|kind| kind.to_string())))
        .right("omega_rad_s", |of| or_none(of.omega_rad_s.map(|omega| format!("{omega:.4}"))))
        .left("joint1_deg", |of| joint(of, 0))
        .left("joint2_deg", |of| joint(of, 1))
        .left("campaign", |of| or_none(of.campaign.clone()))
        .print();
    let place = |of: &FoundFile| of.folder.join(&of.file).display().to_string();
    let problem = |of: &FoundFile| Some(format!("{}: {}", place(of), of.problem.as_ref()?));
    let empty = found.empty.iter().map(|folder| format!("{}: no trial", folder.display()));
    let left_out: Vec<String> = found.files.iter().filter_map(problem).chain(empty).collect();
    let config = match request.out.as_os_str().is_empty() {
        true => String::new(),
        false => format!(" -c {}", request.out.join(CONFIG_FILE).display()),
    };
    let text = json!({ "left_out": left_out, "found": found, "config": config });
    write_text(include_str!("text/init.txt"), &text)
}
