//! What `simulate --sensitivities` prints and writes.

use std::path::PathBuf;

use trilink_fit::simulate::{KnownFits, Setup};
use trilink_report::{FigureFile, sensitivities_drawing};
use trilink_tables::{SENSITIVE_METRICS, SensitivityRow};

use super::table::fixed;
use crate::cli::output::{note, say};
use crate::cli::rows_file::{RowsFile, print_rows, write_figure};
use crate::cli::table::{self, short};
use crate::cli::{Context, Failure, Outcome};
use crate::interrupt;

#[derive(clap::Args)]
pub(super) struct Sensitivities {
    /// Answer with how d, v, sigma, alpha1 and the work answer to every number of the robot, the gait and the frequency, and with
    /// what the uncertainty of each contributes.
    #[arg(long, conflicts_with_all = ["trajectory", "page", "bands"])]
    pub sensitivities: bool,
    /// Write the sensitivities: Parquet, CSV or JSON, by the file's ending.
    #[arg(long, value_name = "FILE", requires = "sensitivities")]
    table: Option<PathBuf>,
    /// Draw the elasticities of one motion: SVG, PNG or PDF, by the file's ending.
    #[arg(long, value_name = "FILE", requires = "sensitivities")]
    figure: Option<PathBuf>,
}

/// The motions that are asked for, and how they are shown.
pub(super) struct Asked<'a> {
    pub campaign: &'a str,
    pub setups: &'a [Setup],
    pub omegas_rad_s: &'a [f64],
    pub from_rest: bool,
    pub fits: Option<&'a KnownFits>,
    pub csv: bool,
    pub json: bool,
}

impl Sensitivities {
    pub(super) fn run(&self, context: &Context, asked: &Asked) -> Result<Outcome, Failure> {
        let Asked { campaign, setups, omegas_rad_s, .. } = asked;
        let motions = setups.len() * omegas_rad_s.len();
        if self.figure.is_some() && motions != 1 {
            return Err(format!("--figure: found {motions} motions, needed one").into());
        }
        let file = self.table.as_deref().map(|path| RowsFile::new(path, "--table")).transpose()?;
        let (mut all, mut outcome) = (Vec::new(), Outcome::Well);
        let mut input = blake3::Hasher::new();
        for setup in *setups {
            let found = setup.sensitivities(
                omegas_rad_s,
                asked.from_rest,
                asked.fits,
                interrupt::token(),
            )?;
            if let Some(why) = found.unknown {
                let model = setup.model;
                note!("{campaign} {model}: the fitted coefficients are taken as exact: {why}");
            }
            for (omega_rad_s, rows) in found.motions {
                input.update(format!("{:?}", setup.problem(omega_rad_s)).as_bytes());
                match rows {
                    Ok(rows) => all.push(rows),
                    Err(error) => {
                        note!("{campaign} {} at {omega_rad_s} rad/s: {error}", setup.model);
                        outcome = Outcome::NeedsAttention;
                    }
                }
            }
        }
        let rows = all.concat();
        if let Some(file) = file {
            file.write(&rows, &input.finalize())?;
            context.progress.say(&format!("{}: {} rows", file.path.display(), rows.len()));
        }
        if let Some(path) = self.figure.as_deref().filter(|_| !rows.is_empty()) {
            let fitted_to = asked.fits.map(|_| &context.config.paths);
            let drawn = |file: FigureFile| sensitivities_drawing(campaign, &rows, file);
            write_figure(path, &context.progress, fitted_to, drawn)?;
        }
        if !print_rows(&rows, asked.csv, asked.json) {
            all.iter().for_each(|rows| print(rows));
        }
        Ok(outcome)
    }
}

/// The metrics of one parameter, in order.
fn by_parameter(rows: &[SensitivityRow]) -> Vec<Vec<&SensitivityRow>> {
    let first = rows.iter().filter(|row| row.metric == SENSITIVE_METRICS[0]);
    let of = |parameter: &SensitivityRow| {
        rows.iter().filter(|row| row.parameter == parameter.parameter).collect()
    };
    first.map(of).collect()
}

/// The elasticities of one motion, and what is known of how far it may be off.
fn print(rows: &[SensitivityRow]) {
    let Some(first) = rows.first() else { return };
    let mut parameters = by_parameter(rows);
    let size = |of: &[&SensitivityRow], number: fn(&SensitivityRow) -> f64| {
        of.iter().map(|row| number(row).abs()).filter(|size| size.is_finite()).fold(0.0, f64::max)
    };
    let by_size = |number: fn(&SensitivityRow) -> f64| {
        move |a: &Vec<&SensitivityRow>, b: &Vec<&SensitivityRow>| {
            size(b, number).total_cmp(&size(a, number))
        }
    };
    parameters.sort_by(by_size(|row| row.elasticity));
    say!(
        "{} at {} rad/s: change of a metric per change of a parameter, both relative",
        first.model,
        first.omega_rad_s
    );
    if first.extrapolation.extrapolated == Some(true) {
        say!("extrapolated: {}", first.extrapolation.beyond_trials);
    }
    let headings = ["parameter", "value"].into_iter().chain(SENSITIVE_METRICS);
    let headings: Vec<(&str, bool)> =
        headings.enumerate().map(|(nth, name)| (name, nth > 0)).collect();
    let number = |value: f64| if value.is_nan() { "-".to_owned() } else { fixed(value, 4) };
    let line = |of: &Vec<&SensitivityRow>| {
        let begin = [of[0].parameter.clone(), short(of[0].parameter_value)];
        begin.into_iter().chain(of.iter().map(|row| number(row.elasticity))).collect()
    };
    let lines: Vec<Vec<String>> = parameters.iter().map(line).collect();
    table::print(&headings, &lines, None);

    let (mut known, exact): (Vec<_>, Vec<_>) =
        parameters.into_iter().partition(|of| of[0].known_from.is_some());
    if known.is_empty() {
        say!("no parameter has a standard deviation: all are taken as exact\n");
        return;
    }
    known.sort_by(by_size(|row| row.variance_part));
    say!("\nstandard deviations, and what part of each metric's variance they make:");
    let headings = ["parameter", "deviation", "from"].into_iter().chain(SENSITIVE_METRICS);
    let headings: Vec<(&str, bool)> =
        headings.enumerate().map(|(nth, name)| (name, nth != 0 && nth != 2)).collect();
    let part = |row: &&SensitivityRow| match row.variance_part.is_nan() {
        true => "-".to_owned(),
        false => format!("{:.1} %", 100.0 * row.variance_part),
    };
    let line = |of: &Vec<&SensitivityRow>| {
        let from = of[0].known_from.map_or("", |source| source.name());
        let begin = [of[0].parameter.clone(), short(of[0].standard_deviation), from.to_owned()];
        begin.into_iter().chain(of.iter().map(part)).collect()
    };
    let mut lines: Vec<Vec<String>> = known.iter().map(line).collect();
    let whole = |what: &str, of: fn(&SensitivityRow) -> f64| {
        let begin = [what, "", ""].map(str::to_owned).into_iter();
        begin.chain(known[0].iter().map(|row| short(of(row)))).collect()
    };
    lines.push(whole("standard deviation", |row| row.metric_deviation));
    lines.push(whole("of", |row| row.metric_value));
    table::print(&headings, &lines, None);
    let exact: Vec<&str> = exact.iter().map(|of| of[0].parameter.as_str()).collect();
    say!("taken as exact: {}\n", exact.join(", "));
}
