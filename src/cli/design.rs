//! `trilink design`.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use trilink_fit::design::{
    Advice, Aim, Candidate, DesignRow, ExpectedRow, Optimality, Prediction, Untold, advise, tell,
};
use trilink_fit::simulate::{FitSummary, KnownFits};
use trilink_fit::{FitInformation, FitInput, KnownFit};
use trilink_robot::{Gait, Model};
use trilink_tables::config::{Config, did_you_mean};
use trilink_tables::{Columns, NoInterval};

use super::output::{note, say, write_json};
use super::parse::{Omegas, parse_numbers, parse_omegas};
use super::results::Format;
use super::setup::preferred;
use super::table::{Table, short};
use super::{Context, Failure, Outcome};
use crate::inspect::{View, json as json_of};
use crate::interrupt;

/// Frequencies that are tried where none are given.
const FREQUENCIES: usize = 24;
/// Trials of frequencies that differ by less than this factor are of one.
const NEAR: f64 = 1.05;
/// Largest half width, as a part of a value, that is called a half width.
const OPEN: f64 = 10.0;

/// Advise which trials to make next: for the coefficients, for a prediction, or to tell two models apart.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/design.txt").trim_end())]
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
    #[command(flatten)]
    format: Format,
}

impl Design {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
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
        let of_model = |name: &str, why: NoInterval| format!("{} {name}: {why}", self.campaign);
        let rival = self.tell.as_deref().map(|name| Ok::<_, Failure>((name, fit(name)?)));
        let advice = match rival.transpose()? {
            Some((name, _)) if name == model => {
                return Err(format!("--tell: found `{name}`, needed another model").into());
            }
            Some((name, (other, of_other))) => known
                .with_information(&input, &fits.data, |one| {
                    let told = match other.row.adequate {
                        Some(false) => "; the trials so far tell it apart",
                        _ => "",
                    };
                    let candidates = self.all_candidates(one, &gaits);
                    other
                        .with_information(&of_other, &fits.data, |other| {
                            tell(one, other, &candidates, size, interrupt::token())
                        })
                        .map_err(|why| of_model(name, why) + told)
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
        if self.format.json {
            write_json(&self.to_json(&model, &advice)?)?;
        } else if !self.format.rows(&advice.trials) {
            self.print(&model, &advice);
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
            let exchanged = of.exchanged.iter().map(|(other, change)| (other.name(), change));
            json!({
                "parameter": of.parameter.name(),
                "deviation": of.deviation,
                "deviation_with": of.deviation_with,
                "exchanged": exchanged.collect::<BTreeMap<_, _>>(),
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
    let mut table = Table::of(trials)
        .left("gait of", |of| of.campaign.clone())
        .right("omega rad/s", |of| short(of.omega_rad_s));
    let amplitude_rad = |of: &DesignRow, joint: usize| of.amplitude_rad[joint];
    for joint in
        (0..2).filter(|joint| trials.iter().any(|of| amplitude_rad(of, *joint).is_finite()))
    {
        table = table.right(&format!("amplitude{} deg", joint + 1), |of| {
            format!("{:.1}", amplitude_rad(of, joint).to_degrees())
        });
    }
    table = table
        .right("repeats", |of| of.repeats.to_string())
        .right("d mm", |of| short(1e3 * of.metrics.d_m))
        .right("v mm/s", |of| short(1e3 * of.metrics.v_m_s));
    let is_extrapolated = |of: &DesignRow| of.extrapolation.extrapolated == Some(true);
    let remark = |of: &DesignRow| if is_extrapolated(of) { "extrapolated" } else { "" };
    if trials.iter().any(is_extrapolated) {
        table = table.left("remark", |of| remark(of).to_owned());
    }
    table.print();
}

fn print_expected(expected: &[ExpectedRow]) {
    let part = |half_width: f64, of: &ExpectedRow| match half_width / of.value.abs() {
        part if part < OPEN => format!("{} ({} %)", short(half_width), rounded(100.0 * part)),
        _ => "open".to_owned(),
    };
    Table::of(expected)
        .left("", |of| of.quantity.clone())
        .right("value", |of| short(of.value))
        .right("now", |of| part(of.half_width, of))
        .right("expected", |of| part(of.expected_half_width, of))
        .right("spread evenly", |of| part(of.evenly_half_width, of))
        .print();
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
