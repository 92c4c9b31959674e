//! What a comparison of models found.

use std::fmt::{self, Display, Formatter};

use trilink_base::named;
use trilink_base::text::known;

use crate::{ComparisonRow, FitRow};

/// Predictions whose objectives differ by less than this part are as good as each other.
const ALIKE: f64 = 0.05;

named! {
    /// Which of a campaign's models the measurements prefer.
    pub enum Outcome {
        NoFit = "no-fit",
        /// One model alone has a fit.
        OnlyOne = "only-one",
        /// No model fits; the preferred one comes closest.
        NoneFits = "none-fits",
        /// The preferred model fits; another has a lower criterion, and does not fit or may not.
        FitsAlone = "fits-alone",
        /// Whether the preferred model fits is not known; another has a lower criterion, and does not fit.
        MayFit = "may-fit",
        /// The preferred model has clearly the lowest criterion.
        Clear = "clear",
        /// It has the lowest criterion, and others have it in many replicates.
        Unclear = "unclear",
    }
}

/// A campaign's comparison, as it is said.
#[derive(Debug)]
pub struct Comparison<'r> {
    outcome: Outcome,
    /// Of how many trials the fits are, and how many the campaign has beside them.
    trials: [i64; 2],
    /// Models with a fit, the preferred one first.
    ranked: Vec<(&'r ComparisonRow, &'r FitRow)>,
}

impl<'r> Comparison<'r> {
    /// Of the rows of a campaign, and of fits that have its own among them.
    pub fn new(
        rows: impl IntoIterator<Item = &'r ComparisonRow>,
        fits: &'r [FitRow],
    ) -> Option<Self> {
        let mut rows = rows.into_iter().peekable();
        let first = *rows.peek()?;
        let fit_of = |row: &ComparisonRow| {
            fits.iter().find(|fit| fit.campaign == row.campaign && fit.model == row.model)
        };
        let measured = fit_of(first).map_or(0, |fit| fit.trials);
        let mut ranked: Vec<_> =
            rows.filter(|row| row.rank > 0).filter_map(|row| Some((row, fit_of(row)?))).collect();
        ranked.sort_by_key(|(row, _)| row.rank);
        let outcome = if ranked.is_empty() { Outcome::NoFit } else { first.outcome };
        Some(Self { outcome, trials: [measured, first.trials_without_metrics], ranked })
    }

    /// The one with the lowest known value.
    fn lowest(&self, value: fn(&ComparisonRow) -> f64) -> Option<&(&'r ComparisonRow, &'r FitRow)> {
        let known = self.ranked.iter().filter(|(row, _)| !value(row).is_nan());
        known.min_by(|(a, _), (b, _)| value(a).total_cmp(&value(b)))
    }

    /// Which model is preferred and by how much, without a full stop.
    pub fn answer(&self) -> String {
        let mut text = match self.trials {
            [0, _] | [_, 0] => String::new(),
            [measured, without] => format!(
                "Fitted to {measured} of {} trials: the others have no metrics. ",
                measured + without
            ),
        };
        let Some((first, _)) = self.ranked.first() else {
            return text + "No model of this campaign has a fit";
        };
        let model = first.model;
        let nearer = self.lowest(|row| row.criterion).map_or("", |(row, _)| row.model.name());
        text += &match self.outcome {
            Outcome::NoFit => String::new(),
            Outcome::OnlyOne => format!("Only {model} has a fit"),
            Outcome::NoneFits => format!("None fits; {model} is the best of those"),
            Outcome::FitsAlone => {
                let fit = self.lowest(|row| row.criterion).and_then(|(_, fit)| fit.adequate);
                let whether = if fit == Some(false) { "does not fit" } else { "may not fit" };
                format!("The data fit {model}; {nearer} is nearer and {whether}")
            }
            Outcome::MayFit => {
                format!("{model} is nearest of those that may fit; {nearer} does not fit")
            }
            Outcome::Clear => format!("The data prefer {model}"),
            Outcome::Unclear => {
                format!("The data do not clearly prefer one model; {model} is nearest")
            }
        };
        let rivals = self.ranked.iter().filter(|(row, _)| row.rival);
        let rivals: Vec<&str> = rivals.map(|(row, _)| row.model.name()).collect();
        if !rivals.is_empty() {
            text += &format!(", not distinguished from {}", rivals.join(", "));
        }
        text += &known([first.j], |[j]| format!(": J = {j:.4}"));
        let Some((second, _)) = self.ranked.get(1) else { return text };
        let numbers = [first.criterion, second.criterion, second.j];
        text += &known(numbers, |[ours, other, j]| {
            format!(
                " with {} free, criterion {ours:.1} against {other:.1} of {} (J = {j:.4} with {})",
                first.free, second.model, second.free
            )
        });
        if first.wins.is_finite() {
            let won = (first.wins * first.replicates as f64).round();
            text += &format!(", the lowest in {won} of {} replicates", first.replicates);
        }
        text
    }

