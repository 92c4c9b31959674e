//! `history.html`: every figure of merit against the runs.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::CompareError;
use super::history::HistoryRow;
use crate::report::{Axes, Chart, Figure, Image, Layer, colours, fill, percent, significant};
use crate::store::write_bytes;

#[derive(Serialize)]
struct Page<'p> {
    version: &'static str,
    runs: usize,
    first: &'p str,
    last: &'p str,
    groups: Vec<Group>,
    notes: Vec<[String; 3]>,
}

/// A campaign, or what is of whole runs.
#[derive(Serialize)]
struct Group {
    name: String,
    figure: Image,
    rows: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    name: String,
    last: String,
    /// Against the run before, and against the first.
    since_last: String,
    since_first: String,
}

/// A figure of merit by run.
type Series<'r> = Vec<(i64, f64, &'r str)>;

/// Writes the page beside the history.
///
/// # Errors
/// A figure cannot be drawn or the page not written.
pub fn write(reports: &Path, rows: &[HistoryRow]) -> Result<(), CompareError> {
    let mut groups: BTreeMap<&str, Vec<(String, Series)>> = BTreeMap::new();
    for row in rows.iter().filter(|row| row.note.is_empty()) {
        let name = match row.model.is_empty() {
            true => row.quantity.clone(),
            false => format!("{}: {}", row.model, row.quantity),
        };
        let series = groups.entry(&row.campaign).or_default();
        let point = (row.run, row.value, row.time.as_str());
        match series.iter_mut().find(|(known, _)| *known == name) {
            Some((_, points)) => points.push(point),
            None => series.push((name, vec![point])),
        }
    }
    // What is of whole runs comes last.
    let (whole, campaigns): (Vec<_>, Vec<_>) =
        groups.into_iter().partition(|(campaign, _)| campaign.is_empty());
    let groups = campaigns.into_iter().chain(whole);
    let groups = groups.map(|(campaign, series)| group(campaign, &series));
    let notes = rows.iter().filter(|row| !row.note.is_empty());
    let notes =
        notes.map(|row| [row.time.clone(), row.note.clone(), significant(row.value, 3)]).collect();
    let page = Page {
        version: env!("CARGO_PKG_VERSION"),
        runs: rows.last().map_or(0, |row| row.run as usize),
        first: rows.first().map_or("", |row| &row.time),
        last: rows.last().map_or("", |row| &row.time),
        groups: groups.collect::<Result<_, _>>()?,
        notes,
    };
    let html = fill("history.html", include_str!("history.html"), &page)
        .map_err(|error| CompareError::File { file: "history.html", message: error.to_string() })?;
    write_bytes(&reports.join("history.html"), html.as_bytes())?;
    Ok(())
}

fn group(campaign: &str, series: &[(String, Series)]) -> Result<Group, CompareError> {
    let name = match campaign.is_empty() {
        true => "Whole runs".to_owned(),
        false => format!("Campaign {campaign}"),
    };
    let chart = |(name, points): &(String, Series)| Chart {
        title: name.clone(),
        x_label: "run".to_owned(),
        y_label: String::new(),
        layers: vec![Layer::Line {
            name: name.clone(),
            points: points.iter().map(|(run, value, _)| (*run as f64, *value)).collect(),
            colour: colours::TREND,
        }],
        axes: Axes::LinearAcross,
        ..Chart::default()
    };
    let charts = series.iter().map(chart).collect();
    let figure = Figure::of_charts("", format!("{name}, run by run"), &[campaign], charts);
    let row = |(name, points): &(String, Series)| {
        let values: Vec<f64> = points.iter().map(|(_, value, _)| *value).collect();
        let last = values.last().copied().unwrap_or(f64::NAN);
        let change = |then: Option<&f64>| match then {
            Some(then) if values.len() > 1 => percent(last, *then),
            _ => String::new(),
        };
        Row {
            name: name.clone(),
            last: significant(last, 5),
            since_last: change(values.iter().nth_back(1)),
            since_first: change(values.first()),
        }
    };
    Ok(Group { figure: Image::draw(&figure)?, rows: series.iter().map(row).collect(), name })
}
