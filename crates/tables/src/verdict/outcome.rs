//! Outcome of the comparison of a campaign's models.

use std::fmt::{self, Display, Formatter};

use trilink_base::named;
use trilink_base::text::known;
use trilink_robot::Model;

use super::Misfit;
use crate::{ComparisonRow, FitRow};

/// Maximum relative difference between the objectives of two models' predictions that count as equally good.
const EQUAL_TOLERANCE: f64 = 0.05;

named! {
    /// Outcome of the comparison of a campaign's models.
    pub enum Outcome {
        NoFit = "no-fit",
        /// Only one model has a fit.
        OnlyOne = "only-one",
        /// No model is adequate; the preferred one comes closest.
        NoneFits = "none-fits",
        /// The preferred model is adequate. Another model has a lower Schwarz criterion, but is or may be inadequate.
        FitsAlone = "fits-alone",
        /// The preferred model may be adequate. Another model has a lower Schwarz criterion, but is inadequate.
        MayFit = "may-fit",
        /// The preferred model clearly has the lowest Schwarz criterion.
        Clear = "clear",
        /// The preferred model has the lowest Schwarz criterion, but in many bootstrap replicates another model has the
        /// lowest.
        Unclear = "unclear",
    }
}

/// Comparison of a campaign's models, displayed as sentences.
#[derive(Debug)]
pub struct Comparison<'r> {
    outcome: Outcome,
    /// Number of trials to which the models were fitted.
    fitted_trials: i64,
    /// Number of the campaign's trials that have no metrics.
    other_trials: i64,
    /// Models with a fit, the preferred one first.
    ranked: Vec<(&'r ComparisonRow, &'r FitRow)>,
}

impl<'r> Comparison<'r> {
    /// Creates the comparison from a campaign's rows of the table `comparison` and the corresponding fits; `fits` may
    /// also contain fits of other campaigns. Returns `None` if there are no rows.
    pub fn new(
        rows: impl IntoIterator<Item = &'r ComparisonRow>,
        fits: &'r [FitRow],
    ) -> Option<Self> {
        let mut rows = rows.into_iter().peekable();
        let first = *rows.peek()?;
        let fit_of = |row: &ComparisonRow| {
            fits.iter().find(|fit| fit.campaign == row.campaign && fit.model == row.model)
        };
        let fitted_trials = fit_of(first).map_or(0, |fit| fit.trials);
        let mut ranked: Vec<_> =
            rows.filter(|row| row.rank > 0).filter_map(|row| Some((row, fit_of(row)?))).collect();
        ranked.sort_by_key(|(row, _)| row.rank);
        let outcome = if ranked.is_empty() { Outcome::NoFit } else { first.outcome };
        let other_trials = first.trials_without_metrics;
        Some(Self { outcome, fitted_trials, other_trials, ranked })
    }

    /// Returns the rows of the model with the lowest `value`; skips models for which it is missing (NaN). `None` if it
    /// is missing for all models.
    fn lowest(&self, value: fn(&ComparisonRow) -> f64) -> Option<&(&'r ComparisonRow, &'r FitRow)> {
        let with_value = self.ranked.iter().filter(|(row, _)| !value(row).is_nan());
        with_value.min_by(|(a, _), (b, _)| value(a).total_cmp(&value(b)))
    }

    /// Formats a clause that states the preferred model and its lead over the next one, without a full stop.
    pub fn answer(&self) -> String {
        let mut text = String::new();
        if self.fitted_trials != 0 && self.other_trials != 0 {
            let all = self.fitted_trials + self.other_trials;
            text = format!(
                "Fitted to {} of {all} trials: the others have no metrics. ",
                self.fitted_trials
            );
        }
        let Some((first, _)) = self.ranked.first() else {
            return text + "No model could be fitted to this campaign";
        };
        text += &self.preference(first.model);
        let rivals = self.ranked.iter().filter(|(row, _)| row.rival);
        let rivals: Vec<&str> = rivals.map(|(row, _)| row.model.name()).collect();
        if !rivals.is_empty() {
            text += &format!(" (not distinguishable from {})", rivals.join(", "));
        }
        text += &known([first.j], |[j]| format!(": J = {j:.4}"));
        let Some((second, _)) = self.ranked.get(1) else { return text };
        let numbers = [first.criterion, second.criterion, second.j];
        text += &known(numbers, |[criterion, other, j]| {
            format!(
                " with {} free parameters, Schwarz criterion {:.1} {} than that of {} (J = {j:.4} with {})",
                first.free,
                (criterion - other).abs(),
                if criterion > other { "higher" } else { "lower" },
                second.model,
                second.free
            )
        });
        if first.wins.is_finite() {
            let won = (first.wins * first.replicates as f64).round();
            text += &format!("; lowest of all in {won} of {} replicates", first.replicates);
        }
        text
    }

