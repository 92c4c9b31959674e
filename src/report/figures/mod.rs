//! The figures: which there are, and which of them the tables at hand allow.

mod common;
mod fits;
pub mod frequency;
mod recovered;
mod release;
mod residuals;
mod simulations;
mod texts;
mod tracking;
pub mod trial;
mod work;

use std::collections::BTreeSet;

use super::drawing::Figure;
use super::recording::Recording;
use super::tables::Tables;
use super::truth::Truth;
use crate::report::ReportInput;
use crate::report::series::{DISPLACEMENT, SPEED, Source};
use crate::report::simulated;
use crate::store::{Reader, StoreError, TrialRow};
use crate::trial::TrialKind;

pub const SKEWED: &str = "kinematic-skewed";
pub const SYMMETRIC: &str = "kinematic-symmetric";
pub const SEMI_PASSIVE: &str = "semi-passive-symmetric";
/// The campaigns of the paper, in its order.
pub const PAPER_CAMPAIGNS: [&str; 3] = [SKEWED, SYMMETRIC, SEMI_PASSIVE];

/// Whether any of the campaigns is the paper's.
pub fn are_of_the_paper(campaigns: &BTreeSet<&str>) -> bool {
    PAPER_CAMPAIGNS.iter().any(|campaign| campaigns.contains(campaign))
}

/// Names that the files of the paper's figures can have.
pub const PAPER_STEMS: [&str; 17] = [
    "fig03", "fig04", "fig05", "fig06", "fig08", "fig09", "fig10", "fig11", "fig12", "fig13",
    "fig14", "fig15", "fig16", "fig17", "fig18", "fig19", "fig20",
];
/// The figure of planted truth, and that of the actuators' work.
pub const TRUTH: &str = "truth";
const WORK: &str = "work";

/// A figure of more panels would not fit into a picture.
const MOST_PANELS: usize = 100;

/// Frequency of the trials that the paper shows moment by moment, rad/s.
const SHOWN_RAD_S: f64 = 3.9;

/// Names that the files of all figures of the paper's campaigns can have.
#[cfg(test)]
pub fn known_stems() -> Vec<String> {
    let own = PAPER_CAMPAIGNS.iter().flat_map(|campaign| {
        let kinds = fits::KINDS.into_iter().chain(["residuals"]);
        kinds.map(move |kind| format!("{campaign}-{kind}"))
    });
    let paper = PAPER_STEMS.into_iter().chain([TRUTH, WORK]);
    paper.map(str::to_owned).chain(own).collect()
}

/// Figures to draw, sentences on what is missing, and what they are made from.
pub struct Figures<'r> {
    pub figures: Vec<Figure>,
    pub missing: Vec<String>,
    tables: &'r Tables,
    source: Source<'r>,
    reader: &'r Reader,
    config: &'r ReportInput,
}

/// The paper's figures for its campaigns, and for every other campaign one with what the
/// models predict and one with the wheels' skid; then of every campaign what its models miss and
/// how its fits came about.
///
/// # Errors
/// A table of a trial that is drawn cannot be read.
pub fn figures<'r>(
    (tables, reader): (&'r Tables, &'r Reader),
    config: &'r ReportInput,
    truth: Option<&Truth>,
) -> Result<Figures<'r>, StoreError> {
    let (source, configured) = (tables.source(config), &tables.campaigns(config));
    let (figures, missing) = (Vec::new(), Vec::new());
    let mut found = Figures { figures, missing, tables, source, reader, config };
    if are_of_the_paper(configured) {
        found.missing = missing_of_the_paper(source, configured);
        found.of_the_paper()?;
    }
    let mut stems = BTreeSet::new();
    let is_of_the_paper = |campaign: &&str| PAPER_CAMPAIGNS.contains(campaign);
    let mut campaigns: Vec<&str> = configured.iter().copied().collect();
    campaigns.sort_by_key(is_of_the_paper);
    for campaign in campaigns {
        let name = match is_of_the_paper(&campaign) {
            true => campaign.to_owned(),
            false => file_name(campaign, &mut stems),
        };
        if !is_of_the_paper(&campaign) {
            let own = [
                frequency::models(&format!("{name}-d-v"), campaign, source),
                frequency::skid(&format!("{name}-sigma"), &[campaign], source),
            ];
            if own.iter().all(Figure::is_empty) {
                found.missing.push(format!("Campaign {campaign}: nothing to draw, {NOTHING}"));
            }
            found.figures.extend(own);
        }
        found.figures.push(residuals::figure(&name, campaign, source));
        found.figures.extend(fits::figures(&name, campaign, tables));
    }
    found.figures.push(work::figure(WORK, tables, config));
    found.figures.extend(truth.map(|truth| recovered::figure(TRUTH, truth, tables, source)));
    let Figures { figures, missing, .. } = &mut found;
    figures.iter_mut().for_each(|figure| figure.print = config.print());
    figures.retain(|figure| !figure.is_empty());
    figures.retain(|Figure { stem, panels, .. }| {
        let is_drawn = panels.len() <= MOST_PANELS;
        let why = format!("found {} panels, needed at most {MOST_PANELS}", panels.len());
        missing.extend((!is_drawn).then(|| format!("Figure {stem} is not drawn: {why}.")));
        is_drawn
    });
    Ok(found)
}

