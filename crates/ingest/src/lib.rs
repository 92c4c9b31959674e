//! From the marker files of a folder to tables: markers, link poses, smoothed coordinates,
//! wheel velocities, cycles, one row per trial.
//!
//! A trial that cannot be processed is a row with status `failed` and the reason; the others
//! go on. Every trial is computed by one thread and nothing depends on which one, so the
//! tables are the same bytes for any number of threads.
//!
//! A trial passes through `markers`, `poses` (eq. 1), `phase` and `cycles` (eq. 17 and 20), one without
//! a gait through `identification`; `checks` and `diagnosis` judge what came of it. [`ingest_trials`]
//! does that for folders, [`process_trial`] for one trial. Beside them stand [`calibrate()`]
//! and [`survey()`] for recordings that are not configured yet, and [`own_table`] for trials that were
//! processed elsewhere.
//!
//! ```no_run
//! use std::path::Path;
//! use trilink_ingest::check_trial;
//! use trilink_tables::{config::Config, trial::TrialList};
//!
//! let config = Config::load(Path::new("pipeline.toml"))?;
//! let folder = Path::new("raw/day1");
//! for trial in &TrialList::load(folder)?.trial {
//!     let (row, checks) = check_trial(folder, trial, &config);
//!     println!("{}: {}, d = {:.4} m", row.trial, row.status, row.metrics.d_m);
//!     checks.iter().for_each(|check| println!("  {}: {}", check.check, check.message));
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// In the order in which a trial passes through them:

/// Marker file -> markers of each link, corrected labels, each link's own pose.
mod markers;

/// Links' poses -> the robot's coordinates over time.
mod poses;

/// Joint angles -> frequency and phase of the commanded gait.
mod phase;

/// Coordinates and phase -> wheel velocities, cycles, their means.
mod cycles;

/// Trials without a gait -> parameters of the robot.
mod identification;

/// What was measured and what is configured -> mistakes, named by their cause.
mod diagnosis;

/// A trial of unknown layout -> the layout.
pub mod calibrate;

// What they share, and what goes around them.
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
pub use diagnosis::other_axis_up;
pub use diagnosis::{FolderInput, undiagnosed};
pub use error::{Problem, TrialFailure};
pub use folder::{Entry, FOLDERS, IngestedTrial, MarkerStamp, TABLES, ingest_trials, outdated};
pub use input::{IngestInput, IngestSettings};
pub use survey::{FileSurvey, Gaps, MarkerCoverage, RecordingSurvey, survey};

use trilink_mocap::Recording;
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Gait, Robot};
use trilink_statistics::Estimate;
use trilink_tables::config::{Config, Smoothing, Vicon};
use trilink_tables::trial::{Trial, TrialKind};
use trilink_tables::{
    CheckRow, Clock, Coordinates, CycleRow, Frames as _, RobotParameterRow, Severity, Table,
    TrialRow, TrialStatus, WheelFrames, WheelVelocities,
};

use checks::Finding;
use cycles::steady::{self, Steady};
use cycles::{Cycle, CycleData, summary, wheel_velocities};
use identification::{against_configured, coast, release};
use markers::layout;
pub use markers::layout::{LinkMarker, marker_name};
pub use markers::rigid::fit as fit_rigid;
pub use phase::{CommandedGait, GAIT_HARMONICS, GaitPhase, Harmonics, strongest_line};
pub use poses::frame_grid;
use poses::{Constant, Linkage, Tracked};
use signals::JointSignal;

/// Used cycles below which a trial has no means.
const LEAST_USED_CYCLES: usize = 2;

/// What a folder amounts to: `trials.parquet`, `checks.parquet` and `robot_parameters.parquet`,
/// in the order of the list.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Ingested {
    pub trials: Vec<TrialRow>,
    pub checks: Vec<CheckRow>,
    /// Of the trials that are not of kind `gait`.
    pub parameters: Vec<RobotParameterRow>,
}

/// All that is computed of one trial; nothing of it is written yet.
#[derive(Debug, Clone, PartialEq)]
pub struct ProcessedTrial {
    pub row: TrialRow,
    pub checks: Vec<CheckRow>,
    /// Missing for trials of kind `gait`.
    pub parameters: Option<RobotParameterRow>,
    /// Empty for trials that are not of kind `gait`.
    pub cycles: Vec<CycleRow>,
    /// `poses/<trial>.parquet`.
    pub poses: Table,
    /// `wheels/<trial>.parquet`.
    pub wheels: Table,
}

