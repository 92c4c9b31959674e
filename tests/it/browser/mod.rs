//! Tests of the pages in a browser. Without a browser, the tests print a message and pass. With `TRILINK_PAGES`, they
//! use the reports in that folder instead of the reports of a small demo.

mod driver;
mod figures;
mod hostile;
mod index;
mod pages;
mod replay;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde_json::json;
use tempfile::TempDir;
use trilink_mechanics::Model;
use trilink_tables::config::Config;

use crate::common::{files, succeed, temporary, trilink};
use driver::Browser;

const SIZES: [(u32, u32); 2] = [(1400, 900), (400, 800)];

/// Runs all stages on synthetic trials and compares the results with a baseline made from the same results; returns the
/// folder and the path of its reports.
fn reports(settings: &str, omega_rad_s: &str) -> (TempDir, PathBuf) {
    let folder = temporary();
    std::fs::write(folder.path().join("pipeline.toml"), settings).unwrap();
    let synth = ["synth", "raw/demo", "--omega", omega_rad_s, "--seed", "1"];
    let save = ["compare", "--save", "baseline.json"];
    for arguments in [&synth[..], &["run"], &save, &["compare", "baseline.json"]] {
        succeed(folder.path(), &[arguments, &["--quiet"]].concat());
    }
    let reports = folder.path().join("reports");
    (folder, reports)
}

/// Returns the folder of reports that the environment variable `TRILINK_PAGES` names or, if it is not set, that of new
/// reports for the paper's campaigns with two models each.
fn demo() -> &'static Path {
    static DEMO: OnceLock<(Option<TempDir>, PathBuf)> = OnceLock::new();
    let made = DEMO.get_or_init(|| {
        if let Some(pages) = std::env::var_os("TRILINK_PAGES") {
            return (None, pages.into());
        }
        let mut config = Config::default();
        (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (2, 3, false);
        for (name, campaign) in &mut config.campaign {
            let passive = name.starts_with("semi-passive");
            let model = if passive { Model::NO_SKID_ROLL } else { Model::NO_SKID };
            campaign.models = vec![model, Model::SKID_ROLL];
        }
        let settings = toml::to_string(&config).expect("a configuration is TOML");
        let (folder, reports) = reports(&settings, "2,3.9");
        (Some(folder), reports)
    });
    &made.1
}

/// Returns the path of the reports folder of a demo project whose robot and campaigns are not those of the paper; the
/// reports are made at the first call.
fn own() -> &'static Path {
    static OWN: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    let made = OWN.get_or_init(|| {
        let settings = include_str!("../../fixtures/trolley.toml");
        let quick = "starts = 2\nbootstrap = 3\nprofiles = false\n";
        let (folder, reports) = reports(&settings.replace("starts = 2\n", quick), "2,4.2");
        // A second run gives the history two entries.
        succeed(folder.path(), &["run", "--force", "--quiet"]);
        (folder, reports)
    });
    &made.1
}

/// Returns every page below a folder of reports, with only the first few trial pages.
fn all_pages(reports: &Path) -> Vec<PathBuf> {
    let is_page = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "html");
    let (of_trials, mut pages): (Vec<_>, Vec<_>) =
        files(reports).into_keys().filter(is_page).partition(|path| path.starts_with("trials"));
    pages.extend(of_trials.into_iter().take(3));
    pages.into_iter().map(|page| reports.join(page)).collect()
}

#[track_caller]
fn assert_no_problems(browser: &Browser) {
    assert_eq!(browser.problems(), Vec::<String>::new());
}
