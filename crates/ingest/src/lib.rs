//! Converts the marker files of a trial folder to tables of markers, link poses, smoothed coordinates, wheel velocities
//! and cycles, and to one summary row per trial.
//!
//! A trial that cannot be processed gets a row with status `failed` and the reason, and does not affect the other
//! trials. Each trial is computed by a single thread, and no result depends on the order of the trials, so the tables
//! are identical byte for byte for any number of threads.
//!
//! A trial passes through `markers`, `poses` (eq. 1), `phase` and `cycles` (eq. 17 and 20), or through
//! `identification` if it has no gait; `checks` and `diagnosis` judge the results. [`ingest_trials`] processes
//! folders, [`process_trial`] one trial. [`calibrate()`] and [`survey()`] are for recordings without a configuration,
//! and [`own_table`] is for trials that were processed elsewhere.
//!
//! ```no_run
//! use std::path::Path;
//! use trilink_ingest::check_trial;
//! use trilink_tables::{config::Config, trial::TrialList};
//!
//! let config = Config::load(Path::new("pipeline.toml"))?;
//! let folder = Path::new("raw/day1");
//! for trial in &TrialList::load(folder)?.trial {
//!     let rows = check_trial(folder, trial, &config);
//!     let row = &rows.trials[0];
//!     println!("{}: {}, d = {:.4} m", row.trial, row.status, row.metrics.d_m);
//!     rows.checks.iter().for_each(|check| println!("  {}: {}", check.check, check.message));
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// Processing stages, in order:

/// Marker file -> markers on each link, corrected labels, pose of each link.
mod markers;

/// Link poses -> coordinates of the robot over time.
mod poses;

/// Joint angles -> frequency and phase of the commanded gait.
mod phase;

/// Coordinates and phase -> smoothed coordinates.
mod smoothing;

/// Coordinates and phase -> wheel velocities, cycles, cycle means.
mod cycles;

/// Trials without a gait -> robot parameters.
mod identification;

/// Comparison of measurement and configuration -> mistakes and their likely causes.
mod diagnosis;

/// Trial with unknown marker layout -> marker layout.
pub mod calibrate;

/// Robot -> places of its joints and wheels, velocities of its wheels.
mod geometry;

// Items that the stages share, and operations that use the stages.
mod checks;
mod error;
mod folder;
mod input;
pub mod own_table;
mod signals;
mod survey;
mod tables;

#[cfg(test)]
mod tests;

use std::ops::Range;
use std::path::Path;

pub use calibrate::{Calibration, CalibrationError, MarkerPosition, calibrate};
pub use checks::Check;
pub use diagnosis::{FolderInput, axis_up_message, without_diagnosis};
pub use error::{Problem, TrialFailure};
pub use folder::{
    Entry, IngestedTrial, MarkerStamp, TABLES, TRIAL_FOLDERS, ingest_trials, outdated_tables,
};
pub use input::{IngestInput, IngestSettings};
pub use survey::{FileSurvey, Gaps, MarkerCoverage, RecordingSurvey, survey};

use trilink_mocap::Recording;
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{AnyRobot, JointCommand};
use trilink_statistics::Estimate;
use trilink_tables::config::{Config, Smoothing, SmoothingWindow};
use trilink_tables::trial::{Trial, TrialKind};
use trilink_tables::{
    CheckRow, Clock, CycleRow, Frames as _, Numbered, RobotParameterRow, Severity, Table, TrialRow,
    TrialStatus, WheelFrames,
};

use checks::Finding;
use cycles::steady::{self, CycleSelection};
use cycles::summary::{measured_joints, set_gait};
use cycles::{Cycle, CycleData, summary, wheel_velocities};
use geometry::Geometry;
use identification::{against_configured, coast, release};
use markers::bodies;
use markers::layout::{self, Layout};
pub use markers::layout::{LinkMarker, marker_name};
pub use markers::rigid::fit as fit_rigid;
pub use phase::{CommandedGait, GAIT_HARMONICS, GaitPhase, Harmonics, strongest_line};
pub use poses::frame_grid;
use poses::{Constant, LinkPoses, Linkage, Tracked};
use signals::JointSignal;
use smoothing::SmoothedMotion;

/// Robot of a trial and its command.
struct Subject {
    geometry: Geometry,
    /// `None` unless the trial's kind is `gait`.
    command: Option<Command>,
    robot: AnyRobot,
}

