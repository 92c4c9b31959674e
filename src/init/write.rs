//! What was found as `pipeline.toml` and lists of trials. What was not is marked.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::json;
use trilink_base::files::name_in;
use trilink_ingest::MarkerPosition;
use trilink_mocap::LengthUnit;
use trilink_tables::PendingFile;
use trilink_tables::trial::{TrialKind, is_valid_id};

use super::campaigns::{Group, Performed, named_omega, words};
use super::clusters::{Links, names};
use super::frequency::Recorded;
use super::layout::Layout;
use super::survey::{Folder, Survey};
use super::{Described, Findings, FoundCampaign, FoundFile, InitError, Mark, Request};
use crate::template::fill;

/// Begins what a line is marked by.
const MARK: &str = "# CHECK: ";
/// Directions of side links that are known less well are marked, degrees.
const WELL_DEG: f64 = 0.5;
/// Longest name of a robot that a subject gives it.
const ROBOT: &str = "robot";

/// All that is known when the files are written.
pub(super) struct Written<'r> {
    pub request: &'r Request,
    pub folders: Vec<Folder>,
    pub surveys: Vec<Survey>,
    pub described: Vec<Result<Described, String>>,
    /// With the index of the file.
    pub gaits: Vec<(usize, Performed)>,
    /// Of indices of files.
    pub groups: Vec<Group>,
    /// Middle, front, rear.
    pub links: Links,
    pub layout: Layout,
    /// What leaves in doubt which link is in front.
    pub front_doubt: Option<String>,
    pub rate_hz: f64,
}

/// Writes the files and says what they have.
pub(super) fn write(of: Written) -> Result<Findings, InitError> {
    let (robot, elsewhere) = (of.robot(), of.elsewhere());
    let mut texts = vec![(of.request.out.join("pipeline.toml"), of.pipeline(&robot, &elsewhere)?)];
    let (mut kept, mut empty) = (Vec::new(), Vec::new());
    for (i, folder) in of.folders.iter().enumerate() {
        match (&folder.list, of.trials(i).next().is_some()) {
            (Some(_), _) if !of.request.force => kept.push(folder.list_path()),
            (_, false) => empty.push(folder.path.clone()),
            _ => texts.push((folder.list_path(), of.list(i, &robot)?)),
        }
    }
    let mut pending = Vec::new();
    for (path, text) in &texts {
        pending.push(PendingFile::write(path, text.as_bytes())?);
    }
    for file in pending {
        file.settle()?;
    }
    Ok(Findings {
        files: (0..of.surveys.len()).map(|i| of.found(i)).collect(),
        empty,
        robot,
        campaigns: of.groups.iter().map(found_campaign).collect(),
        elsewhere,
        marks: texts.iter().flat_map(|(path, text)| marks(path, text)).collect(),
        written: texts.into_iter().map(|(path, _)| path).collect(),
        kept,
        links: of.links,
    })
}

fn found_campaign(group: &Group) -> FoundCampaign {
    FoundCampaign {
        name: group.name.clone(),
        files: group.files.len(),
        joints: group.joints,
        passive_joint: group.passive.map(|joint| joint + 1),
    }
}

/// The marked lines of a text.
fn marks(path: &Path, text: &str) -> Vec<Mark> {
    let mark = |(i, line): (usize, &str)| {
        let (before, text) = line.split_once(MARK)?;
        let of = before.split(" = ").next().unwrap_or_default().trim().to_owned();
        Some(Mark { file: path.to_owned(), line: i + 1, of, text: text.to_owned() })
    };
    text.lines().enumerate().filter_map(mark).collect()
}

/// Text of others in a comment.
fn remark(text: &str) -> String {
    text.replace(['\n', '\r'], " ").trim_start_matches([':', ',', ' ']).to_owned()
}

