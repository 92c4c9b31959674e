//! A fit as a problem of PEtab, version 1: parameters, observables, conditions and measurements as
//! tables of tabs with a YAML file that names them.
//!
//! PEtab has its model in SBML; this program's is in no standard language, so a problem names none.
//! Residuals are of a Laplace distribution, whose scale of each measurement is such that the
//! negative logarithm of the likelihood is the objective (eq. 22) and a constant.
//!
//! Reference: L. Schmiester et al., *PEtab: Interoperable specification of parameter estimation
//! problems in systems biology*, PLOS Computational Biology 17 (2021) e1008646.

use std::path::{Path, PathBuf};

use trilink_fit::{FitData, FitInput, Measurement};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{JointCommand, Parameter};
use trilink_tables::config::{Config, GaitInput};
use trilink_tables::{FitRow, Reader, write_bytes};

use super::ExportError;

/// Of what a fit compares, the first of the metrics in their order.
const MEANINGS: [&str; 6] = [
    "displacement a cycle",
    "speed",
    "skid ratio of wheel 0",
    "skid ratio of wheel 1",
    "skid ratio of wheel 2",
    "amplitude of the passive joint",
];
const PARAMETERS: &str = "parameters.tsv";
const CONDITIONS: &str = "conditions.tsv";
const OBSERVABLES_FILE: &str = "observables.tsv";
const MEASUREMENTS: &str = "measurements.tsv";
const PROBLEM: &str = "problem.yaml";

/// Says what no file of PEtab can.
const README: &str = include_str!("petab.md");

/// Writes a problem for every model of every campaign that has measurements, each to
/// `folder/CAMPAIGN/MODEL`; gives their folders.
///
/// # Errors
/// The tables of trials and fits cannot be read, or a file cannot be written.
pub fn write_petab(config: &Config, folder: &Path) -> Result<Vec<PathBuf>, ExportError> {
    let (derived, reader) = (&config.paths.derived, Reader::default());
    let data = FitData::read(derived, &reader)?;
    let fits: Vec<FitRow> = reader.rows(&derived.join("fits.parquet"))?;
    let mut written = Vec::new();
    for input in FitInput::all(config) {
        let is_of =
            |fit: &&FitRow| fit.campaign == input.campaign.name && fit.model == input.model.name;
        let measurements = input.measurements(&data);
        let Some(fit) = fits.iter().find(is_of).filter(|_| !measurements.is_empty()) else {
            continue;
        };
        let home = folder.join(&input.campaign.name).join(input.model.name.name());
        for (name, text) in files(&input, fit, &measurements) {
            write_bytes(&home.join(name), text.as_bytes())?;
        }
        written.push(home);
    }
    if !written.is_empty() {
        write_bytes(&folder.join("README.md"), README.as_bytes())?;
    }
    Ok(written)
}