    /// Formats sentences for a summary of the comparison: whether the preferred model fits, by how much the next one
    /// misses the measurements, and in how many resamples the preferred model was chosen.
    pub fn card(&self) -> String {
        let Some((first, fit)) = self.ranked.first() else { return format!("{}.", self.answer()) };
        let model = first.model;
        let ratio = known([fit.lack_of_fit, fit.lack_of_fit_limit], |[ratio, limit]| {
            format!(" (misfit {ratio:.2} of noise, limit {limit:.2})")
        });
        let verdict = match fit.adequate {
            Some(true) => format!("{model} fits"),
            Some(false) if self.ranked.len() > 1 => format!("No model fits; {model} comes closest"),
            Some(false) => format!("{model} does not fit"),
            None => format!("{model} may fit"),
        };
        let mut sentences = vec![format!("{verdict}{ratio}.")];
        let all = self.fitted_trials + self.other_trials;
        if self.fitted_trials != 0 && self.other_trials != 0 {
            let fitted = self.fitted_trials;
            sentences
                .push(format!("Fitted to {fitted} of {all} trials: the others have no metrics."));
        }
        if let Some((rival, of_rival)) = self.ranked.get(1) {
            let misses = of_rival.misfit.as_ref().and_then(Misfit::largest);
            sentences.extend(misses.map(|misses| format!("{} {misses}.", rival.model)));
        }
        if self.outcome == Outcome::FitsAlone || self.outcome == Outcome::MayFit {
            sentences.push(format!("{}.", self.preference(model)));
        }
        let rivals = self.ranked.iter().filter(|(row, _)| row.rival);
        let rivals: Vec<&str> = rivals.map(|(row, _)| row.model.name()).collect();
        if !rivals.is_empty() {
            sentences.push(format!("Not distinguishable from {}.", rivals.join(", ")));
        }
        if first.wins.is_finite() && self.ranked.len() > 1 {
            let won = (first.wins * first.replicates as f64).round();
            sentences.push(format!("Chosen in {won} of {} resamples.", first.replicates));
        }
        sentences.join(" ")
    }

    /// Returns whether the preferred model is adequate; `None` if this is not known or there is no fit.
    pub fn adequate(&self) -> Option<bool> {
        self.ranked.first().and_then(|(_, fit)| fit.adequate)
    }

    /// Formats the preferred model and whether it is adequate, in a few words.
    pub fn short(&self) -> String {
        let Some((first, fit)) = self.ranked.first() else { return "no fit".to_owned() };
        match fit.adequate {
            Some(true) => format!("{} fits", first.model),
            Some(false) if self.ranked.len() > 1 => "no model fits".to_owned(),
            Some(false) => format!("{} does not fit", first.model),
            None => format!("{} may fit", first.model),
        }
    }

    /// Formats a sentence that states which model is preferred and why.
    fn preference(&self, model: Model) -> String {
        let lowest = self.lowest(|row| row.criterion);
        let other = lowest.map_or("", |(row, _)| row.model.name());
        match self.outcome {
            Outcome::NoFit => String::new(),
            Outcome::OnlyOne => format!("Only {model} has been fitted"),
            Outcome::NoneFits => format!("No model fits; {model} comes closest"),
            Outcome::FitsAlone => {
                let fits = lowest.and_then(|(_, fit)| fit.adequate);
                let whether = if fits == Some(false) { "does not fit" } else { "may not fit" };
                format!("{model} fits; {other} has a lower Schwarz criterion but {whether}")
            }
            Outcome::MayFit => {
                format!("{model} may fit; {other} has a lower Schwarz criterion but does not fit")
            }
            Outcome::Clear => format!("The data prefer {model}"),
            Outcome::Unclear => {
                format!("The data do not clearly prefer one model; {model} comes closest")
            }
        }
    }

