//! Figures of the report: their kinds and names, and the choice of those for which the tables have data.

mod amplitude;
mod coast;
mod common;
mod fits;
pub(crate) mod frequency;
mod recovered;
mod release;
mod residuals;
mod simulations;
mod texts;
mod tracking;
pub(crate) mod trial;
mod work;

use std::collections::BTreeSet;

use rayon::prelude::*;

pub use common::FREQUENCY;
pub(crate) use common::{link_noun, subscripted, wheels};
pub(crate) use texts::texts;

use trilink_plot::Figure;
use trilink_robot::{AnyGait, AnyRobot, Gait, JointCommand, Quantity};
use trilink_tables::config::RobotConfig;
use trilink_tables::trial::TrialKind;
use trilink_tables::{Reader, RobotParameterRow, StoreError, TrialRow};

use super::recording::Recording;
use super::tables::Tables;
use super::truth::Truth;
use crate::series::Source;
use crate::simulated;
use crate::{ReportInput, optimum};

pub(crate) const SKEWED: &str = "kinematic-skewed";
pub(crate) const SYMMETRIC: &str = "kinematic-symmetric";
pub(crate) const SEMI_PASSIVE: &str = "semi-passive-symmetric";
/// Names of the campaigns in the paper, in the paper's order.
pub(crate) const PAPER_CAMPAIGNS: [&str; 3] = [SKEWED, SYMMETRIC, SEMI_PASSIVE];

/// Returns whether any of the given campaigns is a campaign of the paper.
pub(crate) fn are_of_the_paper(campaigns: &BTreeSet<&str>) -> bool {
    PAPER_CAMPAIGNS.iter().any(|campaign| campaigns.contains(campaign))
}

