//! `trilink design`.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use trilink_fit::design::{
    Advice, Aim, Candidate, DesignRow, ExpectedRow, Optimality, Prediction, Undetermined, advise,
    tell,
};
use trilink_fit::simulate::{FitSummary, KnownFits};
use trilink_fit::{FitInformation, FitInput, KnownFit};
use trilink_robot::{AnyGait, Model};
use trilink_tables::config::{Config, did_you_mean};
use trilink_tables::{Columns, NoInterval};

use super::output::{say, warn, write_json};
use super::parse::{NumberList, parse_numbers, parse_omegas};
use super::results::{Format, return_rows};
use super::setup::preferred;
use super::table::{Table, rounded, short};
use super::{Context, Failure, Outcome, candidates};
use crate::build::check_unconfigured_tables;
use crate::inspect::{View, json as json_of};

/// Default number of candidate frequencies.
const FREQUENCIES: usize = 24;
/// Maximum ratio of the highest to the lowest frequency of trials that count as having a single frequency.
const MAX_SAME_RATIO: f64 = 1.05;
/// Maximum relative half width of a confidence interval that is printed; a wider interval is called open.
const MAX_RELATIVE_HALF_WIDTH: f64 = 10.0;

/// Recommend the next trials: to identify the coefficients, to improve a prediction, or to discriminate between two
/// models.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/design.txt").trim_end())]
pub(super) struct Design {
    /// Name of a `[campaign.*]` table whose trials were fitted.
    #[arg(add = candidates::campaigns())]
    campaign: String,
    /// Name of the `[model.*]` table [default: the preferred model of the comparison].
    #[arg(long, add = candidates::models())]
    model: Option<String>,
    /// Number of trials to add.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=50))]
    add: u32,
    /// Maximum number of repeats of one trial.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=50))]
    repeats: u32,
    /// Candidate frequencies, rad/s: `1,2,3`, or `0.5..6/12` [default: 24 over the range of the
    /// trials, or from half to twice their frequency if they have only one].
    #[arg(long, value_name = "RAD_S", value_parser = parse_omegas)]
    omega: Vec<NumberList>,
    /// Candidate amplitudes of the commanded joints, degrees: `20,30` [default: those of the gait].
    #[arg(long, value_name = "DEG", value_parser = parse_amplitudes)]
    amplitude_deg: Vec<NumberList>,
    /// Campaigns of the same robot whose gaits are candidates [default: the campaign to which trials are added].
    #[arg(long, num_args = 1.., value_name = "CAMPAIGN")]
    candidates: Vec<String>,
    /// Design criterion: `d` minimises the volume of the coefficients' confidence region, `a` the mean variance of
    /// their logarithms.
    #[arg(long, value_name = "WHAT", default_value = "d", value_parser = parse_optimality)]
    optimality: Optimality,
    /// Minimise the uncertainty of a metric predicted at a frequency in rad/s, such as `d at 2.5`, instead of that of
    /// the coefficients.
    #[arg(long = "for", value_name = "PREDICTION", value_parser = Prediction::parse, conflicts_with_all = ["tell", "optimality"])]
    aim: Option<Prediction>,
    /// Choose the trials that best discriminate between the model and this other model, instead of those that best
    /// identify the coefficients.
    #[arg(long, value_name = "MODEL", conflicts_with = "optimality")]
    tell: Option<String>,
    #[command(flatten)]
    format: Format,
}