/// Commanded motion of the joints.
struct Command {
    /// Commands of the joints from front to rear; `None` for a joint that is not commanded.
    joints: Vec<Option<JointCommand>>,
    omega_rad_s: f64,
}

/// Minimum number of used cycles for trial means.
const MIN_USED_CYCLES: usize = 2;

/// Rows of `trials.parquet`, `checks.parquet` and `robot_parameters.parquet`, in the order of the trials in the list.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Ingested {
    pub trials: Vec<TrialRow>,
    pub checks: Vec<CheckRow>,
    /// Rows of the trials whose kind is not `gait`, with their identified robot parameters.
    pub parameters: Vec<RobotParameterRow>,
}

/// Results of one trial, not yet written to disk.
#[derive(Debug, Clone, PartialEq)]
pub struct ProcessedTrial {
    pub row: TrialRow,
    pub checks: Vec<CheckRow>,
    /// Identified robot parameters; `None` if the trial's kind is `gait`.
    pub parameters: Option<RobotParameterRow>,
    /// Rows of the trial's cycles; empty unless the trial's kind is `gait`.
    pub cycles: Vec<CycleRow>,
    /// Table for the file `poses/<trial>.parquet`.
    pub poses: Table,
    /// Table for the file `wheels/<trial>.parquet`.
    pub wheels: Table,
}

/// Processes one trial of a folder without writing any file.
///
/// ```
/// use trilink_tables::config::Config;
/// use trilink_ingest::process_trial;
/// use trilink_synth::{Recipe, synthesise};
/// use trilink_tables::trial::TrialList;
///
/// let mut config = Config::default();
/// config.campaign.retain(|name, _| name == "kinematic-symmetric");
/// let folder = tempfile::tempdir()?;
/// let recipe = Recipe { omegas_rad_s: vec![4.0], ..Recipe::new(1) };
/// synthesise(&config, folder.path(), &recipe, &|_| Ok(()))?;
///
/// let list = TrialList::load(folder.path())?;
/// let processed = process_trial(folder.path(), &list.trial[0], &config)?;
/// assert!(processed.row.cycles > 2 && processed.row.metrics.d_m > 0.4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Returns an error if the trial's entry in the list, its marker file or the recorded motion is unusable.
pub fn process_trial(
    folder: &Path,
    trial: &Trial,
    config: &Config,
) -> Result<ProcessedTrial, TrialFailure> {
    process_file(folder, trial, config, &mut PartialResult::new(trial))
}

/// Processes one trial of a folder and returns its rows, without writing any file.
pub fn check_trial(folder: &Path, trial: &Trial, config: &Config) -> Ingested {
    let mut partial = PartialResult::new(trial);
    let (row, checks, parameters) = match process_file(folder, trial, config, &mut partial) {
        Ok(ProcessedTrial { row, checks, parameters, .. }) => (row, checks, parameters),
        Err(failure) => {
            let (row, checks) = partial.failed(&failure);
            (row, checks, None)
        }
    };
    Ingested { trials: vec![row], checks, parameters: parameters.into_iter().collect() }
}

/// Row and findings of a trial as far as it has been processed; reported even if a later stage fails.
struct PartialResult {
    row: TrialRow,
    findings: Vec<Finding>,
}

impl PartialResult {
    fn new(trial: &Trial) -> Self {
        Self { row: summary::blank_row(trial), findings: Vec::new() }
    }

    /// Returns the row of a failed trial, with all measured quantities except the metrics, and its checks: first the
    /// reason for the failure, then the checks made before the failure.
    fn failed(self, failure: &TrialFailure) -> (TrialRow, Vec<CheckRow>) {
        let message = failure.to_string();
        let reason = Finding::new(Check::Failed, false, f64::NAN, f64::NAN, message.clone());
        let checks = std::iter::once(&reason)
            .chain(&self.findings)
            .map(|finding| finding.row(&self.row.trial))
            .collect();
        let row = TrialRow {
            cycles: 0,
            metrics: GaitMetrics::MISSING,
            metrics_se: GaitMetrics::MISSING,
            sigma_debiased: [Estimate::MISSING; 3],
            more_sigma_debiased: Numbered::default(),
            status: TrialStatus::Failed,
            message,
            ..self.row
        };
        (row, checks)
    }
}

