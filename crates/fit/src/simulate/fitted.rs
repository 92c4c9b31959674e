//! Setups with fitted instead of configured coefficients.

use std::path::PathBuf;

use serde::Serialize;
use trilink_mechanics::Problem;
use trilink_robot::{AnyRobot, Model, Parameter};
use trilink_tables::config::{Config, GaitInput, RobotConfig};
use trilink_tables::{
    BootstrapRow, ComparisonRow, Extrapolation, FitRow, Misfit, NoInterval, NoIntervalReason,
    Reader, StoreError,
};

use super::SetupError;
use super::settings::campaign_of;
use crate::{Alternatives, FitData, FitInput, KnownFit, MeasuredRange, PredictionBands, preferred};

/// Maximum relative difference of a coefficient from its fitted value for the two to count as equal.
const TOLERANCE: f64 = 1e-9;

/// Fits stored in the tables of `derived/`.
#[derive(Debug, Clone)]
pub struct KnownFits {
    path: PathBuf,
    fits: Vec<FitRow>,
    alternatives: Vec<FitRow>,
    bootstrap: Vec<BootstrapRow>,
    /// Data that the models were fitted to: only the table of trials, or all tables if [`KnownFits::read`] was called
    /// with `bands`.
    pub data: FitData,
    /// Reason why the table of trials is missing; empty if it is not missing.
    without_trials: String,
}

/// Summary of the fit that provides the coefficients for a simulation.
#[derive(Debug, Clone, Serialize)]
pub struct FitSummary {
    pub free: Vec<Parameter>,
    /// Gait that drove the model in the fit; the simulation always follows the commanded gait.
    pub fitted_gait: GaitInput,
    /// Whether the model is adequate; null if unknown.
    pub adequate: Option<bool>,
    /// Pattern of the residuals of an inadequate model.
    pub misfit: Option<Misfit>,
    /// Coefficients that ended at a bound.
    pub at_bound: Vec<Parameter>,
    /// Coefficients that are practically not identifiable.
    pub practically_not: Vec<Parameter>,
    /// Coefficients that are structurally not identifiable.
    pub structurally_not: Vec<Parameter>,
}

impl FitSummary {
    pub fn new(row: &FitRow) -> Self {
        Self {
            free: row.free.clone(),
            fitted_gait: row.gait_input,
            adequate: row.adequate,
            misfit: row.misfit.clone(),
            at_bound: row.at_bound.clone(),
            practically_not: row.practically_not.clone(),
            structurally_not: row.structurally_not.clone(),
        }
    }

    /// Returns warnings about the fit, separated by semicolons; empty if there are none.
    pub fn caution(&self) -> String {
        let mut warnings = Vec::new();
        let misfit = self.misfit.as_ref().map_or(String::new(), |misfit| format!(": {misfit}"));
        match self.adequate {
            Some(true) => {}
            Some(false) => warnings.push(format!("the model does not fit the trials{misfit}")),
            None => {
                warnings.push(format!("it is not known whether the model fits the trials{misfit}"));
            }
        }
        for (parameters, problem) in [
            (&self.at_bound, "fitted values at a bound"),
            (&self.practically_not, "practically not identifiable"),
            (&self.structurally_not, "structurally not identifiable"),
        ] {
            if !parameters.is_empty() {
                let names: Vec<&str> = parameters.iter().map(|one| one.name()).collect();
                warnings.push(format!("{problem}: {}", names.join(", ")));
            }
        }
        warnings.join("; ")
    }
}

impl KnownFits {
    /// Reads the tables of the fits; with `bands`, also the tables needed for confidence bands of predictions.
    ///
    /// # Errors
    /// Returns an error if a table is missing or cannot be read. Without `bands`, the table of trials may be missing.
    pub fn read(config: &Config, bands: bool) -> Result<Self, SetupError> {
        let derived = &config.paths.derived;
        let reader = Reader::default();
        let path = derived.join("fits.parquet");
        let fits = reader.rows(&path).map_err(|error| {
            SetupError::Table(if error.is_not_there() {
                format!(
                    "{}: does not exist; `trilink run` or `trilink fit` creates it",
                    path.display()
                )
            } else {
                error.to_string()
            })
        })?;
        let mut alternatives = Vec::new();
        let mut bootstrap = Vec::new();
        let mut data = FitData::default();
        let mut without_trials = String::new();
        let unreadable = |error: StoreError| SetupError::Table(error.to_string());
        if bands {
            alternatives =
                reader.rows(&derived.join("alternative_fits.parquet")).map_err(unreadable)?;
            bootstrap = reader.rows(&derived.join("bootstrap.parquet")).map_err(unreadable)?;
            data = FitData::read(derived, &reader).map_err(unreadable)?;
        } else {
            let trials = derived.join("trials.parquet");
            match reader.rows_if_there(&trials).map_err(unreadable)? {
                Some(rows) => data.trials = rows,
                None => without_trials = format!("{} does not exist", trials.display()),
            }
        }
        Ok(Self { path, fits, alternatives, bootstrap, data, without_trials })
    }

