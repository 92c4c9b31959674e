//! What a report is made of, and what each of its figures and pages.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::drawing::Figure;
use super::page::TrialPages;
use super::tables::{Tables, table_paths};
use super::truth::Truth;
use super::{ReportError, ReportInput, figures, trials};
use crate::config::Paths;
use crate::store::hash;
use crate::trial::TRUTH_FILE;

/// What a report is made of.
#[derive(Debug)]
pub struct Content {
    pub(super) tables: Arc<Tables>,
    pub(super) figures: Vec<Figure>,
    pub(super) missing: Vec<String>,
    pub(super) truth: Option<Truth>,
    /// Files of the trials' pages.
    pub(super) pages: TrialPages,
    page_parts: BTreeMap<String, BTreeMap<String, String>>,
}

/// Files that there are to read, and whether they are the program's own.
pub fn input_paths(paths: &Paths) -> Vec<(PathBuf, bool)> {
    let mut tables = table_paths(&paths.derived);
    tables.extend(trials::table_paths(&paths.derived));
    let tables = tables.into_iter().map(|path| (path, true));
    let all = tables.chain([(paths.raw.join(TRUTH_FILE), false)]);
    all.filter(|(path, _)| path.is_file()).collect()
}

impl Content {
    /// Reads the tables and the truth, and puts the figures together. `hash_of` gives the hash of
    /// a file that is read.
    ///
    /// # Errors
    /// `trials.parquet` is not there, or a table cannot be read.
    pub fn read(
        input: &ReportInput,
        hash_of: impl Fn(&Path) -> Option<String>,
    ) -> Result<Self, ReportError> {
        let tables = Arc::new(Tables::read(&input.paths.derived)?);
        let mut missing = tables.missing.clone();
        let truth = Truth::read(&input.paths.raw).unwrap_or_else(|problem| {
            missing.push(problem);
            None
        });
        let found = figures::figures(&tables, input, truth.as_ref());
        missing.extend(found.missing);
        let pages = trials::pages(&tables);
        let page_parts = trials::parts(input, &tables, &pages, hash_of);
        Ok(Self { tables, figures: found.figures, missing, truth, pages, page_parts })
    }

    /// Stem, campaigns and hash of every figure. Numbers are printed such that they can be told
    /// apart.
    pub fn figures(&self) -> impl Iterator<Item = (&str, &[String], String)> {
        self.figures.iter().map(|figure| {
            let hash = hash(format!("{figure:?}").as_bytes());
            (figure.stem.as_str(), figure.campaigns.as_slice(), hash)
        })
    }

    /// What the page of every trial is made of, by its path inside of `reports/`.
    pub fn page_parts(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        &self.page_parts
    }
}
