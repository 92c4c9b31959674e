//! Tests of table inspection from the command line, Python and R.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use crate::common::{small_run, small_settings, succeed, text, trilink};
use serde_json::Value;
use tempfile::TempDir;

/// Returns a shared folder with tables, which no test changes.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    FOLDER.get_or_init(|| small_run(&small_settings(), "1")).path()
}

fn inspect(arguments: &[&str]) -> String {
    let arguments: Vec<&str> = ["inspect"].iter().chain(arguments).copied().collect();
    succeed(folder(), &arguments)
}

fn refused(arguments: &[&str]) -> String {
    let arguments: Vec<&str> = ["inspect"].iter().chain(arguments).copied().collect();
    let output = trilink(folder(), &arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    assert!(output.stdout.is_empty());
    text(&output.stderr)
}

#[test]
fn a_table_shows_the_columns_and_rows_that_were_asked_for_in_order() {
    let table = inspect(&[
        "trials",
        "--where",
        "campaign == 'kinematic-symmetric' and omega_rad_s > 1",
        "--columns",
        "trial,d_m,sigma0",
        "--sort",
        "-trial",
    ]);
    let lines: Vec<Vec<&str>> =
        table.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines[0], ["trial", "d_m", "sigma0"]);
    let trials: Vec<&str> = lines[1..].iter().map(|line| line[0]).collect();
    assert_eq!(trials, ["kinematic-symmetric-3.90-r1", "kinematic-symmetric-2.00-r1"]);
    let ends: Vec<usize> = table.lines().map(str::len).collect();
    assert!(ends.iter().all(|end| *end <= 60), "{table}");
    let upwards = inspect(&["trials", "--sort", "trial desc, cycles", "--columns", "trial"]);
    assert!(upwards.lines().nth(1) > upwards.lines().nth(2), "{upwards}");
    assert_eq!(inspect(&["trials", "--head", "1", "--columns", "trial"]).lines().count(), 2);
}

#[test]
fn csv_and_json_have_every_digit_of_every_row() {
    let table = trilink_tables::Table::read(&folder().join("derived/predictions.parquet")).unwrap();
    let json: Vec<serde_json::Map<String, Value>> =
        serde_json::from_str(&inspect(&["predictions", "--json"])).unwrap();
    let csv = inspect(&["predictions", "--csv"]);
    let lines: Vec<&str> = csv.lines().collect();
    let column = lines[0].split(',').position(|name| name == "d_m").unwrap();
    assert_eq!((json.len(), lines.len()), (table.len(), table.len() + 1));
    let d_m = table.values::<f64>("d_m").unwrap();
    for (i, d_m) in d_m.iter().enumerate() {
        assert_eq!(json[i]["d_m"].as_f64(), Some(*d_m));
        assert_eq!(lines[i + 1].split(',').nth(column).unwrap().parse(), Ok(*d_m));
    }
    let alpha = table.values::<f64>("alpha1_rad").unwrap();
    assert!(
        alpha.iter().zip(&json).all(|(alpha, row)| alpha.is_nan() == row["alpha1_rad"].is_null())
    );
}

#[test]
fn the_schema_has_types_units_meanings_and_where_the_table_comes_from() {
    let schema = inspect(&["fits", "--schema"]);
    let line = |name: &str| {
        let found = schema.lines().find(|line| line.split_whitespace().next() == Some(name));
        found.unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ")
    };
    assert_eq!(
        line("skid0_kg_s_lo"),
        "skid0_kg_s_lo float64 kg/s lower 95 % confidence limit: skid resistance c^S of the wheel \
         (eq. 15), 0"
    );
    assert_eq!(
        line("free"),
        "free text free parameters of the fit, or the commands that the optimisation varies"
    );
    assert_eq!(line("trilink.version:"), format!("trilink.version: {}", env!("CARGO_PKG_VERSION")));
    assert!(line("trilink.input:").len() > 20, "{schema}");
    for table in ["trials", "checks", "poses/kinematic-symmetric-3.90-r1", "robot_parameters"] {
        assert!(inspect(&[table, "--schema"]).lines().count() > 5);
    }
}

#[test]
fn every_column_of_every_table_has_a_meaning() {
    let outside = tempfile::tempdir().unwrap();
    const MODEL: [&str; 3] = ["kinematic-symmetric", "--model", "skid-roll"];
    let written: [(&str, &[&str]); 5] = [
        ("simulate", &["--omega", "3", "--trajectory"]),
        ("simulate", &["--omega", "3", "--from-rest", "--trajectory"]),
        ("simulate", &["--omega", "3", "--sensitivities", "--table"]),
        ("branches", &["--over", "omega_rad_s=2..3", "--table"]),
        ("optimise", &["--maximise", "v", "--free", "omega", "--starts", "1", "--table"]),
    ];
    let mut others = Vec::new();
    for (nth, (command, options)) in written.into_iter().enumerate() {
        let path = outside.path().join(format!("{nth}.parquet")).to_str().unwrap().to_owned();
        succeed(folder(), &[&[command], &MODEL[..], options, &[&path]].concat());
        others.push(path);
    }
    let list = inspect(&[]);
    let named = list.lines().skip(1).filter_map(|line| line.split_whitespace().next());
    let named = named.map(|name| name.trim_end_matches("/<trial>"));
    let mut tables: Vec<&str> = named.collect();
    assert!(tables.contains(&"fits") && tables.contains(&"poses"), "{list}");
    tables.extend(others.iter().map(String::as_str));
    let mut unknown = Vec::new();
    for table in tables {
        let schema: Vec<Value> =
            serde_json::from_str(&inspect(&[table, "--schema", "--json"])).unwrap();
        assert!(schema.len() > 3, "{table}");
        unknown.extend(
            schema
                .into_iter()
                .filter(|of| !of["meaning"].is_string())
                .map(|of| format!("{table} {}", of["name"])),
        );
    }
    assert!(unknown.is_empty(), "{unknown:#?}");
}

