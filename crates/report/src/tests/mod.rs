//! Tests of the whole report, made from synthetic tables.

mod chains;
mod hostile;
pub(super) mod made_up;
mod missing;
mod names;
mod print;
mod recording;
mod replay;
#[allow(unreachable_pub)]
#[path = "../../../../tests/it/common/temporary.rs"]
mod temporary;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::OnceLock;

use trilink_mechanics::{FromRest, Model, MotionStatus};
use trilink_tables::config::{Config, FigureWidth, RobotConfig};
use trilink_tables::{
    CheckRow, Columns as _, ComparisonRow, FitStatus, Provenance, Reader, RobotParameterRow,
    Severity, TrialRow, TrialStatus,
};

use super::tables::Tables;
use super::*;
use made_up::{SEMI_PASSIVE, SKEWED, Tables as MadeUp};
use temporary::temporary;

/// Returns the plotted data of a figure as CSV.
fn csv_of(figure: &Figure) -> String {
    String::from_utf8(figure.encode(Format::Csv).expect("draws")).expect("text")
}

/// Start of the HTML code for a figure on a page, up to the figure's text alternative.
const SHEET: &str = "<div class=\"sheet\" role=\"group\" aria-label=\"";

fn report(config: &Config) -> Result<Reported, ReportError> {
    let input = ReportInput::new(config, BTreeSet::new());
    let content = Content::read(&input, Reader::default())?;
    let written = content.write(&input, &BTreeSet::new(), &BTreeSet::new(), &Default::default())?;
    Ok(written.reported)
}

fn config(folder: &Path) -> Config {
    let mut config = Config::default();
    config.paths.raw = vec!["raw".into()];
    config.paths.start_at(folder);
    // One robot has a parameter with a standard deviation, and the other has none.
    let robot = config
        .robot
        .get_mut("kinematic")
        .and_then(RobotConfig::three_links_mut)
        .expect("the robot");
    robot.set_deviation(trilink_robot::Quantity::H, [0.0005]);
    config
}

fn reported(tables: &MadeUp, folder: &Path) -> Reported {
    tables.write(&folder.join("derived"));
    report(&config(folder)).expect("reports")
}

/// Returns a shared report on the paper's campaigns with known true parameters; tests must not modify its files.
fn standard() -> &'static (tempfile::TempDir, Reported) {
    static STANDARD: OnceLock<(tempfile::TempDir, Reported)> = OnceLock::new();
    STANDARD.get_or_init(|| {
        let folder = temporary();
        let raw = folder.path().join("raw");
        std::fs::create_dir_all(&raw).expect("a folder");
        std::fs::write(raw.join("truth.json"), made_up::truth()).expect("writes");
        let reported = reported(&MadeUp::of_the_paper(), folder.path());
        (folder, reported)
    })
}