    /// Whether the preferred model fits, and what speaks against it.
    fn adequacy(&self, (first, fit): (&ComparisonRow, &FitRow)) -> String {
        let FitRow { adequate, lack_of_fit, lack_of_fit_limit, .. } = fit;
        let ratio = known([*lack_of_fit, *lack_of_fit_limit], |[ratio, limit]| {
            format!("J is {ratio:.2} times what noise alone leaves, limit {limit:.2}")
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
            // Said at the beginning.
            Some(false) => String::new(),
            None => format!("whether it fits is not known, since {}", why_unknown(first)),
        };
        let said = match (&*verdict, &*reasons) {
            ("", one) | (one, "") => one.to_owned(),
            (verdict, reasons) if adequate.is_none() => format!("{verdict}: {reasons}"),
            (verdict, reasons) => format!("{verdict} ({reasons})"),
        };
        let cause = first.contradiction.as_ref().filter(|_| *adequate != Some(true));
        let cause = cause.map(|cause| cause.sentence(first.model));
        [Some(said), cause].into_iter().flatten().map(clause).collect()
    }

    /// What the preferred model predicts, against the one that predicts it best.
    fn predictions(&self, first: &ComparisonRow) -> String {
        let is_alike = |ours: f64, best: f64| ours <= (1.0 + ALIKE) * best;
        let left_out = self.lowest(|row| row.j_left_out).map_or(String::new(), |(best, _)| {
            let other = best.model;
            known([first.j_left_out, best.j_left_out], |[ours, least]| match () {
                () if other == first.model => {
                    format!("it predicts left-out frequencies best ({least:.4})")
                }
                () if is_alike(ours, least) => format!(
                    "it predicts left-out frequencies as well as {other} ({ours:.4} and {least:.4})"
                ),
                () => format!(
                    "left-out frequencies are predicted better by {other} ({least:.4} against \
                     {ours:.4})"
                ),
            })
        });
        let extrapolated =
            self.lowest(|row| row.j_extrapolated).map_or(String::new(), |(best, _)| {
                let numbers =
                    [first.j_extrapolated, best.j_extrapolated, best.extrapolated_above_rad_s];
                known(numbers, |[ours, least, above_rad_s]| match is_alike(ours, least) {
                    true => String::new(),
                    false => format!(
                        "fitted up to {above_rad_s} rad/s, frequencies above are predicted better by {} \
                     ({least:.4} against {ours:.4})",
                        best.model
                    ),
                })
            });
        [left_out, extrapolated].map(clause).concat()
    }
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

/// What a sentence goes on with, if anything.
fn clause(text: String) -> String {
    if text.is_empty() { text } else { format!("; {text}") }
}

/// Why it is not known whether a model fits.
fn why_unknown(row: &ComparisonRow) -> String {
    let filtered = match (row.terms <= row.free, row.trials_filtered) {
        (true, _) => return "there are no more measurements than free coefficients".to_owned(),
        (false, 0) => return "nothing tells the noise".to_owned(),
        (false, 1) => "1 trial was".to_owned(),
        (false, several) => format!("{several} trials were"),
    };
    format!(
        "{filtered} filtered before the export (W026: export unfiltered), so that nothing tells the noise"
    )
}
