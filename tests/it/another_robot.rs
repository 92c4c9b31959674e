//! Tests of a robot with markers and gaits other than the paper's, defined by `pipeline.toml` and `trials.toml` alone.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::TempDir;
use trilink_mechanics::Model;
use trilink_tables::config::Config;
use trilink_tables::trial::TrialKind;
use trilink_tables::{Columns as _, FitRow, FitStatus, Table, TrialRow};

use crate::common::{files, succeed, text, trilink};

/// Configuration of a robot that is larger and heavier than those of the paper, with a passive rear joint.
const PIPELINE: &str = include_str!("../fixtures/trolley.toml");

const CAMPAIGNS: [&str; 2] = ["pulled", "wriggling"];

/// Creates a folder with the configuration [`PIPELINE`] and synthetic trials of its robot.
fn recorded() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "pipeline.toml", PIPELINE);
    succeed(folder.path(), &["synth", "raw/trolley", "--omega", "2,4.2", "--seed", "5"]);
    folder
}

fn write(folder: &Path, name: &str, content: &str) {
    std::fs::write(folder.join(name), content).expect("the file can be written");
}

fn trials(folder: &Path) -> Vec<TrialRow> {
    let table = Table::read(&folder.join("derived/trials.parquet")).expect("a table");
    TrialRow::from_table(&table).expect("trials")
}

fn truth(folder: &Path) -> Value {
    let text = std::fs::read_to_string(folder.join("raw/trolley/truth.json")).expect("a truth");
    serde_json::from_str(&text).expect("the truth is JSON")
}

#[test]
fn another_robot_is_measured_fitted_and_drawn_without_a_change_of_code() {
    let folder = recorded();
    let output = trilink(folder.path(), &["run", "raw/trolley"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));

    let (mut trials, truth) = (trials(folder.path()), truth(folder.path()));
    // The trials include a release of the rear joint and a coast-down.
    assert_eq!(trials.len(), 6);
    trials.retain(|trial| trial.kind == TrialKind::Gait);
    assert_eq!(trials.len(), 4);
    for trial in &trials {
        let known =
            |quantity: &str| truth["trials"][&trial.id][quantity].as_f64().expect("a number");
        for (quantity, found) in [("d_m", trial.metrics.d_m), ("v_m_s", trial.metrics.v_m_s)] {
            let error = (found / known(quantity) - 1.0).abs();
            assert!(error < 0.01, "{}: {quantity}: {found} {}", trial.trial, known(quantity));
        }
        let error = trial.omega_rad_s / known("omega_rad_s") - 1.0;
        assert!(error.abs() < 1e-3, "{}: {}", trial.trial, trial.omega_rad_s);
        let alpha1_rad = trial.metrics.alpha_rad[0];
        let alpha1 = alpha1_rad / known("alpha1_rad") - 1.0;
        assert!(alpha1.abs() < 0.01, "{}: {}", trial.trial, alpha1_rad);
    }

    let fits = Table::read(&folder.path().join("derived/fits.parquet")).expect("a table");
    let fits = FitRow::from_table(&fits).expect("fits");
    let named: Vec<_> = fits.iter().map(|fit| (fit.campaign.as_str(), fit.model.name())).collect();
    assert_eq!(
        named,
        [
            ("pulled", "no-skid-roll"),
            ("pulled", "skid-roll"),
            ("wriggling", "no-skid"),
            ("wriggling", "skid-roll"),
        ]
    );
    for fit in fits.iter().filter(|fit| fit.model == Model::SKID_ROLL) {
        assert_eq!(fit.status, FitStatus::Ok);
        assert!(fit.j.is_finite());
    }

    let reports = files(&folder.path().join("reports"));
    for campaign in CAMPAIGNS {
        let kinds = ["simulated", "gait", "wheels", "d-v", "models", "sigma", "residuals"];
        let of_passive_joint =
            ["from-rest", "sweep", "alpha"].iter().filter(|_| campaign == "pulled");
        for figure in kinds.iter().chain(of_passive_joint) {
            for extension in ["svg", "png", "csv"] {
                let name = format!("figures/{campaign}-{figure}.{extension}");
                assert!(reports.contains_key(Path::new(&name)), "{name}");
            }
        }
    }
    let page = text(&reports[Path::new("index.html")]);
    assert!(CAMPAIGNS.iter().all(|campaign| page.contains(campaign)));
}

#[test]
fn a_frame_is_timed_by_the_configured_rate() {
    let folder = recorded();
    succeed(folder.path(), &["ingest", "raw/trolley"]);
    let poses = folder.path().join("derived/poses/trolley_pulled-2.00-r1.parquet");
    let poses = Table::read(&poses).expect("a table");
    assert_eq!(poses.values::<f64>("time_s").expect("times")[200], 1.0);
}

