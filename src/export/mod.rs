//! A trial for other viewers: markers as the cameras saw them and the links' poses, as files that
//! OpenSim, Foxglove, Rerun and spreadsheets open.

mod foxglove;
mod mcap;
mod protobuf;
mod table;
mod trc;

use std::path::PathBuf;

use trilink_mocap::{ReadError, Recording, read_markers};
use trilink_robot::{Pose, Robot};
use trilink_tables::config::{Config, ConfigError, nearest};
use trilink_tables::trial::{ListedTrial, TrialFolders};
use trilink_tables::{
    Coordinates, Frames as _, Reader, StoreError, TrialRow, TrialStatus, poses_path,
};

/// How a trial is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportFormat {
    /// OpenSim's table of markers, mm; the links' axles and the joints are markers, too.
    Trc,
    /// MCAP with Foxglove's frame transforms and point clouds, m.
    Mcap,
    /// One row per frame.
    Csv,
}

/// Why a trial cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error("trial `{name}`: found no such trial, needed one of {known} trials{near}")]
    Unknown { name: String, known: usize, near: String },
    #[error("trial `{name}`: found in several folders, needed one of `{}`", names.join("`, `"))]
    Ambiguous { name: String, names: Vec<String> },
    #[error(transparent)]
    Markers(#[from] ReadError),
    #[error("{}: found no frame rate, needed one of the file or `vicon.rate_hz`", path.display())]
    NoRate { path: PathBuf },
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// Poses of links 0, 1, 2 in a frame.
type LinkPoses = [Pose; 3];

/// What was recorded of a trial.
#[derive(Debug)]
pub struct Motion {
    /// Its name, with its folder's in front where others have the same.
    pub name: String,
    markers: Recording,
    rate_hz: f64,
    /// By row of the marker file; none where a link was missing.
    poses: Vec<Option<LinkPoses>>,
    robot: Option<Robot>,
    /// Why there are no poses.
    pub without_poses: Option<String>,
}

impl Motion {
    /// Reads a trial that is called by its name, or by its folder and its id: `FOLDER/ID`.
    ///
    /// # Errors
    /// There is no such trial (the nearest is named), several have the name, or its markers cannot
    /// be read. That it has no poses is no error.
    pub fn read(config: &Config, name: &str) -> Result<Self, ExportError> {
        let folders = TrialFolders::load(&config.paths)?;
        let ListedTrial { folder, trial, .. } = find(&folders, name)?;
        let path = folders.folders[*folder].path.join(&trial.file);
        let markers = read_markers(&path, config.vicon.unit)?.without(&config.vicon.ignore);
        let of_settings = (!config.vicon.rate_from_file).then_some(config.vicon.rate_hz);
        let rate_hz = markers.rate_hz.or(of_settings).filter(|rate_hz| *rate_hz > 0.0);
        let rate_hz = rate_hz.ok_or(ExportError::NoRate { path })?;
        let robot = match &trial.campaign {
            Some(campaign) => config.campaign_setup(campaign).map(|(robot, _)| robot),
            None => trial
                .robot
                .as_ref()
                .and_then(|robot| config.robot.get(robot))
                .map(|of| of.to_robot()),
        };
        let (poses, without_poses) = match &robot {
            Some(robot) => match poses(config, &trial.id, robot, &markers.frames) {
                Ok(poses) => (poses, None),
                Err(error) if error.is_not_there() => {
                    (Vec::new(), Some(why_none(config, &trial.id)?))
                }
                Err(error) => return Err(error.into()),
            },
            None => (Vec::new(), Some("its robot is not in the configuration".to_owned())),
        };
        Ok(Self { name: trial.id.clone(), markers, rate_hz, poses, robot, without_poses })
    }

    /// The bytes of a file in a format.
    pub fn write(&self, format: ExportFormat) -> Vec<u8> {
        match format {
            ExportFormat::Trc => trc::write(self).into_bytes(),
            ExportFormat::Csv => table::write(self).into_bytes(),
            ExportFormat::Mcap => foxglove::write(self),
        }
    }

    fn rows(&self) -> usize {
        self.markers.frames.len()
    }

    /// Since the first frame.
    fn time_s(&self, row: usize) -> f64 {
        let frames = &self.markers.frames;
        (frames[row] - frames[0]) as f64 / self.rate_hz
    }

    fn pose(&self, row: usize) -> Option<&LinkPoses> {
        self.poses.get(row)?.as_ref()
    }

    /// Markers' labels without characters that would end a cell or a line, no two the same.
    fn labels(&self) -> Vec<String> {
        let mut taken = std::collections::BTreeSet::new();
        let label = |label: &String| {
            let plain = |c: char| if c.is_whitespace() || c.is_control() { '_' } else { c };
            let plain: String = label.chars().map(plain).collect();
            let others = (2..).map(|nth| format!("{plain}_{nth}"));
            let mut names = [plain.clone()].into_iter().chain(others);
            names.find(|name| taken.insert(name.clone())).unwrap_or(plain)
        };
        self.markers.labels.iter().map(label).collect()
    }
}

/// The trial of a name, of a folder and an id, or of an id that one folder has.
fn find<'t>(folders: &'t TrialFolders, name: &str) -> Result<&'t ListedTrial, ExportError> {
    let trials = &folders.trials;
    let qualified =
        |trial: &ListedTrial| format!("{}/{}", folders.folders[trial.folder].name, trial.id);
    let exact = trials.iter().find(|of| of.trial.id == name || qualified(of) == name);
    if let Some(trial) = exact {
        return Ok(trial);
    }
    let same: Vec<&ListedTrial> = trials.iter().filter(|of| of.id == name).collect();
    match same.as_slice() {
        [trial] => Ok(trial),
        [] => {
            let near = nearest(name, trials.iter().map(|of| of.trial.id.as_str()));
            let near = near.map_or(String::new(), |near| format!(" (did you mean `{near}`?)"));
            Err(ExportError::Unknown { name: name.to_owned(), known: trials.len(), near })
        }
        several => {
            let names = several.iter().map(|of| of.trial.id.clone()).collect();
            Err(ExportError::Ambiguous { name: name.to_owned(), names })
        }
    }
}

