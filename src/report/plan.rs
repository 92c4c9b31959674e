//! Which figures have to be drawn again, and why.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::drawing::Figure;
use super::page;
use super::tables::{Tables, table_paths};
use super::truth::Truth;
use super::{EXTENSIONS, REPORT_VERSION, ReportError, figures, trials};
use crate::report::ReportInput;
use crate::store::{
    How, Parts, Redo, StageState, Stamp, VERSION, absolute, changed_outputs, changed_settings,
    flatten, hash, reasons,
};
use crate::trial::TRUTH_FILE;

const CONTENT: &str = "what it shows";
const CAMPAIGNS: &str = "the list of its campaigns";

/// What a report has to do.
pub struct ReportPlan<'s> {
    pub redo: Redo,
    pub(super) known: &'s StageState,
    /// Missing where nothing is to be done.
    pub(super) content: Option<Content>,
    /// SVGs and files of figures that stay.
    pub(super) kept: BTreeMap<String, (String, BTreeMap<String, Stamp>)>,
    /// What the trials' pages are made of, by their path inside of `reports/`.
    pub(super) pages: BTreeMap<String, Parts>,
    /// Those that stay.
    pub(super) kept_pages: BTreeSet<String>,
    inputs: BTreeMap<String, Stamp>,
    settings: BTreeMap<String, String>,
    input: String,
}

/// What a report is made of.
pub(super) struct Content {
    pub tables: Tables,
    pub figures: Vec<Figure>,
    pub missing: Vec<String>,
    pub truth: Option<Truth>,
}

/// Compares tables, configuration and truth with what the record knows of the last report.
///
/// # Errors
/// `trials.parquet` is not there, or a table cannot be read.
pub fn plan<'s>(
    config: &ReportInput,
    known: &'s StageState,
    how: How,
) -> Result<ReportPlan<'s>, ReportError> {
    let reports = &config.paths.reports;
    let settings = flatten(config);
    // A change of the template tells itself.
    let input = format!("version {REPORT_VERSION}, page {}", &hash(page::texts().as_bytes())[..16]);
    let derived = &config.paths.derived;
    let (mut tables, truth) = (table_paths(derived), config.paths.raw.join(TRUTH_FILE));
    tables.extend(trials::table_paths(derived));
    let read: Vec<&PathBuf> = tables.iter().chain([&truth]).filter(|path| path.is_file()).collect();
    let damaged = changed_outputs(reports, all_outputs(known), how.verify);
    let mut redo = Redo::new("figure");
    let is_same = !how.force
        && known.input == input
        && known.settings == settings
        && damaged.is_empty()
        && known.has_read(read.iter().map(|path| path.as_path()), how.verify);
    if is_same {
        redo.up_to_date = known.things.len();
        return Ok(ReportPlan {
            redo,
            known,
            content: None,
            kept: BTreeMap::new(),
            pages: BTreeMap::new(),
            kept_pages: BTreeSet::new(),
            inputs: known.inputs.clone(),
            settings,
            input,
        });
    }
    let content = Content::read(config)?;
    let renew = |path: &&PathBuf| match **path == truth {
        true => known.renew(path, how.verify),
        false => known.renew_own(path, how.verify),
    };
    let inputs: BTreeMap<String, Stamp> =
        read.iter().filter_map(|path| Some((absolute(path), renew(path).ok()?))).collect();
    let mut kept = BTreeMap::new();
    for figure in &content.figures {
        let mut why = Vec::new();
        match known.things.get(&figure.stem) {
            _ if how.force => why.push("--force".to_owned()),
            None => why.push("new".to_owned()),
            Some(thing) => {
                why.extend(reasons(&thing.parts, &parts(figure), Vec::new));
                why.extend(changed_outputs(reports, &thing.outputs, how.verify));
                let svg = thing.outputs.iter().find(|(name, _)| name.ends_with(".svg"));
                match svg.and_then(|(name, stamp)| intact_text(&reports.join(name), stamp)) {
                    Some(svg) if why.is_empty() => {
                        kept.insert(figure.stem.clone(), (svg, thing.outputs.clone()));
                    }
                    None if why.is_empty() => why.push("its SVG cannot be read".to_owned()),
                    _ => {}
                }
            }
        }
        redo.add(&figure.stem, why);
    }
    let stamp = |path: &Path| inputs.get(&absolute(path)).map(|stamp| stamp.blake3.clone());
    let pages = trials::parts(config, &content.tables, &trials::pages(&content.tables), stamp);
    let mut kept_pages = BTreeSet::new();
    for (name, parts) in &pages {
        let why = match known.things.get(name) {
            _ if how.force => vec!["--force".to_owned()],
            None => vec!["new".to_owned()],
            Some(thing) => {
                let changed = changed_outputs(reports, &thing.outputs, how.verify);
                reasons(&thing.parts, parts, Vec::new).into_iter().chain(changed).collect()
            }
        };
        if why.is_empty() {
            kept_pages.insert(name.clone());
        }
        redo.add(name, why);
    }
    let drawn = content.figures.iter().map(|figure| &figure.stem);
    let drawn: BTreeSet<&String> = drawn.chain(pages.keys()).collect();
    redo.removed = known.things.keys().filter(|name| !drawn.contains(name)).cloned().collect();
    let same_inputs = known.inputs.len() == inputs.len()
        && inputs.iter().all(|(path, stamp)| {
            known.inputs.get(path).is_some_and(|known| known.blake3 == stamp.blake3)
        });
    if redo.things.is_empty() {
        redo.whole.extend(changed_outputs(reports, &known.outputs, how.verify));
        if known.input != input {
            redo.whole.push(format!("the stage is of {input}, was {}", known.input));
        }
        redo.whole.extend(changed_settings(&known.settings, &settings, &[String::new()]));
        if !same_inputs {
            redo.whole.push("a table or truth.json changed".to_owned());
        }
    }
    // Tables with other times and the same bytes change nothing.
    let content = Some(content).filter(|_| !redo.is_empty());
    Ok(ReportPlan { redo, known, content, kept, pages, kept_pages, inputs, settings, input })
}

