//! Tests of conditions and queries on small tables.

use std::thread;

use polars::prelude::{DataType, NamedFrom, Series, df};
use trilink_robot::{Parameter, Quantity};
use trilink_tables::{Columns as _, Provenance};

use super::condition::{mask, parse};
use super::*;

const TEXTS: [&str; 4] = ["kinematic-symmetric", "kinematic-skewed", "", "it's"];

trilink_tables::rows! {
    /// Row of the test table.
    pub struct Row {
        pub campaign: String,
        pub omega_rad_s: f64,
        pub cycles: i64,
        pub used: bool,
        pub at_bound: Vec<Parameter>,
    }
}

/// Writes a table of four rows, the last of which has no frequency, to a temporary folder.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let rows = [(3.9, 12, true), (4.0, 7, false), (0.5, 7, true), (f64::NAN, 0, false)];
    let lists = [&Quantity::Skid.of_each()[..2], &[Quantity::Skid.parameter(0)], &[], &[]];
    let row = |((campaign, at_bound), (omega_rad_s, cycles, used)): ((&str, &[_]), _)| Row {
        campaign: campaign.to_owned(),
        omega_rad_s,
        cycles,
        used,
        at_bound: at_bound.to_vec(),
    };
    let rows: Vec<Row> = TEXTS.into_iter().zip(lists).zip(rows).map(row).collect();
    let table = Row::to_table(&rows);
    let provenance = Provenance { input: "0123".to_owned() };
    table.write(&folder.path().join("trials.parquet"), &provenance).unwrap();
    folder
}

/// Returns the indices of the rows that satisfy a condition.
fn rows(condition: &str) -> Result<Vec<usize>, String> {
    let folder = folder();
    let query = Query { condition: Some(condition.to_owned()), ..Query::default() };
    let view = super::query(&folder.path().join("trials.parquet"), &query);
    let view = view.map_err(|error| error.to_string())?;
    let row = |row: Vec<String>| TEXTS.iter().position(|known| *known == row[0]).unwrap();
    Ok(view.cells(text).into_iter().map(row).collect())
}

#[test]
fn a_condition_selects_the_rows_for_which_it_is_true() {
    for (condition, expected) in [
        ("omega_rad_s > 3", &[0, 1][..]),
        ("campaign == 'kinematic-symmetric' and omega_rad_s > 3", &[0]),
        ("campaign = 'kinematic-symmetric' AND omega_rad_s > 3", &[0]),
        ("campaign = 'it''s'", &[3]),
        ("campaign <> ''", &[0, 1, 3]),
        ("campaign < 'kinematic-symmetric'", &[1, 3]),
        ("campaign is null", &[2]),
        ("omega_rad_s = 0.5 or cycles = 12", &[0, 2]),
        ("not omega_rad_s > 3", &[2]),
        ("not (used or cycles = 7)", &[3]),
        ("used", &[0, 2]),
        ("used = false", &[1, 3]),
        ("used is not true", &[1, 3]),
        ("(omega_rad_s > 3) is not true", &[2, 3]),
        ("(omega_rad_s > 3) is false", &[2]),
        ("omega_rad_s is null", &[3]),
        ("omega_rad_s is not null", &[0, 1, 2]),
        // Three-valued logic of missing values.
        ("omega_rad_s > 3 or cycles = 0", &[0, 1, 3]),
        ("omega_rad_s > 3 and cycles = 0", &[]),
        ("not (omega_rad_s > 3 and cycles = 0)", &[0, 1, 2]),
        ("omega_rad_s = null", &[]),
        ("omega_rad_s in (3.9, 0.5)", &[0, 2]),
        ("omega_rad_s not in (3.9, 0.5)", &[1]),
        ("campaign in ('kinematic-skewed', 'x')", &[1]),
        ("omega_rad_s between 0.5 and 3.9", &[0, 2]),
        ("omega_rad_s not between 0.5 and 3.9", &[1]),
        ("campaign like 'kinematic-%'", &[0, 1]),
        ("campaign not like 'kinematic-s_ewed'", &[0, 3]),
        ("campaign ilike 'KINEMATIC%'", &[0, 1]),
        ("at_bound like '%skid1%'", &[0]),
        ("at_bound = ''", &[2, 3]),
        ("cycles / 2 = 3.5", &[1, 2]),
        ("cycles * 2 - 1 + 0 = 23", &[0]),
        ("-cycles < -10", &[0]),
        ("+cycles >= 7", &[0, 1, 2]),
        ("abs(omega_rad_s - 3.9) < 0.2", &[0, 1]),
        ("ABS(cycles - 10) = 3", &[1, 2]),
        ("cycles % 2 = 1", &[1, 2]),
        ("-cycles % 2 = -1", &[1, 2]),
        ("omega_rad_s % 1 > 0.8", &[0]),
        ("(7 % cycles) is null", &[3]),
        ("1 / cycles > 0", &[0, 1, 2]),
        ("cycles = 7.0", &[1, 2]),
        ("omega_rad_s > -1e-3", &[0, 1, 2]),
        ("\"omega_rad_s\" > 3", &[0, 1]),
        ("true", &[0, 1, 2, 3]),
        ("null", &[]),
        ("9223372036854775807 + 1 > 9223372036854775807", &[0, 1, 2, 3]),
    ] {
        assert_eq!(rows(condition).unwrap(), expected, "{condition}");
    }
}

