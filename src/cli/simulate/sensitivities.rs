//! Output of `simulate --sensitivities`.

use trilink_fit::simulate::{Draws, KnownFits, Setup};
use trilink_report::sensitivities_drawing;
use trilink_tables::SensitivityRow;

use super::Simulate;
use crate::cli::output::{note, say};
use crate::cli::results::Files;
use crate::cli::table::{Table, short};
use crate::cli::{Context, Failure, Outcome};
use crate::template::fixed;

#[derive(clap::Args)]
#[command(mut_arg("table", |arg| arg.requires("sensitivities").help("Write the sensitivities to a file; its extension selects Parquet, CSV or JSON")))]
#[command(mut_arg("figure", |arg| arg.requires("sensitivities").help("Draw the elasticities of one motion; the file extension selects SVG, PNG or PDF")))]
pub(super) struct Sensitivities {
    /// Compute the sensitivities of d, v, sigma, alpha1 and the work to the frequency and to every parameter of the
    /// robot and the gait (of a chain, of all metrics to every number), and the contribution of each parameter's
    /// uncertainty.
    #[arg(long, conflicts_with_all = ["trajectory", "page", "bands"])]
    pub sensitivities: bool,
    /// Also propagate the uncertainties by N motions with inputs drawn at random (JCGM 101), 1000 to 1000000.
    #[arg(long, value_name = "N", requires = "sensitivities", num_args = 0..=1, default_missing_value = "10000")]
    #[arg(value_parser = clap::value_parser!(u32).range(1_000..=1_000_000))]
    monte_carlo: Option<u32>,
    #[command(flatten)]
    pub files: Files,
}

impl Simulate {
    /// Computes the sensitivities for all models and frequencies, prints them, and writes the requested table and
    /// figure.
    pub(super) fn print_sensitivities(
        &self,
        context: &Context,
        setups: &[Setup],
        omegas_rad_s: &[f64],
        fits: Option<&KnownFits>,
    ) -> Result<Outcome, Failure> {
        let campaign = &self.campaign;
        let files = &self.sensitivities.files;
        let motions = setups.len() * omegas_rad_s.len();
        if files.figure.is_some() && motions != 1 {
            return Err(format!("--figure: found {motions} motions, needed one").into());
        }
        files.check()?;
        let seed = context.config.fit.seed;
        let draws = self.sensitivities.monte_carlo;
        let draws = draws.map(|count| Draws { count: count as usize, seed });
        let mut all = Vec::new();
        let mut outcome = Outcome::Well;
        let mut input = format!("{draws:?}");
        for setup in setups {
            let model = setup.model;
            let found =
                setup.sensitivities(omegas_rad_s, self.from_rest, fits, draws, context.cancel())?;
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
            files.draw(context, self.numbers.fitted, |file| {
                sensitivities_drawing(campaign, &rows, file)
            })?;
        }
        if !self.format.rows(&rows) {
            all.iter().for_each(|rows| print(rows));
        }
        Ok(outcome)
    }
}

/// Groups rows by parameter; each group has a row per metric, in the order of `rows`.
fn by_parameter(rows: &[SensitivityRow]) -> Vec<Vec<&SensitivityRow>> {
    let first = rows.iter().take_while(|row| row.metric == rows[0].metric);
    let groups =
        first.map(|first| rows.iter().filter(|row| row.parameter == first.parameter).collect());
    groups.collect()
}

/// Sorts groups of rows, one per parameter, by the largest magnitude of `number` in the group, in descending order.
fn sort_by_size(parameters: &mut [Vec<&SensitivityRow>], number: fn(&SensitivityRow) -> f64) {
    let size = |rows: &[&SensitivityRow]| {
        rows.iter().map(|row| number(row).abs()).filter(|size| size.is_finite()).fold(0.0, f64::max)
    };
    parameters.sort_by(|a, b| size(b).total_cmp(&size(a)));
}

/// Returns the cells of a line: a name, and a number for each metric.
fn total_line(name: &str, numbers: impl Iterator<Item = f64>) -> Vec<String> {
    [name, "", ""].map(str::to_owned).into_iter().chain(numbers.map(short)).collect()
}

/// Prints the elasticities of one motion and the uncertainty budget of its metrics.
fn print(rows: &[SensitivityRow]) {
    let Some(first) = rows.first() else { return };
    let mut parameters = by_parameter(rows);
    sort_by_size(&mut parameters, |row| row.elasticity);
    say!(
        "{} at {} rad/s: elasticities (relative change of a metric per relative change of a parameter)",
        first.model,
        first.omega_rad_s
    );
    if first.extrapolation.extrapolated == Some(true) {
        say!("extrapolated: {}", first.extrapolation.beyond_trials);
    }
    let metrics: Vec<&str> =
        rows.chunk_by(|a, b| a.metric == b.metric).map(|rows| rows[0].metric.as_str()).collect();
    let mut table = Table::new(&parameters)
        .left("parameter", |rows| rows[0].parameter.clone())
        .right("value", |rows| short(rows[0].parameter_value));
    for (i, name) in metrics.iter().enumerate() {
        table = table.right(name, |rows| match rows[i].elasticity {
            value if value.is_nan() => "-".to_owned(),
            value => fixed(value, 4),
        });
    }
    table.print();

    let (mut known, exact): (Vec<_>, Vec<_>) =
        parameters.into_iter().partition(|rows| rows[0].known_from.is_some());
    if known.is_empty() {
        say!("no parameter has a standard deviation: all are taken as exact\n");
        return;
    }
    sort_by_size(&mut known, |row| row.variance_part);
    say!("\nstandard deviations of the parameters and their shares of each metric's variance:");
    let mut lines: Vec<Vec<String>> = Vec::new();
    for rows in &known {
        let source = rows[0].known_from.map_or("", |source| source.name());
        let mut line =
            vec![rows[0].parameter.clone(), short(rows[0].standard_deviation), source.to_owned()];
        line.extend(rows.iter().map(|row| match row.variance_part {
            share if share.is_nan() => "-".to_owned(),
            share => format!("{:.1} %", 100.0 * share),
        }));
        lines.push(line);
    }
    lines.push(total_line("standard deviation", known[0].iter().map(|row| row.metric_deviation)));
    lines.push(total_line("of", known[0].iter().map(|row| row.metric_value)));
    if let Some(draws) = known[0][0].draws {
        let mut add = |name: &str, of_draws: fn(&SensitivityRow) -> f64| {
            lines.push(total_line(name, known[0].iter().map(|row| of_draws(row))));
        };
        add("standard deviation of draws", |row| row.draws_deviation);
        add("lower limit (95 %) of draws", |row| row.draws_lower);
        add("upper limit (95 %) of draws", |row| row.draws_upper);
        if let Some(unsolved @ 1..) = known[0][0].unsolved_draws {
            note!("{unsolved} of {draws} draws have no periodic solution");
        }
    }
    let headings = ["parameter", "deviation", "from"].into_iter().chain(metrics);
    let mut table = Table::new(&lines);
    for (i, name) in headings.enumerate() {
        table = table.column(name, i != 0 && i != 2, |line| line[i].clone());
    }
    table.print();
    let exact: Vec<&str> = exact.iter().map(|of| of[0].parameter.as_str()).collect();
    say!("taken as exact: {}\n", exact.join(", "));
}
