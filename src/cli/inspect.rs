//! `trilink inspect`.

use std::collections::BTreeSet;

use polars::prelude::{AnyValue, DataType};

use super::output::{note, say, write_data};
use super::{Context, Failure, Outcome, table};
use crate::inspect::{
    ColumnInfo, Listed, Query, View, csv, describe, describe_all, find, float, json, list, meaning,
    query, text, unit,
};

/// Others write whole schemas into a file's metadata.
const LONGEST_METADATA: usize = 100;

#[derive(clap::Args)]
pub(super) struct Inspect {
    /// A table of `derived`, such as `trials`, `fits`, `poses/TRIAL` or `poses` of all trials, or
    /// any Parquet file; all of `derived` are listed if none is named.
    table: Option<String>,
    /// Columns to show, in this order; * is any characters, ? is one.
    #[arg(long, value_delimiter = ',', value_name = "COLUMN,..")]
    columns: Vec<String>,
    /// Rows to show, by a condition as SQL has it: "campaign = 'x' and omega_rad_s > 3".
    #[arg(long = "where", value_name = "CONDITION")]
    condition: Option<String>,
    /// Columns to sort by; downwards with a minus sign or ` desc`.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "COLUMN,..")]
    sort: Vec<String>,
    /// Rows at most, the first ones.
    #[arg(long, value_name = "N", conflicts_with = "tail")]
    head: Option<usize>,
    /// Rows at most, the last ones.
    #[arg(long, value_name = "N")]
    tail: Option<usize>,
    /// Show the columns with their types, units and meanings instead of rows.
    #[arg(long, conflicts_with_all = ["columns", "condition", "sort", "head", "tail", "csv"])]
    schema: bool,
    /// Print CSV with every digit.
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Print a JSON array of objects with every digit, or with `--schema` of the columns.
    #[arg(long)]
    json: bool,
}

impl Inspect {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let derived = &context.config.paths.derived;
        let Some(name) = &self.table else {
            return list_tables(&context);
        };
        let path = find(derived, name)?;
        if self.schema {
            return show_schema(&path, self.json);
        }
        let sort = self.sort.iter().map(|key| sort_key(key)).collect::<Result<_, _>>()?;
        let columns = self.columns.iter().map(|column| column.trim().to_owned()).collect();
        let Self { head, tail, .. } = self;
        let asked = Query { columns, condition: self.condition.clone(), sort, head, tail };
        let view = query(&path, &asked)?;
        if !view.left_out.is_empty() {
            let columns = view.left_out.iter();
            let columns: Vec<String> =
                columns.map(|column| format!("{} ({})", column.name, column.type_name)).collect();
            context.progress.say(&format!("not shown: {}", columns.join(", ")));
        }
        match (self.csv, self.json) {
            (true, _) => write_data(csv(&view).trim_end_matches('\n')),
            (_, true) => write_data(&json(&view)),
            _ => show(&context, &view),
        }
        Ok(Outcome::Well)
    }
}

/// The rows with some digits.
fn show(context: &Context, view: &View) {
    let cells = view.cells(in_short);
    let is_number = |column: &ColumnInfo| column.dtype == Some(DataType::Float64);
    let columns = view.columns.iter();
    let headings: Vec<_> =
        columns.map(|column| (column.name.as_str(), is_number(column))).collect();
    let hidden = table::print(&headings, &cells, table::terminal_width());
    if hidden > 0 {
        context.progress.say(&format!(
            "{hidden} columns do not fit on the terminal; --columns chooses, --csv has them all"
        ));
    }
    context.progress.say(&format!("{} of {} rows", cells.len(), view.total));
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
    let row = |column: &ColumnInfo| {
        vec![
            column.name.clone(),
            column.type_name.clone(),
            unit(&column.name).unwrap_or_default().to_owned(),
            meaning(&column.name).unwrap_or_default(),
        ]
    };
    let rows: Vec<Vec<String>> = info.columns.iter().map(row).collect();
    table::print(&["column", "type", "unit", "meaning"].map(|name| (name, false)), &rows, None);
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
    let headings = [("table", false), ("rows", true), ("columns", true)];
    let mut problems = BTreeSet::new();
    let row = |listed: &Listed| match describe(&listed.path) {
        Ok(info) => {
            let rows = match listed.tables {
                Some(tables) => format!("{tables} tables"),
                None => info.rows.to_string(),
            };
            vec![listed.name.clone(), rows, info.columns.len().to_string()]
        }
        Err(problem) => {
            problems.insert(problem.to_string());
            vec![listed.name.clone(), "-".to_owned(), "-".to_owned()]
        }
    };
    let rows: Vec<Vec<String>> = tables.iter().map(row).collect();
    table::print(&headings, &rows, None);
    problems.iter().for_each(|problem| note!("{problem}"));
    Ok(if problems.is_empty() { Outcome::Well } else { Outcome::NeedsAttention })
}
