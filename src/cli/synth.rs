//! `trilink synth`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use trilink_robot::Model;
use trilink_synth::{Format, OMEGAS_RAD_S, Recipe, Servo, Slope, SynthError, synthesise};

use super::output::say;
use super::parse::{NumberList, parse_omegas, positive, within};
use super::{Context, Failure, Outcome};

/// Format of the marker files.
#[derive(Clone, Copy, clap::ValueEnum)]
enum FileFormat {
    /// Text, as exported by Vicon Nexus (`Trajectories`), with six significant digits.
    Csv,
    /// C3D with floating-point numbers.
    C3d,
    /// OptiTrack Motive CSV, in m with y up.
    Motive,
    /// TRC, as written by Cortex and OpenSim.
    Trc,
    /// Qualisys Track Manager TSV, 3D data.
    Qualisys,
    /// Vicon Tracker CSV (`Objects`): each link is a rigid body.
    Tracker,
    /// OptiTrack Motive CSV with rigid bodies instead of markers.
    MotiveBodies,
    /// Qualisys Track Manager TSV, 6D data (rigid bodies).
    #[value(name = "qualisys-6d")]
    Qualisys6d,
    /// CSV table of markers for any program, with one column per coordinate.
    Table,
    /// CSV table of rigid bodies for any program: positions and quaternions.
    Poses,
    /// Parquet table of rigid bodies for any program.
    PosesParquet,
}

/// Synthesise trials with known parameters, in the format of the camera system.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/synth.txt").trim_end())]
pub(super) struct Synth {
    /// Trial folder to write.
    folder: PathBuf,
    /// Random seed; the same seed gives identical files.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Seed of the measurement noise and of the variation between cycles; another seed gives further trials from the
    /// same laboratory [default: --seed].
    #[arg(long, value_name = "SEED")]
    noise_seed: Option<u64>,
    /// Model that generates the motion, named as a `[model.*]` table of pipeline.toml, for all robots or for one; the
    /// option may be given more than once [default: skid-roll].
    #[arg(long, value_name = "[ROBOT=]MODEL")]
    law: Vec<String>,
    /// Factors that multiply the true skid coefficients of wheels 0, 1, 2, to test whether `compare` detects the
    /// change.
    #[arg(long, value_name = "F0,F1,F2", value_parser = parse_factors)]
    skid_factors: Option<[f64; 3]>,
    /// Frequencies of every campaign, rad/s, such as `1,3.9` or `0.5..6/12`; the option may be given more than once
    /// [default: 0.5 to 6 in steps of 0.5, and 3.9].
    #[arg(long, allow_hyphen_values = true, value_parser = parse_omegas)]
    omega: Vec<NumberList>,
    /// Number of trials at each frequency, 1 to 99.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=99))]
    repeats: u8,
    /// Repeat only the trials at these frequencies, rad/s; the option may be given more than once.
    #[arg(long, value_name = "OMEGA", allow_hyphen_values = true, value_parser = parse_omegas)]
    repeat_omega: Vec<NumberList>,
    /// Number of days over which the trials are distributed in turn, 1 to 99; all friction changes by about 3 % from
    /// day to day.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=99))]
    days: u8,
    /// Time constant of the first-order lag of the servos, s; typically 0.02 for a hobby servo.
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = within(0.0, 1.0, " s"))]
    servo_lag: f64,
    /// Compliance of the servos, rad/(N m), such as 0.05.
    #[arg(long, value_name = "RAD_PER_NM", default_value_t = 0.0, value_parser = within(0.0, 1.0, " rad/(N m)"))]
    servo_compliance: f64,
    /// Relative standard deviation of all friction from cycle to cycle, 0 to 1.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0, value_parser = within(0.0, 1.0, ""))]
    friction_variation: f64,
    /// Relative standard deviation of all friction from trial to trial, 0 to 1.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0, value_parser = within(0.0, 1.0, ""))]
    trial_variation: f64,
    /// Number of trials of each campaign with 1.5 times the friction of the others.
    #[arg(long, value_name = "N", default_value_t = 0)]
    unlike: u8,
    /// Make robots that are off their configured values by errors drawn from the standard deviations in pipeline.toml;
    /// `truth.json` contains the true values.
    #[arg(long)]
    declared_errors: bool,
    /// Slope of the floor, 0 to 2 degrees, and the direction in which the floor rises, degrees from the x axis
    /// [default: 0], such as `0.3,45`. Each robot then coasts in four directions on this floor. Gaits stay on a level
    /// floor, because the equations of motion in the frame of the robot do not contain its heading.
    #[arg(long, value_name = "DEG[,DIRECTION]", value_parser = parse_slope)]
    slope: Option<Slope>,
    /// Format of the marker files.
    #[arg(long, value_enum, default_value_t = FileFormat::Csv)]
    format: FileFormat,
    /// Fraction of frames, 0 to 1, in which one marker is swapped with another of its link or jumps by 20 mm, for
    /// practice; `truth.json` lists these frames.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0, value_parser = within(0.0, 1.0, ""))]
    misplaced: f64,
}