impl Figures<'_> {
    fn add(&mut self, figures: Result<impl IntoIterator<Item = Figure>, String>) {
        match figures {
            Ok(figures) => self.figures.extend(figures),
            Err(sentence) => self.missing.push(sentence),
        }
    }

    /// The paper's figures, in its order.
    fn of_the_paper(&mut self) -> Result<(), StoreError> {
        let source = self.source;
        self.add(simulations::steady_passive(self.config));
        self.add(simulations::skidding(self.config).map(Some));
        self.release()?;
        self.tracked("fig09", SKEWED)?;
        self.figures.push(frequency::measured("fig10", SKEWED, &SPEED, source));
        self.tracked("fig11", SYMMETRIC)?;
        self.figures.push(frequency::measured("fig13", SYMMETRIC, &DISPLACEMENT, source));
        self.tracked("fig14", SEMI_PASSIVE)?;
        self.figures.extend([
            frequency::measured("fig15", SEMI_PASSIVE, &SPEED, source),
            frequency::models("fig16", SKEWED, source),
            frequency::models("fig17", SYMMETRIC, source),
            frequency::models("fig18", SEMI_PASSIVE, source),
            frequency::skid("fig19", &[SYMMETRIC, SKEWED], source),
            frequency::skid("fig20", &[SYMMETRIC, SEMI_PASSIVE], source),
        ]);
        Ok(())
    }

    fn recording(&self, trial: &str) -> Result<Result<Recording, String>, StoreError> {
        let recording = Recording::read(&self.config.paths.derived, trial, self.reader)?;
        Ok(recording
            .ok_or_else(|| format!("poses/{trial}.parquet or wheels/{trial}.parquet is not there")))
    }

    /// Fig. 8: the first release of the semi-passive robot that follows its law.
    fn release(&mut self) -> Result<(), StoreError> {
        let releases = self.tables.robots.iter();
        let releases = releases.filter(|row| row.kind == TrialKind::JointRelease);
        let figure = match releases.min_by_key(|row| !row.status.is_ok()) {
            None => Err("no trial of kind joint-release has results".to_owned()),
            Some(row) if !row.status.is_ok() => {
                Err(format!("of trial {}, {}", row.trial, row.status))
            }
            Some(row) => self.recording(&row.trial)?.and_then(|recording| {
                let no_swing = || format!("the tables of trial {} show no swing", row.trial);
                release::figure(row, &recording).ok_or_else(no_swing)
            }),
        };
        self.add(figure.map(Some).map_err(|why| not_drawn("fig08", &why)));
        Ok(())
    }

    /// The figure of the campaign's trial nearest to [`SHOWN_RAD_S`] as it was tracked; of the
    /// symmetric campaign its wheels too. Without a trial there is none.
    fn tracked(&mut self, stem: &str, campaign: &str) -> Result<(), StoreError> {
        let distance = |trial: &&TrialRow| (trial.omega_rad_s - SHOWN_RAD_S).abs();
        let measured = self.source.measured_trials(campaign);
        let nearest = measured
            .filter(|trial| simulated::OMEGAS_RAD_S.contains(&trial.omega_rad_s))
            .min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.trial.cmp(&b.trial)));
        let Some(trial) = nearest else { return Ok(()) };
        let recording = self.recording(&trial.trial)?;
        let (config, missing) = (self.config, &mut self.missing);
        let draw = || {
            let setup = config.campaign_setup(campaign);
            setup.ok_or_else(|| format!("campaign {campaign} is not configured"))?;
            let recording = recording?;
            let figure = tracking::figure(stem, trial, &recording, config, missing)
                .ok_or_else(|| format!("trial {} has no used cycle", trial.trial))?;
            let wheels = (campaign == SYMMETRIC)
                .then(|| tracking::wheels("fig12", trial, &recording))
                .flatten();
            Ok::<_, String>([figure].into_iter().chain(wheels))
        };
        let figures = draw().map_err(|why| not_drawn(stem, &why));
        self.add(figures);
        Ok(())
    }
}

