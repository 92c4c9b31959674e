//! Fitted coefficients instead of the configured ones.

use std::path::PathBuf;

use serde::Serialize;
use trilink_robot::{Model, Parameter, Robot};
use trilink_tables::config::{Config, GaitInput};
use trilink_tables::{
    BootstrapRow, ComparisonRow, FitRow, Misfit, NoInterval, NoIntervalReason, Reader, StoreError,
};

use super::settings::campaign_of;
use super::{Setup, SetupError};
use crate::{FitData, FitInput, KnownFit, MeasuredRange, PredictionBands, preferred};

/// Relative difference of a coefficient from a fitted one that is none.
const SAME_VALUE: f64 = 1e-9;

/// The fits that the configuration's tables have.
#[derive(Debug, Clone)]
pub struct KnownFits {
    path: PathBuf,
    fits: Vec<FitRow>,
    alternatives: Vec<FitRow>,
    bootstrap: Vec<BootstrapRow>,
    /// What was fitted: the trials, and with bands all of it.
    pub data: FitData,
    /// Why the trials are not there; empty where they are.
    without_trials: String,
}

/// What an answer says of the fit that its coefficients are from.
#[derive(Debug, Clone, Serialize)]
pub struct FitSummary {
    pub free: Vec<Parameter>,
    /// The gait that drove the fit; the motion is that of the commanded one.
    pub fitted_gait: GaitInput,
    /// Whether the model fits; null where nothing tells.
    pub adequate: Option<bool>,
    /// Where and to which side the measurements are off an inadequate model.
    pub misfit: Option<Misfit>,
    /// Coefficients that ended at a bound, and that the trials do not tell.
    pub at_bound: Vec<Parameter>,
    pub practically_not: Vec<Parameter>,
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

    /// What is to be known before one believes it, in sentences; empty where all is well.
    pub fn caution(&self) -> String {
        let mut said = Vec::new();
        let misfit = self.misfit.as_ref().map_or(String::new(), |misfit| format!(": {misfit}"));
        match self.adequate {
            Some(true) => {}
            Some(false) => said.push(format!("the model does not fit its trials{misfit}")),
            None => said.push(format!("nothing tells whether the model fits its trials{misfit}")),
        }
        for (of, what) in [
            (&self.at_bound, "ended at a bound"),
            (&self.practically_not, "hardly told by the trials"),
            (&self.structurally_not, "not told by the trials"),
        ] {
            if !of.is_empty() {
                let names: Vec<&str> = of.iter().map(|one| one.name()).collect();
                said.push(format!("{what}: {}", names.join(", ")));
            }
        }
        said.join("; ")
    }
}

impl KnownFits {
    /// Reads the tables, and with `bands` what tells how far predictions may be off.
    ///
    /// # Errors
    /// There are none, or they cannot be read.
    pub fn read(config: &Config, bands: bool) -> Result<Self, SetupError> {
        let (derived, reader) = (&config.paths.derived, Reader::default());
        let path = derived.join("fits.parquet");
        let wrong = |error: StoreError| match error.is_not_there() {
            true => {
                format!("{}: not there; `trilink run` or `trilink fit` makes it", path.display())
            }
            false => error.to_string(),
        };
        let fits = reader.rows(&path).map_err(wrong)?;
        let (mut alternatives, mut bootstrap, mut data) =
            (Vec::new(), Vec::new(), FitData::default());
        let mut without_trials = String::new();
        let wrong = |error: StoreError| error.to_string();
        if bands {
            alternatives = reader.rows(&derived.join("alternative_fits.parquet")).map_err(wrong)?;
            bootstrap = reader.rows(&derived.join("bootstrap.parquet")).map_err(wrong)?;
            data = FitData::read(derived, &reader).map_err(wrong)?;
        } else {
            let trials = derived.join("trials.parquet");
            match reader.rows_if_there(&trials).map_err(wrong)? {
                Some(rows) => data.trials = rows,
                None => without_trials = format!("{} is not there", trials.display()),
            }
        }
        Ok(Self { path, fits, alternatives, bootstrap, data, without_trials })
    }