impl Written<'_> {
    /// Trials of a folder: what each is, by the index of its file.
    fn trials(&self, folder: usize) -> impl Iterator<Item = (usize, &Described)> {
        let of_folder = self.surveys.iter().enumerate().filter(move |(_, of)| of.folder == folder);
        of_folder.filter_map(|(i, _)| Some((i, self.described[i].as_ref().ok()?)))
    }

    fn has(&self, kind: TrialKind) -> bool {
        self.described.iter().flatten().any(|of| of.recorded.kind() == kind)
    }

    /// The subject that most files name.
    fn robot(&self) -> String {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        for survey in &self.surveys {
            let is_of_robot = |label: &&String| {
                let name = trilink_ingest::marker_name(label);
                self.links.iter().flatten().any(|of| of == name || of == *label)
            };
            let subject = survey.labels.iter().find(is_of_robot);
            if let Some((subject, _)) = subject.and_then(|label| label.split_once(':')) {
                *counts.entry(words(subject)).or_default() += 1;
            }
        }
        counts.remove("");
        let most = counts.values().copied().max();
        let name = counts.into_iter().find(|(_, count)| Some(*count) == most);
        name.map_or(ROBOT.to_owned(), |(name, _)| name)
    }

    /// Names of the markers on none of the links, in files of the robot.
    fn elsewhere(&self) -> Vec<String> {
        let of_robot = self.surveys.iter().zip(&self.described).filter(|(_, found)| found.is_ok());
        let all: BTreeSet<String> = of_robot.flat_map(|(of, _)| names(&of.labels)).collect();
        let is_on = |name: &String| self.links.iter().flatten().any(|of| of == name);
        all.into_iter().filter(|name| !is_on(name)).collect()
    }

    fn found(&self, i: usize) -> FoundFile {
        let survey = &self.surveys[i];
        let recorded = self.described[i].as_ref().map(|of| of.recorded);
        let performed = self.gaits.iter().find(|(file, _)| *file == i).map(|(_, gait)| gait);
        FoundFile {
            folder: self.folders[survey.folder].path.clone(),
            file: survey.name.clone(),
            subjects: survey.subjects(),
            labels: survey.labels.len(),
            rate_hz: survey.rate_hz,
            frames: survey.frames,
            kind: recorded.as_ref().ok().map(Recorded::kind),
            omega_rad_s: performed.map(|gait| gait.omega_rad_s),
            joints: performed.map(|gait| gait.joints),
            campaign: self.campaign(i).map(|group| group.name.clone()),
            problem: recorded.err().map(|reason| remark(reason)),
        }
    }

    fn campaign(&self, file: usize) -> Option<&Group> {
        self.groups.iter().find(|group| group.files.contains(&file))
    }

    fn pipeline(&self, robot: &str, elsewhere: &[String]) -> Result<String, InitError> {
        let Self { request, layout, .. } = self;
        let with_trials = |i: &usize| self.trials(*i).next().is_some();
        let folders = (0..self.folders.len()).filter(with_trials);
        let raw = folders.map(|i| match name_in(&request.out, &self.folders[i].path) {
            name if name.is_empty() => ".".to_owned(),
            name => name,
        });
        let measured = [TrialKind::CoastDown, TrialKind::JointRelease];
        let measured = measured.into_iter().filter(|kind| self.has(*kind)).map(TrialKind::name);
        let calibration = &layout.calibration;
        let place =
            |marker: &MarkerPosition| (marker.label.clone(), marker.position_mm.map(|of| of.value));
        let places = |markers: &Vec<MarkerPosition>| markers.iter().map(place).collect::<Vec<_>>();
        let campaign = |group: &Group| json!({ "of": found_campaign(group), "doubt": group.doubt });
        let passive = self.groups.iter().find_map(|group| Some(group.joints[group.passive?]));
        let usable = || self.surveys.iter().zip(&self.described).filter(|(_, found)| found.is_ok());
        let said: BTreeSet<u64> =
            usable().filter_map(|(of, _)| Some(of.rate_hz?.to_bits())).collect();
        let values = json!({
            "files": self.surveys.len(),
            "raw": raw.collect::<Vec<_>>(),
            "rate_hz": format!("{:?}", self.rate_hz),
            "rates": said.len(),
            "silent": usable().filter(|(of, _)| of.rate_hz.is_none()).count(),
            "unit": (request.unit != LengthUnit::Mm).then(|| request.unit.name()),
            "elsewhere": elsewhere,
            "measured": measured.collect::<Vec<_>>(),
            "has_coast": self.has(TrialKind::CoastDown),
            "has_release": self.has(TrialKind::JointRelease),
            "robot": robot,
            "h_mm": [calibration.h_mm.value, calibration.h_mm.se],
            "layout_file": remark(&layout.path.display().to_string()),
            "l_m": layout.l_m,
            "l_is_given": request.l_m.is_some(),
            "wheels_mm": calibration.l_mm.each_ref().map(|of| of.value),
            "rest_deg": passive.map(|joint| joint.offset_deg),
            "direction_se_deg": layout.direction_se_deg,
            "is_direction_doubtful": layout.direction_se_deg > WELL_DEG,
            "front_doubt": self.front_doubt,
            "campaigns": self.groups.iter().map(campaign).collect::<Vec<_>>(),
            "links": calibration.links.each_ref().map(places),
        });
        Ok(fill(include_str!("pipeline.txt"), &values)?)
    }

    /// The list of a folder's trials.
    fn list(&self, folder: usize, robot: &str) -> Result<String, InitError> {
        let left_out = |(i, of): (usize, &Survey)| {
            let reason = self.described[i].as_ref().err().filter(|_| of.folder == folder)?;
            Some((of.name.clone(), remark(reason)))
        };
        let mut ids = BTreeSet::new();
        let trial = |(i, of): (usize, &Described)| {
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
                "kind": of.recorded.kind().name(),
                "campaign": campaign,
                "robot": campaign.is_none().then_some(robot),
                "named": named.map(|omega| format!("{omega:?}")),
                "measured": omega_rad_s,
            })
        };
        let values = json!({
            "left_out": self.surveys.iter().enumerate().filter_map(left_out).collect::<Vec<_>>(),
            "trials": self.trials(folder).map(trial).collect::<Vec<_>>(),
        });
        Ok(fill(include_str!("trials.txt"), &values)?)
    }
}

/// The id of a trial: its file's name as far as an id may have it, and another one than before.
fn id(survey: &Survey, ids: &mut BTreeSet<String>) -> String {
    let listed = survey.listed.as_ref().map(|trial| trial.id.clone());
    let plain = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '-' };
    let stem: String = survey.stem().chars().take(56).map(plain).collect();
    let stem = stem.trim_start_matches('.').to_owned();
    let named = listed.unwrap_or(stem);
    let first = if is_valid_id(&named) { named } else { "trial".to_owned() };
    let others = (2..).map(|number| format!("{first}-{number}"));
    let mut all = std::iter::once(first.clone()).chain(others);
    let id = all.find(|id| !ids.contains(&id.to_ascii_lowercase())).unwrap_or(first);
    ids.insert(id.to_ascii_lowercase());
    id
}