impl Design {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        context.check_assumed(check_unconfigured_tables)?;
        let config = &context.config;
        let fits = KnownFits::read(config, true)?;
        let model = match &self.model {
            Some(model) => model.clone(),
            None => preferred(config, &fits, &self.campaign)?.name().to_owned(),
        };
        let (known, input) = self.fit(config, &fits, &model)?;
        let caution = FitSummary::new(&known.row).caution();
        if !caution.is_empty() {
            warn(&format!("{} {model}: {caution}", self.campaign));
        }
        let gaits = self.gaits(config)?;
        let size = [self.add, self.repeats].map(|count| count as usize);
        let of_model = |name: &str, why: NoInterval| format!("{} {name}: {why}", self.campaign);
        let rival = self
            .tell
            .as_deref()
            .map(|name| Ok::<_, Failure>((name, self.fit(config, &fits, name)?)));
        let advice = match rival.transpose()? {
            Some((name, _)) if name == model => {
                return Err(format!(
                    "--tell: found `{name}`, needed a model other than that of `--model`"
                )
                .into());
            }
            Some((name, (other, other_input))) => known
                .with_information(&input, &fits.data, |one| {
                    let told = match other.row.adequate {
                        Some(false) => "; the present trials already reject this model",
                        _ => "",
                    };
                    let candidates = self.all_candidates(one, &gaits);
                    other
                        .with_information(&other_input, &fits.data, |other| {
                            tell(one, other, &candidates, size, context.cancel())
                        })
                        .map_err(|why| of_model(name, why) + told)
                })
                .map_err(|why| of_model(&model, why))???,
            None => known
                .with_information(&input, &fits.data, |information| {
                    let aim = self.aim.map_or(Aim::Coefficients(self.optimality), Aim::Prediction);
                    let candidates = self.all_candidates(information, &gaits);
                    advise(information, &known.row, &candidates, aim, size, context.cancel())
                })
                .map_err(|why| of_model(&model, why))??,
        };
        self.note_extrapolation(&model, &advice);
        return_rows("expected", &advice.expected);
        if self.format.json {
            return_rows("trials", &advice.trials);
            write_json(&self.to_json(&model, &advice)?)?;
        } else if !self.format.rows(&advice.trials) {
            self.print(&model, &advice);
        }
        Ok(Outcome::Well)
    }

    /// Returns the fit of a model to the campaign, and the input of that fit.
    fn fit(
        &self,
        config: &Config,
        fits: &KnownFits,
        model: &str,
    ) -> Result<(KnownFit, FitInput), Failure> {
        let model = Model::new(model);
        let known = fits.get(&self.campaign, model)?;
        let input = FitInput::new(config, &self.campaign, model);
        Ok((known, input.ok_or("no such campaign or model")?))
    }

    /// Warns about recommended trials and predictions outside the range of the fitted trials.
    fn note_extrapolation(&self, model: &str, advice: &Advice) {
        let trials = advice.trials.iter().map(|row| ("a trial", &row.extrapolation));
        let predictions =
            advice.expected.iter().map(|row| (row.quantity.as_str(), &row.extrapolation));
        let mut beyond: Vec<String> = trials
            .chain(predictions)
            .filter(|(_, extrapolation)| extrapolation.extrapolated == Some(true))
            .map(|(what, extrapolation)| format!("{what}: {}", extrapolation.beyond_trials))
            .collect();
        beyond.dedup();
        if !beyond.is_empty() {
            let beyond = beyond.join("; ");
            let extrapolated = "extrapolated beyond the trials of the fit";
            warn(&format!("{} {model}: {extrapolated}: {beyond}", self.campaign));
        }
    }

    /// Returns the candidate gaits with the names of their campaigns.
    fn gaits(&self, config: &Config) -> Result<Vec<(String, AnyGait)>, Failure> {
        let own = [self.campaign.clone()];
        let names = if self.candidates.is_empty() { &own[..] } else { &self.candidates };
        let robot = |name: &String| config.campaign.get(name).map(|campaign| &campaign.robot);
        let mut gaits = Vec::new();
        for name in names {
            let Some((_, gait)) = config.setup(name) else {
                let hint = did_you_mean(name, config.campaign.keys().map(String::as_str));
                return Err(format!("--candidates: no campaign `{name}`{hint}").into());
            };
            let own = config.setup(&self.campaign).map(|(_, gait)| gait);
            let has_same_joints = own.is_some_and(|own| {
                let mut pairs = own.joints.iter().zip(gait.joints);
                pairs.all(|(own, other)| own.is_some() == other.is_some())
            });
            if robot(name) != robot(&self.campaign) || !has_same_joints {
                return Err(format!(
                    "--candidates: {name} has a different robot from {}, or drives different \
                     joints",
                    self.campaign
                )
                .into());
            }
            let amplitudes = self.amplitude_deg.concat();
            if amplitudes.is_empty() {
                gaits.push((name.clone(), gait));
            }
            for amplitude_deg in amplitudes {
                let mut gait = gait;
                let joints = gait.joints.iter_mut().flatten();
                joints.for_each(|command| command.amplitude_rad = amplitude_deg.to_radians());
                gaits.push((name.clone(), gait));
            }
        }
        Ok(gaits)
    }

    /// Returns every candidate gait at every candidate frequency.
    fn all_candidates(
        &self,
        information: &FitInformation,
        gaits: &[(String, AnyGait)],
    ) -> Vec<Candidate> {
        let (low, high) = match information.range_rad_s() {
            [low, high] if high > MAX_SAME_RATIO * low => (low, high),
            // The trials have a single frequency.
            [low, high] => (0.5 * low, 2.0 * high),
        };
        let mut omegas_rad_s = self.omega.concat();
        if omegas_rad_s.is_empty() {
            omegas_rad_s.extend((0..FREQUENCIES).map(|i| {
                let omega_rad_s = low + (high - low) * i as f64 / (FREQUENCIES - 1) as f64;
                // Two decimals, as an operator would set a frequency.
                (100.0 * omega_rad_s).round() / 100.0
            }));
            omegas_rad_s.dedup();
        }
        let mut candidates = Vec::new();
        for (campaign, command) in gaits {
            candidates.extend(omegas_rad_s.iter().map(|omega_rad_s| Candidate {
                campaign: campaign.clone(),
                command: *command,
                omega_rad_s: *omega_rad_s,
            }));
        }
        candidates
    }

    fn to_json(&self, model: &str, advice: &Advice) -> Result<Value, Failure> {
        let rows = |table| serde_json::from_str::<Value>(&json_of(&View::from_table(table)));
        let untold = advice.undetermined.iter().map(|untold| {
            let exchanged = untold.exchanged.iter().map(|(other, change)| (other.name(), change));
            json!({
                "parameter": untold.parameter.name(),
                "deviation": untold.deviation,
                "deviation_with": untold.deviation_with,
                "exchanged": exchanged.collect::<BTreeMap<_, _>>(),
                "omega_rad_s": untold.trial.as_ref().map(|trial| trial.omega_rad_s),
                "campaign": untold.trial.as_ref().map(|trial| &trial.campaign),
            })
        });
        Ok(json!({
            "campaign": self.campaign,
            "model": model,
            "trials": rows(DesignRow::to_table(&advice.trials))?,
            "expected": rows(ExpectedRow::to_table(&advice.expected))?,
            "untold": untold.collect::<Vec<_>>(),
            "is_best_of_all": advice.is_best_of_all,
            "without_motion": advice.without_motion,
            "tell": self.tell,
            "standard_errors": Some(advice.standard_errors).filter(|count| count.is_finite()),
        }))
    }

    fn print(&self, model: &str, advice: &Advice) {
        print_trials(&advice.trials);
        if let Some(other) = &self.tell {
            let standard_errors = short(advice.standard_errors);
            say!(
                "\nwith these trials, the predictions of {model} and {other} differ by \
                 {standard_errors} standard errors"
            );
        }
        if !advice.expected.is_empty() {
            say!("\nhalf widths of the 95 % intervals:");
            print_expected(&advice.expected);
        }
        advice.undetermined.iter().for_each(print_untold);
        if advice.without_motion > 0 {
            say!(
                "{} candidate trials were skipped, because no stable periodic motion is predicted for them",
                advice.without_motion
            );
        }
    }
}