/// Computes one trial of a folder and writes nothing.
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
/// The entry of the list, the marker file or what it shows cannot be used.
pub fn process_trial(
    folder: &Path,
    trial: &Trial,
    config: &Config,
) -> Result<ProcessedTrial, TrialFailure> {
    process_file(folder, trial, config, &mut Known::new(trial))
}

/// One trial of a folder with its checks. Writes nothing.
pub fn check_trial(folder: &Path, trial: &Trial, config: &Config) -> (TrialRow, Vec<CheckRow>) {
    let mut known = Known::new(trial);
    match process_file(folder, trial, config, &mut known) {
        Ok(processed) => (processed.row, processed.checks),
        Err(failure) => known.failed(&failure),
    }
}

/// What is known of a trial, also of one that fails later on.
struct Known {
    row: TrialRow,
    findings: Vec<Finding>,
}

impl Known {
    fn new(trial: &Trial) -> Self {
        Self { row: summary::blank_row(trial), findings: Vec::new() }
    }

    /// The row of a trial that fails, without metrics but with all else that was measured, and its
    /// checks: the reason, and those that were made before it.
    fn failed(self, failure: &TrialFailure) -> (TrialRow, Vec<CheckRow>) {
        let message = failure.to_string();
        let reason = Finding::new(Check::Failed, false, f64::NAN, f64::NAN, message.clone());
        let findings = std::iter::once(&reason).chain(&self.findings);
        let checks = findings.map(|finding| finding.row(&self.row.trial)).collect();
        let row = TrialRow {
            cycles: 0,
            metrics: GaitMetrics::MISSING,
            metrics_se: GaitMetrics::MISSING,
            sigma_debiased: [Estimate::MISSING; 3],
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
    known: &mut Known,
) -> Result<ProcessedTrial, TrialFailure> {
    let input = IngestInput::new(config, trial)?;
    let path = folder.join(&trial.file);
    process(&path, trilink_mocap::read_file(&path)?.0, trial, &input, known)
}

/// The stage itself, from a marker file's bytes to a trial's tables. What is found on the way is
/// added to what is `known`. A check that is beyond what a trial can have is the reason for a
/// failure before anything that follows from it.
fn process(
    path: &Path,
    bytes: impl AsRef<[u8]>,
    trial: &Trial,
    input: &IngestInput,
    known: &mut Known,
) -> Result<ProcessedTrial, TrialFailure> {
    let Vicon { unit, ignore, .. } = &input.settings.vicon;
    let file = trilink_mocap::parse_markers(path, bytes.as_ref(), *unit)?.without(ignore);
    // Of a long recording that is a gigabyte.
    drop(bytes);
    let processed = process_recording(file, trial, input, known);
    stop_beyond_limits(&known.findings).and(processed).map_err(|problem| problem.of(path))
}

/// Fails a trial that a check has found beyond what a trial can have.
fn stop_beyond_limits(findings: &[Finding]) -> Result<(), Problem> {
    let beyond = findings.iter().filter(|finding| finding.severity == Severity::Error);
    let beyond: Vec<String> = beyond.map(Finding::to_string).collect();
    match beyond.is_empty() {
        true => Ok(()),
        false => Err(Problem::BeyondLimits { checks: beyond.join("; ") }),
    }
}

/// [`process`] of the markers of a trial.
fn process_recording(
    mut file: Recording,
    trial: &Trial,
    input: &IngestInput,
    Known { row, findings }: &mut Known,
) -> Result<ProcessedTrial, Problem> {
    let (robot, gait, settings) = (&input.robot(), input.command(trial), &input.settings);
    let IngestSettings { ingest, markers, .. } = settings;
    let rate_hz = settings.frame_rate(&file)?;
    let layout = layout::locate(markers, &file)?;
    diagnosis::check_layout(&file, &layout)?;
    let linkage = Linkage::of(robot);
    let max_gap = settings.max_gap_frames(rate_hz);
    let solve = |file: &Recording, steady: Range<usize>| {
        poses::solve(file, &layout, Some(linkage), ingest.poses, rate_hz, steady)
    };
    let look_at = |file: &Recording, tracked: &Tracked, frames: &Range<usize>| {
        let mut found = poses::tracking_checks(tracked, file, &layout, settings, frames);
        found.extend(diagnosis::check_linkage(&linkage, &tracked.constant));
        found
    };
    // How bad it is what is constant over the trial.
    let severity = |constant: &Constant| {
        let checks = [poses::tilt_check(&constant.tilt)].into_iter();
        let checks = checks.chain(diagnosis::check_linkage(&linkage, constant));
        checks.filter(|found| !found.holds()).map(|found| found.severity).max()
    };
    let poses = solve(&file, 0..file.frames.len())?;
    if gait.is_none() || severity(&poses.constant).is_none() {
        // Of a long recording they are a gigabyte.
        file.forget_positions();
    }
    let mut tracked = poses.over_time(&file.frames, &layout, max_gap)?;
    *findings = look_at(&file, &tracked, &(0..tracked.frames()));
    // Frames whose joints tell the gait.
    let mut on_the_clock = 0..tracked.frames();
    if let Some(command) = &gait
        && findings.iter().any(|found| !found.holds())
        && let Ok(frames) = frames_in_use(trial, input, command, &tracked, rate_hz)
    {
        if severity(&tracked.constant).is_some() {
            // The robot may have been lifted before or after.
            let row_of = |frame: usize| tracked.recorded_frames.partition_point(|&of| of < frame);
            let poses = solve(&file, row_of(frames.start)..row_of(frames.end))?;
            if severity(&poses.constant) < severity(&tracked.constant) {
                tracked = poses.over_time(&file.frames, &layout, max_gap)?;
            }
        }
        *findings = look_at(&file, &tracked, &frames);
        on_the_clock = tracked.on_one_clock(&frames);
    }
    poses::describe_tracking(row, &tracked);
    file.forget_positions();
    stop_beyond_limits(findings)?;

    let skip_cycles = ingest.skip_cycles;
    let measure = |command: &(Gait, f64)| {
        let (driven, gait) =
            (measure_phase(command, &tracked, on_the_clock, rate_hz, skip_cycles)?, &command.0);
        let phi_rad = &tracked.seen.phi_rad;
        row.omega_rad_s = driven.omega_rad_s;
        row.gait = summary::joint_gaits(phi_rad, &driven.moving, &driven.phase);
        // Before cycles are looked for that show the commanded gait.
        let found = diagnosis::check_gait(row.gait.map(|joint| joint.command()), gait);
        findings.extend(Some(found).filter(|found| found.severity == Severity::Error));
        stop_beyond_limits(findings)?;
        Ok(driven)
    };
    let driven = gait.as_ref().map(measure).transpose()?;
    let window = smoothing_window(trial, ingest.smoothing_window, &tracked, driven.as_ref());
    let motion = Motion::of(robot, &tracked, window, rate_hz);

    row.smoothing_window = window as i64;
    let mut cycle_rows = Vec::new();
    if let (Some((gait, _)), Some(driven)) = (&gait, &driven) {
        let raw_wheels = wheel_velocities(robot, &tracked.filled, rate_hz);
        let data = motion.cycle_data(robot, gait, driven, &tracked, &raw_wheels, rate_hz);
        let (cycles, steady) = steady_cycles(&data, skip_cycles)?;
        // What every trial is checked for goes first.
        if let Some(frames) = checked_frames(&data, &cycles, &steady) {
            *findings = look_at(&file, &tracked, &frames);
            stop_beyond_limits(findings)?;
        }
        summary::describe_gait(row, &data, &cycles, &steady);
        findings.extend(summary::gait_checks(row, &data, &cycles, &steady));
        cycle_rows = summary::cycle_rows(trial, &cycles, &steady, rate_hz);
    }
    let measured = match trial.kind {
        TrialKind::Gait => None,
        TrialKind::JointRelease => Some(release::measure(robot, &tracked.seen, rate_hz)?),
        TrialKind::CoastDown => {
            Some(coast::measure(robot, &tracked.seen, &motion.wheels.roll_m_s[0], rate_hz)?)
        }
    };
    let parameters = measured.map(|(parameters, found)| {
        findings.extend(found);
        findings.push(against_configured(&parameters));
        RobotParameterRow {
            trial: trial.id.clone(),
            kind: trial.kind,
            robot: trial.robot.clone().unwrap_or_default(),
            ..parameters
        }
    });
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
        }
        .into_table(&trial.id),
        poses: tables::poses(&trial.id, tracked, motion.smooth, markers, rate_hz),
    })
}

