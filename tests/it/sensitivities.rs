//! Tests of fitted coefficients in `trilink simulate`, of its sensitivities, and of uncertainty budgets.

use std::path::Path;

use serde_json::Value;
use trilink_tables::{
    Columns, PredictionRow, PredictionSource, SENSITIVE_METRICS, SensitivityRow, Table,
};

use crate::common::fitted::{CAMPAIGN, OMEGAS, fitted, folder};
use crate::common::{succeed, text, trilink};

/// Returns the JSON output of `simulate` for the fitted campaign, and what it wrote to stderr.
fn simulate(folder: &Path, arguments: &[&str]) -> (Vec<Value>, String) {
    let begin = ["simulate", CAMPAIGN, "--model", "skid-roll", "--json"];
    let output = trilink(folder, &[&begin[..], arguments].concat());
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    (serde_json::from_str(&text(&output.stdout)).unwrap(), said)
}

#[test]
fn fitted_motions_and_their_intervals_are_those_of_the_predictions() {
    let (answers, said) = simulate(folder(), &["--omega", OMEGAS, "--fitted", "--bands"]);
    let table = Table::read(&folder().join("fits/predictions.parquet")).unwrap();
    let rows: Vec<PredictionRow> = PredictionRow::from_table(&table).unwrap();
    assert!(rows.iter().all(|row| (1.0..=5.0).contains(&row.omega_rad_s)), "beyond the trials");
    let rows = rows.iter().filter(|row| row.source == PredictionSource::Trial);
    let mut compared = 0;
    for (row, answer) in rows.zip(&answers) {
        assert!((answer["omega_rad_s"].as_f64().unwrap() - row.omega_rad_s).abs() < 1e-12);
        let why = row.no_interval.as_ref().map(ToString::to_string);
        assert_eq!(answer["no_interval"].as_str(), why.as_deref());
        assert_eq!(answer["fit"]["fitted_gait"], "commanded");
        for (found, known) in
            [(answer, &row.metrics), (&answer["lower"], &row.lower), (&answer["upper"], &row.upper)]
        {
            for (name, known) in [("d_m", known.d_m), ("v_m_s", known.v_m_s)] {
                let found = found[name].as_f64().unwrap();
                assert!((found / known - 1.0).abs() < 1e-6, "{name}: {found} and {known}: {said}");
            }
            let sigma = found["sigma"][1].as_f64().unwrap();
            assert!((sigma / known.sigma[1] - 1.0).abs() < 1e-5, "{sigma} {:?}", known.sigma);
            compared += 1;
        }
    }
    assert_eq!(compared, 18);
    // Settings override fits: a coefficient that is set has no uncertainty, but the gait may be set freely.
    let (other, _) =
        simulate(folder(), &["--omega", "3", "--fitted", "--bands", "--set", "amplitude1_deg=25"]);
    assert!(other[0]["lower"]["d_m"].as_f64() < other[0]["d_m"].as_f64(), "{other:?}");
    let set = ["--omega", "3", "--fitted", "--bands", "--set", "skid0_kg_s=90"];
    let (other, _) = simulate(folder(), &set);
    assert_eq!(other[0]["parameters"]["skid_kg_s"][0], 90.0);
    let why = other[0]["no_interval"].as_str().unwrap();
    assert!(why.contains("skid0_kg_s was set") && other[0]["lower"]["d_m"].is_null(), "{why}");
    let begin = ["simulate", CAMPAIGN, "--model", "skid-roll", "--omega", "3", "--fitted"];
    let csv = succeed(folder(), &[&begin[..], &["--bands", "--csv"]].concat());
    assert!(csv.starts_with("model,omega_rad_s,d_m,d_m_lo,d_m_hi,"), "{csv}");
    let table = succeed(folder(), &[&begin[..], &["--bands"]].concat());
    assert!(table.contains("95 % from"), "{table}");
}