#[test]
fn invalid_conditions_are_explained() {
    for (condition, named) in [
        (
            "omega_rads > 3",
            "no column `omega_rads`; did you mean `omega_rad_s`? The columns are campaign,",
        ),
        ("zzz > 3", "no column `zzz`. The columns are campaign,"),
        ("omega_rad_s", "`omega_rad_s` is a number, but must be a boolean"),
        (
            "omega_rad_s > 'x'",
            "`omega_rad_s` is a number, but `'x'` is text; both must be of the same kind",
        ),
        ("campaign = \"x\"", "no column \"x\": write text in single quotes, 'x'"),
        ("campaign + 1 > 2", "`campaign` is text, but must be a number"),
        ("not campaign", "`campaign` is text, but must be a boolean"),
        ("omega_rad_s in (1, 'x')", "both must be of the same kind"),
        ("campaign like omega_rad_s", "`omega_rad_s` is a number, but must be text"),
        ("campaign like campaign", "needed a pattern such as"),
        (
            "sqrt(omega_rad_s) > 1",
            "`sqrt(omega_rad_s)` is not supported; supported are and, or, not",
        ),
        ("abs(campaign) > 1", "`campaign` is text, but must be a number"),
        ("abs(cycles, 2) > 1", "found `abs(cycles, 2)`, needed abs(..) of a number"),
        ("abs() > 1", "needed abs(..) of a number"),
        ("omega_rad_s ^ 2 = 0", "`^` is not supported"),
        ("cycles = (select 1)", "is not supported"),
        ("omega_rad_s >", "Expected: an expression, found: EOF"),
        ("omega_rad_s > 3 4", "found `4` after `omega_rad_s > 3`, needed `and` or `or`"),
        ("omega_rad_s > 3; drop table trials", "found `;` after"),
        ("campaign = 'x", "Unterminated string literal"),
        ("", "Expected: an expression"),
    ] {
        let message = rows(condition).unwrap_err();
        assert!(message.starts_with(&format!("--where \"{condition}\": ")), "{message}");
        assert!(message.contains(named), "{message}");
    }
}

