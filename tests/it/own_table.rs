//! Tests of fits to tables that other programs made.

use std::f64::consts::TAU;
use std::path::Path;
use std::sync::OnceLock;

use tempfile::TempDir;
use trilink_robot::Quantity;
use trilink_tables::{Columns, Comparison, ComparisonRow, FitRow, PredictionRow, Table};

use crate::common::{files, small_run, small_settings, succeed, text, trilink};

/// Returns a folder with tables of ingested trials, to which tests only add other tables.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    let run = || {
        let mut config = small_settings();
        config.fit.bootstrap = 2;
        config.fit.profiles = false;
        small_run(&config, "1")
    };
    FOLDER.get_or_init(run).path()
}

fn rows<T: Columns>(path: &str) -> Vec<T> {
    T::from_table(&Table::read(&folder().join(path)).unwrap()).unwrap()
}

/// Fits the trials of a CSV table and writes the results to the folder `name`; returns the exit status and the text on
/// stderr.
fn fit(name: &str, csv: &str) -> (Option<i32>, String) {
    let table = format!("{name}.csv");
    std::fs::write(folder().join(&table), csv).unwrap();
    let output = trilink(folder(), &["fit", "--trials", &table, "--into", name]);
    (output.status.code(), text(&output.stderr))
}

#[test]
fn a_table_with_all_that_was_measured_has_the_fit_of_the_ingested_trials() {
    let before = files(&folder().join("derived"));
    let csv = succeed(folder(), &["inspect", "trials", "--csv"]);
    let (status, said) = fit("all", &csv);
    assert_eq!(status, Some(0), "{said}");
    let parquet = ["fit", "--trials", "derived/trials.parquet", "--into", "parquet", "-q"];
    succeed(folder(), &parquet);
    let expected: Vec<FitRow> = rows("derived/fits.parquet");
    for home in ["all", "parquet"] {
        let found: Vec<FitRow> = rows(&format!("{home}/fits.parquet"));
        assert_eq!(found.len(), 2);
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!(found.j, expected.j);
            assert_eq!((found.model, found.trials), (expected.model, expected.trials));
            for parameter in &expected.free {
                assert_eq!(found.parameters[*parameter], expected.parameters[*parameter]);
            }
        }
    }
    assert!(before == files(&folder().join("derived")));
}

