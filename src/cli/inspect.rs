//! `trilink inspect`.

use std::collections::BTreeSet;
use std::path::Path;

use polars::prelude::{AnyValue, DataType};

use super::output::{note, say, write_data};
use super::results::Format;
use super::table::{self, Table};
use super::terminal::{Text, Tone};
use super::{Anywhere, Context, Failure, Outcome, candidates, check_not_below_project};
use crate::inspect::{
    ColumnInfo, Listed, Query, View, describe, describe_all, find, float, list, meaning, query,
    text, unit,
};

/// Maximum number of printed characters of a metadata value; some programs store whole schemas as metadata.
const MAX_METADATA: usize = 100;

/// Maximum number of columns without space that are named.
const MAX_NAMES: usize = 4;
/// Significant digits of printed numbers.
const DIGITS: usize = 6;
/// Significant digits of printed numbers if not all columns fit on the terminal otherwise.
const FEW_DIGITS: usize = 4;
/// Columns of wide tables that are shown by default.
const DEFAULT_COLUMNS: [(&str, &[&str]); 2] = [
    ("trials", &["trial", "status", "omega_rad_s", "d_m", "v_m_s", "sigma0", "sigma1", "sigma2"]),
    (
        "fits",
        &["campaign", "model", "adequate", "lack_of_fit", "skid0_kg_s", "skid1_kg_s", "skid2_kg_s"],
    ),
];

/// Inspect a table of `derived`, or any Parquet file.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/inspect.txt").trim_end())]
pub(super) struct Inspect {
    /// Table of `derived`, such as `trials`, `fits`, `poses/TRIAL` or `poses` of all trials, or any
    /// Parquet file [default: list the tables of `derived`].
    #[arg(add = candidates::tables())]
    table: Option<String>,
    #[command(flatten)]
    query: Query,
    /// Columns to sort by; a minus sign or ` desc` sorts in descending order.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "COLUMN,..")]
    sort: Vec<String>,
    /// Show the columns with their types, units and meanings instead of rows.
    #[arg(long, conflicts_with_all = ["columns", "condition", "sort", "head", "tail", "csv"])]
    schema: bool,
    #[command(flatten)]
    format: Format,
}

impl Inspect {
    pub(super) fn run(self, Anywhere(context): Anywhere) -> Result<Outcome, Failure> {
        if !self.table.as_ref().is_some_and(|table| Path::new(table).exists()) {
            check_not_below_project(context.is_configured.then_some(&context.file))?;
            context.check_results()?;
        }
        let derived = &context.config.paths.derived;
        let Some(name) = &self.table else {
            return list_tables(&context);
        };
        let path = find(derived, name)?;
        if self.schema {
            return show_schema(&path, self.format.json);
        }
        let mut columns = self.query.columns;
        let mut hidden = 0;
        if columns.is_empty() && !self.format.csv && !self.format.json {
            (columns, hidden) = default_columns(&path)?;
        }
        let sort = self.sort.iter().map(|key| sort_key(key)).collect::<Result<_, _>>()?;
        let view = query(&path, &Query { columns, sort, ..self.query })?;
        if !view.left_out.is_empty() {
            let columns = view.left_out.iter();
            let columns: Vec<String> =
                columns.map(|column| format!("{} ({})", column.name, column.type_name)).collect();
            context.say(&format!("not shown: {}", columns.join(", ")));
        }
        if !self.format.view(&view) {
            show(&context, &view);
            if hidden > 0 {
                context.say(&format!(
                    "{hidden} more columns: --columns \"*\" shows all, --schema explains them"
                ));
            }
        }
        Ok(Outcome::Well)
    }
}

/// Returns the columns that are shown by default, none for all, and the number of the other columns.
fn default_columns(path: &Path) -> Result<(Vec<String>, usize), Failure> {
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    let defaults = DEFAULT_COLUMNS.iter().find(|(table, _)| Some(*table) == stem);
    let Some((_, names)) = defaults else { return Ok((Vec::new(), 0)) };
    let known = describe_all(path)?.columns;
    // Tables of other programs may have the same name.
    if names.iter().any(|name| known.iter().all(|column| column.name != *name)) {
        return Ok((Vec::new(), 0));
    }
    Ok((names.iter().map(|name| (*name).to_owned()).collect(), known.len() - names.len()))
}