fn process_file(
    folder: &Path,
    trial: &Trial,
    config: &Config,
    partial: &mut PartialResult,
) -> Result<ProcessedTrial, TrialFailure> {
    let input = IngestInput::new(config, trial)?;
    let path = folder.join(&trial.file);
    process(&path, trilink_mocap::read_file(&path)?.0, trial, &input, partial)
}

/// Processes the bytes of a marker file and adds the findings to `partial`. If a check fails with the severity `error`,
/// this is returned as the cause of failure in place of any error that follows from it.
fn process(
    path: &Path,
    bytes: impl AsRef<[u8]>,
    trial: &Trial,
    input: &IngestInput,
    partial: &mut PartialResult,
) -> Result<ProcessedTrial, TrialFailure> {
    let unit = input.settings.vicon.unit;
    let file = trilink_mocap::parse_markers(path, bytes.as_ref(), unit)?;
    let file = input.with_layout_labels(file);
    // The bytes of a long recording take up a gigabyte.
    drop(bytes);
    let processed = process_recording(file, trial, input, partial);
    stop_beyond_limits(&partial.findings).and(processed).map_err(|problem| problem.in_file(path))
}

/// Returns an error with the messages of all findings of the severity `error`, if there are any.
fn stop_beyond_limits(findings: &[Finding]) -> Result<(), Problem> {
    let errors = findings.iter().filter(|finding| finding.severity == Severity::Error);
    let messages: Vec<String> = errors.map(Finding::to_string).collect();
    if messages.is_empty() {
        Ok(())
    } else {
        Err(Problem::BeyondLimits { checks: messages.join("; ") })
    }
}

/// Processes the recorded markers of a trial and adds its findings to `partial`.
fn process_recording(
    file: Recording,
    trial: &Trial,
    input: &IngestInput,
    partial: &mut PartialResult,
) -> Result<ProcessedTrial, Problem> {
    let subject = input.subject(trial);
    let recording = TrialRecording::new(file, &input.settings, &subject.geometry)?;
    let links = input.settings.markers.links().into_iter();
    let labels: Vec<Vec<String>> = links.map(|link| link.keys().cloned().collect()).collect();
    process_markers(recording, &labels, trial, &subject, partial)
}

/// Processes the recorded markers of a trial, given their labels by link.
fn process_markers(
    mut recording: TrialRecording,
    labels: &[Vec<String>],
    trial: &Trial,
    subject: &Subject,
    partial: &mut PartialResult,
) -> Result<ProcessedTrial, Problem> {
    let Subject { geometry, command, robot } = subject;
    let ingest = &recording.settings.ingest;
    let skip_cycles = ingest.skip_cycles;
    let rate_hz = recording.rate_hz;
    let (tracked, gait_frames) = recording.track(trial, subject, partial)?;
    poses::describe_tracking(&mut partial.row, &tracked);
    recording.file.forget_positions();
    stop_beyond_limits(&partial.findings)?;

    let driven = match command {
        Some(command) => Some(measure_gait(
            geometry,
            command,
            &tracked,
            gait_frames,
            rate_hz,
            skip_cycles,
            partial,
        )?),
        None => None,
    };
    let PartialResult { row, findings } = partial;
    let window = match ingest.smoothing {
        Smoothing::MovingAverage => {
            Some(smoothing_window(trial, ingest.smoothing_window, &tracked, driven.as_ref()))
        }
        Smoothing::Kalman => None,
    };
    let motion = SmoothedMotion::new(geometry, &tracked, driven.as_ref(), window, rate_hz);
    row.smoothing_window = window.unwrap_or(0) as i64;
    let mut cycle_rows = Vec::new();
    if let (Some(Command { joints, .. }), Some(driven)) = (command, &driven) {
        let raw_wheels = wheel_velocities(geometry, &tracked.filled, rate_hz);
        let data = CycleData {
            geometry,
            joints,
            driven,
            tracked: &tracked,
            raw_wheels: &raw_wheels,
            rate_hz,
            motion: &motion,
        };
        let (cycles, steady) = steady_cycles(&data, skip_cycles)?;
        // The checks for all kinds of trials come first.
        if let Some(frames) = checked_frames(&data, &cycles, &steady) {
            *findings = recording.checks(&tracked, &frames);
            stop_beyond_limits(findings)?;
        }
        summary::describe_gait(row, &data, &cycles, &steady);
        findings.extend(summary::gait_checks(row, &data, &cycles, &steady));
        cycle_rows = summary::cycle_rows(trial, &cycles, &steady, rate_hz);
    }
    let parameters = robot_parameters(trial, robot, &tracked, &motion, rate_hz, findings)?;
    let failed = findings.iter().filter(|finding| !finding.holds());
    let warnings: Vec<&str> = failed.map(|finding| finding.message.as_str()).collect();
    row.status = if warnings.is_empty() { TrialStatus::Ok } else { TrialStatus::Flagged };
    row.message = warnings.join("; ");
    Ok(ProcessedTrial {
        checks: findings.iter().map(|finding| finding.row(&trial.id)).collect(),
        row: row.clone(),
        parameters,
        cycles: cycle_rows,
        wheels: WheelFrames {
            clock: Clock::new(tracked.first_frame, tracked.frames(), rate_hz),
            velocities: motion.wheels,
            // The errors assume white noise.
            errors: motion
                .errors
                .filter(|_| row.noise_white != Some(false))
                .map(|errors| errors.wheels),
        }
        .into_table(&trial.id),
        poses: tables::poses(&trial.id, tracked, motion.coordinates, labels, rate_hz),
    })
}

