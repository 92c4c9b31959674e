//! Export of a trial: measured marker positions and poses of the links, in formats for OpenSim, Foxglove, Rerun and
//! spreadsheets.

mod foxglove;
mod mcap;
mod protobuf;
mod table;
mod trc;

use std::path::PathBuf;

use trilink_mocap::{ReadError, Recording, read_markers};
use trilink_robot::{AnyRobot, Pose};
use trilink_tables::config::{Config, ConfigError, GaitConfig, nearest};
use trilink_tables::trial::{ListedTrial, TrialFolders};
use trilink_tables::{Coordinates, Frames as _, Reader, StoreError, TrialRow, poses_path};

/// Format of an exported trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportFormat {
    /// Marker table for OpenSim, mm; includes the wheel axles and the joints as markers.
    Trc,
    /// MCAP with frame transforms and point clouds for Foxglove, m.
    Mcap,
    /// Table with one row per frame.
    Csv,
}

/// Error of an export.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error("trial `{name}` is not among the {known} trials{near}")]
    Unknown { name: String, known: usize, near: String },
    #[error("trial `{name}` exists in several folders; specify one of `{}`", names.join("`, `"))]
    Ambiguous { name: String, names: Vec<String> },
    #[error(transparent)]
    Markers(#[from] ReadError),
    #[error(
        "{}: the file states no frame rate; set `vicon.rate_hz` and `vicon.rate_from_file = false`",
        path.display()
    )]
    NoRate { path: PathBuf },
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// Poses of the links by number, and of the joints from front to rear, in a frame.
type Poses = [Vec<Pose>; 2];

/// Recorded motion of a trial.
#[derive(Debug)]
pub struct Motion {
    /// Name of the trial, preceded by its folder if the id occurs in several folders.
    pub name: String,
    markers: Recording,
    rate_hz: f64,
    /// Poses for each row of the marker file; `None` in frames in which a link is missing.
    poses: Vec<Option<Poses>>,
    /// Number of joints of the robot; 0 if it is not configured.
    joints: usize,
    /// Reason why there are no poses; `None` if there are any.
    pub without_poses: Option<String>,
}

impl Motion {
    /// Reads a trial, given by its name or by `FOLDER/ID`.
    ///
    /// # Errors
    /// Returns an error if there is no such trial (the most similar name is suggested), several trials have the name,
    /// or the markers cannot be read. Missing poses are not an error.
    pub fn read(config: &Config, name: &str) -> Result<Self, ExportError> {
        let folders = TrialFolders::load(&config.paths)?;
        let ListedTrial { folder, trial, .. } = find(&folders, name)?;
        let path = folders.folders[*folder].path.join(&trial.file);
        let markers = read_markers(&path, config.vicon.unit)?.without(&config.vicon.ignore);
        let configured_hz = (!config.vicon.rate_from_file).then_some(config.vicon.rate_hz);
        let rate_hz = markers.rate_hz.or(configured_hz).filter(|rate_hz| *rate_hz > 0.0);
        let rate_hz = rate_hz.ok_or(ExportError::NoRate { path })?;
        let robot = match &trial.campaign {
            Some(campaign) => config.setup(campaign).map(|(robot, _)| robot),
            None => trial
                .robot_name(config)
                .and_then(|robot| config.robot.get(robot))
                .map(|robot| robot.to_robot(&GaitConfig::default())),
        };
        let (poses, without_poses) = match &robot {
            Some(robot) => match poses(config, &trial.id, robot, &markers.frames) {
                Ok(poses) => (poses, None),
                Err(error) if error.is_not_there() => {
                    (Vec::new(), Some(why_without_poses(config, &trial.id)?))
                }
                Err(error) => return Err(error.into()),
            },
            None => {
                (Vec::new(), Some("the robot of the trial is not in the configuration".to_owned()))
            }
        };
        let joints = robot.map_or(0, |robot| robot.joints());
        Ok(Self { name: trial.id.clone(), markers, rate_hz, poses, joints, without_poses })
    }

    /// Returns the content of an export file in the given format.
    pub fn write(&self, format: ExportFormat) -> Vec<u8> {
        match format {
            ExportFormat::Trc => trc::write(self),
            ExportFormat::Csv => table::write(self).into_bytes(),
            ExportFormat::Mcap => foxglove::write(self),
        }
    }

