//! Writing of `pipeline.toml` and the lists of trials, in which everything that could not be determined is marked.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::{Value, json};
use trilink_base::files::name_in;
use trilink_ingest::calibrate::layout_entries;
use trilink_mocap::LengthUnit;
use trilink_statistics::Estimate;
use trilink_tables::PendingFile;
use trilink_tables::config::{CONFIG_FILE, toml_key};
use trilink_tables::trial::{TrialKind, is_valid_id};

use super::add::Existing;
use super::campaigns::{Group, MeasuredGait, named_omega, words};
use super::clusters::{Links, by_number, names, without_points};
use super::frequency::Recorded;
use super::layout::{Layout, MAX_DIRECTION_SE_DEG};
use super::survey::{Folder, Survey};
use super::{Described, Findings, FoundCampaign, FoundFile, InitError, Mark, Request, link_names};
use crate::template::fill;

/// Start of the comment that marks a line for review.
const MARK: &str = "# CHECK: ";
/// Default name of the robot.
const ROBOT: &str = "robot";

/// Everything needed to write `pipeline.toml` and the lists of trials.
pub(super) struct Written<'r> {
    pub request: &'r Request,
    pub folders: Vec<Folder>,
    pub surveys: Vec<Survey>,
    pub described: Vec<Result<Described, String>>,
    /// Measured gaits, each with the index of its file.
    pub gaits: Vec<(usize, MeasuredGait)>,
    /// Campaigns, as groups of file indices.
    pub groups: Vec<Group>,
    pub links: Links,
    pub layout: Layout,
    /// Reason for doubt about which link is in front; `None` if there is no doubt.
    pub front_doubt: Option<String>,
    pub rate_hz: f64,
}

/// Writes `pipeline.toml` and the lists of trials, and returns the findings.
pub(super) fn write(mut written: Written) -> Result<Findings, InitError> {
    let elsewhere = written.elsewhere();
    let config = written.request.out.join(CONFIG_FILE);
    let existing = if written.request.add { Some(Existing::read(&config)?) } else { None };
    let mut robot = written.robot();
    if let Some(existing) = &existing {
        robot = existing.free_name("robot", &robot);
        for group in &mut written.groups {
            group.name = existing.free_name("campaign", &existing.free_name("gait", &group.name));
        }
    }
    let text = written.pipeline(&robot, &elsewhere, existing.as_ref())?;
    let text = match &existing {
        Some(existing) => existing.extended(&written.raw(), &text)?,
        None => text,
    };
    let mut texts = vec![(config, text)];
    let mut kept = Vec::new();
    let mut empty = Vec::new();
    for (i, folder) in written.folders.iter().enumerate() {
        match (&folder.list, written.trials(i).next().is_some()) {
            (Some(_), _) if !written.request.force => kept.push(folder.list_path()),
            (_, false) => empty.push(folder.path.clone()),
            _ => texts.push((folder.list_path(), written.list(i, &robot)?)),
        }
    }
    let mut pending = Vec::new();
    for (path, text) in &texts {
        pending.push(PendingFile::write(path, text.as_bytes())?);
    }
    for file in pending {
        file.commit()?;
    }
    Ok(Findings {
        files: (0..written.surveys.len()).map(|i| written.found(i)).collect(),
        empty,
        robot,
        campaigns: written.groups.iter().map(found_campaign).collect(),
        elsewhere,
        marks: texts.iter().flat_map(|(path, text)| marks(path, text)).collect(),
        written: texts.into_iter().map(|(path, _)| path).collect(),
        kept,
        links: match written.links.len() {
            3 => by_number(&written.links).map(|names| without_points(names)).collect(),
            _ => written.links.iter().map(|names| without_points(names)).collect(),
        },
    })
}