#[test]
fn a_missing_fit_has_advice_and_a_doubtful_fit_a_warning() {
    let empty = tempfile::tempdir().unwrap();
    let refused = |folder: &Path, model: &str| {
        let output =
            trilink(folder, &["simulate", CAMPAIGN, "--model", model, "--omega", "3", "--fitted"]);
        assert_eq!(output.status.code(), Some(2));
        text(&output.stderr)
    };
    let said = refused(empty.path(), "skid");
    assert!(said.contains("no pipeline.toml and no trials in the current folder"), "{said}");
    let said = refused(folder(), "skid");
    assert!(
        said.contains("no fit of skid to campaign kinematic-symmetric, only of skid-roll"),
        "{said}"
    );
    assert!(said.contains("list skid under campaign.kinematic-symmetric.models"), "{said}");
    let doubtful = fitted(0.0);
    let (answers, said) = simulate(doubtful.path(), &["--omega", "3", "--fitted", "--bands"]);
    assert!(said.contains("it is not known whether the model fits the trials"), "{said}");
    assert!(answers[0]["fit"]["adequate"].is_null());
    assert!(answers[0]["no_interval"].as_str().unwrap().contains("noise"), "{answers:?}");
}

fn rows(folder: &Path, arguments: &[&str]) -> (Vec<SensitivityRow>, String) {
    let own = tempfile::tempdir().unwrap();
    let path = own.path().join("s.parquet");
    let begin = ["simulate", CAMPAIGN, "--model", "skid-roll", "--sensitivities"];
    let table = ["--table", path.to_str().unwrap()];
    let output = trilink(folder, &[&begin[..], &table, arguments].concat());
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    let rows = SensitivityRow::from_table(&Table::read(&path).unwrap()).unwrap();
    (rows, text(&output.stdout))
}

#[test]
fn the_contributions_to_an_uncertainty_budget_add_up() {
    let (found, printed) = rows(folder(), &["--omega", "3"]);
    let l = found.iter().find(|row| row.parameter == "l_m" && row.metric == "d_m").unwrap();
    assert_eq!((l.standard_deviation, l.parameter_value), (0.0005, 0.112));
    assert!((l.contribution - (l.derivative * 0.0005).abs()).abs() < 1e-15);
    assert!((l.elasticity - l.derivative * 0.112 / l.metric_value).abs() < 1e-12);
    for part in ["taken as exact: ", "standard deviation", "mass0_kg", "configured"] {
        assert!(printed.contains(part), "{part}: {printed}");
    }
    let (of_fit, _) = rows(folder(), &["--omega", "3", "--fitted"]);
    for rows in [&found, &of_fit] {
        for metric in SENSITIVE_METRICS.iter().filter(|metric| **metric != "alpha1_rad") {
            let own = || rows.iter().filter(|row| row.metric == *metric);
            let known = own().filter(|row| row.known_from.is_some());
            let sum: f64 = known.clone().map(|row| row.variance_part).sum();
            assert!((sum - 1.0).abs() < 1e-9, "{metric}: {sum}");
            // The variance of correlated parameters may differ from the sum of their variances.
            let alone: f64 = known.map(|row| row.contribution.powi(2)).sum();
            let deviation = own().next().unwrap().metric_deviation;
            assert!(deviation > 0.0 && alone > 0.0);
            if std::ptr::eq(rows, &found) {
                assert!((alone.sqrt() / deviation - 1.0).abs() < 1e-9, "{metric}");
            }
        }
    }
    let fitted = of_fit.iter().filter(|row| row.known_from.is_some_and(|of| of.name() == "fitted"));
    assert_eq!(fitted.count(), 3 * SENSITIVE_METRICS.len());
    // The fit depends on the length, so that part of the effect of an error in the length cancels. The total agrees
    // with the width of the interval, except for differences between neighbouring frequencies.
    let (answers, _) = simulate(folder(), &["--omega", "3", "--fitted", "--bands"]);
    let width = answers[0]["upper"]["sigma"][1].as_f64().unwrap()
        - answers[0]["lower"]["sigma"][1].as_f64().unwrap();
    let sigma1 = of_fit.iter().find(|row| row.metric == "sigma1").unwrap();
    let ratio = width / (2.0 * 1.96 * sigma1.metric_deviation);
    assert!((0.7..2.0).contains(&ratio), "{ratio}");
}

