//! Tests of histories of synthetic runs.

use std::path::Path;

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Normal};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{ByParameter, Quantity};
use trilink_tables::config::Config;
use trilink_tables::{
    Column, Columns as _, FitRow, Provenance, RunStatus, Table, TrialRow, UtcTime, numbers, texts,
};

use crate::compare::history::{ACCEPTED, HistoryRow, INADEQUATE, TRIAL_ADDED, TRIAL_REMOVED};
use crate::compare::record_run;
use crate::compare::trend;

fn config(folder: &Path) -> Config {
    let mut config = Config::default();
    config.paths.start_at(folder);
    std::fs::create_dir_all(&config.paths.reports).unwrap();
    config
}

/// Returns a history row for a run. Run 1 is dated 12 November 2026, and each later run is one day after the previous
/// one.
fn run(number: i64) -> HistoryRow {
    let start = chrono::NaiveDate::from_ymd_opt(2026, 11, 11).unwrap();
    let day = start + chrono::Days::new(number as u64);
    HistoryRow {
        time: UtcTime::parse(&format!("{day}T02:31:07Z")).unwrap(),
        run: number,
        status: Some(RunStatus::Ok),
        version: "0.1.0".to_owned(),
        program: "0123456789abcdef".to_owned(),
        configuration: "fedcba9876543210".to_owned(),
        ..HistoryRow::blank()
    }
}

/// Returns history rows for `count` runs with two coefficients of 100 with a standard error of 0.5. If `step` gives a
/// run and a shift, the second coefficient shifts from that run on.
fn runs(count: i64, seed: u64, step: Option<(i64, f64)>) -> Vec<HistoryRow> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(100.0, 0.5).unwrap();
    let mut rows = Vec::new();
    for number in 1..=count {
        let shift = step.filter(|(from, _)| number >= *from).map_or(0.0, |(_, shift)| shift);
        for (quantity, shift) in [("skid0_kg_s", 0.0), ("skid1_kg_s", shift)] {
            let value = normal.sample(&mut random) + shift;
            rows.push(HistoryRow {
                campaign: "skewed".to_owned(),
                model: "skid-roll".to_owned(),
                quantity: quantity.to_owned(),
                value,
                lower: value - 2.0,
                upper: value + 2.0,
                value_se: 0.5,
                ..run(number)
            });
        }
        for (quantity, value) in
            [("trials ok", 12.0), ("trials failed", 0.0), ("fit_s of run", 3.5)]
        {
            rows.push(HistoryRow { quantity: quantity.to_owned(), value, ..run(number) });
        }
    }
    rows
}

fn event(number: i64, quantity: &str, note: &str) -> HistoryRow {
    HistoryRow { quantity: quantity.to_owned(), note: note.to_owned(), value: 3.0, ..run(number) }
}

/// Renders the page for a history, with each run of white space replaced by a single space.
fn page(rows: &[HistoryRow]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let config = config(folder.path());
    trend::write(&config, rows).unwrap();
    let page = std::fs::read_to_string(config.paths.reports.join(trend::PAGE)).unwrap();
    page.split_whitespace().collect::<Vec<_>>().join(" ")
}

const NO_STEP: &str = "No figure of merit has shifted by more than";