/// What there will be to do once the stages before have changed what they have of `campaigns` and
/// of single `trials`.
pub fn plan_after(
    known: &StageState,
    how: How,
    campaigns: &BTreeSet<String>,
    trials: &[String],
) -> Redo {
    let mut redo = Redo::new("figure");
    for stem in &known.order {
        let shown = known.things.get(stem).and_then(|thing| thing.parts.get(CAMPAIGNS));
        let shows = |campaign: &str| campaigns.contains(campaign);
        let is_touched = shown.is_none_or(|shown| shown.split('\n').any(shows));
        let mut why = Vec::new();
        if how.force {
            why.push("--force".to_owned());
        } else if is_touched {
            why.push("if what it shows changes".to_owned());
        }
        redo.add(stem, why);
    }
    let own: BTreeSet<String> = trials.iter().map(|trial| trials::page_of(trial)).collect();
    for page in known.things.keys().filter(|name| trials::is_page(name)) {
        let mut why = Vec::new();
        if how.force {
            why.push("--force".to_owned());
        } else if own.contains(page) {
            why.push("if its trial changes".to_owned());
        }
        redo.add(page, why);
    }
    redo.whole.push(if known.order.is_empty() { "new" } else { "if a table changes" }.to_owned());
    redo
}

fn all_outputs(known: &StageState) -> impl Iterator<Item = (&String, &Stamp)> {
    known.things.values().flat_map(|thing| &thing.outputs).chain(&known.outputs)
}

/// The text of a file if it is what was written.
fn intact_text(path: &Path, stamp: &Stamp) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    (hash(text.as_bytes()) == stamp.blake3).then_some(text)
}

/// What a figure is made of. Numbers are printed such that they can be told apart.
pub(super) fn parts(figure: &Figure) -> Parts {
    Parts::from([
        (VERSION.to_owned(), REPORT_VERSION.to_string()),
        (CONTENT.to_owned(), hash(format!("{figure:?}").as_bytes())),
        (CAMPAIGNS.to_owned(), figure.campaigns.join("\n")),
    ])
}

/// Of a figure, inside of `reports/`.
pub(super) fn file_name(stem: &str, extension: &str) -> String {
    format!("figures/{stem}.{extension}")
}

/// Removes figures that an earlier report drew and this one does not: those that the record has,
/// and those of the paper's campaigns.
pub(super) fn remove_stale(
    reports: &Path,
    known: &StageState,
    figures: &[Figure],
) -> Result<(), ReportError> {
    let drawn: BTreeSet<&str> = figures.iter().map(|figure| figure.stem.as_str()).collect();
    let of_the_paper = figures::known_stems();
    let stems = of_the_paper.iter().chain(known.things.keys());
    // Figures lie in their folder; nothing else is removed, whatever the record says.
    let stems = stems.filter(|stem| !stem.contains(['/', '\\']));
    for stem in stems.filter(|stem| !drawn.contains(stem.as_str())) {
        for extension in EXTENSIONS {
            let path = reports.join(file_name(stem, extension));
            match std::fs::remove_file(&path) {
                Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                    return Err(ReportError::Remove { path, source });
                }
                _ => {}
            }
        }
    }
    Ok(())
}

impl Content {
    fn read(config: &ReportInput) -> Result<Self, ReportError> {
        let tables = Tables::read(&config.paths.derived)?;
        let mut missing = tables.missing.clone();
        let truth = Truth::read(&config.paths.raw).unwrap_or_else(|problem| {
            missing.push(problem);
            None
        });
        let found = figures::figures(&tables, config, truth.as_ref());
        missing.extend(found.missing);
        Ok(Self { tables, figures: found.figures, missing, truth })
    }
}

impl ReportPlan<'_> {
    /// The record's part: of a report that is still to be made without what it leaves.
    pub(super) fn state(&self) -> StageState {
        let inputs = self.inputs.clone();
        match self.content {
            None => StageState { inputs, ..self.known.clone() },
            Some(_) => StageState {
                inputs,
                input: self.input.clone(),
                settings: self.settings.clone(),
                ..StageState::default()
            },
        }
    }
}