#[test]
fn sensitivities_are_printed_as_csv_and_json_and_drawn() {
    let own = tempfile::tempdir().unwrap();
    let begin = ["simulate", CAMPAIGN, "--model", "skid,no-skid", "--omega", "3"];
    let begin = [&begin[..], &["--sensitivities"]].concat();
    let csv = succeed(own.path(), &[&begin[..], &["--csv"]].concat());
    let json = succeed(own.path(), &[&begin[..], &["--json"]].concat());
    let json: Vec<Value> = serde_json::from_str(&json).unwrap();
    assert_eq!(csv.lines().count(), json.len() + 1);
    // Only coefficients in the model's laws are listed, and no sums.
    let is_roll = |row: &&Value| row["parameter"].as_str().unwrap().starts_with("roll");
    assert_eq!(json.iter().filter(is_roll).count(), 0);
    let of = |model: &str, parameter: &str, metric: &str, key: &str| {
        let mut rows = json.iter();
        let found = rows.find(|row| {
            row["model"] == model && row["parameter"] == parameter && row["metric"] == metric
        });
        found.unwrap()[key].clone()
    };
    assert_eq!(of("no-skid", "mass0_kg", "d_m", "derivative"), 0.0);
    assert!(of("skid", "offset1_deg", "d_m", "elasticity").is_null());
    assert!(of("no-skid", "h_m", "sigma0", "elasticity").is_null());
    let v = of("no-skid", "omega_rad_s", "v_m_s", "elasticity").as_f64().unwrap();
    assert!((v - 1.0).abs() < 1e-9, "{v}");

    let figure = [&begin[..], &["--figure", "s.svg"]].concat();
    let output = trilink(own.path(), &figure);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--figure: found 2 motions, needed one"));
    let one = ["simulate", CAMPAIGN, "--model", "skid", "--omega", "3", "--sensitivities"];
    for name in ["s.svg", "s.pdf"] {
        succeed(own.path(), &[&one[..], &["--figure", name]].concat());
        assert!(own.path().join(name).metadata().unwrap().len() > 1000);
    }
    let svg = std::fs::read_to_string(own.path().join("s.svg")).unwrap();
    for part in [">σ₀<", ">ω<", ">l<", ">α₂<"] {
        assert!(svg.contains(part), "{part}");
    }
    let output = trilink(own.path(), &[&one[..], &["--figure", "s.bmp"]].concat());
    assert_eq!(output.status.code(), Some(2));
    // Both joint angles pass 0: det W_b = 0 without condition (5).
    let singular = ["simulate", CAMPAIGN, "--model", "no-skid", "--omega", "3", "--sensitivities"];
    let output = trilink(own.path(), &[&singular[..], &["--set", "amplitude1_deg=31"]].concat());
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("det W_b"), "{}", text(&output.stderr));
}

#[test]
fn a_motion_beyond_the_trials_of_its_fit_says_so_wherever_it_is_written() {
    let (answers, said) = simulate(folder(), &["--omega", "3,12", "--fitted", "--bands"]);
    let beyond = "omega 12 rad/s (trials cover 1 to 5)";
    let of = |answer: &Value| (answer["extrapolated"].clone(), answer["beyond_trials"].clone());
    assert_eq!(of(&answers[0]), (Value::from(false), Value::from("")));
    assert_eq!(of(&answers[1]), (Value::from(true), Value::from(beyond)));
    let warning = format!(
        "warning: {CAMPAIGN} skid-roll: 1 of 2 motions are extrapolated beyond the trials of the \
         fit: {beyond}"
    );
    assert!(said.contains(&warning), "{said}");
    let (within, said) = simulate(folder(), &["--omega", "1,5", "--fitted"]);
    assert!(within.iter().all(|of| of["extrapolated"] == false), "{within:?}");
    assert!(!said.contains("extrapolated"), "{said}");
    let gait = ["--omega", "3", "--fitted", "--set", "amplitude1_deg=45", "offset2_deg=20"];
    let (other, said) = simulate(folder(), &gait);
    assert_eq!(
        other[0]["beyond_trials"],
        "amplitude1 45 degrees (trials cover only 30), offset2 20 degrees (trials cover only 0)"
    );
    assert!(said.contains("offset2 20 degrees (trials cover only 0)"), "{said}");
    // Coefficients that are not fitted get no note about extrapolation.
    let (configured, _) = simulate(folder(), &["--omega", "12"]);
    assert!(configured[0].get("extrapolated").is_none(), "{configured:?}");

    let begin = ["simulate", CAMPAIGN, "--model", "skid-roll", "--omega", "12"];
    let begin = [&begin[..], &["--fitted"]].concat();
    let printed = succeed(folder(), &begin);
    assert!(
        printed.contains("stable, reached from rest after 3 cycles, extrapolated"),
        "{printed}"
    );
    let own = tempfile::tempdir().unwrap();
    let file = |name: &str| own.path().join(name).display().to_string();
    let [csv, trajectory, page] = ["s.csv", "t.csv", "p.html"].map(file);
    succeed(folder(), &[&begin[..], &["--trajectory", &trajectory, "--page", &page]].concat());
    succeed(folder(), &[&begin[..], &["--sensitivities", "--table", &csv]].concat());
    for path in [&csv, &trajectory] {
        let text = std::fs::read_to_string(path).unwrap();
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        let column = lines[0].iter().position(|name| *name == "extrapolated").expect(path);
        assert!(lines[1..].iter().all(|line| line[column] == "true"), "{path}: {text}");
    }
    let page = std::fs::read_to_string(page).unwrap();
    assert!(page.contains("Extrapolated beyond the trials of the fit:</strong> omega 12 rad"));
    let line = ["design", CAMPAIGN, "--for", "d at 9", "--add", "2", "--omega", "3,8", "--json"];
    let output = trilink(folder(), &line);
    let said = text(&output.stderr);
    assert!(
        said.contains(
            "the fit: a trial: omega 8 rad/s (trials cover 1 to 5); d at 9: omega 9 rad/s"
        ),
        "{said}"
    );
    let advice: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    let of = |row: &Value| row["extrapolated"].clone();
    let [trials, expected] = ["trials", "expected"].map(|of| advice[of].as_array().unwrap());
    assert_eq!(trials.iter().map(of).collect::<Vec<_>>(), [false, true]);
    assert_eq!((of(&expected[0]), of(expected.last().unwrap())), (Value::Null, true.into()));
    let line = ["branches", CAMPAIGN, "--fitted", "--over", "omega_rad_s=4..6", "--json"];
    let output = trilink(folder(), &line);
    let said = text(&output.stderr);
    assert!(said.contains("skid-roll, the preferred model of the comparison"), "{said}");
    assert!(
        said.contains("omega 5.") && said.contains("to 6 rad/s (trials cover 1 to 5)"),
        "{said}"
    );
    let points: Vec<Value> = serde_json::from_str(&text(&output.stdout)).unwrap();
    for point in &points {
        let is_beyond = point["value"].as_f64().unwrap() > 5.0 * 1.005;
        assert_eq!(point["extrapolated"], is_beyond, "{point}");
    }
}