#[test]
fn labels_in_the_layout_may_name_the_subject() {
    let folder = recorded();
    succeed(folder.path(), &["ingest", "raw/trolley"]);
    let by_marker = trials(folder.path());

    // Two robots in view have markers with the same names, which only the subject distinguishes.
    for trial in &by_marker {
        let path = folder.path().join(format!("raw/trolley/{}", trial.file));
        let export = std::fs::read_to_string(&path).expect("a marker file");
        let lines: Vec<String> = export
            .lines()
            .enumerate()
            .map(|(i, line)| match i {
                0 | 1 => format!("{line}\r\n"),
                2 => format!("{}Idle:A1,,,\r\n", line.replace("Snake:", "Robo:")),
                3 => format!("{line},X,Y,Z\r\n"),
                4 => format!("{line},mm,mm,mm\r\n"),
                _ => format!("{line},1,2,3\r\n"),
            })
            .collect();
        std::fs::write(&path, lines.concat()).expect("the file can be written");
    }
    let ambiguous = trilink(folder.path(), &["ingest", "raw/trolley"]);
    assert_eq!(ambiguous.status.code(), Some(1));
    assert!(text(&ambiguous.stderr).contains("Idle:A1"), "{}", text(&ambiguous.stderr));

    let mut layout = PIPELINE.to_owned();
    for link in ["A", "B", "C"] {
        for number in 1..=3 {
            let label = format!("{link}{number}");
            layout = layout.replace(&format!("\n{label} ="), &format!("\n\"Robo:{label}\" ="));
        }
    }
    write(folder.path(), "pipeline.toml", &layout);
    succeed(folder.path(), &["ingest", "raw/trolley"]);
    for (by_subject, by_marker) in trials(folder.path()).iter().zip(&by_marker) {
        assert_eq!(by_subject.trial, by_marker.trial);
        assert_eq!(by_subject.metrics.d_m.to_bits(), by_marker.metrics.d_m.to_bits());
        assert_eq!(by_subject.residual_mm, by_marker.residual_mm);
    }
}

/// Names used in the demo and their replacements. Campaign names come first, because they contain other names.
const RENAMED: [(&str, &str); 8] = [
    ("kinematic-skewed", "zigzag"),
    ("kinematic-symmetric", "meander"),
    ("semi-passive-symmetric", "amble"),
    ("semi-passive", "steel"),
    ("kinematic", "walnut"),
    ("passive-symmetric", "trailing"),
    ("symmetric", "level"),
    ("skewed", "slanted"),
];

/// Returns the reports of the demo at two frequencies, after `renamed` has replaced names in the paths and contents of
/// its configuration, lists of trials and marker files.
fn demo_of(renamed: impl Fn(String) -> String) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut config = Config::default();
    (config.fit.starts, config.fit.bootstrap) = (2, 2);
    // Keep only the last two models of each campaign.
    config.campaign.values_mut().for_each(|campaign| drop(campaign.models.drain(..2)));
    let settings = toml::to_string(&config).expect("a configuration is TOML");
    let (written, folder) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    write(written.path(), "pipeline.toml", &settings);
    succeed(written.path(), &["-q", "synth", "raw/demo", "--omega", "2,3.9", "--seed", "1"]);
    for (name, bytes) in files(written.path()) {
        let place = folder.path().join(renamed(name.display().to_string()));
        std::fs::create_dir_all(place.parent().unwrap()).unwrap();
        std::fs::write(place, renamed(text(&bytes))).unwrap();
    }
    succeed(folder.path(), &["-q", "run"]);
    files(&folder.path().join("reports"))
}

#[test]
fn the_demo_under_other_names_has_the_same_figures_panel_for_panel_and_value_for_value() {
    let known = demo_of(|text| text);
    let found =
        demo_of(|text| RENAMED.iter().fold(text, |text, (old, new)| text.replace(old, new)));
    let by_old_names =
        |bytes: &[u8]| RENAMED.iter().fold(text(bytes), |text, (old, new)| text.replace(new, old));
    // In these files, panels and layers are sorted by the names of the campaigns.
    let is_by_name = |name: &Path| name.ends_with("truth.csv") || name.ends_with("work.csv");
    let values = |(name, bytes): (&PathBuf, &Vec<u8>)| {
        let csv = by_old_names(bytes);
        let mut lines: Vec<&str> = csv.lines().collect();
        if is_by_name(name) {
            lines = lines.into_iter().map(|line| line.split_once(',').unwrap().1).collect();
            lines.sort_unstable();
        }
        (lines.join("\n"), name.display().to_string())
    };
    let tables = |files: &BTreeMap<PathBuf, Vec<u8>>| -> BTreeMap<String, String> {
        let is_table = |name: &Path| name.extension().is_some_and(|extension| extension == "csv");
        files.iter().filter(|(name, _)| is_table(name)).map(values).collect()
    };
    let [known_tables, found_tables] = [&known, &found].map(tables);
    assert_eq!([known_tables.len(), found_tables.len()], [38; 2]);
    for (values, name) in &known_tables {
        assert!(found_tables.contains_key(values), "no figure has what {name} has");
    }
    // Count panels, legend keys, series, points with trials, and bands on every page except the scorecard, which
    // belongs to the paper.
    let pages = |files: &BTreeMap<PathBuf, Vec<u8>>| -> BTreeMap<String, [usize; 5]> {
        let is_page = |name: &Path| name.starts_with("trials") || name == Path::new("index.html");
        let count = |(name, page): (&PathBuf, &Vec<u8>)| {
            let page = text(page);
            let parts = ["class=\"panel", "class=\"key", "data-name", "data-points", "data-band"];
            (
                by_old_names(name.display().to_string().as_bytes()),
                parts.map(|part| page.matches(part).count()),
            )
        };
        files.iter().filter(|(name, _)| is_page(name)).map(count).collect()
    };
    assert!(pages(&known)["index.html"].iter().all(|count| *count > 0));
    assert_eq!(pages(&known).len(), 10);
    assert_eq!(pages(&known), pages(&found));
}