/// Prints the recommended trials.
fn print_trials(trials: &[DesignRow]) {
    let mut table = Table::new(trials)
        .left("gait of", |row| row.campaign.clone())
        .right("omega rad/s", |row| short(row.omega_rad_s));
    let amplitudes_rad = |row: &DesignRow| {
        let all = row.amplitude_rad.iter().chain(&*row.more_amplitude_rad).copied();
        all.filter(|rad| rad.is_finite()).collect::<Vec<f64>>()
    };
    if trials.iter().any(|row| !amplitudes_rad(row).is_empty()) {
        table = table.right("amplitudes deg", move |row| {
            let amplitudes_rad = amplitudes_rad(row).into_iter();
            let amplitudes = amplitudes_rad.map(|rad| format!("{:.1}", rad.to_degrees()));
            amplitudes.collect::<Vec<_>>().join(", ")
        });
    }
    table = table
        .right("repeats", |row| row.repeats.to_string())
        .right("d mm", |row| short(1e3 * row.metrics.d_m))
        .right("v mm/s", |row| short(1e3 * row.metrics.v_m_s));
    if trials.iter().any(is_extrapolated) {
        table = table.prose("remark", |row| if is_extrapolated(row) { "extrapolated" } else { "" });
    }
    table.print();
}

/// Whether a recommended trial lies outside the range of the fitted trials.
fn is_extrapolated(row: &DesignRow) -> bool {
    row.extrapolation.extrapolated == Some(true)
}