#[test]
fn without_a_name_all_tables_are_listed() {
    let list = inspect(&[]);
    let line = |name: &str| {
        let line = list.lines().find(|line| line.starts_with(name)).unwrap_or_default();
        line.split_whitespace().map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(line("fits")[..2], ["fits", "2"]);
    assert_eq!(line("cycles/<trial>")[..3], ["cycles/<trial>", "2", "tables"]);
}

#[test]
fn a_table_is_found_by_path_and_one_that_is_not_there_by_its_nearest_name() {
    let path = folder().join("derived/trials.parquet");
    let by_path = inspect(&[path.to_str().unwrap(), "--csv"]);
    assert_eq!(by_path, inspect(&["trials", "--csv"]));
    let message = refused(&["trails"]);
    assert!(
        message.contains("`trails` is neither a table nor a file; did you mean `trials`?"),
        "{message}"
    );
    assert!(message.contains("contains alternative_fits, bootstrap, checks,"), "{message}");
    let message = refused(&["poses/kinematic-symetric-3.90-r1"]);
    let named = "did you mean `poses/kinematic-symmetric-3.90-r1`?";
    assert!(message.contains(named), "{message}");
    for (arguments, named) in [
        (&["trials", "--columns", "d_mm"][..], "no column `d_mm`; did you mean `d_m`?"),
        (&["trials", "--sort", "omega"], "no column `omega`; did you mean `omega_rad_s`?"),
        (&["trials", "--sort", "d_m up"], "--sort: found `d_m up`, needed a column"),
        (&["trials", "--where", "d_m >"], "--where \"d_m >\": Expected: an expression"),
        (&["pipeline.toml"], "pipeline.toml: not a Parquet table"),
        (&["trials", "--csv", "--json"], "cannot be used with"),
    ] {
        let message = refused(arguments);
        assert!(message.contains(named), "{message}");
    }
}

#[test]
fn a_closed_pipe_ends_the_table_quietly() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_trilink"))
        .args(["inspect", "poses/kinematic-symmetric-2.00-r1"])
        .current_dir(folder())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(text(&output.stderr), "");
    assert_eq!(output.status.code(), Some(0));
}

#[test]
fn python_opens_the_tables_with_the_same_names_types_and_values() {
    let python = std::env::var("TRILINK_PYTHON").unwrap_or("python3".to_owned());
    let derived = folder().join("derived");
    let values = tempfile::tempdir().unwrap();
    for (path, _) in crate::common::files(&derived) {
        let name = path.with_extension("");
        let target = values.path().join(path.with_extension("json"));
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        std::fs::write(target, inspect(&[name.to_str().unwrap(), "--json"])).unwrap();
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/open_tables.py");
    let opened = Command::new(&python).arg(script).arg(&derived).arg(values.path()).output();
    let Ok(opened) = opened else {
        eprintln!("left out: {python} does not start");
        return;
    };
    let said = text(&opened.stdout);
    eprintln!("{said}{}", text(&opened.stderr));
    match opened.status.code() {
        Some(77) => eprintln!("left out: nothing to open tables with"),
        status => assert_eq!(status, Some(0), "{said}{}", text(&opened.stderr)),
    }
}

#[test]
fn r_opens_the_tables_with_the_same_names_types_and_values() {
    let derived = folder().join("derived");
    let values = tempfile::tempdir().unwrap();
    for (path, _) in crate::common::files(&derived) {
        let name = path.with_extension("");
        let target = values.path().join(&name);
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        let name = name.to_str().unwrap();
        std::fs::write(target.with_extension("csv"), inspect(&[name, "--csv"])).unwrap();
        let schema: Value = serde_json::from_str(&inspect(&[name, "--schema", "--json"])).unwrap();
        let line = |of: &Value| format!("{} {}\n", of["name"], of["type"]);
        let types: String = schema.as_array().unwrap().iter().map(line).collect();
        std::fs::write(target.with_extension("types"), types).unwrap();
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/r/open_tables.R");
    let opened = Command::new("Rscript").arg(script).arg(&derived).arg(values.path()).output();
    let Ok(opened) = opened else {
        eprintln!("left out: Rscript does not start");
        return;
    };
    let said = text(&opened.stdout) + &text(&opened.stderr);
    eprintln!("{said}");
    match opened.status.code() {
        Some(77) => eprintln!("left out: neither nanoparquet nor arrow is installed"),
        status => assert_eq!(status, Some(0), "{said}"),
    }
}
