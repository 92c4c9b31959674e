//! What `simulate --sensitivities` prints and writes.

use trilink_fit::simulate::{KnownFits, Setup};
use trilink_report::{FigureFile, sensitivities_drawing};
use trilink_tables::{SENSITIVE_METRICS, SensitivityRow};

use super::Simulate;
use crate::cli::output::{note, say};
use crate::cli::results::Files;
use crate::cli::table::{Table, short};
use crate::cli::{Context, Failure, Outcome};
use crate::interrupt;
use crate::template::fixed;

#[derive(clap::Args)]
#[command(mut_arg("table", |of| of.requires("sensitivities").help("Write the sensitivities: Parquet, CSV or JSON, by the file's ending")))]
#[command(mut_arg("figure", |of| of.requires("sensitivities").help("Draw the elasticities of one motion: SVG, PNG or PDF, by the file's ending")))]
pub(super) struct Sensitivities {
    /// Answer with how d, v, sigma, alpha1 and the work answer to every number of the robot, the gait and the frequency, and with
    /// what the uncertainty of each contributes.
    #[arg(long, conflicts_with_all = ["trajectory", "page", "bands"])]
    pub sensitivities: bool,
    #[command(flatten)]
    files: Files,
}

impl Simulate {
    pub(super) fn print_sensitivities(
        &self,
        context: &Context,
        setups: &[Setup],
        omegas_rad_s: &[f64],
        fits: Option<&KnownFits>,
    ) -> Result<Outcome, Failure> {
        let (campaign, files) = (&self.campaign, &self.sensitivities.files);
        let motions = setups.len() * omegas_rad_s.len();
        if files.figure.is_some() && motions != 1 {
            return Err(format!("--figure: found {motions} motions, needed one").into());
        }
        files.check()?;
        let (mut all, mut outcome, mut input) = (Vec::new(), Outcome::Well, String::new());
        for setup in setups {
            let model = setup.model;
            let found =
                setup.sensitivities(omegas_rad_s, self.from_rest, fits, interrupt::token())?;
            if let Some(why) = found.unknown {
                note!("{campaign} {model}: the fitted coefficients are taken as exact: {why}");
            }
            for (omega_rad_s, rows) in found.motions {
                input += &format!("{:?}", setup.problem(omega_rad_s));
                match rows {
                    Ok(rows) => all.push(rows),
                    Err(error) => {
                        note!("{campaign} {model} at {omega_rad_s} rad/s: {error}");
                        outcome = Outcome::NeedsAttention;
                    }
                }
            }
        }
        let rows = all.concat();
        files.write(context, &rows, &input, "rows")?;
        if !rows.is_empty() {
            let drawn = |file: FigureFile| sensitivities_drawing(campaign, &rows, file);
            files.draw(context, self.numbers.fitted, drawn)?;
        }
        if !self.format.rows(&rows) {
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
    let number = |value: f64| if value.is_nan() { "-".to_owned() } else { fixed(value, 4) };
    let mut table = Table::of(&parameters)
        .left("parameter", |of| of[0].parameter.clone())
        .right("value", |of| short(of[0].parameter_value));
    for (i, name) in SENSITIVE_METRICS.into_iter().enumerate() {
        table = table.right(name, |of| number(of[i].elasticity));
    }
    table.print();

    let (mut known, exact): (Vec<_>, Vec<_>) =
        parameters.into_iter().partition(|of| of[0].known_from.is_some());
    if known.is_empty() {
        say!("no parameter has a standard deviation: all are taken as exact\n");
        return;
    }
    known.sort_by(by_size(|row| row.variance_part));
    say!("\nstandard deviations, and what part of each metric's variance they make:");
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
    let headings = ["parameter", "deviation", "from"].into_iter().chain(SENSITIVE_METRICS);
    let mut table = Table::of(&lines);
    for (i, name) in headings.enumerate() {
        table = table.column(name, i != 0 && i != 2, |line| line[i].clone());
    }
    table.print();
    let exact: Vec<&str> = exact.iter().map(|of| of[0].parameter.as_str()).collect();
    say!("taken as exact: {}\n", exact.join(", "));
}