/// Frequency and phase of a commanded gait, from the joints in some frames.
fn measure_phase(
    (gait, omega_rad_s): &(Gait, f64),
    tracked: &Tracked,
    frames: Range<usize>,
    rate_hz: f64,
    skip_cycles: usize,
) -> Result<GaitPhase, Problem> {
    let command = CommandedGait { gait, omega_rad_s: *omega_rad_s, rate_hz, skip_cycles };
    let phi_rad = &tracked.seen.phi_rad;
    diagnosis::check_swing(&command, phi_rad)?;
    if frames == (0..tracked.frames()) {
        return command.estimate_phase(phi_rad);
    }
    let mut phi_rad = phi_rad.clone();
    for phi_rad in &mut phi_rad {
        phi_rad[..frames.start].fill(f64::NAN);
        phi_rad[frames.end..].fill(f64::NAN);
    }
    command.estimate_phase(&phi_rad)
}

/// What follows from the coordinates: smoothed, and the wheels' velocities.
struct Motion {
    smooth: Coordinates,
    wheels: WheelVelocities,
}

impl Motion {
    fn of(robot: &Robot, tracked: &Tracked, window: usize, rate_hz: f64) -> Self {
        let smooth = tracked.filled.map(|series| signals::moving_average(series, window));
        let wheels = wheel_velocities(robot, &smooth, rate_hz);
        Self { smooth, wheels }
    }