#[test]
fn without_the_trials_extrapolation_is_unknown() {
    let own = fitted(0.002);
    std::fs::remove_file(own.path().join("fits/trials.parquet")).unwrap();
    let (answers, said) = simulate(own.path(), &["--omega", "12", "--fitted"]);
    assert!(answers[0]["extrapolated"].is_null(), "{answers:?}");
    let why = answers[0]["beyond_trials"].as_str().unwrap();
    assert!(
        why.starts_with("not known: ") && why.ends_with("trials.parquet does not exist"),
        "{why}"
    );
    assert!(said.contains("the range of the trials of the fit is not known"), "{said}");
}

#[test]
fn coefficients_that_are_not_the_fitted_ones_are_said_to_be_starting_values() {
    let said = |folder: &Path, line: &[&str]| {
        let output = trilink(folder, line);
        assert_eq!(output.status.code(), Some(0), "{line:?}: {}", text(&output.stderr));
        text(&output.stderr)
    };
    let starting = "starting values, not fitted: skid0_kg_s, skid1_kg_s, skid2_kg_s; --fitted takes the fit in ";
    let simulate = ["simulate", CAMPAIGN, "--model", "skid-roll", "--omega", "3"];
    let optimise =
        ["optimise", CAMPAIGN, "--model", "skid-roll", "--maximise", "v", "--free", "omega"];
    let branches = ["branches", CAMPAIGN, "--over", "omega_rad_s=2..3"];
    let empty = tempfile::tempdir().unwrap();
    for line in [&simulate[..], &[&optimise[..], &["--starts", "2"]].concat(), &branches] {
        let found = said(folder(), line);
        assert!(found.contains(starting) && found.contains("fits.parquet"), "{found}");
        let found = said(empty.path(), line);
        assert!(found.starts_with("no pipeline.toml") && found.lines().count() == 1, "{found}");
        let fitted = said(folder(), &[line, &["--fitted"]].concat());
        assert!(!fitted.contains("starting values"), "{fitted}");
    }
    // Values from the command line are not values of the configuration.
    let one = said(folder(), &[&simulate[..], &["--set", "skid0_kg_s=90"]].concat());
    assert!(one.contains("not fitted: skid1_kg_s, skid2_kg_s;"), "{one}");
    let all = said(folder(), &[&simulate[..], &["--set", "skid_kg_s=90,30,40"]].concat());
    assert!(!all.contains("starting values"), "{all}");
    let other = said(folder(), &["simulate", CAMPAIGN, "--model", "coulomb", "--omega", "3"]);
    assert!(other.contains("contains fits of skid-roll, but none of coulomb"), "{other}");
    // The model has no fit.
    let none = said(folder(), &["simulate", CAMPAIGN, "--model", "no-skid", "--omega", "3"]);
    assert_eq!(none, "");
}