#[test]
fn long_and_deep_conditions_are_errors_or_work() {
    let columns = [ColumnInfo {
        name: "n".to_owned(),
        type_name: "int64".to_owned(),
        dtype: Some(DataType::Float64),
    }];
    let two = df!("n" => [2_i64]).unwrap();
    let holds = |text: &str| {
        let (parsed, _) = parse(text)?;
        let mask = mask(&parsed, &columns, &two).map_err(|error| error.to_string())?;
        Ok::<_, String>(mask.get(0).unwrap())
    };
    assert!(!holds(&vec!["n=1"; 390].join(" or ")).unwrap());
    assert!(holds(&format!("n in ({}2)", "1,".repeat(3900))).unwrap());
    let too_deep = holds(&format!("{}1 > n", "1+".repeat(3900)));
    assert!(too_deep.unwrap_err().contains("more than 400 terms; use fewer"));
    let too_long = holds(&format!("{}1 > n", "1+".repeat(5000)));
    assert!(too_long.unwrap_err().contains("bytes, but at most 8000 are allowed"));
    for deep in ["(".repeat(3000), "not ".repeat(1900), "- ".repeat(3900)] {
        // As small as the stack of a program's main thread may be.
        let small = thread::Builder::new().stack_size(1 << 20);
        let found = thread::scope(|scope| {
            let thread = small.spawn_scoped(scope, || holds(&format!("{deep}n"))).unwrap();
            thread.join().unwrap()
        });
        assert!(found.is_err());
    }
}

#[test]
fn rows_are_sorted_and_truncated_after_the_condition() {
    let folder = folder();
    let key = |column: &str, descending| (column.to_owned(), descending);
    let query = Query {
        columns: vec!["omega_rad_s".to_owned(), "campaign".to_owned()],
        condition: Some("cycles < 10".to_owned()),
        sort: vec![key("cycles", true), key("omega_rad_s", true)],
        head: Some(2),
        tail: None,
    };
    let view = super::query(&folder.path().join("trials.parquet"), &query).unwrap();
    let names: Vec<&str> = view.columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["omega_rad_s", "campaign"]);
    assert_eq!(csv(&view), "omega_rad_s,campaign\n4,kinematic-skewed\n0.5,\n");
    assert_eq!(view.total, 4);
    let last = Query { head: None, tail: Some(1), ..query };
    let view = super::query(&folder.path().join("trials.parquet"), &last).unwrap();
    assert_eq!(csv(&view), "omega_rad_s,campaign\n,it's\n");
    let more = Query { columns: Vec::new(), condition: None, tail: Some(9), ..last };
    let view = super::query(&folder.path().join("trials.parquet"), &more).unwrap();
    assert_eq!(view.frame.height(), 4);
}

#[test]
fn patterns_select_columns() {
    let folder = folder();
    let path = folder.path().join("trials.parquet");
    let names = |columns: &[&str]| {
        let columns = columns.iter().map(|name| (*name).to_owned()).collect();
        let view = super::query(&path, &Query { columns, ..Query::default() })?;
        Ok::<_, InspectError>(view.columns.iter().map(|of| of.name.clone()).collect::<Vec<_>>())
    };
    assert_eq!(names(&["used", "c*"]).unwrap(), ["used", "campaign", "cycles"]);
    assert_eq!(names(&["?ycles", "*"]).unwrap()[..2], ["cycles", "campaign"]);
    assert_eq!(names(&["*"]).unwrap().len(), 5);
    let message = names(&["sigma*"]).unwrap_err().to_string();
    assert!(message.contains("no column matches `sigma*`. The columns are campaign,"), "{message}");
}