    /// Returns the number of frames (rows).
    fn rows(&self) -> usize {
        self.markers.frames.len()
    }

    /// Returns the time since the first frame, s.
    fn time_s(&self, row: usize) -> f64 {
        let frames = &self.markers.frames;
        (frames[row] - frames[0]) as f64 / self.rate_hz
    }

    /// Returns the poses of the links and joints in a frame; `None` if a link is missing.
    fn pose(&self, row: usize) -> Option<&Poses> {
        self.poses.get(row)?.as_ref()
    }

    /// Returns the numbers of links and joints; zero if there are no poses.
    fn parts(&self) -> [usize; 2] {
        if self.without_poses.is_some() { [0; 2] } else { [self.joints + 1, self.joints] }
    }

    /// Returns unique labels for the markers, without characters that would end a cell or a line.
    fn labels(&self) -> Vec<String> {
        let mut taken = std::collections::BTreeSet::new();
        let labels = self.markers.labels.iter().map(|label| {
            let plain = label.replace(|c: char| c.is_whitespace() || c.is_control(), "_");
            let others = (2..).map(|number| format!("{plain}_{number}"));
            let mut names = [plain.clone()].into_iter().chain(others);
            names.find(|name| taken.insert(name.clone())).unwrap_or(plain)
        });
        labels.collect()
    }
}

/// Finds a trial by its name, by `FOLDER/ID`, or by an id that occurs in only one folder.
fn find<'t>(folders: &'t TrialFolders, name: &str) -> Result<&'t ListedTrial, ExportError> {
    let trials = &folders.trials;
    let exact = trials.iter().find(|listed| {
        let folder = &folders.folders[listed.folder].name;
        listed.trial.id == name || format!("{folder}/{}", listed.id) == name
    });
    if let Some(trial) = exact {
        return Ok(trial);
    }
    let same: Vec<&ListedTrial> = trials.iter().filter(|listed| listed.id == name).collect();
    match same.as_slice() {
        [trial] => Ok(trial),
        [] => {
            let near = nearest(name, trials.iter().map(|listed| listed.trial.id.as_str()));
            let near = near.map_or(String::new(), |near| format!(" (did you mean `{near}`?)"));
            Err(ExportError::Unknown { name: name.to_owned(), known: trials.len(), near })
        }
        several => {
            let names = several.iter().map(|listed| listed.trial.id.clone()).collect();
            Err(ExportError::Ambiguous { name: name.to_owned(), names })
        }
    }
}

/// Reads the poses of all links in the given frames from the table of poses.
fn poses(
    config: &Config,
    trial: &str,
    robot: &AnyRobot,
    frames: &[i64],
) -> Result<Vec<Option<Poses>>, StoreError> {
    let table = Reader::default().table(&poses_path(&config.paths.derived, trial))?;
    let known = table.values::<i64>("frame")?;
    let Coordinates { x_m, y_m, theta_rad, phi_rad } = Coordinates::from_table(&table)?;
    let poses = frames.iter().map(|frame| {
        let row = known.binary_search(frame).ok()?;
        let reference = Pose { x_m: x_m[row], y_m: y_m[row], theta_rad: theta_rad[row] };
        let phi_rad: Vec<f64> = phi_rad.iter().map(|phi_rad| phi_rad[row]).collect();
        if phi_rad.len() != robot.joints() {
            return None;
        }
        let poses = robot.poses(reference, &phi_rad);
        let are_finite =
            poses[0].iter().all(|pose| (pose.x_m + pose.y_m + pose.theta_rad).is_finite());
        are_finite.then_some(poses)
    });
    Ok(poses.collect())
}

/// Explains why a trial has no table of poses.
fn why_without_poses(config: &Config, trial: &str) -> Result<String, StoreError> {
    let path = config.paths.derived.join("trials.parquet");
    let rows: Option<Vec<TrialRow>> = Reader::default().rows_if_there(&path)?;
    let row = rows.into_iter().flatten().find(|row| row.trial == trial);
    Ok(match row {
        Some(row) if !row.status.has_metrics() => {
            format!("the trial has the status `{}`: {}", row.status, row.message)
        }
        _ => "the trial has not been ingested; run `trilink ingest`".to_owned(),
    })
}