/// Prints rows, with as many columns as fit on the terminal.
fn show(context: &Context, view: &View) {
    let cells = |digits| view.cells(|cell| in_short(cell, digits));
    let all = cells(DIGITS);
    let table = table_of(view, &all);
    let hidden = if table.fits() {
        table.print_fitting()
    } else {
        table_of(view, &cells(FEW_DIGITS)).print_fitting()
    };
    if !hidden.is_empty() {
        let hidden = match hidden.len() {
            ..=MAX_NAMES => hidden.join(", "),
            count => format!("{count} columns"),
        };
        context.say(&format!(
            "no space on the terminal for {hidden}; choose columns with --columns, or print all with --csv"
        ));
    }
    context.say(&format!("{} of {} rows", all.len(), view.total));
}

/// Creates the table of the cells of a view.
fn table_of<'c>(view: &View, cells: &'c [Vec<String>]) -> Table<'c, Vec<String>> {
    let columns = view.columns.iter().enumerate();
    columns.fold(Table::new(cells), |table, (i, ColumnInfo { name, dtype, .. })| {
        let is_number = *dtype == Some(DataType::Float64);
        table.column(name, is_number, |row| match (name.as_str(), row[i].as_str()) {
            ("status" | "severity", word) => Text::status(word),
            ("adequate", "true") => Tone::Good.paint("true"),
            ("adequate", "false") => Tone::Bad.paint("false"),
            (_, cell) => cell.into(),
        })
    })
}

/// Formats a cell: numbers with a number of significant digits, null as a dash.
fn in_short(cell: &AnyValue, digits: usize) -> String {
    match float(cell) {
        Some(number) => table::rounded(number, digits),
        None if cell.is_null() => "-".to_owned(),
        None => text(cell),
    }
}

/// Parses a sort key, such as `d_m`, `-d_m` or `d_m desc`; returns the column and whether the order is descending.
fn sort_key(text: &str) -> Result<(String, bool), String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let (name, descending) = match words[..] {
        [name] => (name.strip_prefix('-').unwrap_or(name), name.starts_with('-')),
        [name, order] if order.eq_ignore_ascii_case("desc") => (name, true),
        [name, order] if order.eq_ignore_ascii_case("asc") => (name, false),
        _ => {
            return Err(format!(
                "--sort: found `{text}`, needed a column, `-column` or `column desc`"
            ));
        }
    };
    Ok((name.to_owned(), descending))
}

/// Prints the columns of a table with their types, units and meanings.
fn show_schema(path: &std::path::Path, as_json: bool) -> Result<Outcome, Failure> {
    let info = describe_all(path)?;
    if as_json {
        let columns = info.columns.iter().map(|ColumnInfo { name, type_name, .. }| {
            let column = serde_json::json!({
                "name": name,
                "type": type_name,
                "unit": unit(name),
                "meaning": meaning(name),
            });
            column.to_string()
        });
        write_data(&format!("[{}]", columns.collect::<Vec<_>>().join(",\n ")));
        return Ok(Outcome::Well);
    }
    Table::new(&info.columns)
        .left("column", |column| column.name.clone())
        .left("type", |column| column.type_name.clone())
        .left("unit", |column| unit(&column.name).unwrap_or_default().to_owned())
        .prose("meaning", |column| meaning(&column.name).unwrap_or_default())
        .print();
    say!("{} rows in {}", info.rows, path.display());
    for (key, value) in &info.metadata {
        let (start, is_cut) = match value.char_indices().nth(MAX_METADATA) {
            Some((end, _)) => (&value[..end], " .."),
            None => (&**value, ""),
        };
        say!("{key}: {start}{is_cut}");
    }
    Ok(Outcome::Well)
}

/// Lists the tables of `derived` with their sizes.
fn list_tables(context: &Context) -> Result<Outcome, Failure> {
    let derived = &context.config.paths.derived;
    let tables = list(derived);
    if tables.is_empty() {
        return Err(format!("{}: no tables; `trilink run` makes them", derived.display()).into());
    }
    let mut problems = BTreeSet::new();
    let mut rows: Vec<[String; 3]> = Vec::new();
    for Listed { name, path, tables } in tables {
        rows.push(match describe(&path) {
            Ok(info) => {
                let count = match tables {
                    Some(tables) => format!("{tables} tables"),
                    None => info.rows.to_string(),
                };
                [name, count, info.columns.len().to_string()]
            }
            Err(problem) => {
                problems.insert(problem.to_string());
                [name, "-".to_owned(), "-".to_owned()]
            }
        });
    }
    Table::new(&rows)
        .left("table", |row| row[0].clone())
        .right("rows", |row| row[1].clone())
        .right("columns", |row| row[2].clone())
        .print();
    problems.iter().for_each(|problem| note!("{problem}"));
    Ok(Outcome::well_if(problems.is_empty()))
}