/// Writes a report like [`reported`], but without the campaign [`SEMI_PASSIVE`], whose simulations take long.
fn reported_in_short(tables: &MadeUp, folder: &Path) -> Reported {
    tables.write(&folder.join("derived"));
    let mut config = config(folder);
    config.campaign.remove(SEMI_PASSIVE);
    report(&config).expect("reports")
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Returns the contents of the files in a report folder and its subfolders, keyed by file name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    for place in [folder.to_owned(), folder.join("figures"), folder.join("trials")] {
        for entry in std::fs::read_dir(place).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_file() {
                let name = path.file_name().expect("a name").to_string_lossy().into_owned();
                files.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    files
}

#[test]
fn the_papers_campaigns_yield_every_expected_figure() {
    let (folder, reported) = standard();
    let all: BTreeSet<String> = reported.figures.iter().cloned().collect();
    assert_eq!(all, names::all_stems());
    assert!(reported.missing.is_empty(), "{:?}", reported.missing);
    let files = files(&folder.path().join("reports"));
    for stem in names::all_stems() {
        assert!(files[&format!("{stem}.png")].starts_with(b"\x89PNG"));
        assert!(files[&format!("{stem}.csv")].len() > 100);
        assert!(files[&format!("{stem}.svg")].ends_with(b"</svg>\n"));
        assert!(files[&format!("{stem}.pdf")].starts_with(b"%PDF-"));
    }
    let page = std::str::from_utf8(&files["index.html"]).expect("a page");
    for stem in &reported.figures {
        for extension in ["svg", "png", "pdf", "csv"] {
            assert!(page.contains(&format!("href=\"figures/{stem}.{extension}\"")), "{stem}");
        }
    }
    for name in ["fits.json", "scorecard.json", "index.html"] {
        assert!(files.contains_key(name), "{name}");
    }
}

#[test]
fn identical_tables_produce_identical_bytes_in_any_folder() {
    let folders = [temporary(), temporary()];
    let [first, second] = folders.each_ref().map(|folder| {
        reported_in_short(&MadeUp::of_the_paper(), folder.path());
        files(&folder.path().join("reports"))
    });
    assert_eq!(first.keys().collect::<Vec<_>>(), second.keys().collect::<Vec<_>>());
    for (name, bytes) in &first {
        assert!(bytes == &second[name], "{name} differs");
    }
}

#[test]
fn a_campaign_without_trials_and_fits_is_skipped_and_named() {
    let folder = temporary();
    let mut tables = MadeUp::of_the_paper();
    tables.trials.retain(|row| row.campaign != SEMI_PASSIVE);
    tables.fits.retain(|row| row.campaign != SEMI_PASSIVE);
    tables.predictions.retain(|row| row.campaign != SEMI_PASSIVE);
    let reported = reported(&tables, folder.path());
    let gone = ["fig14", "fig15", "fig18", "fig20"];
    let is_left = |stem: &String| !gone.contains(&stem.as_str()) && !stem.starts_with(SEMI_PASSIVE);
    let left = names::all_stems().into_iter().filter(|stem| is_left(stem) && stem != "truth");
    assert!(reported.figures.iter().cloned().collect::<BTreeSet<_>>().into_iter().eq(left));
    let [missing] = reported.missing.as_slice() else { panic!("{:?}", reported.missing) };
    assert!(missing.contains(SEMI_PASSIVE) && missing.contains("neither a trial with results"));
    assert!(read(&reported.page).contains(&reported.missing[0]));
}

#[test]
fn missing_tables_are_named_and_a_single_trial_suffices() {
    let folder = temporary();
    let derived = folder.path().join("derived");
    let mut tables = MadeUp::of_the_paper();
    tables.trials.truncate(1);
    tables.write(&derived);
    const OPTIONAL: [&str; 9] = [
        "checks",
        "fits",
        "predictions",
        "comparison",
        "precision",
        "starts",
        "profiles",
        "bootstrap",
        "robot_parameters",
    ];
    for name in OPTIONAL {
        std::fs::remove_file(derived.join(format!("{name}.parquet"))).expect("was there");
    }
    let mut config = config(folder.path());
    config.campaign.remove(SEMI_PASSIVE);
    let reported = report(&config).expect("reports");
    let found: BTreeSet<&str> = reported.figures.iter().map(String::as_str).collect();
    let of_skewed = ["simulated", "wheels", "sigma"].map(|kind| format!("{SKEWED}-{kind}"));
    let printed = ["fig06", "fig09", "fig10", "fig16"];
    assert_eq!(found, printed.into_iter().chain(of_skewed.iter().map(String::as_str)).collect());
    for name in OPTIONAL {
        assert!(reported.missing.iter().any(|sentence| sentence.contains(name)), "{name}");
    }
    assert_eq!(read(&folder.path().join("reports/fits.json")), "[]\n");
}

#[test]
fn the_scorecard_is_written_even_without_trials_or_fits() {
    let folder = temporary();
    let reported = reported(&MadeUp::default(), folder.path());
    let json = read(reported.scorecard.as_ref().expect("a scorecard"));
    let entries: Vec<serde_json::Value> = serde_json::from_str(&json).expect("JSON");
    let of = |verdict: &str| entries.iter().filter(|entry| entry["verdict"] == verdict).count();
    let reproduced = of("reproduced");
    let differ = of("differs");
    assert!(reproduced > 40 && differ > 5, "{reproduced} {differ}");
    let page = read(&folder.path().join("reports/scorecard.html"));
    let sentence = format!(
        "Of the {} numbers and claims of the paper that are tested, {reproduced} are reproduced, {differ} differ and",
        entries.len()
    );
    assert!(page.contains(&sentence));
    assert_eq!(page.matches("<tr id=\"claim-").count(), entries.len());
    assert!(page.contains("<td class=\"n\">729<small>mm</small></td>\n<td class=\"n\">1292</td>"));
    // The index lists the claims that differ.
    let index = read(&reported.page);
    assert_eq!(index.matches("<a href=\"scorecard.html#claim-").count(), differ);
    assert!(!index.contains("<tr id=\"claim-"));
}

#[test]
fn a_project_without_the_papers_campaigns_has_no_scorecard() {
    let folder = temporary();
    let reports = folder.path().join("reports");
    std::fs::create_dir_all(&reports).expect("a folder");
    // A scorecard of an earlier configuration is removed.
    std::fs::write(reports.join("scorecard.json"), "[]").expect("writes");
    MadeUp::default().write(&folder.path().join("derived"));
    let mut config = config(folder.path());
    let campaigns = std::mem::take(&mut config.campaign).into_iter();
    config.campaign = campaigns.map(|(name, campaign)| (format!("own-{name}"), campaign)).collect();
    let reported = report(&config).expect("a report");
    assert_eq!(reported.scorecard, None);
    for name in ["scorecard.json", "scorecard.html"] {
        assert!(!reports.join(name).exists(), "{name}");
    }
    assert!(!read(&reported.page).contains("scorecard.html"));
}

#[test]
fn the_error_names_a_missing_table_of_trials() {
    let folder = temporary();
    let error = report(&config(folder.path())).expect_err("nothing to report");
    assert!(error.to_string().contains("trials.parquet"), "{error}");
}

#[test]
fn every_released_joint_of_a_robot_has_a_figure() {
    let folder = temporary();
    let derived = folder.path().join("derived");
    let mut tables = MadeUp::of_the_paper();
    tables.trials.retain(|row| row.campaign == SKEWED);
    tables.predictions.clear();
    tables.fits.clear();
    tables.write(&derived);
    let mut rows = tables.robots();
    let of_joint2 = rows.iter().find(|row| row.joint == 1).map(|row| RobotParameterRow {
        trial: "release-2".to_owned(),
        joint: 2,
        ..row.clone()
    });
    rows.extend(of_joint2);
    recording::write_release(&derived, "release-2");
    let provenance = Provenance { input: "made up".to_owned() };
    let table = RobotParameterRow::to_table(&rows);
    table.write(&derived.join("robot_parameters.parquet"), &provenance).expect("writes");
    let reported = report(&config(folder.path())).expect("reports");
    let page = read(&reported.page);
    for joint in [1, 2] {
        let stem = format!("semi-passive-joint{joint}-release");
        assert!(reported.figures.contains(&stem), "{:?}", reported.figures);
        assert!(page.contains(&format!("Release of joint {joint} of robot semi-passive")));
        assert!(page.contains(&format!("<td>semi-passive, joint {joint}</td>")));
    }
}

#[test]
fn user_defined_campaigns_get_their_own_figures() {
    let folder = temporary();
    let mut tables = MadeUp::of_the_paper();
    tables.trials.retain(|row| row.campaign == SKEWED);
    tables.predictions.retain(|row| row.campaign == SKEWED);
    tables.fits.clear();
    for row in &mut tables.trials {
        row.campaign = "über/<b>".to_owned();
    }
    for row in &mut tables.predictions {
        row.campaign = "über/<b>".to_owned();
        if row.model == Model::SKID {
            row.model = Model::new("<b>skid");
        }
    }
    tables.write(&folder.path().join("derived"));
    let mut config = config(folder.path());
    let campaign = config.campaign.remove(SKEWED).expect("the paper's");
    config.campaign = [("über/<b>".to_owned(), campaign)].into();
    let reported = report(&config).expect("reports");
    let kinds = ["simulated", "gait", "wheels", "d-v", "models", "sigma", "residuals"];
    let own = kinds.map(|kind| format!("_ber__b_-{kind}"));
    assert!(reported.figures.iter().eq(own.iter().chain([&"semi-passive-release".to_owned()])));
    assert!(reported.missing.is_empty(), "{:?}", reported.missing);
    assert!(!read(&reported.page).contains("<b>"));
    let svg = read(&folder.path().join("reports/figures/_ber__b_-sigma.svg"));
    assert!(!svg.contains("<b>") && svg.contains("&lt;b&gt;skid"));
}

#[test]
fn the_page_lists_every_check_and_the_measured_robot_parameters() {
    let folder = temporary();
    let mut tables = made_up::with_trouble(MadeUp::of_the_paper(), "lost");
    let info = CheckRow {
        trial: tables.trials[0].trial.clone(),
        check: "W007 long-gaps".to_owned(),
        severity: Severity::Info,
        value: 0.1,
        limit: 0.3,
        message: "1 cycle with gaps is left out".to_owned(),
    };
    let ok = CheckRow { severity: Severity::Ok, trial: "other".to_owned(), ..info.clone() };
    tables.checks.extend([info, ok]);
    let page = read(&reported_in_short(&tables, folder.path()).page);
    let counts = ["1", "1", "", ""].map(|count| format!("<td class=\"n\">{count}</td>")).concat();
    let (_, explained) = page.split_once("<summary>W007 long-gaps</summary>").expect("the check");
    let (what, row) = explained.split_once("</details>").expect("what it looks at");
    assert!(what.contains("<strong>What to do.</strong>"), "{what}");
    assert!(row.trim_start().starts_with(&format!("</th>{counts}")), "{row}");
    assert!(page.contains("<td class=\"n\">0.1875 ± 0.0012</td><td class=\"n\">0.188</td>"));
}

#[test]
fn messages_and_names_cannot_become_markup() {
    let folder = temporary();
    let hostile = "<img src=x onerror=alert(1)>";
    let mut tables = made_up::with_trouble(MadeUp::of_the_paper(), hostile);
    tables.trials[0].trial = hostile.to_owned();
    tables.fits[0].status = FitStatus::Failed;
    tables.fits[0].failure = hostile.to_owned();
    tables.checks[0].check = hostile.to_owned();
    tables.fits[1].model = Model::new(hostile);
    let page = read(&reported_in_short(&tables, folder.path()).page);
    let file = "_img_src_x_onerror_alert_1__.html";
    assert!(page.contains(&format!("<a href=\"trials/{file}\">&lt;img")));
    let own = read(&folder.path().join("reports/trials").join(file));
    assert!(own.contains("<h1>&lt;img src=x onerror=alert(1)&gt;</h1>"));
    assert!(!page.contains("<img src=x") && !own.contains("<img src=x"));
    assert!(page.matches("&lt;img src=x onerror=alert(1)&gt;").count() >= 5);
}

#[test]
fn every_trial_has_a_page_and_a_failed_trial_shows_no_motion() {
    let folder = temporary();
    let mut tables = MadeUp::of_the_paper();
    reported_in_short(&tables, folder.path());
    let place = folder.path().join("reports/trials");
    let page = read(&place.join("kinematic-symmetric-3.90-r1.html"));
    for text in [
        "Joint angle φ₂",
        "Skid velocity of wheel 1",
        "Gaps",
        "451.0 ± 5.0",
        "Longest missing",
        // Where it is, and what is beside it.
        "File <code>raw/kinematic-symmetric-3.90-r1.csv</code>, 120 frames per second",
        "Previous: <a href=\"kinematic-symmetric-3.50-r1.html\" rel=\"prev\">",
        "Next: <a href=\"kinematic-symmetric-4.50-r1.html\" rel=\"next\">",
        // The gait, heading and path with the models' motions drawn over them, and the results of each cycle.
        "data-name=\"no-skid\"",
        "data-name=\"skid-roll, fitted\"",
        "(b) Heading θ",
        "data-name=\"not used\"",
        ">no: one of the first 2, taken for transient</td>",
        // The column of predictions by skid-roll.
        "<th scope=\"col\" class=\"n\">skid-roll</th>",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert_eq!(page.matches(SHEET).count(), 6);
    let row = page.lines().find(|line| line.starts_with("<tr><th scope=\"row\">d <small>mm"));
    let row = row.expect("predictions of d");
    // The prediction is 663.466 mm; the measured value is (451.0 ± 5.0) mm.
    assert!(
        row.contains("<td class=\"n\">663.5<small>+47.11 %</small><small>43 SE</small>"),
        "{row}"
    );
    let mut of_skid = page.lines().filter(|line| line.starts_with("<tr><th scope=\"row\">σ₀</th>"));
    assert!(
        of_skid.any(|row| row.contains("<td class=\"n\">–</td>")),
        "no-skid predicts no skid ratio"
    );
    assert!(page.contains("<td class=\"n\">singular</td>"));
    let first = read(&place.join("kinematic-symmetric-0.50-r1.html"));
    assert!(first.contains("Next: <a") && !first.contains("Previous: <a"));
    // Link 1 is missing in 40 frames, which last 0.333 s.
    assert!(page.contains("<td class=\"n\">0.333</td>"));
    assert_eq!(std::fs::read_dir(&place).expect("a folder").count(), 36);
    tables.trials.truncate(2);
    tables.trials[1].status = TrialStatus::Failed;
    reported_in_short(&tables, folder.path());
    assert!(!read(&place.join(format!("{}.html", tables.trials[1].trial))).contains("Motion"));
}

#[test]
fn with_many_trials_only_important_and_requested_ones_have_pages() {
    let folder = temporary();
    let mut tables = MadeUp::of_the_paper();
    tables.trials.retain(|row| row.campaign == SKEWED);
    for nth in 2..4 {
        let repeats: Vec<TrialRow> = tables.trials[..12]
            .iter()
            .map(|row| TrialRow { trial: format!("{}{nth}", row.trial), ..row.clone() })
            .collect();
        tables.trials.extend(repeats);
    }
    tables.trials[20].status = TrialStatus::Failed;
    tables.trials[30].status = TrialStatus::Flagged;
    tables.write(&folder.path().join("derived"));
    let read_tables =
        Tables::read(&folder.path().join("derived"), &Reader::default()).expect("reads");
    let pages = |most: usize, asked: &str| -> BTreeSet<String> {
        let mut config = config(folder.path());
        config.report.trial_pages = most;
        let input = ReportInput::new(&config, [asked.to_owned()].into());
        let pages = trials::pages(&input, &read_tables);
        pages.into_values().map(|name| name.replace(".html", "")).collect()
    };
    let names =
        |rows: &[&TrialRow]| rows.iter().map(|row| row.trial.clone()).collect::<BTreeSet<_>>();
    let all: Vec<&TrialRow> = tables.trials.iter().collect();
    assert_eq!(pages(36, ""), names(&all));
    // The first trial at each frequency, the failed trial and the flagged trial.
    let mut some = all[..12].to_vec();
    some.extend([all[20], all[30]]);
    assert_eq!(pages(35, ""), names(&some));
    assert_eq!(pages(2, ""), names(&[all[20], all[30]]));
    assert_eq!(pages(1, &all[33].trial), names(&[all[20], all[33]]));
    assert_eq!(pages(0, "no-such-trial"), BTreeSet::new());

    let mut config = config(folder.path());
    config.report.trial_pages = 2;
    config.campaign.remove(SEMI_PASSIVE);
    let page = read(&report(&config).expect("reports").page);
    assert!(page.contains("2 of 36 trials have a page") && page.contains("report --trial NAME"));
    assert_eq!(
        page.matches("href=\"trials/").count(),
        6,
        "first, in the warnings and in the table"
    );
    assert!(page.contains(&format!("<th scope=\"row\">{}</th>", all[0].trial)));
    let written = std::fs::read_dir(folder.path().join("reports/trials")).expect("a folder");
    assert_eq!(written.count(), 2);
}

#[test]
fn the_page_stays_small_enough_with_a_thousand_trials() {
    let bytes = |repeats: usize| {
        let folder = temporary();
        let mut tables = MadeUp::of_the_paper();
        tables.trials.retain(|row| row.campaign == SKEWED);
        let first = tables.trials.clone();
        let messages = ["", "1 cycle with gaps is left out"];
        for nth in 2..=repeats {
            tables.trials.extend(first.iter().enumerate().map(|(i, row)| TrialRow {
                trial: format!("{}-{nth}", row.trial),
                status: [TrialStatus::Ok, TrialStatus::Flagged][i % 2],
                message: messages[i % 2].to_owned(),
                ..row.clone()
            }));
        }
        TrialRow::to_table(&tables.trials)
            .write(
                &folder.path().join("derived/trials.parquet"),
                &trilink_tables::Provenance { input: "made up".to_owned() },
            )
            .expect("writes");
        let mut config = config(folder.path());
        config.campaign.retain(|name, _| name == SKEWED);
        config.report.trial_pages = 1000;
        let input = ReportInput::new(&config, BTreeSet::new());
        let content = Content::read(&input, Reader::default()).expect("reads");
        let written = content
            .write(&input, &BTreeSet::new(), &BTreeSet::new(), &Default::default())
            .expect("writes");
        (read(&written.reported.page).len(), tables.trials.len())
    };
    let [(few, before), (many, after)] = [1, 20].map(bytes);
    let per_trial = (many - few) / (after - before);
    // At 1500 bytes per trial, a page of 500 kB for one campaign grows to 2 MB with a thousand trials.
    assert!((100..1500).contains(&per_trial), "{per_trial} bytes");
}

#[test]
fn a_trial_without_tables_is_reported_as_missing_from_the_figure() {
    let folder = temporary();
    let derived = folder.path().join("derived");
    MadeUp::of_the_paper().write(&derived);
    std::fs::remove_dir_all(derived.join("poses")).expect("can go");
    let mut config = config(folder.path());
    config.campaign.remove(SEMI_PASSIVE);
    let reported = report(&config).expect("reports");
    for figure in ["Figure semi-passive-release ", "Fig. 9 ", "Fig. 11 "] {
        let sentence = reported
            .missing
            .iter()
            .find(|sentence| sentence.starts_with(figure))
            .expect("a sentence");
        assert!(sentence.contains(".parquet"), "{sentence}");
    }
    assert!(!reported.figures.iter().any(|stem| stem == "fig09" || stem == "fig12"));
}

#[test]
fn the_page_says_which_motions_shown_are_not_reached_from_rest() {
    let folder = temporary();
    let mut tables = MadeUp::of_the_paper();
    assert!(!read(&standard().1.page).contains("starts from rest"));
    let rows = tables.predictions.iter_mut().filter(|row| row.from_rest.is_some());
    for (row, goes) in rows.zip([FromRest::Another, FromRest::Another, FromRest::Unsettled]) {
        (row.campaign, row.model) = (SKEWED.to_owned(), Model::NO_SKID);
        row.from_rest = Some(goes);
        row.status = MotionStatus::SymmetryBroken;
    }
    let page = read(&reported_in_short(&tables, folder.path()).page);
    for remark in [
        "no-skid: at 2 frequencies of the trials, the robot reaches a motion other than",
        "no-skid: at 1 frequency of the trials, the robot does not reach a steady motion when it starts from rest.",
        "show one of two motions that are mirror images of each other (status symmetry-broken).",
    ] {
        assert!(page.contains(remark), "{remark}");
    }
}

#[test]
fn the_page_loads_no_external_resources() {
    let page = read(&standard().1.page);
    assert!(!page.contains("http:") && !page.contains("https:") && !page.contains("<script src"));
    // Every figure except those that the page only links to, and the three campaigns' curves at the top of the page.
    let mut shown = names::all_stems();
    shown.retain(|stem| !["starts", "wheels", "d-v"].contains(&figures::kind(stem)));
    assert_eq!(page.matches(SHEET).count(), shown.len() + 3);
    for stem in names::all_stems() {
        assert!(page.contains(&format!("<a href=\"figures/{stem}.svg\">SVG</a>")), "{stem}");
    }
    assert_eq!(page.matches("base64,").count(), 1, "the font, once");
    assert!(page.len() < 1_200_000, "{} bytes", page.len());
}

#[test]
fn figures_embed_their_font_and_contain_no_machine_specific_data() {
    let (folder, _) = standard();
    let here = folder.path().to_string_lossy().into_owned();
    for stem in names::all_stems() {
        let svg = read(&folder.path().join(format!("reports/figures/{stem}.svg")));
        assert_eq!(svg.matches("font-family=").count(), 1);
        assert!(svg.contains(" font-family=\"Roboto, sans-serif\" "));
        assert!(svg.contains("@font-face{font-family:Roboto;src:url(data:font/ttf;base64,"));
        for path in [here.as_str(), env!("CARGO_MANIFEST_DIR"), "/usr/share", "file:"] {
            assert!(!svg.contains(path), "{stem}: {path}");
        }
    }
}

#[test]
fn the_csv_of_a_figure_contains_the_plotted_data() {
    let (folder, _) = standard();
    let csv = read(&folder.path().join("reports/figures/fig16.csv"));
    let mut lines = csv.lines();
    let header = "panel,campaign,series,kind,trial,omega_rad_s,d_mm,d_mm_error_95,d_mm_lo,d_mm_hi,\
                  v_mm_s,v_mm_s_error_95,v_mm_s_lo,v_mm_s_hi,origin";
    assert_eq!(lines.next(), Some(header));
    let measured = "kinematic-skewed,measured,measured,kinematic-skewed-0.50-r1";
    assert!(
        csv.contains(&format!("\na,{measured},0.5002,105.8,2.281048,,,,,,,synthetic\n")),
        "{csv}"
    );
    assert!(csv.contains(&format!("\nb,{measured},0.5002,,,,,")), "{csv}");
    assert!(csv.contains("\na,kinematic-skewed,no-skid,model,,6,122.405,,,,,,,,synthetic\n"));
    let profiles = read(&folder.path().join("reports/figures/kinematic-skewed-profiles.csv"));
    let header = "panel,title,layer,skid0_kg_s,delta_j_percent_of_j,skid1_kg_s,skid2_kg_s,origin";
    assert_eq!(profiles.lines().next(), Some(header));
    let residuals = read(&folder.path().join("reports/figures/kinematic-skewed-residuals.csv"));
    let header =
        "panel,title,trial,layer,omega_rad_s,residual_percent,residual_percent_error_95,origin";
    assert_eq!(residuals.lines().next(), Some(header));
    let numbers = csv
        .lines()
        .find(|line| line.starts_with("a,kinematic-skewed,skid-roll,model,,6,"))
        .expect("its end")
        .split(',')
        .skip(6)
        .take(4);
    let [value, _, low, high] = numbers.collect::<Vec<_>>()[..] else { panic!("four numbers") };
    let [value, low, high] = [value, low, high].map(|number| number.parse::<f64>().expect("one"));
    assert!((low / value - 0.98).abs() < 1e-8 && (high / value - 1.03).abs() < 1e-8);
    let of = |series: &str| csv.lines().filter(|line| line.contains(series)).count();
    assert_eq!(of(",measured,measured,"), 2 * 12);
    assert_eq!(of(",skid-roll,model,"), 2 * 56);
    assert_eq!(of(",no-skid-measured,model,"), 2 * 12);
    let singular = read(&folder.path().join("reports/figures/fig17.csv"));
    assert!(!singular.contains("no-skid-measured") && !singular.contains("NaN"));
    let page = read(&folder.path().join("reports/index.html"));
    for text in [
        "under the measured gait (commanded gait for no-skid); shaded",
        "Open diamonds: no-skid-measured under the measured gait of each",
    ] {
        assert!(page.contains(text), "{text}");
    }
}

#[test]
fn the_page_compares_the_models_and_the_two_gait_inputs() {
    let page = read(&standard().1.page);
    for text in [
        "The data prefer skid-roll: J = ",
        "<td class=\"n\">98.5 %</td>",
        "The models of this campaign are driven by the measured gait (commanded gait for no-skid).",
        "Fits with the commanded gait instead",
        // 1.02 times 104.21, from a model that does not fit.
        "<strong>106.3†</strong>",
        "<strong>104.2</strong>",
        "<td>kg&#x2f;s</td><td class=\"n\">98.4 to 111.9</td>\n\
         <td class=\"n\">2.1</td><td class=\"n\">2.7</td><td class=\"n\">3.4</td><td class=\"n\">31</td>\
         <td class=\"n\">2.04</td>",
        // Robot parameters that are taken as exact contribute no systematic uncertainty.
        "<td class=\"n\">2.1</td><td class=\"n\">none stated</td><td class=\"n\">2.1</td>",
        "<span class=\"status ok\">fits</span>",
        "<span class=\"status failed\">does not fit</span>",
        "<span class=\"soft\">not known</span>",
        "23.7<small>at most 1.38</small>",
        "the measured d is 7.0 to 119 % above that of the model at 4.5 to 6 rad&#x2f;s",
        "No confidence intervals: no-skid-damped (neither replicates nor profiles were requested).",
        "<strong>kinematic-symmetric</strong>: raw skid ratios are fitted for the trials that have no debiased ones: \
         &lt;one&gt;",
        "The intervals do not include the uncertainty of these parameters of robot kinematic, which are \
         taken as exact: l_m, b_m, mass_kg, inertia_kg_m2, \
         roll_kg_s.",
        "To include the uncertainty of the parameters of robot semi-passive in the intervals",
        "21.3 to ∞",
        "practically not identifiable",
        "<td class=\"n\">8</td><td class=\"n\">3</td><td class=\"n\">1.2 %</td><td class=\"n\">5.0</td>\
         <td class=\"n\">3.4 %</td><td class=\"n\">2.3</td>",
        "<td class=\"n\">5.0</td><td class=\"n\">–</td><td>all trials are of one day</td>",
    ] {
        assert!(page.contains(text), "{text}");
    }
    // A robot without any standard deviation is noted at the tables of its coefficients.
    let exact = "Limits take the robot’s declared parameters as exact.";
    for (campaign, expected) in [(SKEWED, false), (SEMI_PASSIVE, true)] {
        let label = format!("Fitted models of campaign {campaign}: ");
        let (_, table) = page.split_once(&label).expect("a table");
        let has_note = table.split("</table>").next().is_some_and(|table| table.contains(exact));
        assert_eq!(has_note, expected, "{campaign}");
    }
    let of_all = format!("Limits of {SEMI_PASSIVE} take the declared parameters");
    assert!(page.contains(&of_all), "{of_all}");
}

#[test]
fn fits_json_has_null_for_missing_values() {
    let (folder, _) = standard();
    let json = read(&folder.path().join("reports/fits.json"));
    let fits: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(fits.as_array().map(Vec::len), Some(12));
    let of = |campaign: &str, model: &str| {
        let fits = fits.as_array().expect("an array").iter();
        let mut fits = fits.filter(|fit| fit["campaign"] == campaign && fit["model"] == model);
        fits.next().expect("a fit").clone()
    };
    assert!(of(SKEWED, "no-skid")["parameters"]["skid0_kg_s"].is_null());
    assert_eq!(of(SKEWED, "skid-roll")["parameters"]["skid0_kg_s"], 104.21);
    let fit = of(SKEWED, "skid-roll");
    assert_eq!(fit["at_bound"][0], "skid2_kg_s");
    assert_eq!(fit["intervals"]["skid0_kg_s"], serde_json::json!([98.4, 111.9]));
    // The interval has no upper limit.
    assert_eq!(fit["intervals"]["skid1_kg_s"], serde_json::json!([21.3, null]));
    assert!(fit["intervals"]["roll0_kg_s"].is_null());
    assert_eq!(fit["comparison"]["wins"], 0.985);
    assert_eq!((&fit["adequate"], &fit["lack_of_fit"]), (&true.into(), &1.04.into()));
    assert_eq!(fit["other_gait"]["gait_input"], "commanded");
    assert_eq!(fit["other_gait"]["parameters"]["skid0_kg_s"], 1.02 * 104.21);
    let unknown = of(SKEWED, "no-skid-measured");
    assert!(unknown["adequate"].is_null() && unknown["other_gait"].is_null());
    assert!(unknown["lack_of_fit"].is_null());
}

#[test]
fn problems_of_a_campaign_are_shown_first_and_in_its_section() {
    let folder = temporary();
    let mut tables = made_up::with_trouble(MadeUp::of_the_paper(), "a line");
    let message = "joint 2 moves with a phase of 90 deg, configured are -90 deg";
    tables.checks.push(CheckRow {
        trial: SKEWED.to_owned(),
        check: "E004 common-reason".to_owned(),
        severity: Severity::Error,
        message: message.to_owned(),
        ..CheckRow::blank()
    });
    let page = read(&reported_in_short(&tables, folder.path()).page);
    let places: Vec<usize> = page.match_indices(message).map(|(place, _)| place).collect();
    let failed = page.find("Failed: no results").expect("a failed trial");
    let campaign = page.find("Campaign kinematic-skewed</h2>").expect("the campaign");
    assert!(places.len() >= 2 && places[0] < failed && places[1] > campaign, "{places:?}");
    assert!(page.contains("Problems of several trials"));
}

#[test]
fn control_characters_in_names_are_escaped() {
    let folder = temporary();
    let mut tables = MadeUp::of_the_paper();
    tables.trials[0].trial = "one\u{202e}txt.exe\u{1b}[2J".to_owned();
    tables.trials[0].message = "line\r\0".to_owned();
    let page = read(&reported_in_short(&tables, folder.path()).page);
    assert!(page.contains("one\\u{202e}txt.exe\\u{1b}[2J"), "the name is not on the page");
    assert!(!page.contains(['\u{202e}', '\u{1b}', '\r', '\0']));
}

#[test]
fn synthetic_trials_are_labelled_and_compared_with_their_true_values() {
    let page = read(&standard().1.page);
    assert!(page.contains("These trials are synthetic."));
    assert!(page.contains("d of 36 trials: within 0.20 % of the true values"));
    let notice = page.find("These trials are synthetic").expect("a notice");
    assert!(notice < page.find("<h2").expect("a section"));

    let folder = temporary();
    let plain = reported_in_short(&MadeUp::of_the_paper(), folder.path());
    assert!(!read(&plain.page).contains("synthetic"), "says synthetic without a truth.json");
    let raw = folder.path().join("raw");
    std::fs::create_dir_all(&raw).expect("a folder");
    std::fs::write(raw.join("truth.json"), "{ \"synthetic\": ").expect("writes");
    let broken = reported_in_short(&MadeUp::of_the_paper(), folder.path());
    assert!(broken.missing.iter().any(|sentence| sentence.contains("truth.json")));
}

#[test]
fn every_page_and_figure_file_states_that_its_trials_are_synthetic() {
    const SAID: &str = "Synthetic trials, not recorded";
    let holds =
        |bytes: &[u8], text: &str| bytes.windows(text.len()).any(|of| of == text.as_bytes());
    let plain = temporary();
    reported_in_short(&MadeUp::of_the_paper(), plain.path());
    let [synthetic, recorded] =
        [standard().0.path(), plain.path()].map(|folder| files(&folder.join("reports")));
    for (files, is_synthetic) in [(synthetic, true), (recorded, false)] {
        for (name, bytes) in &files {
            let says = |text: &str| assert_eq!(holds(bytes, text), is_synthetic, "{name}: {text}");
            match name.rsplit_once('.').expect("an ending").1 {
                "html" => ["<title>Synthetic trials: ", "synthetic.</strong>"].map(says).into(),
                "svg" => [">Synthetic trials, not recorded</text>"].map(says).into(),
                "png" => ["tEXtComment\0Synthetic trials, not recorded"].map(says).into(),
                "pdf" => ["/Subject (Synthetic trials, not recorded)"].map(says).into(),
                "tex" => {
                    ["with 95\\,\\% confidence intervals of the free parameters. The trials are synthetic"]
                        .map(says)
                        .into()
                }
                "csv" => {
                    let table = std::str::from_utf8(bytes).expect("text");
                    let (head, rows) = table.split_once('\n').expect("a head");
                    assert_eq!(head.ends_with(",origin"), is_synthetic, "{name}");
                    let all = rows.lines().all(|row| row.ends_with(",synthetic"));
                    assert_eq!(all, is_synthetic, "{name}");
                    Vec::new()
                }
                _ => Vec::new(),
            };
        }
        let page = std::str::from_utf8(&files["index.html"]).expect("text");
        let marks = page.matches("<p class=\"origin\">Synthetic trials</p>").count();
        let sheets = if is_synthetic { page.matches(SHEET).count() } else { 0 };
        assert_eq!(marks, sheets, "figures that are lifted out of the page");
        // The printed height of the figure is unchanged; the notice is added below the figure.
        let svg = std::str::from_utf8(&files["fig16.svg"]).expect("text");
        assert_eq!(svg.contains(SAID), is_synthetic);
    }
}

#[test]
fn the_folders_with_synthetic_trials_are_named() {
    let folder = temporary();
    let mut tables = MadeUp::of_the_paper();
    for row in &mut tables.trials {
        row.folder = if row.campaign == SKEWED { "computed" } else { "recorded" }.to_owned();
        row.id.clone_from(&row.trial);
    }
    tables.write(&folder.path().join("derived"));
    let mut config = config(folder.path());
    config.campaign.remove(SEMI_PASSIVE);
    config.paths.raw = ["computed", "recorded"].map(|name| folder.path().join(name)).into();
    for raw in &config.paths.raw {
        std::fs::create_dir_all(raw).expect("a folder");
    }
    std::fs::write(folder.path().join("computed/truth.json"), made_up::truth()).expect("writes");
    let reported = report(&config).expect("reports");
    let page = read(&reported.page);
    assert!(page.contains("Some of these trials are synthetic: the trials of computed."), "{page}");
    let says = |stem: &str| {
        read(&folder.path().join(format!("reports/figures/{stem}.svg")))
            .contains("Synthetic trials")
    };
    assert_eq!([says("fig16"), says("fig17")], [true, false]);
    let of_trial = |campaign: &str| {
        let trial = tables.trials.iter().find(|row| row.campaign == campaign).expect("a trial");
        read(&folder.path().join("reports").join(page_of(&trial.trial)))
    };
    assert!(of_trial(SKEWED).contains("This trial is synthetic."));
    assert!(!of_trial(made_up::SYMMETRIC).contains("synthetic"));
}

#[test]
fn a_failed_trial_is_shown_first_with_its_cause_and_its_page() {
    let folder = temporary();
    let cause = "kinematic-skewed-3.00-r2.csv, line 6: found `abc`, needed a number";
    let mut tables = made_up::with_trouble(MadeUp::of_the_paper(), cause);
    let page = read(&reported_in_short(&tables, folder.path()).page);
    let first = |page: &str| {
        let (_, first) = page.split_once("<main>").expect("a page");
        first.split_once("class=\"answers\"").expect("answers").0.replace('\n', " ")
    };
    let said = first(&page);
    let total = tables.trials.len();
    for text in [
        &format!("1 of {total} trials failed: no results"),
        "<li><a href=\"trials&#x2f;kinematic-skewed-3.00-r2.html\">kinematic-skewed-3.00-r2</a>: \
         kinematic-skewed-3.00-r2.csv, line 6: found `abc`, needed a number</li>",
        &format!("1 of {total} trials flagged: check their results"),
        "residual 0.62 mm, limit 0.5 mm</li>",
    ] {
        assert!(said.replace("trials/", "trials&#x2f;").contains(text), "{text}: {said}");
    }
    let [failed, flagged] = [" failed:", " flagged:"].map(|of| said.find(of).expect("a box"));
    assert!(failed < flagged);
    assert!(!said.contains(" more</a>"), "{said}");

    // If many trials failed, only the first are listed, with the total number.
    let failed = tables.trials.iter().find(|row| row.status == TrialStatus::Failed);
    let failed = failed.expect("one failed").clone();
    tables.trials.extend(
        (0..16).map(|nth| TrialRow { trial: format!("{}-{nth}", failed.trial), ..failed.clone() }),
    );
    let page = read(&reported_in_short(&tables, folder.path()).page);
    let said = first(&page);
    for text in [
        &format!("17 of {} trials failed: no results", total + 16),
        "<a href=\"#warnings\">and 12 more</a>",
    ] {
        assert!(said.contains(text), "{text}: {said}");
    }
    assert_eq!(said.matches("found `abc`").count(), 5, "{said}");
    let all = page.split_once("<h2 id=\"warnings\">").expect("the checks").1;
    // The checks list them together.
    assert_eq!(all.matches("found `abc`").count(), 1);
    assert!(all.contains(": 17 of "), "{all}");
}

#[test]
fn figures_and_replays_keep_their_colours_without_inline_styles() {
    let files = files(&standard().0.path().join("reports"));
    let page = std::str::from_utf8(&files["index.html"]).expect("text");
    let drawings = page.matches("<svg class=").count();
    let presented = "overflow=\"visible\" fill=\"none\" font-family=\"Roboto, sans-serif\" font-size=\"120\" viewBox=";
    assert!(drawings > 10);
    assert_eq!(page.matches(presented).count(), drawings);
    for (name, bytes) in files.iter().filter(|(name, _)| name.ends_with(".html")) {
        let page = std::str::from_utf8(bytes).expect("text");
        for markup in page.split("<svg").skip(1).map(|rest| rest.split("</svg>").next()) {
            let styled = markup.is_some_and(|markup| markup.contains(" style="));
            assert!(!styled, "{name}: {markup:?}");
        }
    }
}

/// Writes a report for visual inspection into the folder that an environment variable gives.
#[test]
#[ignore = "for the eye: TRILINK_LOOK=folder cargo test -p trilink-report --lib to_look_at -- --ignored"]
fn a_report_to_look_at() {
    let folder = std::env::var_os("TRILINK_LOOK").expect("TRILINK_LOOK names a folder");
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder.join("raw")).expect("a folder");
    std::fs::write(folder.join("raw/truth.json"), made_up::truth()).expect("writes");
    let message = "kinematic-skewed-3.00-r2.csv, line 6: found `abc`, needed a number";
    reported(&made_up::with_trouble(MadeUp::of_the_paper(), message), folder);
}

#[test]
fn figures_name_the_gait_input_and_show_inadequate_models_and_scatter() {
    let mut tables = MadeUp::of_the_paper();
    for fit in &mut tables.fits {
        fit.gait_input = trilink_tables::config::GaitInput::Commanded;
    }
    for fit in tables.fits.iter_mut().filter(|fit| fit.campaign == SKEWED) {
        fit.gait_input = trilink_tables::config::GaitInput::Measured;
        fit.adequate = Some(fit.model != Model::SKID_ROLL);
        fit.scatter = trilink_robot::ByParameter::from_fn(|of| 0.02 * fit.parameters[of]);
        if fit.model == Model::SKID_ROLL {
            fit.no_interval = Some(trilink_tables::NoIntervalReason::Inadequate.into());
        }
    }
    let folder = temporary();
    tables.write(&folder.path().join("derived"));
    let input = ReportInput::new(&config(folder.path()), BTreeSet::new());
    let content = Content::read(&input, Reader::default()).expect("reads");
    let figure = |stem: &str| {
        let mut figures = content.figures.iter().filter(|figure| figure.stem == stem);
        figures.next().unwrap_or_else(|| panic!("{stem}"))
    };
    let fig16 = figure("fig16");
    assert!(fig16.caption.contains("under the measured gait;"), "{}", fig16.caption);
    assert!(figure("fig17").caption.contains("under the commanded gait;"));
    let of_both = "commanded gait of some campaigns and the measured gait of others";
    assert!(figure("fig19").caption.contains(of_both));
    let names: Vec<&str> = fig16.panels[0].layers.iter().map(|layer| &*layer.name).collect();
    assert!(names.contains(&"skid-roll (does not fit)") && names.contains(&"skid"), "{names:?}");
    assert!(csv_of(fig16).contains(",skid-roll,model,"));
    let profiles = figure(&format!("{SKEWED}-profiles"));
    let bands = |model: &str| {
        let panels = profiles.panels.iter().filter(|panel| panel.title == model);
        let layers = panels.flat_map(|panel| &panel.layers).map(|layer| layer.name.as_str());
        ["95 % interval", "scatter"].map(|name| layers.clone().filter(|of| *of == name).count())
    };
    assert_eq!(bands("skid"), [3, 3]);
    assert_eq!(bands("skid-roll"), [0, 3]);
}

#[test]
fn figures_of_several_campaigns_show_the_preferred_model_of_each() {
    let folder = temporary();
    let mut tables = MadeUp::of_the_paper();
    let derived = folder.path().join("derived");
    for fit in tables.fits.iter_mut().filter(|fit| fit.model == Model::SKID) {
        fit.adequate = Some(true);
    }
    tables.write(&derived);
    let mut config = config(folder.path());
    config.campaign.remove(SEMI_PASSIVE);
    let path = derived.join("comparison.parquet");
    let rows: Vec<ComparisonRow> = Reader::default().rows(&path).expect("rows");
    let lines = |preferred: [(&str, Model); 2]| {
        let rows: Vec<ComparisonRow> = rows
            .iter()
            .map(|row| ComparisonRow {
                preferred: preferred.contains(&(row.campaign.as_str(), row.model)),
                ..row.clone()
            })
            .collect();
        let made = trilink_tables::Provenance { input: "made up".to_owned() };
        ComparisonRow::to_table(&rows).write(&path, &made).expect("writes");
        let input = ReportInput::new(&config, BTreeSet::new());
        let content = Content::read(&input, Reader::default()).expect("reads");
        let figure = content.figures.iter().find(|figure| figure.stem == "fig19").expect("fig19");
        let names = figure.panels[0].layers.iter().map(|layer| layer.name.clone());
        let mut names: Vec<String> = names.filter(|name| !name.contains("measured")).collect();
        names.sort();
        names
    };
    assert_eq!(
        lines([(SKEWED, Model::SKID), (made_up::SYMMETRIC, Model::SKID_ROLL)]),
        ["kinematic-skewed, skid", "kinematic-symmetric, skid-roll"]
    );
    // If the preferred model has no skid, it predicts no skid ratios, and the best-ranked model with skid is shown
    // instead; among the adequate models, skid-roll has the lowest criterion.
    assert_eq!(
        lines([(SKEWED, Model::NO_SKID), (made_up::SYMMETRIC, Model::SKID)]),
        ["kinematic-skewed, skid-roll", "kinematic-symmetric, skid"]
    );
}

#[test]
fn flagged_trials_have_a_distinct_style_and_residuals_keep_their_sign() {
    let mut tables = MadeUp::of_the_paper();
    let trial = tables.trials.iter_mut().find(|row| row.campaign == SKEWED).expect("a trial");
    trial.status = TrialStatus::Flagged;
    trial.sigma_debiased[1] = trilink_statistics::Estimate::new(0.0123, 0.0011);
    let flagged = trial.trial.clone();
    let omega_rad_s = trial.omega_rad_s;
    tables
        .predictions
        .iter_mut()
        .filter(|row| {
            (row.campaign.as_str(), row.model) == (SKEWED, Model::SKID)
                && (row.omega_rad_s - omega_rad_s).abs() < 0.01
        })
        .for_each(|row| row.metrics.d_m *= -3.0);
    let folder = temporary();
    tables.write(&folder.path().join("derived"));
    let mut config = config(folder.path());
    config.campaign.remove(SEMI_PASSIVE);
    let input = ReportInput::new(&config, BTreeSet::new());
    let content = Content::read(&input, Reader::default()).expect("reads");
    let figure = |stem: &str| {
        let mut figures = content.figures.iter().filter(|figure| figure.stem == stem);
        figures.next().unwrap_or_else(|| panic!("{stem}"))
    };
    let layer = |name: &str| {
        let mut layers = figure("fig16").panels[0].layers.iter();
        layers.find(|layer| layer.name == name).unwrap_or_else(|| panic!("{name}"))
    };
    assert_eq!(layer("flagged").trials, [flagged]);
    assert_eq!(layer("measured").trials.len(), 11);
    assert!(layer("flagged").look != layer("measured").look);
    let csv = csv_of(figure("fig16"));
    assert!(csv.contains("\na,kinematic-skewed,flagged,measured,kinematic-skewed-"), "{csv}");
    let residuals = figure(&format!("{SKEWED}-residuals"));
    let d = residuals.panels.iter().find(|panel| panel.title == "d").expect("a panel");
    assert!(d.beyond.contains("to \u{2212}"), "{}", d.beyond);
    let of = |name: &str| d.layers.iter().find(|layer| layer.name == name).expect("a layer");
    assert_eq!((of("measured").trials.len(), of("flagged").trials.len()), (11, 1));
    let page = read(&report(&config).expect("reports").page);
    assert!(page.contains("<td class=\"n\">0.0123(11)</td>"));
    assert!(page.contains("corrected for marker noise"));
}

#[test]
fn figures_from_known_data_are_unchanged() {
    let folder = temporary();
    reported_in_short(&MadeUp::of_the_paper(), folder.path());
    let files = files(&folder.path().join("reports"));
    let hash = |name: &str| trilink_tables::hash(&files[name])[..8].to_owned();
    let found = ["fig13", "kinematic-symmetric-profiles"]
        .map(|stem| [hash(&format!("{stem}.csv")), hash(&format!("{stem}.svg"))].join(" "));
    const KNOWN: &str = "154d1311 2a8e4a7f 20c971ad dbe14fb2";
    assert_eq!(found.join(" "), KNOWN);
}