/// Prints the current and the expected half widths of the 95 % confidence intervals.
fn print_expected(expected: &[ExpectedRow]) {
    Table::new(expected)
        .left("", |row| row.quantity.clone())
        .right("value", |row| short(row.value))
        .right("now", |row| relative(row.half_width, row.value))
        .right("expected", |row| relative(row.expected_half_width, row.value))
        .right("spread evenly", |row| relative(row.evenly_half_width, row.value))
        .print();
}

/// Formats the half width of an interval together with its percentage of `value`; "open" if the interval is too wide.
fn relative(half_width: f64, value: f64) -> String {
    match half_width / value.abs() {
        ratio if ratio < MAX_RELATIVE_HALF_WIDTH => {
            format!("{} ({} %)", rounded(half_width, 3), percent(100.0 * ratio))
        }
        _ => "open".to_owned(),
    }
}

/// Formats a percentage with two significant digits.
fn percent(percent: f64) -> String {
    let digits = (1.0 - percent.abs().max(1e-9).log10().floor()).clamp(0.0, 6.0);
    format!("{percent:.*}", digits as usize)
}

/// Explains why a parameter is barely identifiable and which trial would help.
fn print_untold(untold: &Undetermined) {
    let Undetermined { parameter, deviation, deviation_with, exchanged, trial } = untold;
    let factor = |deviation: f64| format!("a factor of {}", short(deviation.exp()));
    let others: Vec<String> =
        exchanged.iter().map(|(other, change)| format!("{other} by {change:+.2} %")).collect();
    let why = if others.is_empty() {
        "it hardly affects the metrics of the trials".to_owned()
    } else {
        format!("a change of +1 % is compensated by {}", others.join(", "))
    };
    let remedy = match trial {
        Some(Candidate { campaign, omega_rad_s, .. }) => format!(
            "with a trial of {campaign} at {} rad/s, the standard deviation would be {}",
            short(*omega_rad_s),
            factor(*deviation_with)
        ),
        None => "no candidate trial would make it identifiable".to_owned(),
    };
    say!(
        "\n{parameter} is hardly identifiable, because {why}. Its standard deviation is {}; {remedy}",
        factor(*deviation)
    );
}

/// Parses a design criterion.
fn parse_optimality(text: &str) -> Result<Optimality, String> {
    let found = Optimality::ALL.into_iter().find(|optimality| optimality.name() == text);
    found.ok_or_else(|| format!("found `{text}`, needed `d` or `a`"))
}

/// Parses a list or range of amplitudes, degrees, such as `20,30` or `10..40/4`.
fn parse_amplitudes(text: &str) -> Result<NumberList, String> {
    parse_numbers(text, "an amplitude")
}
