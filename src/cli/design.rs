//! `trilink design`.

use serde_json::{Value, json};
use trilink_fit::design::{
    Advice, Aim, Candidate, DesignRow, ExpectedRow, Optimality, Prediction, Untold, advise, tell,
};
use trilink_fit::simulate::{FitSummary, KnownFits};
use trilink_fit::{FitInformation, FitInput, KnownFit};
use trilink_robot::{Gait, Model};
use trilink_tables::config::{Config, did_you_mean};
use trilink_tables::{Columns, FitRow};

use super::fitted::preferred;
use super::omegas::{Omegas, parse_numbers, parse_omegas};
use super::output::{note, say, write_data};
use super::rows_file::print_rows;
use super::table::{self, short};
use super::{Context, Failure, Outcome};
use crate::inspect::{View, json as json_of};
use crate::interrupt;

/// Frequencies that are tried where none are given.
const FREQUENCIES: usize = 24;
/// Trials of frequencies that differ by less than this factor are of one.
const NEAR: f64 = 1.05;
/// Largest half width, as a part of a value, that is called a half width.
const OPEN: f64 = 10.0;

#[derive(clap::Args)]
pub(super) struct Design {
    /// Name of a `[campaign.*]` that was fitted.
    campaign: String,
    /// Name of the `[model.*]` [default: the one that the comparison of the fits prefers].
    #[arg(long)]
    model: Option<String>,
    /// How many trials are to be added.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=50))]
    add: u32,
    /// How often one trial may be made.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=50))]
    repeats: u32,
    /// Frequencies that could be tried, rad/s: `1,2,3`, or `0.5..6/12` [default: 24 in the range of the trials, of one frequency from half to twice as much].
    #[arg(long, value_name = "RAD_S", value_parser = parse_omegas)]
    omega: Vec<Omegas>,
    /// Amplitudes of the commanded joints that could be tried, degrees: `20,30` [default: the gait's].
    #[arg(long, value_name = "DEG", value_parser = parse_amplitudes)]
    amplitude_deg: Vec<Omegas>,
    /// Campaigns of the same robot whose gaits could be tried [default: the campaign].
    #[arg(long, num_args = 1.., value_name = "CAMPAIGN")]
    candidates: Vec<String>,
    /// What is to be small: `d`, the volume of the coefficients' confidence region, or `a`, the mean variance of their logarithms.
    #[arg(long, value_name = "WHAT", default_value = "d", value_parser = parse_optimality)]
    optimality: Optimality,
    /// Make a prediction certain instead of the coefficients: `d at 2.5`, a metric at a frequency.
    #[arg(long = "for", value_name = "PREDICTION", value_parser = Prediction::parse, conflicts_with_all = ["tell", "optimality"])]
    aim: Option<Prediction>,
    /// Tell the model from this other one instead.
    #[arg(long, value_name = "MODEL", conflicts_with = "optimality")]
    tell: Option<String>,
    /// Print the advised trials as CSV with every digit.
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Design {
    pub(super) fn run(self, context: &Context) -> Result<Outcome, Failure> {
        let config = &context.config;
        let fits = KnownFits::read(config, true)?;
        let fit = |name: &str| -> Result<(KnownFit, FitInput), Failure> {
            let model = Model::new(name);
            let known = fits.of(&self.campaign, model)?;
            let input = FitInput::new(config, &self.campaign, model);
            Ok((known, input.ok_or("no such campaign or model")?))
        };
        let model = match &self.model {
            Some(model) => model.clone(),
            None => preferred(config, &fits, &self.campaign)?.name().to_owned(),
        };
        let (known, input) = fit(&model)?;
        let caution = FitSummary::new(&known.row).caution();
        if !caution.is_empty() {
            note!("warning: {} {model}: {caution}", self.campaign);
        }
        let gaits = self.gaits(config)?;
        let size = [self.add, self.repeats].map(|of| of as usize);
        let of_model = |name: &str, why: String| format!("{} {name}: {why}", self.campaign);
        let rival = self.tell.as_deref().map(|name| Ok::<_, Failure>((name, fit(name)?)));
        let advice = match rival.transpose()? {
            Some((name, _)) if name == model => {
                return Err(format!("--tell: found `{name}`, needed another model").into());
            }
            Some((name, (other, of_other))) => known
                .with_information(&input, &fits.data, |one| {
                    let candidates = self.all_candidates(one, &gaits);
                    other
                        .with_information(&of_other, &fits.data, |other| {
                            tell(one, other, &candidates, size, interrupt::token())
                        })
                        .map_err(|why| of_model(name, why) + &told(&other.row))
                })
                .map_err(|why| of_model(&model, why))???,
            None => known
                .with_information(&input, &fits.data, |information| {
                    let aim = self.aim.map_or(Aim::Coefficients(self.optimality), Aim::Prediction);
                    let candidates = self.all_candidates(information, &gaits);
                    advise(information, &known.row, &candidates, aim, size, interrupt::token())
                })
                .map_err(|why| of_model(&model, why))??,
        };
        self.note_extrapolation(&model, &advice);
        match (self.csv, self.json) {
            (true, _) => drop(print_rows(&advice.trials, true, false)),
            (_, true) => {
                write_data(&serde_json::to_string_pretty(&self.to_json(&model, &advice)?)?)
            }
            _ => self.print(&model, &advice),
        }
        Ok(Outcome::Well)
    }

    /// Says what of an advice is beyond the trials that were fitted.
    fn note_extrapolation(&self, model: &str, advice: &Advice) {
        let of_trials = advice.trials.iter().map(|of| ("a trial", &of.extrapolation));
        let of_predictions =
            advice.expected.iter().map(|of| (of.quantity.as_str(), &of.extrapolation));
        let beyond =
            of_trials.chain(of_predictions).filter(|(_, of)| of.extrapolated == Some(true));
        let mut beyond: Vec<String> =
            beyond.map(|(what, of)| format!("{what}: {}", of.beyond_trials)).collect();
        beyond.dedup();
        if !beyond.is_empty() {
            note!(
                "warning: {} {model}: extrapolated beyond the trials of the fit: {}",
                self.campaign,
                beyond.join("; ")
            );
        }
    }

    /// The gaits that could be tried, and whose they are.
    fn gaits(&self, config: &Config) -> Result<Vec<(String, Gait)>, Failure> {
        let own = [self.campaign.clone()];
        let names = if self.candidates.is_empty() { &own[..] } else { &self.candidates };
        let robot = |name: &String| config.campaign.get(name).map(|of| &of.robot);
        let mut gaits = Vec::new();
        for name in names {
            let (Some(_), Some((_, gait))) = (robot(name), config.campaign_setup(name)) else {
                let hint = did_you_mean(name, config.campaign.keys().map(String::as_str));
                return Err(format!("--candidates: no campaign `{name}`{hint}").into());
            };
            let commanded = |of: &Gait| of.joints.map(|joint| joint.is_some());
            let own = config.campaign_setup(&self.campaign).map(|(_, gait)| commanded(&gait));
            if robot(name) != robot(&self.campaign) || own != Some(commanded(&gait)) {
                return Err(format!(
                    "--candidates: {name} has another robot, or drives other joints, than {}",
                    self.campaign
                )
                .into());
            }
            let amplitudes = self.amplitude_deg.concat();
            let scaled = |amplitude_deg: &f64| {
                let mut gait = gait;
                let joints = gait.joints.iter_mut().flatten();
                joints.for_each(|of| of.amplitude_rad = amplitude_deg.to_radians());
                (name.clone(), gait)
            };
            match amplitudes.is_empty() {
                true => gaits.push((name.clone(), gait)),
                false => gaits.extend(amplitudes.iter().map(scaled)),
            }
        }
        Ok(gaits)
    }

    fn all_candidates(
        &self,
        information: &FitInformation,
        gaits: &[(String, Gait)],
    ) -> Vec<Candidate> {
        let (low, high) = match information.range_rad_s() {
            [low, high] if high > NEAR * low => (low, high),
            // Trials of one frequency.
            [low, high] => (0.5 * low, 2.0 * high),
        };
        let mut omegas_rad_s = self.omega.concat();
        if omegas_rad_s.is_empty() {
            let at = |i: usize| low + (high - low) * i as f64 / (FREQUENCIES - 1) as f64;
            // As one would set it.
            omegas_rad_s.extend((0..FREQUENCIES).map(|i| (100.0 * at(i)).round() / 100.0));
            omegas_rad_s.dedup();
        }
        let of_gait = |(campaign, command): &(String, Gait)| {
            let at = |omega_rad_s: &f64| Candidate {
                campaign: campaign.clone(),
                command: *command,
                omega_rad_s: *omega_rad_s,
            };
            omegas_rad_s.iter().map(at).collect::<Vec<_>>()
        };
        gaits.iter().flat_map(of_gait).collect()
    }

    fn to_json(&self, model: &str, advice: &Advice) -> Result<Value, Failure> {
        let of = |table| serde_json::from_str::<Value>(&json_of(&View::of(table)));
        let untold = |of: &Untold| {
            let exchanged = of.exchanged.iter();
            let exchanged =
                exchanged.map(|(other, change)| (other.name().to_owned(), json!(change)));
            json!({
                "parameter": of.parameter.name(),
                "deviation": of.deviation,
                "deviation_with": of.deviation_with,
                "exchanged": exchanged.collect::<serde_json::Map<_, _>>(),
                "omega_rad_s": of.trial.as_ref().map(|of| of.omega_rad_s),
                "campaign": of.trial.as_ref().map(|of| &of.campaign),
            })
        };
        Ok(json!({
            "campaign": self.campaign,
            "model": model,
            "trials": of(DesignRow::to_table(&advice.trials))?,
            "expected": of(ExpectedRow::to_table(&advice.expected))?,
            "untold": advice.untold.iter().map(untold).collect::<Vec<_>>(),
            "is_best_of_all": advice.is_best_of_all,
            "without_motion": advice.without_motion,
            "tell": self.tell,
            "standard_errors": Some(advice.standard_errors).filter(|of| of.is_finite()),
        }))
    }

    fn print(&self, model: &str, advice: &Advice) {
        print_trials(&advice.trials);
        if let Some(other) = &self.tell {
            let standard_errors = short(advice.standard_errors);
            say!("\nwith them {} and {other} differ by {standard_errors} standard errors", model);
        }
        if !advice.expected.is_empty() {
            say!("\nhalf widths of the 95 % intervals:");
            print_expected(&advice.expected);
        }
        advice.untold.iter().for_each(print_untold);
        if advice.without_motion > 0 {
            say!("{} candidates have no stable motion and were left out", advice.without_motion);
        }
    }
}

fn print_trials(trials: &[DesignRow]) {
    let joints: Vec<usize> =
        (0..2).filter(|i| trials.iter().any(|of| of.amplitude_rad[*i].is_finite())).collect();
    let mut headings = vec!["gait of".to_owned(), "omega rad/s".to_owned()];
    headings.extend(joints.iter().map(|joint| format!("amplitude{} deg", joint + 1)));
    headings.extend(["repeats", "d mm", "v mm/s"].map(str::to_owned));
    let is_extrapolated = |of: &DesignRow| of.extrapolation.extrapolated == Some(true);
    let numbers = headings.len();
    headings.extend(trials.iter().any(is_extrapolated).then(|| "remark".to_owned()));
    let line = |of: &DesignRow| {
        let mut cells = vec![of.campaign.clone(), short(of.omega_rad_s)];
        let amplitudes = joints.iter().map(|joint| of.amplitude_rad[*joint].to_degrees());
        cells.extend(amplitudes.map(|of| format!("{of:.1}")));
        let metrics = [of.metrics.d_m, of.metrics.v_m_s].map(|of| short(1e3 * of));
        cells.push(of.repeats.to_string());
        cells.extend(metrics);
        cells.extend(is_extrapolated(of).then(|| "extrapolated".to_owned()));
        cells
    };
    let headings: Vec<(&str, bool)> = headings
        .iter()
        .enumerate()
        .map(|(i, name)| (name.as_str(), i > 0 && i < numbers))
        .collect();
    table::print(&headings, &trials.iter().map(line).collect::<Vec<_>>(), None);
}

fn print_expected(expected: &[ExpectedRow]) {
    let headings =
        [("", false), ("value", true), ("now", true), ("expected", true), ("spread evenly", true)];
    let line = |of: &ExpectedRow| {
        let part = |half_width: f64| match half_width / of.value.abs() {
            part if part < OPEN => format!("{} ({} %)", short(half_width), rounded(100.0 * part)),
            _ => "open".to_owned(),
        };
        let half_widths = [of.half_width, of.expected_half_width, of.evenly_half_width];
        let cells = [of.quantity.clone(), short(of.value)].into_iter();
        cells.chain(half_widths.map(part)).collect()
    };
    table::print(&headings, &expected.iter().map(line).collect::<Vec<_>>(), None);
}

/// What to say where a model that is to be told from another one does not fit.
fn told(row: &FitRow) -> String {
    match row.adequate {
        Some(false) => "; the trials so far tell it apart".to_owned(),
        _ => String::new(),
    }
}

/// To two digits.
fn rounded(percent: f64) -> String {
    let digits = (1.0 - percent.abs().max(1e-9).log10().floor()).clamp(0.0, 6.0);
    format!("{percent:.*}", digits as usize)
}

fn print_untold(of: &Untold) {
    let Untold { parameter, deviation, deviation_with, exchanged, trial } = of;
    let factor = |deviation: f64| format!("a factor of {}", short(deviation.exp()));
    let others: Vec<String> =
        exchanged.iter().map(|(other, change)| format!("{other} by {change:+.2} %")).collect();
    let why = match others.is_empty() {
        true => "the trials hardly answer to it".to_owned(),
        false => format!("+1 % of it is made up for by {}", others.join(", ")),
    };
    let mend = match trial {
        Some(Candidate { campaign, omega_rad_s, .. }) => format!(
            "a trial of {campaign} at {} rad/s would leave {}",
            short(*omega_rad_s),
            factor(*deviation_with)
        ),
        None => "no candidate would tell it".to_owned(),
    };
    say!(
        "\n{parameter} is hardly told, its standard deviation is {}: {why}; {mend}",
        factor(*deviation)
    );
}

fn parse_optimality(text: &str) -> Result<Optimality, String> {
    let found = Optimality::ALL.into_iter().find(|of| of.name() == text);
    found.ok_or_else(|| format!("found `{text}`, needed `d` or `a`"))
}

fn parse_amplitudes(text: &str) -> Result<Omegas, String> {
    parse_numbers(text, "an amplitude")
}