/// Kind of figure: the suffix of its file names, and the figures of this kind in the paper. Each of the latter is given
/// by its file name without extension and the campaigns that it shows (all campaigns of the robot, if the figure
/// describes a robot).
#[derive(Clone, Copy)]
struct Kind(&'static str, &'static [(&'static str, &'static [&'static str])]);

const SIMULATED: Kind = Kind("simulated", &[("fig03", &[SEMI_PASSIVE]), ("fig06", &[SYMMETRIC])]);
const FROM_REST: Kind = Kind("from-rest", &[("fig04", &[SEMI_PASSIVE])]);
const SWEEP: Kind = Kind("sweep", &[("fig05", &[SEMI_PASSIVE])]);
const GAIT: Kind =
    Kind("gait", &[("fig09", &[SKEWED]), ("fig11", &[SYMMETRIC]), ("fig14", &[SEMI_PASSIVE])]);
const WHEELS: Kind = Kind("wheels", &[("fig12", &[SYMMETRIC])]);
const MEASURED: Kind =
    Kind("d-v", &[("fig10", &[SKEWED]), ("fig13", &[SYMMETRIC]), ("fig15", &[SEMI_PASSIVE])]);
const MODELS: Kind =
    Kind("models", &[("fig16", &[SKEWED]), ("fig17", &[SYMMETRIC]), ("fig18", &[SEMI_PASSIVE])]);
const SKID: Kind = Kind("sigma", &[]);
const AMPLITUDE: Kind = Kind("alpha", &[]);
const RESIDUALS: Kind = Kind("residuals", &[]);
const STARTS: Kind = Kind("starts", &[]);
const PROFILES: Kind = Kind("profiles", &[]);
const REPLICATES: Kind = Kind("replicates", &[]);
const OPTIMA: Kind = Kind("optima", &[]);
const BY_GAIT: Kind = Kind("by-gait", &[("fig19", &[SYMMETRIC, SKEWED])]);
const BY_ROBOT: Kind = Kind("by-robot", &[("fig20", &[SYMMETRIC, SEMI_PASSIVE])]);
const RELEASE: Kind = Kind("release", &[("fig08", &[SEMI_PASSIVE])]);

/// All kinds of figures in the order of the report page, except the figures that show all campaigns.
const KINDS: [Kind; 17] = [
    SIMULATED, FROM_REST, SWEEP, GAIT, WHEELS, MEASURED, MODELS, SKID, AMPLITUDE, RESIDUALS,
    STARTS, PROFILES, REPLICATES, OPTIMA, BY_GAIT, BY_ROBOT, RELEASE,
];

/// Name of the figure that compares fitted values with the true values of synthetic trials.
pub(crate) const TRUTH: &str = "truth";
/// Name of the figure that shows the actuators' work.
pub(crate) const WORK: &str = "work";

impl Kind {
    /// Returns the stem of the figure's file names: that of the corresponding figure in the paper or, if there is none,
    /// `name` with the suffix of the kind.
    fn stem(&self, name: &str, campaigns: &[&str]) -> String {
        let Self(end, printed) = self;
        let printed = printed.iter().find(|(_, of)| *of == campaigns);
        printed.map_or_else(|| format!("{name}-{end}"), |(stem, _)| (*stem).to_owned())
    }
}

/// Maximum number of panels in a figure.
const MAX_PANELS: usize = 100;
/// Maximum number of campaigns that can be distinguished in one figure.
const MAX_CAMPAIGNS: usize = 4;

/// Frequency (rad/s) of the trials whose motion the paper shows against time.
const SHOWN_RAD_S: f64 = 3.9;

/// Returns the number of a figure in the paper, such as `Fig. 16` for `fig16`; empty for other figures.
pub(crate) fn number(stem: &str) -> String {
    let digits = stem.strip_prefix("fig");
    let digits = digits.filter(|_| {
        KINDS.iter().flat_map(|Kind(_, printed)| *printed).any(|(printed, _)| *printed == stem)
    });
    digits.map_or(String::new(), |digits| format!("Fig. {}", digits.trim_start_matches('0')))
}

/// Returns the anchor of a figure on a page, such as `fig-16` for `fig16`, or `fig-` with the stem for figures that are
/// not in the paper.
pub(crate) fn id(stem: &str) -> String {
    let number = number(stem);
    let number = number.strip_prefix("Fig. ").unwrap_or(stem);
    format!("fig-{number}")
}

/// Returns the name by which sentences refer to a figure, such as `Fig. 16` or `Figure work`.
fn called(stem: &str) -> String {
    Some(number(stem)).filter(|number| !number.is_empty()).unwrap_or(format!("Figure {stem}"))
}

/// Returns the kind of the figure with a given stem: the suffix that the names of such figures have, such as `models`;
/// empty for a figure of another kind.
pub(crate) fn kind(stem: &str) -> &'static str {
    let is_of = |Kind(end, printed): &&Kind| {
        let is_printed = printed.iter().any(|(printed, _)| *printed == stem);
        is_printed || stem.strip_suffix(end).is_some_and(|name| name.ends_with('-'))
    };
    KINDS.iter().find(is_of).map_or("", |Kind(end, _)| end)
}

/// Figures to draw, and sentences that explain which figures are missing.
#[derive(Default)]
pub(crate) struct Figures {
    pub figures: Vec<Figure>,
    pub missing: Vec<String>,
}

impl Figures {
    fn add(&mut self, found: Result<impl IntoIterator<Item = Figure>, String>) {
        match found {
            Ok(figures) => self.figures.extend(figures),
            Err(sentence) => self.missing.push(sentence),
        }
    }
}

/// Returns the figure of the decay that a joint release or a coast-down measures, with the fitted law, for the page of
/// the trial.
pub(crate) fn decay(
    row: &RobotParameterRow,
    recording: &Recording,
    input: &ReportInput,
) -> Option<Figure> {
    match row.kind {
        TrialKind::CoastDown => {
            let robot = input.robot(&row.robot)?;
            let names = match &robot {
                AnyRobot::ThreeLinks(_) => RobotConfig::THREE_LINKS.map(str::to_owned).into(),
                AnyRobot::Chain(chain) => chain.names_by_number(),
            };
            let transition_m_s = robot.value(Quantity::Transition.one());
            coast::figure("coast", row, recording, transition_m_s, &names)
        }
        _ => release::figure("release", row, recording),
    }
}

/// Inputs from which the figures are built.
#[derive(Clone, Copy)]
struct Inputs<'r> {
    tables: &'r Tables,
    source: Source<'r>,
    reader: &'r Reader,
    config: &'r ReportInput,
}

/// Returns all figures for which the tables have data.
///
/// Every campaign has the same figures: simulated and measured motions, measurements and models against frequency,
/// residuals, and details of the fits. They are followed by comparisons between the campaigns of one robot and between
/// the campaigns with one gait, and by figures of individual robots and of all campaigns together.
///
/// # Errors
/// Returns an error if the table of a trial that a figure shows cannot be read.
pub(crate) fn figures(
    (tables, reader): (&Tables, &Reader),
    config: &ReportInput,
    truth: Option<&Truth>,
) -> Result<Figures, StoreError> {
    let inputs = Inputs { tables, source: tables.source(config), reader, config };
    let mut campaigns: Vec<&str> = tables.campaigns(config).into_iter().collect();
    campaigns.sort_by_key(|campaign| rank(campaign));
    let mut taken = BTreeSet::new();
    let named = campaigns.iter().map(|campaign| (*campaign, file_name(campaign, &mut taken)));
    let of_campaigns = named.collect::<Vec<_>>().into_par_iter();
    let of_campaigns = of_campaigns.map(|(campaign, name)| inputs.of_campaign(campaign, &name));
    let mut found = Figures::default();
    for of_campaign in of_campaigns.collect::<Result<Vec<_>, _>>()? {
        found.figures.extend(of_campaign.figures);
        found.missing.extend(of_campaign.missing);
    }
    found.figures.extend(inputs.together(&campaigns));
    inputs.releases(&campaigns, &mut found)?;
    found.figures.push(work::figure(WORK, tables, config));
    found.figures.extend(truth.map(|truth| recovered::figure(TRUTH, truth, tables, inputs.source)));
    let Figures { figures, missing } = &mut found;
    for figure in figures.iter_mut() {
        let number = number(&figure.stem);
        if !number.is_empty() {
            figure.title.push_str(&format!(", as {number} of the paper"));
        }
        figure.print = config.print();
        figure.is_synthetic =
            truth.is_some_and(|truth| truth.is_synthetic_in(&figure.campaigns, tables));
    }
    figures.retain(|figure| !figure.is_empty());
    figures.retain(|Figure { stem, panels, .. }| {
        let is_drawn = panels.len() <= MAX_PANELS;
        missing.extend((!is_drawn).then(|| {
            let count = panels.len();
            format!(
                "Figure {stem} is not drawn: it would have {count} panels, more than {MAX_PANELS}."
            )
        }));
        is_drawn
    });
    found.figures = found.figures.into_iter().flat_map(Figure::pages).collect();
    Ok(found)
}

impl Inputs<'_> {
    /// Returns the figures of a campaign; `name` is the campaign's name as used in file names.
    fn of_campaign(self, campaign: &str, name: &str) -> Result<Figures, StoreError> {
        let Self { tables, source, config, .. } = self;
        let stem = |kind: Kind| kind.stem(name, &[campaign]);
        let mut found = Figures::default();
        let has_measurements = source.has_measurements(campaign);
        let lack = match (has_measurements, source.models(campaign).is_empty()) {
            (true, false) => None,
            (true, true) => Some("no model is drawn, because no model was fitted"),
            (false, false) => Some("no measurement is drawn, because no trial has results"),
            (false, true) => Some(
                "nothing is drawn, because the campaign has neither a trial with results nor a \
                 prediction",
            ),
        };
        found.missing.extend(lack.map(|lack| format!("Campaign {campaign}: {lack}.")));
        if let Some((robot, gait)) = config.setup(campaign) {
            let inputs = (tables, config);
            let stems = [SIMULATED, FROM_REST, SWEEP].map(stem);
            let figures = match robot {
                AnyRobot::Chain(_) => simulations::of_chain(stems, campaign, inputs),
                AnyRobot::ThreeLinks(_) if Gait::from(gait).passive_joint().is_some() => {
                    simulations::passive(stems, campaign, inputs)
                }
                AnyRobot::ThreeLinks(_) => {
                    vec![simulations::skidding(&stem(SIMULATED), campaign, inputs)]
                }
            };
            figures.into_iter().for_each(|figure| found.add(figure.map(|figure| [figure])));
        }
        self.tracked([GAIT, WHEELS].map(stem), campaign, &mut found)?;
        found.figures.extend([
            frequency::measured(&stem(MEASURED), campaign, source),
            frequency::models(&stem(MODELS), campaign, source),
            frequency::skid(&stem(SKID), &[campaign], source),
        ]);
        found.figures.extend(amplitude::figure(&stem(AMPLITUDE), campaign, tables, config));
        found.figures.push(residuals::figure(&stem(RESIDUALS), campaign, source));
        let stems = [STARTS, PROFILES, REPLICATES].map(stem);
        found.figures.extend(fits::figures(stems, campaign, tables, source));
        found.figures.push(optimum::figure(&stem(OPTIMA), campaign, tables.maps_of(campaign)));
        Ok(found)
    }

    /// Adds the figures of the measured motion and of the wheel velocities for the campaign's trial whose frequency is
    /// closest to [`SHOWN_RAD_S`], if there is one.
    fn tracked(
        self,
        [gait, wheels]: [String; 2],
        campaign: &str,
        found: &mut Figures,
    ) -> Result<(), StoreError> {
        let distance = |trial: &&TrialRow| (trial.omega_rad_s - SHOWN_RAD_S).abs();
        let measured = self.source.measured_trials(campaign);
        let nearest = measured
            .filter(|trial| simulated::OMEGAS_RAD_S.contains(&trial.omega_rad_s))
            .min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.trial.cmp(&b.trial)));
        let Some(trial) = nearest else { return Ok(()) };
        let recording = self.recording(&trial.trial)?;
        let draw = |missing: &mut Vec<String>| {
            let setup = self.config.setup(campaign);
            setup.ok_or_else(|| format!("campaign {campaign} is not configured"))?;
            let recording = recording?;
            let inputs = (self.tables, self.config);
            let motion = tracking::figure(&gait, trial, &recording, inputs, missing);
            let wheels = tracking::wheels(&wheels, trial, &recording, self.config);
            Ok::<_, String>(
                [motion.ok_or_else(|| format!("no cycle of trial {} is used", trial.trial))?]
                    .into_iter()
                    .chain(wheels),
            )
        };
        let figures = draw(&mut found.missing);
        found.add(figures.map_err(|why| not_drawn(&gait, &why)));
        Ok(())
    }

    /// Reads the measured motion of a trial. The inner error is a sentence that says which table is missing.
    fn recording(self, trial: &str) -> Result<Result<Recording, String>, StoreError> {
        let row = self.tables.trials.iter().find(|row| row.trial == trial);
        let window = row.map_or(0, |row| row.smoothing_window);
        let recording = Recording::read(&self.config.paths.derived, trial, window, self.reader)?;
        Ok(recording.ok_or_else(|| {
            format!("poses/{trial}.parquet or wheels/{trial}.parquet does not exist")
        }))
    }

    /// Returns the figures that compare the skid ratios of campaigns with the same robot, and those that compare the
    /// skid ratios of campaigns with the same gait (see [`is_alike`]).
    fn together(self, campaigns: &[&str]) -> Vec<Figure> {
        let setup = |campaign: &str| self.config.names(campaign);
        let is_drawn = |campaign: &&str| {
            self.source.has_measurements(campaign) || !self.source.models(campaign).is_empty()
        };
        let mut members: Vec<(AnyGait, &str)> = campaigns
            .iter()
            .filter(|campaign| is_drawn(campaign))
            .filter_map(|campaign| Some((self.config.setup(campaign)?.1, *campaign)))
            .collect();
        // Campaigns are sorted by gait, not by name: smaller offsets first, then gaits without a passive joint first.
        let offsets = |gait: &AnyGait| -> f64 {
            gait.joints.iter().flatten().map(|joint| joint.offset_rad.abs()).sum()
        };
        members.sort_by(|(a, of_a), (b, of_b)| {
            let is_passive = |campaign: &str| !self.config.free_joints(campaign).is_empty();
            offsets(a).total_cmp(&offsets(b)).then(is_passive(of_a).cmp(&is_passive(of_b)))
        });
        let mut groups: Vec<(&str, Kind, Vec<&str>)> = Vec::new();
        for (nth, (gait, campaign)) in members.iter().enumerate() {
            let Some((own_robot, own_gait)) = setup(campaign) else { continue };
            let has_robot = |(_, other): &(AnyGait, &str)| {
                setup(other).is_some_and(|(robot, _)| robot == own_robot)
            };
            let is_chain = self.config.is_chain(campaign);
            let has_gait = |(other_gait, other): &(AnyGait, &str)| {
                // Gaits of chains also have commands of other kinds than angles; they are compared by name.
                let is_alike = if is_chain {
                    setup(other).is_some_and(|(_, gait)| gait == own_gait)
                        && self.config.links(other) == self.config.links(campaign)
                } else {
                    is_alike(&(*gait).into(), &(*other_gait).into())
                };
                is_alike && self.config.is_chain(other) == is_chain
            };
            let names = |is_of: &dyn Fn(&(AnyGait, &str)) -> bool| -> Vec<&str> {
                members.iter().filter(|other| is_of(other)).map(|(_, other)| *other).collect()
            };
            if !members[..nth].iter().any(has_robot) {
                groups.push((own_robot, BY_GAIT, names(&has_robot)));
            }
            let of_gait = names(&has_gait);
            let is_new = !groups.iter().any(|(_, _, known)| *known == of_gait);
            if is_new && !members[..nth].iter().any(has_gait) {
                groups.push((own_gait, BY_ROBOT, of_gait));
            }
        }
        let mut taken = [BTreeSet::new(), BTreeSet::new()];
        let mut figures = Vec::new();
        for (of, kind, campaigns) in groups {
            let max_campaigns = campaigns.len().div_ceil(campaigns.len().div_ceil(MAX_CAMPAIGNS));
            for campaigns in campaigns.chunks(max_campaigns).filter(|campaigns| campaigns.len() > 1)
            {
                let name = file_name(of, &mut taken[usize::from(kind.0 == BY_ROBOT.0)]);
                let stem = kind.stem(&name, campaigns);
                figures.push(frequency::skid(&stem, campaigns, self.source));
            }
        }
        figures
    }

    /// Adds, for each joint of a robot that was released, the figure of its first successful release (Fig. 8 of the paper).
    fn releases(self, campaigns: &[&str], found: &mut Figures) -> Result<(), StoreError> {
        let releases = self.tables.robots.iter().filter(|row| row.kind == TrialKind::JointRelease);
        let joints: BTreeSet<(&str, i64)> =
            releases.clone().map(|row| (row.robot.as_str(), row.joint)).collect();
        let mut taken = BTreeSet::new();
        for &(robot, joint) in &joints {
            let campaigns: Vec<&str> = campaigns
                .iter()
                .filter(|of| self.config.robot_name(of) == Some(robot))
                .copied()
                .collect();
            let has_several = joints.iter().filter(|(other, _)| *other == robot).count() > 1;
            let (name, campaigns) = match has_several {
                true => (format!("{robot}-joint{joint}"), &[][..]),
                false => (robot.to_owned(), &campaigns[..]),
            };
            let stem = RELEASE.stem(&file_name(&name, &mut taken), campaigns);
            let rows = releases.clone().filter(|row| row.robot == robot && row.joint == joint);
            let Some(row) = rows.min_by_key(|row| !row.status.is_ok()) else { continue };
            let figure = if row.status.is_ok() {
                self.recording(&row.trial)?.and_then(|recording| {
                    release::figure(&stem, row, &recording).ok_or_else(|| {
                        format!(
                            "the tables of trial {} contain no decay of the joint angle",
                            row.trial
                        )
                    })
                })
            } else {
                Err(format!("the fit to trial {} failed: {}", row.trial, row.status))
            };
            found.add(figure.map(Some).map_err(|why| not_drawn(&stem, &why)));
        }
        Ok(())
    }
}