/// Recorded markers of a trial, with the settings for reconstructing and checking the poses.
struct TrialRecording<'i> {
    file: Recording,
    settings: &'i IngestSettings,
    layout: Layout,
    /// Finding about markers that the file does not have.
    missing: Option<Finding>,
    linkage: Linkage,
    rate_hz: f64,
}

impl<'i> TrialRecording<'i> {
    fn new(
        file: Recording,
        settings: &'i IngestSettings,
        geometry: &Geometry,
    ) -> Result<Self, Problem> {
        let rate_hz = settings.frame_rate(&file)?;
        let (mut file, mut layout, missing) = layout::locate_or_occlude(&settings.markers, file)?;
        diagnosis::check_layout(&file, &layout, &settings.markers)?;
        bodies::balance(&mut file, &mut layout);
        let linkage = Linkage::new(geometry, |link| layout[link].is_empty());
        Ok(Self { file, settings, layout, missing, linkage, rate_hz })
    }

    /// Reconstructs and checks the robot's coordinates over time. Also returns the frames whose joint angles determine
    /// the gait's frequency and phase.
    ///
    /// A trial that has a gait and fails a check is processed twice: the first pass locates the used cycles, and the
    /// second restricts the checks, and if necessary the estimates of quantities that are constant over a trial, to the
    /// frames of these cycles.
    fn track(
        &mut self,
        trial: &Trial,
        subject: &Subject,
        partial: &mut PartialResult,
    ) -> Result<(Tracked, Range<usize>), Problem> {
        let command = subject.command.as_ref();
        let poses = self.solve(0..self.file.frames.len())?;
        if command.is_none() || self.severity(&poses.constant).is_none() {
            // The positions of a long recording take up a gigabyte.
            self.file.forget_positions();
        }
        let mut tracked = self.over_time(poses)?;
        let mut gait_frames = 0..tracked.frames();
        partial.findings = self.checks(&tracked, &gait_frames);
        if let Some(command) = command
            && partial.findings.iter().any(|finding| !finding.holds())
            && let Ok(frames) = self.frames_in_use(trial, &subject.geometry, command, &tracked)
        {
            if self.severity(&tracked.constant).is_some() {
                // Before and after these frames the robot may have been lifted.
                let [start, end] = [frames.start, frames.end].map(|frame| {
                    tracked.recorded_frames.partition_point(|&recorded| recorded < frame)
                });
                let poses = self.solve(start..end)?;
                if self.severity(&poses.constant) < self.severity(&tracked.constant) {
                    tracked = self.over_time(poses)?;
                }
            }
            partial.findings = self.checks(&tracked, &frames);
            gait_frames = tracked.on_one_clock(&frames);
        }
        Ok((tracked, gait_frames))
    }

    /// Fits the poses of all links; tilt and joint positions are estimated from the `steady` rows.
    fn solve(&self, steady: Range<usize>) -> Result<LinkPoses, Problem> {
        let Self { file, settings, layout, linkage, rate_hz, .. } = self;
        poses::solve(file, layout, Some(*linkage), settings.ingest.poses, *rate_hz, steady)
    }