impl Synth {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let Self { folder, seed, omega, .. } = self;
        let robots = context.config.campaign.values().map(|campaign| &campaign.robot);
        let mut laws = BTreeMap::new();
        for law in &self.law {
            match law.split_once('=') {
                Some((robot, model)) => drop(laws.insert(robot.to_owned(), Model::new(model))),
                None => laws.extend(robots.clone().map(|robot| (robot.clone(), Model::new(law)))),
            }
        }
        let recipe = Recipe {
            noise_seed: self.noise_seed,
            laws,
            skid_factors: self.skid_factors.unwrap_or([1.0; 3]),
            omegas_rad_s: if omega.is_empty() { OMEGAS_RAD_S.into() } else { omega.concat() },
            repeats: self.repeats.into(),
            repeated_rad_s: self.repeat_omega.concat(),
            days: self.days.into(),
            servo: Servo { lag_s: self.servo_lag, compliance_rad_nm: self.servo_compliance },
            declared_errors: self.declared_errors,
            slope: self.slope,
            friction_variation: self.friction_variation,
            trial_variation: self.trial_variation,
            unlike: self.unlike.into(),
            format: match self.format {
                FileFormat::Csv => Format::Csv,
                FileFormat::C3d => Format::C3d,
                FileFormat::Motive => Format::Motive,
                FileFormat::Trc => Format::Trc,
                FileFormat::Qualisys => Format::Qualisys,
                FileFormat::Tracker => Format::Tracker,
                FileFormat::MotiveBodies => Format::MotiveBodies,
                FileFormat::Qualisys6d => Format::Qualisys6d,
                FileFormat::Table => Format::Table,
                FileFormat::Poses => Format::Poses,
                FileFormat::PosesParquet => Format::PosesParquet,
            },
            misplaced: self.misplaced,
            ..Recipe::new(seed)
        };
        let trials = write_trials(&context, &folder, &recipe)?;
        say!("{trials} synthetic trials in {}", folder.display());
        Ok(Outcome::Well)
    }
}

/// Writes the trials of a recipe and returns the number of trials.
pub(super) fn write_trials(
    context: &Context,
    folder: &Path,
    recipe: &Recipe,
) -> Result<usize, Failure> {
    let stage = context.progress.stage("synth", recipe.trials(&context.config));
    let on_trial = |trial: &str| {
        stage.step(trial);
        context.cancel().check()
    };
    match synthesise(&context.config, folder, recipe, &on_trial) {
        Err(SynthError::Cancelled(_)) => Err(stage.interrupted("trials").into()),
        made => Ok(made?.len()),
    }
}

/// Parses a slope, degrees, and optionally the direction in which the floor rises, degrees.
fn parse_slope(text: &str) -> Result<Slope, String> {
    let needed = || {
        format!(
            "found `{text}`, needed a slope of 0 to 2 degrees and optionally a direction of -360 to 360 degrees, such \
             as 0.3,45"
        )
    };
    let (slope, direction) = text.split_once(',').unwrap_or((text, "0"));
    let [slope, direction] = [slope, direction].map(|part| part.trim().parse::<f64>().ok());
    let slope = slope.filter(|slope| (0.0..=2.0).contains(slope)).ok_or_else(needed)?;
    let direction = direction.filter(|direction| direction.abs() <= 360.0).ok_or_else(needed)?;
    Ok(Slope { slope_deg: slope, direction_deg: direction })
}

/// Parses three positive numbers that are separated by commas.
fn parse_factors(text: &str) -> Result<[f64; 3], String> {
    let needed = || format!("found `{text}`, needed three numbers above 0, such as 1,1.05,1");
    let factors: Option<Vec<f64>> = text.split(',').map(positive).collect();
    factors.and_then(|factors| factors.try_into().ok()).ok_or_else(needed)
}