#[test]
fn the_tables_of_a_folder_are_queried_as_one_table() {
    let folder = folder();
    let of = folder.path().join("poses");
    std::fs::create_dir(&of).unwrap();
    for trial in ["b", "a"] {
        let table = folder.path().join("trials.parquet");
        std::fs::copy(table, of.join(format!("{trial}.parquet"))).unwrap();
    }
    let path = find(folder.path(), "poses").unwrap();
    let all = super::query(&path, &Query::default()).unwrap();
    assert_eq!((all.total, all.frame.height(), &all.columns[0].name[..]), (8, 8, "trial"));
    let trials = |query: Query| -> Vec<String> {
        let columns = ["trial", "cycles"].map(String::from).into();
        let view = super::query(&path, &Query { columns, ..query }).unwrap();
        view.cells(text).into_iter().map(|row| row.concat()).collect()
    };
    let condition = |of: &str| Query { condition: Some(of.to_owned()), ..Query::default() };
    assert_eq!(trials(condition("cycles = 12")), ["a12", "b12"]);
    assert_eq!(trials(condition("trial = 'b' and cycles > 0")), ["b12", "b7", "b7"]);
    assert_eq!(trials(Query { head: Some(5), ..Query::default() }).len(), 5);
    let sort = vec![("cycles".to_owned(), true), ("trial".to_owned(), true)];
    assert_eq!(trials(Query { sort, head: Some(2), ..Query::default() }), ["b12", "a12"]);
    assert_eq!(describe_all(&path).unwrap().rows, 8);
    // Rows that are not needed are counted, but not read.
    let whole = std::fs::read(of.join("b.parquet")).unwrap();
    let footer = u32::from_le_bytes(*whole[..whole.len() - 4].last_chunk().unwrap()) as usize;
    let mut damaged = whole.clone();
    damaged[4..whole.len() - 8 - footer].fill(0);
    std::fs::write(of.join("b.parquet"), damaged).unwrap();
    assert_eq!(describe_all(&path).unwrap().rows, 8);
    assert_eq!(trials(Query { head: Some(3), ..condition("cycles >= 0") }), ["a12", "a7", "a7"]);
    assert!(super::query(&path, &condition("cycles = 12")).is_err());
    std::fs::write(of.join("b.parquet"), whole).unwrap();
    std::fs::write(of.join("c.parquet"), "no table").unwrap();
    let message = super::query(&path, &Query::default()).unwrap_err().to_string();
    assert!(message.contains("c.parquet"), "{message}");
}

#[test]
fn missing_values_are_null_in_json() {
    let folder = folder();
    let query = Query {
        columns: ["omega_rad_s", "cycles", "used", "at_bound"].map(String::from).into(),
        head: Some(4),
        ..Query::default()
    };
    let view = super::query(&folder.path().join("trials.parquet"), &query).unwrap();
    let text = json(&view);
    let first =
        r#"{"omega_rad_s":3.9,"cycles":12,"used":true,"at_bound":"skid0_kg_s, skid1_kg_s"}"#;
    assert!(text.starts_with(&format!("[{first},\n")), "{text}");
    assert!(text.contains(r#"{"omega_rad_s":null,"cycles":0,"#), "{text}");
}

#[test]
fn missing_values_come_last_in_either_order() {
    let numbers = df!("n" => [None, Some(2.5), Some(3.0), Some(f64::NAN), Some(-1.0)]).unwrap();
    for (descending, expected) in [(false, "-1 2.5 3 NaN "), (true, "3 2.5 -1 NaN ")] {
        let sorted = sorted(numbers.clone(), &[("n".to_owned(), descending)]).unwrap();
        let cells = sorted.column("n").unwrap().as_materialized_series().iter();
        assert_eq!(cells.map(|cell| text(&cell)).collect::<Vec<_>>().join(" "), expected);
    }
}

#[test]
fn columns_of_other_programs_are_compared_by_value() {
    let columns = ["big", "short", "x", "list"].map(|name| ColumnInfo {
        name: name.to_owned(),
        type_name: String::new(),
        dtype: Some(DataType::Float64),
    });
    let lists = Series::new("list".into(), [Series::new("".into(), [1_i64, 2])]);
    let mut frame =
        df!("big" => [u64::MAX], "short" => [0.1_f32], "x" => [f64::NAN], "n" => [9_i64]).unwrap();
    frame.with_column(lists.into()).unwrap();
    assert_eq!(frame.column("short").unwrap().dtype(), &DataType::Float32);
    for (condition, expected) in [
        ("big = 18446744073709551615", Some(true)),
        ("big > -1 and big > 18446744073709551614 and not big < 5.0", Some(true)),
        ("big - 1 = 18446744073709551614", Some(true)),
        ("short = 0.1", Some(true)),
        ("x <> x", Some(true)),
        ("x = x or x < 1 or x >= 1", Some(false)),
        ("not x = null", None),
        ("x + null is null", Some(true)),
        ("list = '1, 2'", Some(true)),
        ("null = null", None),
    ] {
        let (parsed, _) = parse(condition).unwrap();
        let mask = mask(&parsed, &columns, &frame).unwrap();
        assert_eq!(mask.get(0), expected, "{condition}");
    }
}