/// Returns whether two gaits are equal. If either gait has a passive joint, only the joint that both command is
/// compared, and its phase is ignored because it merely defines the origin of time.
fn is_alike(one: &Gait, other: &Gait) -> bool {
    let is_whole = [one, other].iter().all(|gait| gait.passive_joint().is_none());
    let mut joints = one.joints.iter().zip(&other.joints);
    joints.all(|joints| match joints {
        (Some(one), Some(other)) => {
            let phase_rad = if is_whole { other.phase_rad } else { one.phase_rad };
            *one == JointCommand { phase_rad, ..*other }
        }
        _ => !is_whole,
    })
}

/// Returns the sentence that says why a figure is not drawn.
fn not_drawn(stem: &str, why: &str) -> String {
    format!("{} is not drawn, because {why}.", called(stem))
}

/// Returns the sort key of a campaign, which puts the paper's campaigns first, in the paper's order, followed by the
/// other campaigns by name.
pub(crate) fn rank(campaign: &str) -> (usize, &str) {
    let paper = PAPER_CAMPAIGNS.iter().position(|known| *known == campaign);
    (paper.unwrap_or(PAPER_CAMPAIGNS.len()), campaign)
}

/// Returns the campaigns with measurements: the paper's campaigns in the paper's order, then the others by name.
fn campaigns_of(source: Source<'_>) -> Vec<&str> {
    let campaigns = source.trials.iter().map(|trial| rank(&trial.campaign));
    let ranked: BTreeSet<(usize, &str)> = campaigns.collect();
    let names = ranked.into_iter().map(|(_, name)| name);
    names.filter(|campaign| source.has_measurements(campaign)).collect()
}

/// Returns a file name made from the name of a campaign or trial, with a number appended if the file name is already in
/// `taken`.
pub(crate) fn file_name(name: &str, taken: &mut BTreeSet<String>) -> String {
    let base: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' })
        .collect();
    let base = if base.starts_with('.') { format!("_{base}") } else { base };
    let numbered = (2..).map(|number| format!("{base}-{number}"));
    let mut names = [base.clone()].into_iter().chain(numbered);
    names.find(|name| taken.insert(name.to_lowercase())).unwrap_or(base)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_figure_is_documented() {
        let documents = include_str!("../../../../docs/tables.md");
        for Kind(end, _) in KINDS {
            assert!(documents.contains(&format!("-{end}`")), "{end}");
        }
    }
}