/// The files of one problem.
fn files(input: &FitInput, fit: &FitRow, trials: &[Measurement]) -> [(&'static str, String); 5] {
    [
        (PARAMETERS, parameters(input, fit)),
        (CONDITIONS, conditions(input, trials)),
        (OBSERVABLES_FILE, observables(input, trials)),
        (MEASUREMENTS, measurements(input, trials)),
        (PROBLEM, problem()),
    ]
}

fn problem() -> String {
    format!(
        "# The model is in no language that PEtab knows: `trilink` solves it. See README.md.\n\
         format_version: 1\n\
         parameter_file: {PARAMETERS}\n\
         problems:\n\
         - sbml_files: []\n  \
           condition_files:\n  - {CONDITIONS}\n  \
           observable_files:\n  - {OBSERVABLES_FILE}\n  \
           measurement_files:\n  - {MEASUREMENTS}\n"
    )
}

/// The free parameters with their bounds, and those that are held.
fn parameters(input: &FitInput, fit: &FitRow) -> String {
    let free = input.free();
    let header = ["parameterId", "parameterName", "parameterScale", "lowerBound", "upperBound"];
    let header = header.into_iter().chain(["nominalValue", "estimate"]).map(str::to_owned);
    let row = |parameter: Parameter| {
        let value = fit.parameters[parameter];
        let bounds = free.iter().find(|free| free.parameter == parameter).map(|free| free.bounds);
        // A fit without a result has no value.
        let value = match bounds {
            Some([low, high]) if value.is_nan() => (low * high).sqrt(),
            _ => value,
        };
        let [low, high] = bounds.unwrap_or([value, value]).map(|bound| bound.to_string());
        let (scale, estimate) = if bounds.is_some() { ("log10", "1") } else { ("lin", "0") };
        let (name, unit) = (parameter.name(), parameter.unit());
        let about = format!("{name}, {unit}");
        let cells = [name.to_owned(), about, scale.to_owned(), low, high, value.to_string()];
        (!value.is_nan()).then(|| cells.into_iter().chain([estimate.to_owned()]).collect())
    };
    table(header.collect(), Parameter::ALL.into_iter().filter_map(row))
}

/// The frequency of each trial, and the gait that drives it.
fn conditions(input: &FitInput, trials: &[Measurement]) -> String {
    let commanded = input.gait.value.to_gait().joints;
    let is_measured = input.gait_input() == GaitInput::Measured;
    let mut header = vec!["conditionId".to_owned(), "conditionName".to_owned()];
    header.push("omega_rad_s".to_owned());
    for (joint, command) in commanded.iter().enumerate() {
        let Some(command) = command else { continue };
        let of = |what: &str| format!("phi{}_{what}_rad", joint + 1);
        header.extend(["offset", "amplitude", "phase"].map(of));
        header.extend(command.second.iter().flat_map(|_| ["amplitude2", "phase2"].map(of)));
    }
    let row = |(number, trial): (usize, &Measurement)| {
        let mut cells = vec![condition_id(number), trial.trial.clone()];
        cells.push(trial.omega_rad_s.to_string());
        for (command, measured) in commanded.iter().zip(trial.gait) {
            let driven = command.map(|of| if is_measured { of.measured(measured) } else { of });
            let numbers = driven.map(JointCommand::to_array);
            cells.extend(numbers.into_iter().flatten().map(cell));
            let second = driven.and_then(|of| of.second);
            let second = second.map(|of| [of.amplitude_rad(), of.phase_rad()]);
            cells.extend(second.into_iter().flatten().map(cell));
        }
        cells
    };
    table(header, trials.iter().enumerate().map(row))
}

fn observables(input: &FitInput, trials: &[Measurement]) -> String {
    let header = ["observableId", "observableName", "observableFormula"];
    let header = header.into_iter().chain(["noiseFormula", "noiseDistribution"]);
    let measured =
        |metric: usize| trials.iter().any(|of| terms(input, of).any(|(i, ..)| i == metric));
    let rows = GaitMetrics::COLUMNS.into_iter().zip(MEANINGS).enumerate();
    let rows = rows.filter(|(metric, _)| measured(*metric));
    let row = |(_, (name, about)): (usize, (&str, &str))| {
        let id = observable_id(name);
        let scale = format!("noiseParameter1_{id}");
        [id, about.to_owned(), name.to_owned(), scale, "laplace".to_owned()].into()
    };
    table(header.map(str::to_owned).collect(), rows.map(row))
}

/// What was measured at the steady motion of each condition, which PEtab says by an infinite time.
fn measurements(input: &FitInput, trials: &[Measurement]) -> String {
    let header = ["observableId", "simulationConditionId", "measurement", "time"];
    let header = header.into_iter().chain(["noiseParameters", "datasetId"]).map(str::to_owned);
    let rows = trials.iter().enumerate().flat_map(|(number, trial)| {
        terms(input, trial).map(move |(metric, weight, value)| {
            let scale = value * trials.len() as f64 / weight;
            let id = observable_id(GaitMetrics::COLUMNS[metric]);
            let (value, scale) = (value.to_string(), scale.to_string());
            vec![id, condition_id(number), value, "inf".to_owned(), scale, trial.trial.clone()]
        })
    });
    table(header.collect(), rows)
}

/// The terms of the objective of a trial: index of the metric, weight and measured value.
fn terms<'t>(
    input: &FitInput,
    trial: &'t Measurement,
) -> impl Iterator<Item = (usize, f64, f64)> + use<'t> {
    let weights = input.protocol().term_weights();
    let all = weights.into_iter().zip(trial.metrics.to_array()).enumerate();
    let all = all.map(|(metric, (weight, value))| (metric, weight, value));
    all.filter(|(_, weight, value)| *weight > 0.0 && value.is_finite())
}

fn condition_id(number: usize) -> String {
    format!("trial{}", number + 1)
}

fn observable_id(name: &str) -> String {
    format!("obs_{name}")
}

fn cell(number: f64) -> String {
    if number.is_nan() { String::new() } else { number.to_string() }
}

/// Lines of cells with tabs between them.
fn table(header: Vec<String>, rows: impl Iterator<Item = Vec<String>>) -> String {
    std::iter::once(header).chain(rows).map(|cells| cells.join("\t") + "\n").collect()
}