#[test]
fn a_planted_step_is_reported_with_its_run_and_the_changes() {
    let mut rows = runs(40, 1, Some((21, 10.0)));
    let step = |rows: &[HistoryRow]| {
        let page = page(rows);
        let (_, steps) = page.split_once("<h2 id=\"steps\">").unwrap();
        steps.split_once("</section>").unwrap().0.to_owned()
    };
    let unchanged = step(&rows);
    for text in [
        "<li>skid of the front wheel (wheel 1) +10.2",
        " % in skewed (skid-roll), from ",
        "On 2026-12-02 in <a href=\"#run-21\">run 21</a> (neither the program, the configuration nor the trials changed)",
    ] {
        assert!(unchanged.contains(text), "{unchanged}");
    }
    assert_eq!(unchanged.matches("<li>").count(), 1, "{unchanged}");
    let from = rows.iter().position(|row| row.run == 21).unwrap();
    let mut change = |to: fn(&mut HistoryRow), said: &str| {
        rows[from..].iter_mut().for_each(to);
        let found = step(&rows);
        assert!(found.contains(said), "{said}: {found}");
    };
    change(|row| row.input = "other files".to_owned(), "(neither the program");
    change(|row| row.program = "another".to_owned(), "run 21</a> (the program changed)");
    let both = "(the program changed; the configuration changed)";
    change(|row| row.configuration = "another".to_owned(), both);
    let newer = "(trilink 0.2.0 replaced trilink 0.1.0; the configuration changed)";
    change(|row| row.version = "0.2.0".to_owned(), newer);
    change(
        |row| {
            (row.program, row.configuration, row.version) =
                (String::new(), String::new(), "0.1.0".to_owned())
        },
        "(the cause is unknown, because the history has no hash of the program)",
    );

    // Files alone, then trials.
    let mut rows = runs(40, 1, Some((21, 10.0)));
    rows.iter_mut().for_each(|row| row.input = if row.run < 21 { "one" } else { "two" }.to_owned());
    assert!(step(&rows).contains("(the marker files of the trials changed)"));
    rows.extend(["a", "b", "<c>", "d"].map(|trial| event(21, TRIAL_ADDED, trial)));
    rows.push(event(21, TRIAL_REMOVED, "e"));
    let named = "(4 trials added: a, b, &lt;c&gt;, ...; 1 trial removed: e)";
    assert!(step(&rows).contains(named), "{}", step(&rows));
}

#[test]
fn only_values_with_the_same_basis_are_compared() {
    let mut rows = runs(30, 1, Some((21, 10.0)));
    let steps = |rows: &[HistoryRow]| page(rows).matches(" (wheel 1) +").count();
    assert_eq!(steps(&rows), 1);
    // A mean over other frequencies has another level, and an inadequate model has none.
    for basis in ["1.00, 2.00", INADEQUATE] {
        for row in rows.iter_mut().filter(|row| row.run > 20) {
            row.basis = basis.to_owned();
        }
        assert_eq!(steps(&rows), 0, "{basis}");
    }
}

#[test]
fn noise_alone_is_no_step() {
    let wrong = (0..200).filter(|seed| !page(&runs(30, *seed, None)).contains(NO_STEP)).count();
    println!("{wrong} of 200 histories of 30 runs report a false step");
    assert_eq!(wrong, 0);
}

#[test]
fn the_page_marks_baselines_their_tolerance_and_every_run() {
    let mut rows = runs(30, 2, Some((25, 10.0)));
    let bare = page(&rows);
    const BASELINE: &str = "data-name=\"accepted baseline and tolerance\"";
    assert!(!bare.contains(BASELINE) && !bare.contains("Accepted as new baselines"));
    rows.push(event(10, ACCEPTED, "new tyres"));
    rows.push(HistoryRow {
        note: "trials.toml: gone".to_owned(),
        status: Some(RunStatus::Failed),
        ..run(31)
    });
    let page = page(&rows);
    assert!(page.contains(&format!("<g {BASELINE} data-band=")), "the band");
    assert!(page.contains("run 10</a>: new tyres <span class=\"soft\">(3 differences"));
    for number in 1..=31 {
        let day = run(number).time[..10].to_owned();
        let row = format!(
            "<tr id=\"run-{number}\" tabindex=\"-1\"><th scope=\"row\"><a href=\"#run-{number}\">run {number}, {day} 02:31</a>"
        );
        assert!(page.contains(&row), "{row}");
        // The marker of the run has the same name, for the script.
        assert!(number == 31 || page.contains(&format!(" run {number}, {day} 02:31 ")), "{number}");
    }
    assert!(page.contains(">12 ok</td>") && page.contains("trials.toml: gone"));
    assert!(page.contains("out of tolerance</span> since <a href=\"#run-25\">run 25</a>"));
    // The axis shows days, and no fractional run numbers.
    assert!(page.contains(" Dec</text>") && !page.contains(">0.5</text>"));
    let one = self::page(&runs(1, 1, None));
    assert!(
        !one.contains("<svg class=\"panel\"") && one.contains("skid-roll: skid of the front wheel")
    );
    assert!(one.contains(NO_STEP));
    let two = self::page(&runs(2, 1, None));
    assert!(two.contains(">12 Nov</text>") && !two.contains(">0.9995<") && two.contains(NO_STEP));
    let none = self::page(&[]);
    assert!(none.contains("0 runs") && none.contains(NO_STEP));
}