    /// Returns the frames in which a trial is checked, from a first pass over the whole recording.
    fn frames_in_use(
        &self,
        trial: &Trial,
        geometry: &Geometry,
        command: &Command,
        tracked: &Tracked,
    ) -> Result<Range<usize>, Problem> {
        let Self { settings: IngestSettings { ingest, .. }, rate_hz, .. } = self;
        let rate_hz = *rate_hz;
        let all = 0..tracked.frames();
        let driven = measure_phase(command, tracked, all.clone(), rate_hz, ingest.skip_cycles)?;
        // The moving average, which is faster, is accurate enough to locate the cycles.
        let window = smoothing_window(trial, ingest.smoothing_window, tracked, Some(&driven));
        let motion = SmoothedMotion::new(geometry, tracked, Some(&driven), Some(window), rate_hz);
        let raw_wheels = wheel_velocities(geometry, &tracked.filled, rate_hz);
        let data = CycleData {
            geometry,
            joints: &command.joints,
            driven: &driven,
            tracked,
            raw_wheels: &raw_wheels,
            rate_hz,
            motion: &motion,
        };
        let (cycles, steady) = steady_cycles(&data, ingest.skip_cycles)?;
        Ok(checked_frames(&data, &cycles, &steady).unwrap_or(all))
    }

    fn over_time(&self, poses: LinkPoses) -> Result<Tracked, Problem> {
        let max_gap = self.settings.max_gap_frames(self.rate_hz);
        poses.over_time(&self.file.frames, &self.layout, max_gap)
    }

    /// Checks markers, poses and linkage in a range of frames.
    fn checks(&self, tracked: &Tracked, frames: &Range<usize>) -> Vec<Finding> {
        let Self { file, settings, layout, linkage, missing, .. } = self;
        let mut findings: Vec<Finding> = missing.iter().cloned().collect();
        findings.extend(poses::tracking_checks(tracked, file, layout, settings, frames));
        findings.extend(diagnosis::check_linkage(linkage, &tracked.constant, &settings.markers));
        findings
    }

    /// Returns the highest severity of the failed checks of quantities that are constant over the trial; `None` if all
    /// of these checks pass.
    fn severity(&self, constant: &Constant) -> Option<Severity> {
        std::iter::once(poses::tilt_check(&constant.tilt))
            .chain(diagnosis::check_linkage(&self.linkage, constant, &self.settings.markers))
            .filter(|finding| !finding.holds())
            .map(|finding| finding.severity)
            .max()
    }
}

/// Measures the frequency, phase and shape of the commanded gait. The trial fails, before its cycles are located, if
/// the robot does not perform the commanded gait.
fn measure_gait(
    geometry: &Geometry,
    command: &Command,
    tracked: &Tracked,
    frames: Range<usize>,
    rate_hz: f64,
    skip_cycles: usize,
    partial: &mut PartialResult,
) -> Result<GaitPhase, Problem> {
    let driven = measure_phase(command, tracked, frames, rate_hz, skip_cycles);
    if let Err(Problem::OtherFrequency { omega_rad_s, .. }) = &driven {
        partial.row.omega_rad_s = *omega_rad_s;
    }
    let driven = driven?;
    partial.row.omega_rad_s = driven.omega_rad_s;
    let gaits = summary::joint_gaits(&tracked.seen.phi_rad, &driven.moving, &driven.phase);
    set_gait(&mut partial.row, gaits);
    let measured = measured_joints(&partial.row, command.joints.len());
    let finding = diagnosis::check_gait(&measured, &command.joints, geometry.is_of_paper);
    if finding.severity == Severity::Error {
        partial.findings.push(finding);
    }
    stop_beyond_limits(&partial.findings)?;
    Ok(driven)
}