#[test]
fn every_name_that_sensitivities_print_is_one_that_settings_take() {
    let empty = tempfile::tempdir().unwrap();
    for (campaign, model) in
        [("kinematic-skewed", "coulomb-viscous"), ("semi-passive-symmetric", "skid-roll")]
    {
        let line = ["simulate", campaign, "--model", model, "--omega", "3", "--json"];
        let found = |more: &[&str]| -> Vec<Value> {
            let printed = succeed(empty.path(), &[&line[..], more].concat());
            serde_json::from_str(&printed).unwrap()
        };
        let known = &found(&[])[0]["d_m"].as_f64().unwrap();
        let rows = found(&["--sensitivities"]);
        let of_d = rows.iter().filter(|row| row["metric"] == "d_m");
        let mut count = 0;
        for row in of_d.filter(|row| row["parameter"] != "omega_rad_s") {
            let (name, value) = (row["parameter"].as_str().unwrap(), &row["parameter_value"]);
            let answer = &found(&["--set", &format!("{name}={value}")])[0];
            let d_m = answer["d_m"].as_f64().unwrap();
            assert!((d_m / known - 1.0).abs() < 1e-8, "{name}: {d_m} {known}");
            count += 1;
        }
        assert!(count > 20, "{campaign}: {count}");
    }
    let line = ["simulate", "kinematic-symmetric", "--model", "skid", "--omega", "3", "--set"];
    let heavier = succeed(empty.path(), &[&line[..], &["mass0_kg=1.05", "--json"]].concat());
    let heavier: Vec<Value> = serde_json::from_str(&heavier).unwrap();
    assert_eq!(heavier[0]["parameters"]["mass_kg"], serde_json::json!([1.05, 0.2, 0.2]));
    for (setting, named) in [
        ("mass0_kg=1,2", "--set mass0_kg=1,2: found a list of length 2, needed a number"),
        ("skid_kg_s=1,2,3,4", "found a list of length 4, needed a list of length 3"),
        ("omega_rad_s=2", "--set omega_rad_s=2: set the frequency with the option --omega instead"),
    ] {
        let output = trilink(empty.path(), &[&line[..], &[setting]].concat());
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output.stderr).contains(named), "{}", text(&output.stderr));
    }
}

#[test]
fn a_monte_carlo_method_confirms_the_budget_where_the_metrics_are_almost_linear() {
    let arguments = ["--omega", "3", "--monte-carlo", "4000"];
    for fitted in [&[][..], &["--fitted"]] {
        let (found, printed) = rows(folder(), &[&arguments[..], fitted].concat());
        assert!(printed.contains("lower limit (95 %) of draws"), "{printed}");
        for metric in SENSITIVE_METRICS.iter().filter(|metric| **metric != "alpha1_rad") {
            let row = found.iter().find(|row| row.metric == *metric).unwrap();
            assert_eq!((row.draws, row.unsolved_draws), (Some(4000), Some(0)));
            // Sampling error of a standard deviation: 1.1 %; of a limit: 2.6 % of a standard deviation.
            let ratio = row.draws_deviation / row.metric_deviation;
            let width = (row.draws_upper - row.draws_lower) / (2.0 * 1.96 * row.metric_deviation);
            println!("{fitted:?} {metric}: {ratio:.4} {width:.4}");
            assert!((ratio - 1.0).abs() < 0.06 && (width - 1.0).abs() < 0.08, "{metric}");
            assert!(row.draws_lower < row.metric_value && row.metric_value < row.draws_upper);
        }
    }
    let (again, _) = rows(folder(), &arguments);
    let (first, _) = rows(folder(), &[&arguments[..], &["--threads", "1"]].concat());
    let draws = |rows: &[SensitivityRow]| -> Vec<u64> {
        rows.iter().map(|row| row.draws_deviation.to_bits()).collect()
    };
    assert_eq!(draws(&again), draws(&first), "the same for any number of threads");
}