    fn cycle_data<'m>(
        &'m self,
        robot: &'m Robot,
        gait: &'m Gait,
        driven: &'m GaitPhase,
        tracked: &'m Tracked,
        raw_wheels: &'m WheelVelocities,
        rate_hz: f64,
    ) -> CycleData<'m> {
        let Self { smooth, wheels } = self;
        CycleData { robot, gait, driven, tracked, raw_wheels, rate_hz, smooth, wheels }
    }
}

/// The cycles, and which of them count.
///
/// # Errors
/// Too few do.
fn steady_cycles(data: &CycleData, skip_cycles: usize) -> Result<(Vec<Cycle>, Steady), Problem> {
    let cycles = data.cycles();
    let steady = steady::steady(&cycles, skip_cycles);
    match steady.used.len() < LEAST_USED_CYCLES {
        true => Err(Problem::TooFewCycles {
            whole: cycles.len(),
            skipped: steady.skipped,
            usable: steady.used.len(),
            needed: LEAST_USED_CYCLES,
        }),
        false => Ok((cycles, steady)),
    }
}

/// The frames that the checks of a trial look at ([`Steady::span`]), with all from the end of the skipped cycles
/// on: rows that are missing there may shift the phase so that a cycle more is skipped.
fn checked_frames(data: &CycleData, cycles: &[Cycle], steady: &Steady) -> Option<Range<usize>> {
    let GaitPhase { phase, moving, .. } = data.driven;
    let skipped = steady.skip as f64 * std::f64::consts::TAU / phase.step_rad;
    let span = steady.span(cycles)?;
    Some(span.start.min(moving.start + skipped.ceil() as usize)..span.end)
}

/// The same at a first look.
fn frames_in_use(
    trial: &Trial,
    input: &IngestInput,
    command: &(Gait, f64),
    tracked: &Tracked,
    rate_hz: f64,
) -> Result<Range<usize>, Problem> {
    let (robot, ingest) = (&input.robot(), &input.settings.ingest);
    let all = 0..tracked.frames();
    let driven = measure_phase(command, tracked, all.clone(), rate_hz, ingest.skip_cycles)?;
    let window = smoothing_window(trial, ingest.smoothing_window, tracked, Some(&driven));
    let motion = Motion::of(robot, tracked, window, rate_hz);
    let raw_wheels = wheel_velocities(robot, &tracked.filled, rate_hz);
    let data = motion.cycle_data(robot, &command.0, &driven, tracked, &raw_wheels, rate_hz);
    let (cycles, steady) = steady_cycles(&data, ingest.skip_cycles)?;
    Ok(checked_frames(&data, &cycles, &steady).unwrap_or(all))
}

/// Width of the moving average, samples: the trial's own, the configured one, or the one with
/// the smallest expected error.
fn smoothing_window(
    trial: &Trial,
    configured: Smoothing,
    tracked: &Tracked,
    driven: Option<&GaitPhase>,
) -> usize {
    match (trial.smoothing_window, configured, driven) {
        (Some(window), _, _) | (None, Smoothing::Window(window), _) => window,
        (None, Smoothing::Auto, None) => signals::WINDOW_WITHOUT_GAIT,
        (None, Smoothing::Auto, Some(GaitPhase { phase, moving, .. })) => {
            let joints = tracked.seen.phi_rad.each_ref().map(|phi_rad| {
                let fit = Harmonics::fit(phi_rad, moving.clone(), phase, GAIT_HARMONICS);
                let amplitudes = |fit: Harmonics| (1..=3).map(|k| fit.amplitude(k)).collect();
                JointSignal {
                    noise_rad: signals::noise(phi_rad),
                    harmonics_rad: fit.map_or(Vec::new(), amplitudes),
                }
            });
            signals::best_window(&joints, phase.step_rad)
        }
    }
}
