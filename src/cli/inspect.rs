//! `trilink inspect`.

use std::collections::BTreeSet;

use polars::prelude::{AnyValue, DataType};

use super::output::{note, say, write_data};
use super::results::Format;
use super::table::{self, Table};
use super::{Context, Failure, Outcome};
use crate::inspect::{
    ColumnInfo, Listed, Query, View, describe, describe_all, find, float, list, meaning, query,
    text, unit,
};

/// Others write whole schemas into a file's metadata.
const LONGEST_METADATA: usize = 100;

/// Look into a table of `derived`, or into any Parquet file.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/inspect.txt").trim_end())]
pub(super) struct Inspect {
    /// A table of `derived`, such as `trials`, `fits`, `poses/TRIAL` or `poses` of all trials, or
    /// any Parquet file; all of `derived` are listed if none is named.
    table: Option<String>,
    #[command(flatten)]
    query: Query,
    /// Columns to sort by; downwards with a minus sign or ` desc`.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "COLUMN,..")]
    sort: Vec<String>,
    /// Show the columns with their types, units and meanings instead of rows.
    #[arg(long, conflicts_with_all = ["columns", "condition", "sort", "head", "tail", "csv"])]
    schema: bool,
    #[command(flatten)]
    format: Format,
}

impl Inspect {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let derived = &context.config.paths.derived;
        let Some(name) = &self.table else {
            return list_tables(&context);
        };
        let path = find(derived, name)?;
        if self.schema {
            return show_schema(&path, self.format.json);
        }
        let sort = self.sort.iter().map(|key| sort_key(key)).collect::<Result<_, _>>()?;
        let view = query(&path, &Query { sort, ..self.query })?;
        if !view.left_out.is_empty() {
            let columns = view.left_out.iter();
            let columns: Vec<String> =
                columns.map(|column| format!("{} ({})", column.name, column.type_name)).collect();
            context.say(&format!("not shown: {}", columns.join(", ")));
        }
        if !self.format.view(&view) {
            show(&context, &view);
        }
        Ok(Outcome::Well)
    }
}

/// The rows with some digits.
fn show(context: &Context, view: &View) {
    let cells = view.cells(in_short);
    let mut table = Table::of(&cells);
    for (i, column) in view.columns.iter().enumerate() {
        let is_number = column.dtype == Some(DataType::Float64);
        table = table.column(&column.name, is_number, |row| row[i].clone());
    }
    let hidden = table.print_fitting(table::terminal_width());
    if hidden > 0 {
        context.say(&format!(
            "{hidden} columns do not fit on the terminal; --columns chooses, --csv has them all"
        ));
    }
    context.say(&format!("{} of {} rows", cells.len(), view.total));
}

/// Six significant digits, and a dash where nothing is.
fn in_short(cell: &AnyValue) -> String {
    match float(cell) {
        Some(number) => table::short(number),
        None if cell.is_null() => "-".to_owned(),
        None => text(cell),
    }
}

/// A column to sort by, and whether downwards.
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

fn show_schema(path: &std::path::Path, as_json: bool) -> Result<Outcome, Failure> {
    let info = describe_all(path)?;
    if as_json {
        let column = |of: &ColumnInfo| {
            serde_json::json!({
                "name": of.name,
                "type": of.type_name,
                "unit": unit(&of.name),
                "meaning": meaning(&of.name),
            })
            .to_string()
        };
        let columns: Vec<String> = info.columns.iter().map(column).collect();
        write_data(&format!("[{}]", columns.join(",\n ")));
        return Ok(Outcome::Well);
    }
    Table::of(&info.columns)
        .left("column", |column| column.name.clone())
        .left("type", |column| column.type_name.clone())
        .left("unit", |column| unit(&column.name).unwrap_or_default().to_owned())
        .left("meaning", |column| meaning(&column.name).unwrap_or_default())
        .print();
    say!("{} rows in {}", info.rows, path.display());
    for (key, value) in &info.metadata {
        let (start, is_cut) = match value.char_indices().nth(LONGEST_METADATA) {
            Some((end, _)) => (&value[..end], " .."),
            None => (&**value, ""),
        };
        say!("{key}: {start}{is_cut}");
    }
    Ok(Outcome::Well)
}

/// What there is to look into.
fn list_tables(context: &Context) -> Result<Outcome, Failure> {
    let derived = &context.config.paths.derived;
    let tables = list(derived);
    if tables.is_empty() {
        let none = "no tables; `trilink run` makes them";
        return Err(format!("{}: {none}", derived.display()).into());
    }
    let mut problems = BTreeSet::new();
    let row = |listed: &Listed| match describe(&listed.path) {
        Ok(info) => {
            let rows = match listed.tables {
                Some(tables) => format!("{tables} tables"),
                None => info.rows.to_string(),
            };
            [listed.name.clone(), rows, info.columns.len().to_string()]
        }
        Err(problem) => {
            problems.insert(problem.to_string());
            [listed.name.clone(), "-".to_owned(), "-".to_owned()]
        }
    };
    let rows: Vec<[String; 3]> = tables.iter().map(row).collect();
    Table::of(&rows)
        .left("table", |row| row[0].clone())
        .right("rows", |row| row[1].clone())
        .right("columns", |row| row[2].clone())
        .print();
    problems.iter().for_each(|problem| note!("{problem}"));
    Ok(Outcome::well_if(problems.is_empty()))
}