/// Converts a group of files into the description of a campaign.
fn found_campaign(group: &Group) -> FoundCampaign {
    let passive = group.passive.iter().map(|joint| joint + 1);
    let is_chain = group.joints.len() != 2;
    FoundCampaign {
        name: group.name.clone(),
        files: group.files.len(),
        joints: group.joints.clone(),
        passive_joint: group.passive.first().map(|joint| joint + 1),
        passive_joints: if is_chain { passive.collect() } else { Vec::new() },
    }
}

/// Returns the lines that are marked for review in `text`, the content of the file `path`.
fn marks(path: &Path, text: &str) -> Vec<Mark> {
    let marks = text.lines().zip(1..).filter_map(|(line, number)| {
        let (before, text) = line.split_once(MARK)?;
        let of = before.split(" = ").next().unwrap_or_default().trim().to_owned();
        Some(Mark { file: path.to_owned(), line: number, of, text: text.to_owned() })
    });
    marks.collect()
}

/// Makes an external text safe for use in a one-line comment.
fn remark(text: &str) -> String {
    text.replace(['\n', '\r'], " ").trim_start_matches([':', ',', ' ']).to_owned()
}

impl Written<'_> {
    /// Returns the usable files of a folder, with their indices.
    fn trials(&self, folder: usize) -> impl Iterator<Item = (usize, &Described)> {
        let surveys =
            self.surveys.iter().enumerate().filter(move |(_, survey)| survey.folder == folder);
        surveys.filter_map(|(i, _)| Some((i, self.described[i].as_ref().ok()?)))
    }

    /// Whether there is a trial of this kind.
    fn has(&self, kind: TrialKind) -> bool {
        self.described.iter().flatten().any(|found| found.recorded.kind() == kind)
    }

    /// Returns the surveys of all usable files.
    fn usable(&self) -> impl Iterator<Item = &Survey> {
        self.surveys
            .iter()
            .zip(&self.described)
            .filter(|(_, found)| found.is_ok())
            .map(|(survey, _)| survey)
    }

    /// Returns the name of the robot: the most frequent subject of its markers.
    fn robot(&self) -> String {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        for survey in &self.surveys {
            let label = survey.labels.iter().find(|label| {
                let name = trilink_ingest::marker_name(label);
                self.links.iter().flatten().any(|known| known == name || known == *label)
            });
            if let Some((subject, _)) = label.and_then(|label| label.split_once(':')) {
                *counts.entry(words(subject)).or_default() += 1;
            }
        }
        counts.remove("");
        let max = counts.values().copied().max();
        let name = counts.into_iter().find(|(_, count)| Some(*count) == max);
        name.map_or(ROBOT.to_owned(), |(name, _)| name)
    }

    /// Returns the names of the markers in usable files that belong to no link.
    fn elsewhere(&self) -> Vec<String> {
        let mut all: BTreeSet<String> =
            self.usable().flat_map(|survey| names(&survey.labels)).collect();
        all.retain(|name| !self.links.iter().flatten().any(|known| known == name));
        without_points(&all.into_iter().collect::<Vec<_>>())
    }

    /// Returns the findings about a file.
    fn found(&self, i: usize) -> FoundFile {
        let survey = &self.surveys[i];
        let recorded = self.described[i].as_ref().map(|found| &found.recorded);
        let gait = self.gaits.iter().find(|(file, _)| *file == i).map(|(_, gait)| gait);
        FoundFile {
            folder: self.folders[survey.folder].path.clone(),
            file: survey.name.clone(),
            subjects: survey.subjects(),
            labels: survey.markers(),
            rate_hz: survey.rate_hz,
            frames: survey.frames,
            kind: recorded.ok().map(Recorded::kind),
            omega_rad_s: gait.map(|gait| gait.omega_rad_s),
            joints: gait.map(|gait| gait.joints.clone()),
            campaign: self.campaign(i).map(|group| group.name.clone()),
            problem: recorded.err().map(|reason| remark(reason)),
        }
    }

    /// Returns the group of files of the campaign to which a file belongs; `None` if it belongs to no campaign.
    fn campaign(&self, file: usize) -> Option<&Group> {
        self.groups.iter().find(|group| group.files.contains(&file))
    }

    /// Returns the folders with usable files, relative to the folder of `pipeline.toml`.
    fn raw(&self) -> Vec<String> {
        let folders = (0..self.folders.len()).filter(|i| self.trials(*i).next().is_some());
        let names = folders.map(|i| match name_in(&self.request.out, &self.folders[i].path) {
            name if name.is_empty() => ".".to_owned(),
            name => name,
        });
        names.collect()
    }

    /// Renders the content of `pipeline.toml` or, if there is one already, what is added to it.
    fn pipeline(
        &self,
        robot: &str,
        elsewhere: &[String],
        existing: Option<&Existing>,
    ) -> Result<String, InitError> {
        let Self { request, .. } = self;
        let measured = [TrialKind::CoastDown, TrialKind::JointRelease];
        let measured = measured.into_iter().filter(|kind| self.has(*kind)).map(TrialKind::name);
        let campaigns = self
            .groups
            .iter()
            .map(|group| json!({ "of": found_campaign(group), "doubt": group.doubt }));
        let rates: BTreeSet<u64> =
            self.usable().filter_map(|survey| Some(survey.rate_hz?.to_bits())).collect();
        let mut values = json!({
            "files": self.surveys.len(),
            "raw": self.raw(),
            "added": existing.is_some(),
            "layout": existing.map(|_| format!("layout.{}", toml_key(robot))),
            "is_other_rate": existing.is_some_and(|existing| existing.has_other_rate(&rates)),
            "rate_hz": format!("{:?}", self.rate_hz),
            "rates": rates.len(),
            "silent": self.usable().filter(|survey| survey.rate_hz.is_none()).count(),
            "unit": (request.unit != LengthUnit::Mm).then(|| request.unit.name()),
            "elsewhere": elsewhere,
            "measured": measured.collect::<Vec<_>>(),
            "has_coast": self.has(TrialKind::CoastDown),
            "has_release": self.has(TrialKind::JointRelease),
            "robot": robot,
            "l_is_given": request.l_m.is_some(),
            "front_doubt": self.front_doubt,
            "campaigns": campaigns.collect::<Vec<_>>(),
            "chain": self.links.len() != 3,
            "layout_file": remark(&self.layout.path.display().to_string()),
            "direction_se_deg": self.layout.direction_se_deg,
            "is_direction_doubtful": self.layout.direction_se_deg > MAX_DIRECTION_SE_DEG,
        });
        let (text, own) = match self.layout.measured.h_mm().filter(|_| self.links.len() == 3) {
            Some(h_mm) => (
                concat!(include_str!("head.txt"), include_str!("three-links.txt")),
                self.of_three_links(h_mm),
            ),
            None => (concat!(include_str!("head.txt"), include_str!("chain.txt")), self.of_chain()),
        };
        if let (Value::Object(values), Value::Object(own)) = (&mut values, own) {
            values.extend(own);
        }
        Ok(fill(text, &values)?)
    }

    /// Returns the values that describe a robot of three links in `pipeline.toml`.
    fn of_three_links(&self, h_mm: Estimate) -> Value {
        let Layout { measured, levers_mm, .. } = &self.layout;
        let passive =
            self.groups.iter().find_map(|group| Some(group.joints[*group.passive.first()?]));
        let links = by_number(&measured.links).map(|link| layout_entries(&link.markers));
        let ends = [&measured.links[0], &measured.links[2]];
        let wheels = ends.map(|link| {
            link.least_skid_mm.map_or("?".to_owned(), |found_mm| format!("{:.1}", found_mm.value))
        });
        json!({
            "h_mm": [h_mm.value, h_mm.se],
            "l_m": levers_mm[0] / 1e3,
            "wheels_mm": wheels,
            "rest_deg": passive.map(|joint| joint.offset_deg),
            "links": links.collect::<Vec<_>>(),
        })
    }

    /// Returns the values that describe a chain in `pipeline.toml`.
    fn of_chain(&self) -> Value {
        let Layout { measured, is_rolling, .. } = &self.layout;
        let last = measured.links.len() - 1;
        let names = link_names(measured.links.len());
        let links = measured.links.iter().zip(names).enumerate().map(|(i, (link, name))| {
            let [front_m, rear_m] = link.joints_mm.map(|joint| Some(joint?.value / 1e3));
            let end = [0, last].iter().position(|end| *end == i);
            let se_mm = link.joints_mm[0].map(|joint| joint.se).filter(|se_mm| se_mm.is_finite());
            json!({
                "name": name,
                "front_joint_m": front_m,
                "rear_joint_m": rear_m,
                "se_mm": se_mm,
                "is_end": end.is_some(),
                "is_rolling": end.is_some_and(|end| is_rolling[end]),
                "markers": layout_entries(&link.markers),
            })
        });
        let released: BTreeSet<usize> = self
            .described
            .iter()
            .flatten()
            .filter_map(|found| match found.recorded {
                Recorded::Release { joint } => Some(joint),
                _ => None,
            })
            .collect();
        let joints = (0..last).map(|joint| {
            let passive = self.groups.iter().find(|group| group.passive.contains(&joint));
            json!({
                "rest_deg": passive.map(|group| group.joints[joint].offset_deg),
                "is_released": released.contains(&joint),
            })
        });
        json!({
            "links": links.collect::<Vec<_>>(),
            "joints": joints.collect::<Vec<_>>(),
        })
    }

    /// Renders the list of trials for a folder.
    fn list(&self, folder: usize, robot: &str) -> Result<String, InitError> {
        let left_out = self.surveys.iter().zip(&self.described).filter_map(|(survey, found)| {
            let reason = found.as_ref().err().filter(|_| survey.folder == folder)?;
            Some((survey.name.clone(), remark(reason)))
        });
        let mut ids = BTreeSet::new();
        let trials = self.trials(folder).map(|(i, found)| {
            let survey = &self.surveys[i];
            let campaign = self.campaign(i).map(|group| &group.name);
            let gait = self.gaits.iter().find(|(file, _)| *file == i);
            let omega_rad_s = gait.map(|(_, gait)| gait.omega_rad_s);
            let listed = survey.listed.as_ref().and_then(|trial| trial.omega_rad_s);
            let named = omega_rad_s
                .and_then(|measured| listed.or_else(|| named_omega(&survey.stem(), measured)));
            json!({
                "id": id(survey, &mut ids),
                "file": survey.name,
                "doubt": remark(&survey.doubts.join("; ")),
                "kind": found.recorded.kind().name(),
                "campaign": campaign,
                "robot": campaign.is_none().then_some(robot),
                "named": named.map(|omega| format!("{omega:?}")),
                "measured": omega_rad_s,
            })
        });
        let values = json!({
            "left_out": left_out.collect::<Vec<_>>(),
            "trials": trials.collect::<Vec<_>>(),
        });
        Ok(fill(include_str!("trials.txt"), &values)?)
    }
}

/// Returns a unique id for a trial: its listed id or its file's name, with invalid characters replaced and a number
/// appended if necessary.
fn id(survey: &Survey, ids: &mut BTreeSet<String>) -> String {
    let listed = survey.listed.as_ref().map(|trial| trial.id.clone());
    let stem = survey.stem();
    let stem = stem.chars().take(56).map(|c| match c {
        c if c.is_ascii_alphanumeric() || "._-".contains(c) => c,
        _ => '-',
    });
    let stem: String = stem.collect();
    let stem = stem.trim_start_matches('.').to_owned();
    let named = listed.unwrap_or(stem);
    let first = if is_valid_id(&named) { named } else { "trial".to_owned() };
    let others = (2..).map(|number| format!("{first}-{number}"));
    let mut all = std::iter::once(first.clone()).chain(others);
    let id = all.find(|id| !ids.contains(&id.to_ascii_lowercase())).unwrap_or(first);
    ids.insert(id.to_ascii_lowercase());
    id
}