    /// The model that the comparison of a campaign's fits prefers.
    ///
    /// # Errors
    /// There is no such table, no fit in it, or the model is not told apart from others.
    pub fn preferred(&self, campaign: &str) -> Result<Model, SetupError> {
        let path = self.path.with_file_name("comparison.parquet");
        let rows: Vec<ComparisonRow> =
            Reader::default().rows(&path).map_err(|error| format!("--model: {error}"))?;
        let rows: Vec<ComparisonRow> =
            rows.into_iter().filter(|row| row.campaign == campaign).collect();
        match preferred(&rows)[..] {
            [] => Err(format!(
                "--model: needed: {} has no fit of campaign {campaign}",
                path.display()
            )
            .into()),
            [model] => Ok(model),
            [first, ref others @ ..] => {
                let others: Vec<&str> = others.iter().map(|model| model.name()).collect();
                Err(format!(
                    "--model: needed one of {first}, {}: the trials of campaign {campaign} do not tell \
                     them apart",
                    others.join(", ")
                )
                .into())
            }
        }
    }

    /// What the trials of a fit cover.
    ///
    /// # Errors
    /// A sentence on why that is not known.
    pub fn measured_range(&self, fit: &FitRow, input: &FitInput) -> Result<MeasuredRange, String> {
        if !self.without_trials.is_empty() {
            return Err(self.without_trials.clone());
        }
        let measurements = input.measurements(&self.data);
        if measurements.len() as i64 != fit.trials {
            return Err(format!(
                "the trials are not those of the fit: it is of {}, found {}",
                fit.trials,
                measurements.len()
            ));
        }
        MeasuredRange::new(&measurements, &input.gait.value.to_gait())
            .ok_or_else(|| "the fit is of no trial".to_owned())
    }

    /// The fit of a model to a campaign.
    ///
    /// # Errors
    /// There is none, or it has failed.
    pub fn of(&self, campaign: &str, model: Model) -> Result<KnownFit, SetupError> {
        let is_own = |row: &&FitRow| row.campaign == campaign && row.model == model;
        let found = self.fits.iter().find(is_own).cloned();
        let path = self.path.display();
        let row = found.ok_or_else(|| {
            let models = self.fits.iter().filter(|row| row.campaign == campaign);
            let models: Vec<&str> = models.map(|row| row.model.name()).collect();
            let known = match models.is_empty() {
                true => format!("{path} has no fit of campaign {campaign}"),
                false => {
                    format!("{path} has of campaign {campaign} the models {}", models.join(", "))
                }
            };
            format!("{known}; list {model} under campaign.{campaign}.models and run `trilink fit`")
        })?;
        if !row.status.is_ok() {
            return Err(format!("{path}: {campaign} {model}: {}", row.status).into());
        }
        let alternative = self.alternatives.iter().find(is_own).cloned();
        let is_own = |row: &&BootstrapRow| row.campaign == campaign && row.model == model;
        Ok(KnownFit {
            row,
            alternative,
            replicates: self.bootstrap.iter().filter(is_own).cloned().collect(),
        })
    }
}

/// Whether a robot's parameter differs from its fitted value.
fn is_other(parameter: Parameter, robot: &Robot, fit: &FitRow) -> bool {
    let (own, fitted) = (parameter.of(robot), fit.parameters[parameter]);
    (own - fitted).abs() > SAME_VALUE * fitted.abs()
}