#[test]
fn with_d_and_v_alone_the_fit_says_what_is_missing_and_has_no_intervals() {
    let csv = "campaign;omega_rad_s;d_m;v_m_s;colour\n\
               kinematic-symmetric;2;0,40;0,12;red\n\
               kinematic-symmetric;3,9;0,48;0,29;red\n";
    let (status, said) = fit("two", csv);
    assert_eq!(status, Some(0), "{said}");
    for part in [
        "column `colour` is ignored",
        "the objective needs metrics that no trial provides: sigma0, sigma1, sigma2",
        "no confidence limits, because there are no cycles, repeats or standard errors from which to estimate the noise of d, v",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let fits: Vec<FitRow> = rows("two/fits.parquet");
    let skid = fits.iter().find(|fit| !fit.free.is_empty()).unwrap();
    assert!(skid.status.is_ok() && skid.j.is_finite() && skid.adequate.is_none());
    for parameter in Quantity::Skid.of_each() {
        assert!(skid.lower[parameter].is_nan() && skid.upper[parameter].is_nan());
    }
    let predictions: Vec<PredictionRow> = rows("two/predictions.parquet");
    assert!(predictions.iter().all(|row| row.no_interval.is_some()));
}

#[test]
fn a_table_says_of_which_trials_the_noise_is_not_white() {
    let table = |white: [&str; 6]| {
        let rows =
            [(1.5, 0.458), (2.5, 0.471), (3.3, 0.476), (3.9, 0.478), (4.5, 0.480), (5.2, 0.481)];
        let row = |((omega, d), white): ((f64, f64), &str)| {
            format!("kinematic-symmetric,{omega},{d},0.004,9,{white}\n")
        };
        let rows: String = rows.into_iter().zip(white).map(row).collect();
        format!("campaign,omega_rad_s,d_m,d_m_se,cycles,noise_white\n{rows}")
    };
    let (status, said) = fit("white", &table(["true", "", "TRUE", "-", "true", "true"]));
    assert_eq!(status, Some(0), "{said}");
    let is_tested = |name: &str| {
        let fits: Vec<FitRow> = rows(&format!("{name}/fits.parquet"));
        fits.iter().any(|fit| fit.adequate.is_some())
    };
    assert!(is_tested("white"), "{said}");
    let (status, said) = fit("filtered", &table(["true", "", "false", "-", "true", "true"]));
    assert_eq!(status, Some(0), "{said}");
    let compared: Vec<ComparisonRow> = rows("filtered/comparison.parquet");
    assert!(compared[0].trials_filtered == 1 && !is_tested("filtered"), "{compared:?}");
    let fits: Vec<FitRow> = rows("filtered/fits.parquet");
    let sentence = Comparison::new(&compared, &fits).unwrap().to_string();
    assert!(sentence.contains("export unfiltered"), "{sentence}");
    let (status, said) = fit("pink", &table(["true", "", "pink", "-", "true", "true"]));
    assert_eq!(status, Some(2), "{said}");
    let wrong = "line 4, column `noise_white`: found `pink`, needed true or false";
    assert!(said.contains(wrong), "{said}");
}

#[test]
fn all_mistakes_of_a_table_are_named_at_once() {
    let csv = "campaign,trial,omega,d_m,sigm0,cycles\n\
               kinematic-symetric,a,2,0.4,1,3\n\
               kinematic-symmetric,b,3,much,1,3\n\
               kinematic-symmetric,b,3,0.4,1,3.5\n\
               kinematic-symmetric,d,3,,1,3\n\
               kinematic-symmetric,e,3,0.4,1,3,9\n";
    let (status, said) = fit("wrong", csv);
    assert_eq!(status, Some(2));
    for part in [
        "column `omega_rad_s` not found; expected a column that contains each trial's frequency; is `omega` meant?",
        "line 2, column `campaign`: found `kinematic-symetric`, needed one of kinematic-symmetric; \
         did you mean `kinematic-symmetric`?",
        "line 3, column `d_m`: found `much`, needed a non-negative number",
        "line 4, column `cycles`: found `3.5`, needed a whole number",
        "line 4, column `trial`: found `b`, which is also the name of the trial in line 3",
        "line 5, columns `d_m`, `v_m_s`: neither contains a value above 0, but at least one of them must",
        "line 6: found 7 fields, but the header has 6",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    assert!(!folder().join("wrong").exists());
}

/// Returns a CSV table with values read off a figure; `change` alters each row to imitate a mistake.
fn figure(columns: &str, change: fn([f64; 3]) -> Vec<f64>) -> String {
    let rows = [[1.5, 0.458, 0.109], [2.5, 0.471, 0.188], [3.9, 0.478, 0.297], [5.2, 0.481, 0.398]];
    let row = |of: [f64; 3]| {
        let cells: Vec<String> = change(of).iter().map(|cell| format!("{cell:.4}")).collect();
        format!("kinematic-symmetric,{}\n", cells.join(","))
    };
    format!("campaign,{columns}\n{}", rows.map(row).concat())
}

#[test]
fn numbers_in_other_units_are_named_by_the_mistake() {
    const ALL: &str = "omega_rad_s,d_m,v_m_s";
    type Mistake = (&'static str, fn([f64; 3]) -> Vec<f64>, &'static str);
    let mistakes: [Mistake; 15] = [
        (ALL, |[omega, d, v]| vec![omega / TAU, d, v], "but v is 6.2"),
        (
            ALL,
            |[omega, d, v]| vec![omega / TAU, d, v],
            "times that quotient (median of 4 rows): is omega_rad_s in Hz?",
        ),
        (
            ALL,
            |[omega, d, v]| vec![omega * 9.5493, d, v],
            "is omega_rad_s in revolutions per minute?",
        ),
        (ALL, |[omega, d, v]| vec![omega, d, 100.0 * v], "is v_m_s in cm/s?"),
        (ALL, |[omega, d, v]| vec![omega, 100.0 * d, v], "is d_m in centimetres?"),
        (
            ALL,
            |[omega, d, v]| vec![omega, 1000.0 * d, 1000.0 * v],
            "line 2, column `d_m`: found `458`, but values above 2.5600 are implausible: is the value in centimetres \
             or millimetres? (4 rows)",
        ),
        (ALL, |[omega, d, v]| vec![omega, v, d], "are these columns swapped?"),
        (
            ALL,
            |[omega, d, v]| vec![omega, d, 1.2 * v],
            "omit column `v_m_s` if it contains another speed",
        ),
        (
            ALL,
            |[omega, d, v]| vec![omega, d, if omega > 5.0 { 0.938 } else { v }],
            "line 5, columns `d_m`, `v_m_s`: found `0.481` and `0.938` at 5.2 rad/s, but v should be d divided by the \
             period, that is, 0.398",
        ),
        (
            "omega_rad_s,v_m_s",
            |[omega, _, v]| vec![omega / TAU, v],
            "column `v_m_s`: found `0.109`, but values above 0.0973 are implausible: is the value in cm/s or mm/s, or \
             is omega_rad_s in Hz?",
        ),
        (
            "omega_rad_s,d_m,sigma1",
            |[omega, d, _]| vec![omega, d, 12.5],
            "column `sigma1`: found `12.5`, but values above 3.0000 are implausible: is the value in percent? (4 rows)",
        ),
        (
            "omega_rad_s,d_m,sigma1_se",
            |[omega, d, _]| vec![omega, d, 2.5],
            "column `sigma1_se`: found `2.5`, but values above 1.0000 are implausible: is the value in percent? (4 \
             rows)",
        ),
        (
            "omega_rad_s,d_m,d_m_se",
            |[omega, d, _]| vec![omega, d, 2.0],
            "the standard errors are 4.2152 times the values in `d_m` (median of 4 rows), but should be smaller than \
             these: are they in millimetres or percent?",
        ),
        (
            "omega_rad_s,d_m,phi1_amplitude_rad",
            |[omega, d, _]| vec![omega, d, 28.6],
            "column `phi1_amplitude_rad`: found `28.6`, but values above 3.1416 are implausible: is the value in \
             degrees? (4 rows)",
        ),
        (
            "omega_rad_s,d_m",
            |[omega, d, _]| vec![2000.0 * omega, d],
            "column `omega_rad_s`: found `3000.0000`, needed a frequency from 0.01 to 1000 rad/s",
        ),
    ];
    for (columns, change, part) in mistakes {
        let (status, said) = fit("units", &figure(columns, change));
        assert_eq!(status, Some(2), "{said}");
        assert!(said.contains(part), "{part}: {said}");
        assert!(!folder().join("units").exists());
    }
}

#[test]
fn the_tables_of_ingested_trials_are_not_replaced() {
    let output =
        trilink(folder(), &["fit", "--trials", "derived/trials.parquet", "--into", "derived"]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(said.contains("derived: this folder holds the ingested trials"), "{said}");
}

#[test]
fn the_table_of_the_documents_can_be_fitted() {
    let csv = include_str!("../../docs/own-table.csv");
    let (status, said) = fit("figure", csv);
    assert_eq!(status, Some(0), "{said}");
    let fits: Vec<FitRow> = rows("figure/fits.parquet");
    let skid = fits.iter().find(|fit| !fit.free.is_empty()).unwrap();
    assert_eq!(skid.trials, 6);
    assert!(skid.j < 0.05, "{}", skid.j);
}