/// Poses of all links in these frames.
fn poses(
    config: &Config,
    trial: &str,
    robot: &Robot,
    frames: &[i64],
) -> Result<Vec<Option<LinkPoses>>, StoreError> {
    let table = Reader::default().table(&poses_path(&config.paths.derived, trial))?;
    let known = table.values::<i64>("frame")?;
    let Coordinates { x_m, y_m, theta_rad, phi_rad } = Coordinates::from_table(&table)?;
    let pose = |frame: &i64| {
        let row = known.binary_search(frame).ok()?;
        let middle = Pose { x_m: x_m[row], y_m: y_m[row], theta_rad: theta_rad[row] };
        let poses = robot.link_poses(middle, [phi_rad[0][row], phi_rad[1][row]]);
        let is_known = |pose: &Pose| (pose.x_m + pose.y_m + pose.theta_rad).is_finite();
        poses.iter().all(is_known).then_some(poses)
    };
    Ok(frames.iter().map(pose).collect())
}

/// What became of a trial that has no table of poses.
fn why_none(config: &Config, trial: &str) -> Result<String, StoreError> {
    let path = config.paths.derived.join("trials.parquet");
    let rows: Option<Vec<TrialRow>> = Reader::default().rows_if_there(&path)?;
    let row = rows.into_iter().flatten().find(|row| row.trial == trial);
    Ok(match row {
        Some(row) if row.status == TrialStatus::Failed => format!("it failed: {}", row.message),
        _ => "it is not ingested; `trilink ingest` makes them".to_owned(),
    })
}