/// What is to be said of setups that have coefficients from the configuration though their campaign was
/// fitted, by model; nothing of coefficients that settings gave.
pub fn starting_values(config: &Config, campaign: &str, setups: &[Setup]) -> Vec<(Model, String)> {
    let path = config.paths.derived.join("fits.parquet");
    // Tables that cannot be used are no matter of a motion that needs none.
    let fits: Vec<FitRow> = Reader::default().rows(&path).unwrap_or_default();
    let fits = || fits.iter().filter(|row| row.campaign == campaign && row.status.is_ok());
    let Some((robot, _)) = config.campaign_setup(campaign) else { return Vec::new() };
    let configured = |free: &[Parameter], setup: &Setup| {
        let is_configured = |of: &&Parameter| of.of(&setup.robot) == of.of(&robot);
        let names = free.iter().filter(is_configured).map(|of| of.name());
        names.collect::<Vec<_>>().join(", ")
    };
    let path = path.display();
    let of_setup = |setup: &Setup| {
        let (names, what) = match fits().find(|row| row.model == setup.model) {
            Some(fit) => {
                let others = fit.free.iter().copied();
                let others: Vec<Parameter> =
                    others.filter(|of| is_other(*of, &setup.robot, fit)).collect();
                (configured(&others, setup), format!("--fitted takes those that {path} has"))
            }
            None => {
                let models: Vec<&str> = fits().map(|row| row.model.name()).collect();
                let free = FitInput::new(config, campaign, setup.model)?.free();
                let free: Vec<Parameter> = free.into_iter().map(|of| of.parameter).collect();
                let names =
                    if models.is_empty() { String::new() } else { configured(&free, setup) };
                let models = models.join(", ");
                (names, format!("{path} has fits of {models}, not of {}", setup.model))
            }
        };
        let said = format!("not fitted, but starting values of the configuration: {names}; {what}");
        (!names.is_empty()).then_some((setup.model, said))
    };
    setups.iter().filter_map(of_setup).collect()
}

/// A fit that a setup's coefficients are from.
#[derive(Debug, Clone)]
pub(super) struct FittedSetup {
    known: KnownFit,
    /// What the fit reads of the configuration.
    input: FitInput,
    pub summary: FitSummary,
    /// What its trials cover, or why that is not known.
    pub range: Result<MeasuredRange, String>,
}

impl FittedSetup {
    pub(super) fn new(
        config: &Config,
        campaign: &str,
        model: Model,
        fits: &KnownFits,
    ) -> Result<Self, SetupError> {
        let known = fits.of(campaign, model)?;
        let input = FitInput::new(config, campaign, model);
        let input = input.ok_or_else(|| "no such campaign or model".to_owned())?;
        let range = fits.measured_range(&known.row, &input);
        Ok(Self { summary: FitSummary::new(&known.row), known, input, range })
    }

    /// The configuration with the coefficients that the model knows as they were fitted.
    pub(super) fn configured(
        &self,
        mut config: Config,
        campaign: &str,
    ) -> Result<Config, SetupError> {
        let name = campaign_of(&config, campaign)?.robot;
        let robot = config.robot.get_mut(&name).ok_or_else(|| "no such robot".to_owned())?;
        let mut fitted = robot.to_robot();
        for (parameter, value) in self.known.row.parameters.iter() {
            if !parameter.is_sum() && value.is_finite() {
                parameter.set(&mut fitted, *value);
            }
        }
        robot.set_coefficients(&fitted);
        Ok(config)
    }

    /// Coefficients that trials of other kinds gave.
    pub(super) fn measured(&self) -> &[Parameter] {
        &self.known.row.measured
    }

    /// Does something with how far predictions of a setup with these coefficients may be off.
    pub(super) fn with_bands<T>(
        &self,
        setup: &Setup,
        data: &FitData,
        task: impl FnOnce(&PredictionBands) -> T,
    ) -> Result<T, NoInterval> {
        let row = &self.known.row;
        let is_other = |parameter: &&Parameter| is_other(**parameter, &setup.robot, row);
        if let Some(other) = row.free.iter().find(is_other) {
            return Err(NoInterval::of(NoIntervalReason::ParameterSet, other.name()));
        }
        self.known.with_bands(&self.input, data, task)
    }
}