    /// Formats sentences that state whether the preferred model is adequate, and what contradicts it.
    fn adequacy(&self, (first, fit): (&ComparisonRow, &FitRow)) -> String {
        let FitRow { adequate, lack_of_fit, lack_of_fit_limit, .. } = fit;
        let ratio = known([*lack_of_fit, *lack_of_fit_limit], |[ratio, limit]| {
            format!("misfit {ratio:.2} times the noise, limit {limit:.2}")
        });
        let misfit = fit.misfit.as_ref().map_or(String::new(), ToString::to_string);
        let reasons = match adequate {
            Some(true) => vec![ratio],
            Some(false) => vec![ratio, misfit],
            None => vec![misfit],
        };
        let reasons = reasons.into_iter().filter(|reason| !reason.is_empty());
        let reasons = reasons.collect::<Vec<_>>().join("; ");
        let verdict = match adequate {
            Some(true) => "it fits".to_owned(),
            Some(false) if self.ranked.len() == 1 => "it does not fit".to_owned(),
            // The first sentence already states that no model fits.
            Some(false) => String::new(),
            None => fit.undecided.as_ref().map_or("whether it fits is unknown".to_owned(), |why| {
                format!("whether it fits is unknown, because {why}")
            }),
        };
        let adequacy = match (&*verdict, &*reasons) {
            ("", one) | (one, "") => one.to_owned(),
            (verdict, reasons) if adequate.is_none() => format!("{verdict}: {reasons}"),
            (verdict, reasons) => format!("{verdict} ({reasons})"),
        };
        let contradiction = first.contradiction.as_ref().filter(|_| *adequate != Some(true));
        let contradiction = contradiction.map(|one| one.sentence(first.model));
        [Some(adequacy), contradiction].into_iter().flatten().map(clause).collect()
    }

    /// Formats a sentence that compares the preferred model's predictions with those of the model that
    /// predicts best.
    fn predictions(&self, first: &ComparisonRow) -> String {
        let mut text = String::new();
        if let Some((best, _)) = self.lowest(|row| row.j_left_out) {
            let other = best.model;
            text += &clause(known([first.j_left_out, best.j_left_out], |[j, lowest]| {
                if other == first.model {
                    format!("it predicts left-out frequencies best ({lowest:.4})")
                } else if predicts_as_well(j, lowest) {
                    format!(
                        "it predicts left-out frequencies as well as {other} ({j:.4} and {lowest:.4})"
                    )
                } else {
                    format!(
                        "left-out frequencies are predicted better by {other} ({lowest:.4} against {j:.4})"
                    )
                }
            }));
        }
        if let Some((best, _)) = self.lowest(|row| row.j_extrapolated) {
            let numbers =
                [first.j_extrapolated, best.j_extrapolated, best.extrapolated_above_rad_s];
            text += &clause(known(numbers, |[j, lowest, above_rad_s]| {
                if predicts_as_well(j, lowest) {
                    return String::new();
                }
                format!(
                    "if only frequencies up to {above_rad_s} rad/s are fitted, {} predicts higher frequencies better \
                     ({lowest:.4} against {j:.4})",
                    best.model
                )
            }));
        }
        text
    }
}

/// Returns whether the objective `j` of a model's predictions is about as low as `lowest`, the objective of the best
/// predictions.
fn predicts_as_well(j: f64, lowest: f64) -> bool {
    j <= (1.0 + EQUAL_TOLERANCE) * lowest
}

impl Display for Comparison<'_> {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        f.write_str(&self.answer())?;
        if let Some(&(first, fit)) = self.ranked.first() {
            f.write_str(&self.adequacy((first, fit)))?;
            if self.ranked.len() > 1 {
                f.write_str(&self.predictions(first))?;
            }
        }
        f.write_str(".")
    }
}

/// Prepends a semicolon to a clause that continues a sentence; an empty clause stays empty.
fn clause(text: String) -> String {
    if text.is_empty() { text } else { format!("; {text}") }
}