/// Identifies the robot's parameters from a trial without a gait and adds the findings; `None` if the trial's kind is
/// `gait`.
fn robot_parameters(
    trial: &Trial,
    robot: &AnyRobot,
    tracked: &Tracked,
    motion: &SmoothedMotion,
    rate_hz: f64,
    findings: &mut Vec<Finding>,
) -> Result<Option<RobotParameterRow>, Problem> {
    let (parameters, checks) = match trial.kind {
        TrialKind::Gait => return Ok(None),
        TrialKind::JointRelease => release::measure(robot, &tracked.seen, rate_hz)?,
        TrialKind::CoastDown => {
            // All wheels roll at the same speed.
            let wheel = robot.roll_kg_s().iter().position(|roll_kg_s| !roll_kg_s.is_nan());
            let speed_m_s = &motion.wheels.roll_m_s[wheel.unwrap_or(0)];
            coast::measure(robot, &tracked.seen, speed_m_s, rate_hz)?
        }
    };
    findings.extend(checks);
    findings.push(against_configured(&parameters));
    Ok(Some(RobotParameterRow {
        trial: trial.id.clone(),
        kind: trial.kind,
        robot: trial.robot.clone().unwrap_or_default(),
        ..parameters
    }))
}

/// Measures the frequency and the phase of a commanded gait from the joint angles in a range of frames.
fn measure_phase(
    Command { joints, omega_rad_s }: &Command,
    tracked: &Tracked,
    frames: Range<usize>,
    rate_hz: f64,
    skip_cycles: usize,
) -> Result<GaitPhase, Problem> {
    let command = CommandedGait { joints, omega_rad_s: *omega_rad_s, rate_hz, skip_cycles };
    let phi_rad = &tracked.seen.phi_rad;
    diagnosis::check_swing(&command, phi_rad)?;
    if frames == (0..tracked.frames()) {
        return command.estimate_phase(phi_rad);
    }
    let mut phi_rad = phi_rad.clone();
    for phi_rad in phi_rad.iter_mut() {
        phi_rad[..frames.start].fill(f64::NAN);
        phi_rad[frames.end..].fill(f64::NAN);
    }
    command.estimate_phase(&phi_rad)
}

/// Returns all cycles and the selection of those that are used.
///
/// # Errors
/// Returns an error if fewer than [`MIN_USED_CYCLES`] cycles can be used.
fn steady_cycles(
    data: &CycleData,
    skip_cycles: usize,
) -> Result<(Vec<Cycle>, CycleSelection), Problem> {
    let cycles = data.cycles();
    let steady = steady::select(&cycles, skip_cycles);
    if steady.used.len() < MIN_USED_CYCLES {
        let later = &cycles[steady.skipped..];
        return Err(Problem::TooFewCycles {
            all: cycles.len(),
            usable: steady.used.len(),
            needed: MIN_USED_CYCLES,
            skipped: steady.skipped,
            gapped: later.iter().filter(|cycle| !cycle.is_whole()).count(),
            off_gait: steady.off_gait,
        });
    }
    Ok((cycles, steady))
}

/// Returns the frames in which a trial is checked: [`CycleSelection::span`], which is extended backwards to the first
/// frame after the skipped cycles if it begins later. (Missing rows there may shift the phase, so that one more cycle
/// is skipped.) `None` if no cycle is used.
fn checked_frames(
    data: &CycleData,
    cycles: &[Cycle],
    steady: &CycleSelection,
) -> Option<Range<usize>> {
    let GaitPhase { phase, moving, .. } = data.driven;
    let skipped = steady.skip as f64 * std::f64::consts::TAU / phase.step_rad;
    let span = steady.span(cycles)?;
    Some(span.start.min(moving.start + skipped.ceil() as usize)..span.end)
}

/// Returns the width of the moving average, samples: the trial's own, else the configured one, else the width with the
/// smallest expected error.
fn smoothing_window(
    trial: &Trial,
    configured: SmoothingWindow,
    tracked: &Tracked,
    driven: Option<&GaitPhase>,
) -> usize {
    match (trial.smoothing_window, configured, driven) {
        (Some(window), _, _) | (None, SmoothingWindow::Window(window), _) => window,
        (None, SmoothingWindow::Auto, None) => signals::WINDOW_WITHOUT_GAIT,
        (None, SmoothingWindow::Auto, Some(GaitPhase { phase, moving, .. })) => {
            let joints = tracked.seen.phi_rad.iter().map(|phi_rad| JointSignal {
                noise_rad: signals::noise(phi_rad),
                harmonics_rad: Harmonics::fit(phi_rad, moving.clone(), phase, GAIT_HARMONICS)
                    .map_or(Vec::new(), |fit| (1..=3).map(|k| fit.amplitude(k)).collect()),
            });
            signals::best_window(&joints.collect::<Vec<_>>(), phase.step_rad)
        }
    }
}
