//! `trilink init`.

use serde_json::json;
use trilink_tables::config::CONFIG_FILE;

use super::output::{note, write_json, write_text};
use super::table::Table;
use super::{Failure, Outcome, check_not_below_project};
use crate::init::{Findings, FoundFile, InitError, JointSwing, Request, init, link_names};

/// Write a first pipeline.toml and trials.toml from marker files alone.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/init.txt").trim_end())]
pub(super) struct Init {
    #[command(flatten)]
    request: Request,
    /// Print one JSON object with all findings.
    #[arg(long)]
    json: bool,
}

impl Init {
    pub(super) fn run(self, progress: super::Progress) -> Result<Outcome, Failure> {
        let Self { request, json } = self;
        if request.out.as_os_str().is_empty() && !request.force {
            check_not_below_project(None)?;
        }
        let files = request.folders.iter();
        let files =
            files.map(|folder| trilink_mocap::marker_files(folder).map_or(0, |files| files.len()));
        let stage = progress.stage("init", files.sum());
        let on_file = |file: &str| {
            stage.step(file);
            progress.cancel.check()
        };
        let found = match init(&request, &on_file) {
            Err(InitError::Cancelled(_)) => return Err(stage.interrupted("files").into()),
            found => found?,
        };
        drop(stage);
        if json {
            write_json(&found)?;
        } else {
            print_findings(&found, &request)?;
        }
        Ok(Outcome::well_if(!found.is_lacking()))
    }
}

/// Prints a table of the files and a summary of the findings.
fn print_findings(found: &Findings, request: &Request) -> Result<(), Failure> {
    let table = Table::new(&found.files)
        .left("file", path)
        .left("campaign or kind", |file| {
            or_dash(file.campaign.clone().or_else(|| file.kind.map(|kind| kind.to_string())))
        })
        .right("omega_rad_s", |file| or_dash(file.omega_rad_s.map(|omega| format!("{omega:.4}"))))
        .right("frames", |file| file.frames.to_string())
        .right("rate_hz", |file| or_dash(file.rate_hz.map(|rate_hz| rate_hz.to_string())))
        .right("labels", |file| file.labels.to_string());
    let joints = 1..found.links.len();
    let table = joints.fold(table, |table, joint| {
        let joint_deg = |file: &FoundFile| Some(swing(*file.joints.as_ref()?.get(joint - 1)?));
        table.left(&format!("joint{joint}_deg"), |file| or_dash(joint_deg(file)))
    });
    let hidden = table
        .left("subject", |file| {
            or_dash(Some(file.subjects.join(", ")).filter(|text| !text.is_empty()))
        })
        .print_fitting();
    if !hidden.is_empty() {
        note!("no space on the terminal for {}; --json prints all", hidden.join(", "));
    }
    let problems = found
        .files
        .iter()
        .filter_map(|file| Some(format!("{}: {}", path(file), file.problem.as_ref()?)));
    let empty = found.empty.iter().map(|folder| format!("{}: no trial", folder.display()));
    let left_out: Vec<String> = problems.chain(empty).collect();
    let config = if request.out.as_os_str().is_empty() {
        String::new()
    } else {
        format!(" -c {}", request.out.join(CONFIG_FILE).display())
    };
    let names = link_names(found.links.len());
    let text = json!({ "left_out": left_out, "names": names, "found": found, "config": config });
    write_text(include_str!("text/init.txt"), &text)
}

/// Returns the path of a file as text.
fn path(file: &FoundFile) -> String {
    file.folder.join(&file.file).display().to_string()
}

/// Formats the motion of a joint: offset, amplitude and phase in degrees.
fn swing(swing: JointSwing) -> String {
    let JointSwing { offset_deg, amplitude_deg, phase_deg } = swing;
    format!("{offset_deg:.1} +- {amplitude_deg:.1} at {phase_deg:.0}")
}

/// Returns the text, or a dash if there is none.
fn or_dash(text: Option<String>) -> String {
    text.unwrap_or_else(|| "-".to_owned())
}
