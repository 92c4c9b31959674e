//! Figures of merit by run, and `history.html` that draws them.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value as Json, json};

use super::CompareError;
use crate::report::{
    Figure, Layer, Layout, Look, Panel, Scale, colours, fill, image, percent, significant,
};
use crate::store::{RunStatus, rows, write_bytes};

rows! {
    /// One figure of merit of one run: `history.parquet`.
    pub struct HistoryRow {
        /// When the run ended, UTC.
        pub time: String,
        /// Counts the runs.
        pub run: i64,
        /// How it ended; missing in histories from before this was kept.
        pub status: Option<RunStatus>,
        pub version: String,
        /// Empty for what is of the whole run, as is the model.
        pub campaign: String,
        pub model: String,
        pub quantity: String,
        pub value: f64,
        /// Why a run became the new baseline, or did not come to its end; then nothing was measured.
        pub note: String,
    }
}

/// The page beside the history.
pub const PAGE: &str = "history.html";
/// The quantity of a row that tells of a new baseline.
pub const ACCEPTED: &str = "accepted";

/// A figure of merit by run.
type Series = Vec<(f64, f64)>;

/// Writes the page beside the history.
///
/// # Errors
/// A figure cannot be drawn or the page not written.
pub fn write(reports: &Path, rows: &[HistoryRow]) -> Result<(), CompareError> {
    // What is of whole runs comes last.
    let mut groups: BTreeMap<(bool, &str), Vec<(String, Series)>> = BTreeMap::new();
    for row in rows.iter().filter(|row| row.note.is_empty()) {
        let name = match row.model.is_empty() {
            true => row.quantity.clone(),
            false => format!("{}: {}", row.model, row.quantity),
        };
        let series = groups.entry((row.campaign.is_empty(), &row.campaign)).or_default();
        let point = (row.run as f64, row.value);
        match series.iter_mut().find(|(known, _)| *known == name) {
            Some((_, points)) => points.push(point),
            None => series.push((name, vec![point])),
        }
    }
    let groups = groups.iter().map(|((_, campaign), series)| group(campaign, series));
    let notes = rows.iter().filter(|row| row.quantity == ACCEPTED);
    let notes = notes.map(|row| json!([row.time, row.note, significant(row.value, 3)]));
    let failures = rows.iter().filter(|row| row.quantity.is_empty());
    let failures =
        failures.map(|row| json!([row.time, row.run, row.status.map(RunStatus::name), row.note]));
    let page = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "runs": rows.iter().map(|row| row.run).max().unwrap_or(0),
        "first": rows.first().map_or("", |row| &row.time),
        "last": rows.last().map_or("", |row| &row.time),
        "groups": groups.collect::<Result<Vec<_>, _>>()?,
        "failures": failures.collect::<Vec<_>>(),
        "notes": notes.collect::<Vec<_>>(),
    });
    let html = fill(PAGE, include_str!("history.html"), &page)
        .map_err(|error| CompareError::File { file: PAGE, message: error.to_string() })?;
    write_bytes(&reports.join(PAGE), html.as_bytes())?;
    Ok(())
}

/// The figure and the table of a campaign, or of what is of whole runs.
fn group(campaign: &str, series: &[(String, Series)]) -> Result<Json, CompareError> {
    let name = match campaign.is_empty() {
        true => "Whole runs".to_owned(),
        false => format!("Campaign {campaign}"),
    };
    let panel = |(name, points): &(String, Series)| {
        let dots = Look::Dots { colour: colours::TREND, joined: true };
        let layer = Layer::new(name, points.iter().copied(), dots);
        Panel { y_scale: Scale::Decades, ..Panel::new(name, "run", "", vec![layer]) }
    };
    let panels = series.iter().map(panel).collect();
    let texts = [format!("{name}, run by run"), String::new()];
    let figure = Figure::new("", texts, &[campaign], Layout::Grid, panels);
    let row = |(name, points): &(String, Series)| {
        let values: Vec<f64> = points.iter().map(|(_, value)| *value).collect();
        let last = values.last().copied().unwrap_or(f64::NAN);
        let change = |then: Option<&f64>| match then {
            Some(then) if values.len() > 1 => percent(last, *then),
            _ => String::new(),
        };
        // Against the run before, and against the first.
        json!({
            "name": name,
            "last": significant(last, 5),
            "since_last": change(values.iter().nth_back(1)),
            "since_first": change(values.first()),
        })
    };
    let rows: Vec<Json> = series.iter().map(row).collect();
    Ok(json!({ "name": name, "figure": image(&figure)?, "rows": rows }))
}
