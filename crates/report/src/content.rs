//! Content of a report, and the inputs of each of its figures and pages.

use std::path::PathBuf;
use std::sync::Arc;

use trilink_plot::Figure;
use trilink_tables::config::Paths;
use trilink_tables::trial::TRUTH_FILE;
use trilink_tables::{Reader, StoreError, is_there, tables_in};

use super::page::TrialPages;
use super::tables::{Tables, table_paths};
use super::trials::{self, PageParts};
use super::truth::Truth;
use super::{ReportError, ReportInput, figures, hash_of};
use crate::Changes;

/// Content of a report: input tables, figures to draw and pages to write.
#[derive(Debug)]
pub struct Content {
    pub(super) tables: Arc<Tables>,
    pub(super) figures: Vec<Figure>,
    pub(super) missing: Vec<String>,
    pub(super) truth: Option<Truth>,
    /// File names of the trial pages.
    pub(super) pages: TrialPages,
    /// Changes in the results since the baseline; `None` if there is no baseline.
    pub(super) changes: Option<Changes>,
    page_parts: PageParts,
    pub(super) reader: Reader,
}

/// Returns the existing input files of a report, each with a flag that is true if `trilink` itself wrote the file.
///
/// # Errors
/// Returns an error if a folder cannot be listed.
pub fn input_paths(paths: &Paths) -> Result<Vec<(PathBuf, bool)>, StoreError> {
    let tables = table_paths(&paths.derived).into_iter().map(|path| (path, true));
    let mut there = Vec::new();
    let truths = paths.raw.iter().map(|folder| (folder.join(TRUTH_FILE), false));
    let baseline = std::iter::once((paths.baseline.clone(), false));
    for (path, own) in tables.chain(truths).chain(baseline) {
        if is_there(&path)? {
            there.push((path, own));
        }
    }
    for folder in ["cycles", "poses", "wheels"] {
        let tables = tables_in(&paths.derived.join(folder))?;
        there.extend(tables.into_iter().map(|path| (path, true)));
    }
    Ok(there)
}

impl Content {
    /// Reads the tables and the true parameters of synthetic trials, and prepares the figures.
    ///
    /// # Errors
    /// Returns an error if `trials.parquet` does not exist or a file cannot be read.
    pub fn read(input: &ReportInput, reader: Reader) -> Result<Self, ReportError> {
        let tables = Arc::new(Tables::read(&input.paths.derived, &reader)?);
        let mut missing = tables.missing.clone();
        let truth = Truth::read(&input.paths, &tables.trials, &reader, &mut missing)?;
        let found = figures::figures((&*tables, &reader), input, truth.as_ref())?;
        missing.extend(found.missing);
        let pages = trials::pages(input, &tables);
        let page_parts = trials::parts(input, (&tables, truth.as_ref()), &pages, |path| {
            reader.0.get(path).map(|stamp| stamp.blake3.clone())
        });
        let figures = found.figures;
        let changes = None;
        Ok(Self { tables, figures, missing, truth, pages, changes, page_parts, reader })
    }

    /// Sets the changes since the baseline, which the report page shows; `None` means that there is no baseline.
    pub fn with_changes(self, changes: Option<Changes>) -> Self {
        Self { changes, ..self }
    }

    /// Returns the file stem, the campaigns and the content hash of every figure.
    pub fn figures(&self) -> impl Iterator<Item = (&str, &[String], String)> {
        let figures = self.figures.iter();
        figures.map(|figure| (&*figure.stem, &*figure.campaigns, hash_of(figure)))
    }

    /// Returns the campaign and the input hashes for every trial page, keyed by the page's path within `reports/`.
    pub fn page_parts(&self) -> &PageParts {
        &self.page_parts
    }
}