    /// Returns the preferred model of a campaign.
    ///
    /// # Errors
    /// Returns an error if the comparison table is missing or has no fit for the campaign, or if the trials do not
    /// discriminate between several models.
    pub fn preferred(&self, campaign: &str) -> Result<Model, SetupError> {
        let path = self.path.with_file_name("comparison.parquet");
        let rows: Vec<ComparisonRow> =
            Reader::default().rows(&path).map_err(|error| format!("--model: {error}"))?;
        let rows: Vec<ComparisonRow> =
            rows.into_iter().filter(|row| row.campaign == campaign).collect();
        match preferred(&rows)[..] {
            [] => Err(format!(
                "--model: this option is required, because {} contains no fit of campaign {campaign}",
                path.display()
            )
            .into()),
            [model] => Ok(model),
            [first, ref others @ ..] => {
                let others: Vec<&str> = others.iter().map(|model| model.name()).collect();
                Err(format!(
                    "--model: this option is required, with one of {first}, {}, because the trials of campaign \
                     {campaign} do not discriminate between these models",
                    others.join(", ")
                )
                .into())
            }
        }
    }

    /// Returns the range of frequencies and gaits covered by the fitted trials.
    ///
    /// # Errors
    /// Returns a message if that range is unknown.
    pub fn measured_range(&self, fit: &FitRow, input: &FitInput) -> Result<MeasuredRange, String> {
        if !self.without_trials.is_empty() {
            return Err(self.without_trials.clone());
        }
        let measurements = input.measurements(&self.data);
        if measurements.len() as i64 != fit.trials {
            return Err(format!(
                "the trials are not those of the fit: {} trials were fitted, but {} were found",
                fit.trials,
                measurements.len()
            ));
        }
        let (robot, gait) = input.setup();
        MeasuredRange::new(&measurements, &robot, &gait)
            .ok_or_else(|| "the fit is not based on any trial".to_owned())
    }

    /// Returns the fit of a model to a campaign.
    ///
    /// # Errors
    /// Returns an error if there is no such fit or the fit failed.
    pub fn get(&self, campaign: &str, model: Model) -> Result<KnownFit, SetupError> {
        let is_own = |row: &&FitRow| row.campaign == campaign && row.model == model;
        let path = self.path.display();
        let row = self.fits.iter().find(is_own).cloned().ok_or_else(|| {
            let models = self.fits.iter().filter(|row| row.campaign == campaign);
            let models: Vec<&str> = models.map(|row| row.model.name()).collect();
            let known = if models.is_empty() {
                format!("{path} contains no fit of campaign {campaign}")
            } else {
                let models = models.join(", ");
                format!(
                    "{path} contains no fit of {model} to campaign {campaign}, only of {models}"
                )
            };
            format!("{known}; list {model} under campaign.{campaign}.models and run `trilink fit`")
        })?;
        if !row.status.is_ok() {
            return Err(format!("{path}: {campaign} {model}: {}", row.failure).into());
        }
        let alternative = self.alternatives.iter().find(is_own).cloned();
        let replicates =
            self.bootstrap.iter().filter(|row| row.campaign == campaign && row.model == model);
        Ok(KnownFit { row, alternative, replicates: replicates.cloned().collect() })
    }
}

/// Returns whether a parameter of a robot differs from its fitted value.
fn differs_from_fit(parameter: Parameter, robot: &AnyRobot, fit: &FitRow) -> bool {
    let fitted = fit.parameters[parameter];
    (robot.value(parameter) - fitted).abs() > TOLERANCE * fitted.abs()
}