fn not_drawn(stem: &str, why: &str) -> String {
    format!("{} is not drawn, because {why}.", number(stem))
}

const NOTHING: &str = "because it has no trial with results and no prediction.";

/// The paper's figures of a campaign: moment by moment, against the frequency, and together with
/// another campaign.
const OF_CAMPAIGNS: [(&str, &str, &str, &str); 3] = [
    (SKEWED, "Fig. 9", "10, 16", "19"),
    (SYMMETRIC, "Figs. 11 and 12", "13, 17", "19, 20"),
    (SEMI_PASSIVE, "Fig. 14", "15, 18", "20"),
];

fn missing_of_the_paper(source: Source<'_>, configured: &BTreeSet<&str>) -> Vec<String> {
    let of_campaign = |(campaign, tracked, own, shared)| {
        let without = match (source.has_measurements(campaign), source.models(campaign).len()) {
            (false, 0) => {
                let why = match configured.contains(campaign) {
                    true => NOTHING,
                    false => "because the configuration does not have it.",
                };
                format!(
                    "{tracked} and Figs. {own} are not drawn and Fig. {shared} does not show it, {why}"
                )
            }
            (false, _) => format!(
                "{tracked} not drawn and no measurements in Figs. {own}, because no trial has results."
            ),
            (true, 0) => {
                format!("no model in Figs. {own} and {shared}, because nothing was fitted.")
            }
            (true, _) => return None,
        };
        Some(format!("Campaign {campaign}: {without}"))
    };
    OF_CAMPAIGNS.into_iter().filter_map(of_campaign).collect()
}

/// Place of a campaign: those of the paper in its order, then the others by name.
pub fn rank(campaign: &str) -> (usize, &str) {
    let paper = PAPER_CAMPAIGNS.iter().position(|known| *known == campaign);
    (paper.unwrap_or(PAPER_CAMPAIGNS.len()), campaign)
}

/// Campaigns that have measurements, in the paper's order and then by name.
fn campaigns_of(source: Source<'_>) -> Vec<&str> {
    let campaigns = source.trials.iter().map(|trial| rank(&trial.campaign));
    let ranked: BTreeSet<(usize, &str)> = campaigns.collect();
    let names = ranked.into_iter().map(|(_, name)| name);
    names.filter(|campaign| source.has_measurements(campaign)).collect()
}

/// The name of a campaign or trial as a file name; a number keeps two that look alike apart.
pub fn file_name(name: &str, taken: &mut BTreeSet<String>) -> String {
    let safe = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' };
    let base: String = name.chars().map(safe).collect();
    let base = if base.starts_with('.') { format!("_{base}") } else { base };
    let numbered = (2..).map(|number| format!("{base}-{number}"));
    let mut names = [base.clone()].into_iter().chain(numbered);
    names.find(|name| taken.insert(name.to_lowercase())).unwrap_or(base)
}

/// `Fig. 16` for `fig16`, nothing for figures that the paper does not have.
pub fn number(stem: &str) -> String {
    let digits = stem.strip_prefix("fig").filter(|_| PAPER_STEMS.contains(&stem));
    digits.map_or(String::new(), |digits| format!("Fig. {}", digits.trim_start_matches('0')))
}
