//! What was found as `pipeline.toml` and lists of trials. What was not is marked.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::{Value, json};
use trilink_base::files::name_in;
use trilink_ingest::MarkerPosition;
use trilink_mocap::LengthUnit;
use trilink_tables::PendingFile;
use trilink_tables::config::toml_key;
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
/// Models that compete in a campaign, by whether a joint is passive, with what they leave free where no
/// trial says the wheels' rolling resistance.
const MODELS: [&[&str]; 2] = [
    &["no-skid", "no-skid-measured", "skid", "skid-roll", "coulomb"],
    &["no-skid", "no-skid-damped", "no-skid-roll", "skid-roll", "coulomb"],
];
const FREE: [&[(&str, &str)]; 2] = [
    &[("skid-roll", r#"["skid", "roll"]"#), ("coulomb", r#"["skid_dry", "roll"]"#)],
    &[
        ("no-skid-roll", r#"["roll"]"#),
        ("skid-roll", r#"["skid", "roll"]"#),
        ("coulomb", r#"["skid_dry", "roll"]"#),
    ],
];
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

fn text(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

fn list<'t>(texts: impl Iterator<Item = &'t str>) -> String {
    format!("[{}]", texts.map(text).collect::<Vec<_>>().join(", "))
}

/// A number without a minus sign before zero.
fn fixed(number: f64, digits: usize) -> String {
    let text = format!("{number:.digits$}");
    match text.strip_prefix('-') {
        Some(rest) if !rest.contains(|c: char| ('1'..='9').contains(&c)) => rest.to_owned(),
        _ => text,
    }
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
        let raw: Vec<String> = (0..self.folders.len())
            .filter(with_trials)
            .map(|i| match name_in(&request.out, &self.folders[i].path) {
                name if name.is_empty() => ".".to_owned(),
                name => name,
            })
            .collect();
        let measured: Vec<&str> = [TrialKind::CoastDown, TrialKind::JointRelease]
            .into_iter()
            .filter(|kind| self.has(*kind))
            .map(|kind| kind.name())
            .collect();
        let calibration = &layout.calibration;
        let line = |marker: &MarkerPosition| {
            let all = |of: [f64; 3]| of.map(|x| fixed(x, 2)).join(", ");
            let position = all(marker.position_mm.map(|of| of.value));
            format!("{} = [{position}]", toml_key(&marker.label))
        };
        let [front, rear] = calibration.l_mm;
        let has_coast = self.has(TrialKind::CoastDown);
        let free = |passive: usize| {
            let line = |(model, free): &(&str, &str)| format!("{model} = {free}");
            if has_coast { Vec::new() } else { FREE[passive].iter().map(line).collect() }
        };
        let campaigns = self.groups.iter().map(|group| {
            let is_passive = usize::from(group.passive.is_some());
            json!({
                "key": toml_key(&group.name),
                "name": text(&group.name),
                "files": group.files.len(),
                "joints": joints(group),
                "passive": group.passive.map(|joint| joint + 1),
                "doubt": group.doubt,
                "models": list(MODELS[is_passive].iter().copied()),
                // Table III's.
                "alpha": (["0.0", "50.0"][is_passive]),
                "free": free(is_passive),
            })
        });
        let passive = self.groups.iter().find_map(|group| Some(group.joints[group.passive?]));
        let values = json!({
            "files": self.surveys.len(),
            "raw": if let [one] = &raw[..] { text(one) } else { list(raw.iter().map(String::as_str)) },
            "rate": self.rate(),
            "unit": (request.unit != LengthUnit::Mm).then(|| text(request.unit.name())),
            "elsewhere": (!elsewhere.is_empty()).then(|| list(elsewhere.iter().map(String::as_str))),
            "measured": measured,
            "has_coast": has_coast,
            "has_release": self.has(TrialKind::JointRelease),
            "robot": toml_key(robot),
            "robot_name": text(robot),
            "h_m": fixed(calibration.h_mm.value / 1e3, 5),
            "h_se_mm": fixed(calibration.h_mm.se, 2),
            "layout_file": remark(&layout.path.display().to_string()),
            "l_m": fixed(layout.l_m, 5),
            "l_is_given": request.l_m.is_some(),
            "wheels_mm": [fixed(front.value, 1), fixed(rear.value, 1)],
            "rest_deg": passive.map(|joint| fixed(joint.offset_deg, 1)),
            "direction": match layout.direction_se_deg {
                se if se.is_nan() => "of the coast-down that is nearest to straight".to_owned(),
                se => format!("in which their wheels roll, +- {} degrees", fixed(se, 2)),
            },
            "is_direction_doubtful": layout.direction_se_deg > WELL_DEG,
            "front_doubt": self.front_doubt,
            "campaigns": campaigns.collect::<Vec<Value>>(),
            "links": calibration.links.each_ref().map(|markers| markers.iter().map(line).collect::<Vec<_>>()),
        });
        Ok(fill(include_str!("pipeline.txt"), &values)?)
    }

    /// The line of `[vicon]` on the frame rate.
    fn rate(&self) -> String {
        let usable = || self.surveys.iter().zip(&self.described).filter(|(_, found)| found.is_ok());
        let said: BTreeSet<u64> =
            usable().filter_map(|(of, _)| Some(of.rate_hz?.to_bits())).collect();
        let silent = usable().filter(|(of, _)| of.rate_hz.is_none()).count();
        let rate_hz = format!("rate_hz = {:?}", self.rate_hz);
        match (said.len(), silent) {
            (0, _) => format!(
                "{rate_hz}  {MARK}no file says its rate, Hz; every frequency was measured with this one"
            ),
            (1, 0) => format!("{rate_hz}  # as all files say"),
            (1, silent) => format!(
                "{rate_hz}  {MARK}{silent} files do not say their rate; this is that of the others"
            ),
            (_, 0) => "rate_from_file = true  # the files have several".to_owned(),
            (_, silent) => format!(
                "rate_from_file = true  {MARK}the files have several rates, and {silent} do not say \
                 theirs and will fail"
            ),
        }
    }

    /// The list of a folder's trials.
    fn list(&self, folder: usize, robot: &str) -> Result<String, InitError> {
        let left_out = |(i, of): (usize, &Survey)| {
            let reason = self.described[i].as_ref().err().filter(|_| of.folder == folder)?;
            Some(json!({ "file": text(&of.name), "reason": remark(reason) }))
        };
        let mut ids = BTreeSet::new();
        let trial = |(i, of): (usize, &Described)| {
            let survey = &self.surveys[i];
            let id = id(survey, &mut ids);
            let group = self.campaign(i);
            let gait = self.gaits.iter().find(|(file, _)| *file == i).map(|(_, gait)| gait);
            let listed = survey.listed.as_ref().and_then(|trial| trial.omega_rad_s);
            let omega = gait.map(|gait| {
                let named = listed.or_else(|| named_omega(&survey.stem(), gait.omega_rad_s));
                let measured = fixed(gait.omega_rad_s, 4);
                match named {
                    Some(named) => (format!("{named:?}"), format!("{measured} measured")),
                    None => (measured, "as measured".to_owned()),
                }
            });
            json!({
                "id": text(&id),
                "file": text(&survey.name),
                "doubt": (!survey.doubts.is_empty()).then(|| remark(&survey.doubts.join("; "))),
                "kind": of.recorded.kind().name(),
                "campaign": group.map(|group| text(&group.name)),
                "robot": group.is_none().then(|| text(robot)),
                "omega": omega,
            })
        };
        let values = json!({
            "left_out": self.surveys.iter().enumerate().filter_map(left_out).collect::<Vec<_>>(),
            "trials": self.trials(folder).map(trial).collect::<Vec<_>>(),
        });
        Ok(fill(include_str!("trials.txt"), &values)?)
    }
}

/// The lines of a gait's joints.
fn joints(group: &Group) -> Vec<String> {
    let line = |i: usize| {
        let joint = group.joints[i];
        let [offset, amplitude, phase] =
            [joint.offset_deg, joint.amplitude_deg.max(0.1), joint.phase_deg].map(|x| fixed(x, 1));
        format!(
            "joint{} = {{ offset_deg = {offset}, amplitude_deg = {amplitude}, phase_deg = {phase} }}",
            i + 1
        )
    };
    (0..2).filter(|i| group.passive != Some(*i)).map(line).collect()
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