/// Returns warnings, by model, about models and robots that use configured coefficients (starting values for fits) although their
/// campaign has been fitted. Coefficients that were changed by settings are not reported.
pub fn starting_values(
    config: &Config,
    campaign: &str,
    setups: &[(Model, AnyRobot)],
) -> Vec<(Model, String)> {
    let path = config.paths.derived.join("fits.parquet");
    // An unreadable table is not an error here, because the simulation does not need it.
    let mut fits: Vec<FitRow> = Reader::default().rows(&path).unwrap_or_default();
    fits.retain(|row| row.campaign == campaign && row.status.is_ok());
    let Some((first, _)) = setups.first() else { return Vec::new() };
    let Some(input) = FitInput::new(config, campaign, *first) else { return Vec::new() };
    let configured = input.setup().0;
    let path = path.display();
    let warnings = setups.iter().filter_map(|(model, robot)| {
        let (mut parameters, hint) = match fits.iter().find(|row| row.model == *model) {
            Some(fit) => {
                let mut differing = fit.free.clone();
                differing.retain(|parameter| differs_from_fit(*parameter, robot, fit));
                (differing, format!("--fitted takes the fit in {path}"))
            }
            None if fits.is_empty() => return None,
            None => {
                let models: Vec<&str> = fits.iter().map(|row| row.model.name()).collect();
                let free = FitInput::new(config, campaign, *model)?.free();
                let free = free.into_iter().map(|of| of.parameter).collect();
                (
                    free,
                    format!("{path} contains fits of {}, but none of {model}", models.join(", ")),
                )
            }
        };
        parameters.retain(|parameter| robot.value(*parameter) == configured.value(*parameter));
        if parameters.is_empty() {
            return None;
        }
        let names: Vec<&str> = parameters.iter().map(|parameter| parameter.name()).collect();
        let names = names.join(", ");
        let warning = format!("starting values, not fitted: {names}; {hint}");
        Some((*model, warning))
    });
    warnings.collect()
}

/// Fit that provides the coefficients of a setup.
#[derive(Debug, Clone)]
pub(super) struct FittedSetup {
    known: KnownFit,
    input: FitInput,
    pub summary: FitSummary,
    /// Range covered by the fitted trials, or the reason why it is unknown.
    range: Result<MeasuredRange, String>,
}

impl FittedSetup {
    pub(super) fn new(
        config: &Config,
        campaign: &str,
        model: Model,
        fits: &KnownFits,
    ) -> Result<Self, SetupError> {
        let known = fits.get(campaign, model)?;
        let input = FitInput::new(config, campaign, model);
        let input = input.ok_or_else(|| "no such campaign or model".to_owned())?;
        let range = fits.measured_range(&known.row, &input);
        Ok(Self { summary: FitSummary::new(&known.row), known, input, range })
    }

    /// Returns the configuration with the fitted coefficients of the model inserted.
    pub(super) fn apply_to(
        &self,
        mut config: Config,
        campaign: &str,
    ) -> Result<Config, SetupError> {
        let name = campaign_of(&config, campaign)?.robot;
        let robot = config.robot.get_mut(&name).and_then(RobotConfig::three_links_mut);
        let robot = robot.ok_or_else(|| "no such robot of three links".to_owned())?;
        let mut fitted = robot.to_robot();
        for (parameter, value) in self.known.row.parameters.iter() {
            if !parameter.is_sum() && value.is_finite() {
                parameter.set(&mut fitted, *value);
            }
        }
        robot.set_coefficients(&fitted);
        Ok(config)
    }

    /// Returns the fitted coefficients, in SI units.
    pub(super) fn coefficients(&self) -> impl Iterator<Item = (Parameter, f64)> {
        let parameters = self.known.row.parameters.iter().map(|(of, value)| (of, *value));
        parameters.filter(|(_, value)| value.is_finite())
    }

    /// Returns the range covered by the fitted trials, or the reason why it is unknown.
    pub(super) fn range(&self) -> Result<&MeasuredRange, &str> {
        self.range.as_ref().map_err(String::as_str)
    }

    /// Returns whether a problem lies outside the range of the fitted trials.
    pub(super) fn extrapolation(&self, problem: &Problem) -> Extrapolation {
        match self.range() {
            Ok(range) => range.extrapolation(problem),
            Err(why) => {
                Extrapolation { extrapolated: None, beyond_trials: format!("not known: {why}") }
            }
        }
    }

    /// Returns copies of a robot with the coefficients of refits; see [`Setup::alternatives`](super::Setup::alternatives).
    pub(super) fn alternatives(
        &self,
        robot: &AnyRobot,
        data: &FitData,
        max_replicates: usize,
    ) -> Result<Alternatives, NoInterval> {
        self.with_bands(robot, data, |bands| bands.alternatives(robot, max_replicates))
    }

    /// Returns the coefficients that are known from other kinds of trials.
    pub(super) fn measured(&self) -> &[Parameter] {
        &self.known.row.measured
    }

    /// Calls `task` with the confidence bands for predictions with the fitted coefficients, which a robot must have.
    ///
    /// # Errors
    /// Returns the reason if there are no bands, for example because a setting overrides a fitted coefficient.
    pub(super) fn with_bands<T>(
        &self,
        robot: &AnyRobot,
        data: &FitData,
        task: impl FnOnce(&PredictionBands) -> T,
    ) -> Result<T, NoInterval> {
        let row = &self.known.row;
        let replaced = row.free.iter().find(|parameter| differs_from_fit(**parameter, robot, row));
        if let Some(parameter) = replaced {
            return Err(NoInterval::new(NoIntervalReason::ParameterSet, parameter.name()));
        }
        self.known.with_bands(&self.input, data, task)
    }
}