#[test]
fn a_thousand_runs_are_one_page_of_bounded_size() {
    let rows = runs(1000, 3, Some((700, 10.0)));
    let start = std::time::Instant::now();
    let page = page(&rows);
    println!("{} bytes in {:?}", page.len(), start.elapsed());
    assert!(page.len() < 1_500_000, "{}", page.len());
    assert!(page.contains("<a href=\"#run-700\">run 700</a>") && page.contains("id=\"run-1\""));
    assert!(page.contains("<g data-name=\"95 % interval\" data-band="), "intervals as a band");
}

#[test]
fn runs_with_and_without_intervals_share_a_legend_entry() {
    let mut rows = runs(5, 3, None);
    for row in rows.iter_mut().filter(|row| row.quantity == "skid0_kg_s") {
        (row.lower, row.upper) = (f64::NAN, f64::NAN);
    }
    let page = page(&rows);
    assert!(!page.contains("class=\"key\" data-name=\"run"));
}

#[test]
fn a_history_with_fewer_columns_is_continued() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(folder.path());
    let rows = runs(3, 1, None);
    let text = |name: &str, of: fn(&HistoryRow) -> &str| texts(name, rows.iter().map(of));
    let former = Table::new(vec![
        text("time", |row| &row.time),
        Column::new("run".into(), rows.iter().map(|row| row.run).collect::<Vec<_>>()),
        text("version", |row| &row.version),
        text("campaign", |row| &row.campaign),
        text("model", |row| &row.model),
        text("quantity", |row| &row.quantity),
        numbers("value", rows.iter().map(|row| row.value).collect()),
        text("note", |row| &row.note),
    ]);
    let path = config.paths.history.clone();
    former.write(&path, &Provenance { input: "runs".to_owned() }).unwrap();
    let trial = |name: usize| TrialRow {
        trial: name.to_string(),
        campaign: "skewed".to_owned(),
        metrics: GaitMetrics { d_m: 0.4, ..GaitMetrics::blank() },
        metrics_se: GaitMetrics { d_m: 0.001, ..GaitMetrics::blank() },
        ..TrialRow::blank()
    };
    let of_skid0 = |value: f64| {
        ByParameter::from_fn(|of| if of == Quantity::Skid.parameter(0) { value } else { f64::NAN })
    };
    let fit = FitRow {
        campaign: "skewed".to_owned(),
        free: vec![Quantity::Skid.parameter(0)],
        parameters: of_skid0(101.0),
        lower: of_skid0(99.0),
        upper: of_skid0(103.0),
        ..FitRow::blank()
    };
    let derived = &config.paths.derived;
    let made = Provenance { input: "made up".to_owned() };
    let trials: Vec<TrialRow> = (0..10_000).map(trial).collect();
    TrialRow::to_table(&trials).write(&derived.join("trials.parquet"), &made).unwrap();
    FitRow::to_table(&[fit]).write(&derived.join("fits.parquet"), &made).unwrap();
    let start = std::time::Instant::now();
    assert_eq!(record_run(&config).unwrap(), None, "it is not damaged");
    println!("ten thousand trials are remembered in {:?}", start.elapsed());
    assert!(start.elapsed().as_secs() < 10);
    let table = Table::read(&path).unwrap();
    let dtype = table.frame.column("time").unwrap().dtype().to_string();
    assert_eq!(dtype, "datetime[ms, UTC]");
    let all = HistoryRow::from_table(&table).unwrap();
    assert_eq!(all.iter().map(|row| row.run).max(), Some(4));
    for (known, row) in rows.iter().zip(&all) {
        let HistoryRow { time, run, version, quantity, value, .. } = known;
        assert_eq!(
            (time, run, version, quantity, value),
            (&row.time, &row.run, &row.version, &row.quantity, &row.value)
        );
        assert!(row.status.is_none() && row.lower.is_nan() && row.program.is_empty());
    }
    let fourth: Vec<&HistoryRow> = all.iter().filter(|row| row.run == 4).collect();
    let trials = fourth.iter().filter(|row| row.quantity == "trial").count();
    assert_eq!(trials, 10_000, "the trials that there are");
    assert!(!fourth.iter().any(|row| row.quantity == TRIAL_ADDED), "no trial came");
    let fitted = fourth.iter().find(|row| row.quantity == "skid0_kg_s").unwrap();
    assert!(fitted.lower < fitted.value && fitted.upper > fitted.value && fitted.value_se > 0.0);
}
