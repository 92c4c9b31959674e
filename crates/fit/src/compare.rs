//! Model selection within a campaign, and the clarity of the preference.

use trilink_robot::Model;
use trilink_tables::{ComparisonRow, Contradiction, FitRow, Outcome};

use super::Fitted;
use super::discrimination::{DiscriminatingTrial, NoiseModel};
use super::resampler::Resampler;

/// Minimum fraction of the bootstrap replicates that must select no rival of the preferred model (another model that is
/// equally adequate) for the preference to count as clear.
const CLEAR_SHARE: f64 = 0.95;

/// Completes the comparison rows of a campaign with the columns that need all of its models, and with the
/// `contradiction` for each model. `without_metrics` is the number of trials without metrics.
pub(super) fn complete(
    models: &mut [Fitted],
    without_metrics: usize,
    resampler: &Resampler,
    replicates: usize,
    contradiction: impl Fn(Model) -> Option<Contradiction>,
) {
    let criteria: Vec<Vec<f64>> = models
        .iter()
        .map(|model| model.bootstrap.iter().map(|row| row.criterion_resampled).collect())
        .collect();
    let filtered = resampler.measurements.iter().filter(|of| of.is_filtered).count();
    for (model, frequency) in models.iter_mut().zip(selection_frequencies(&criteria)) {
        for row in &mut model.comparison {
            row.wins = frequency;
            row.contradiction = contradiction(row.model);
            row.replicates = replicates as i64;
            row.trials_without_metrics = without_metrics as i64;
            row.trials_filtered = filtered as i64;
        }
    }
    let pairs = models
        .iter_mut()
        .flat_map(|Fitted { comparison, fits, .. }| comparison.iter_mut().zip(&*fits));
    rank(pairs.collect());
    let preferred = models.iter().find(|model| model.comparison.iter().any(|row| row.preferred));
    let predictions = preferred.map_or(&[][..], |preferred| &preferred.predictions);
    let residuals = preferred.map_or(&[][..], |preferred| &preferred.residuals);
    let noise = NoiseModel::from_residuals(residuals);
    let trials: Vec<Option<DiscriminatingTrial>> =
        models.iter().map(|model| noise.best_trial(predictions, &model.predictions)).collect();
    for (model, trial) in models.iter_mut().zip(trials) {
        for row in &mut model.comparison {
            // Rows of an earlier run may contain a trial from when another model was preferred.
            let trial = trial.as_ref().filter(|_| !row.preferred);
            row.tell_omega_rad_s = trial.map_or(f64::NAN, |trial| trial.omega_rad_s);
            row.tell_metric = trial.map_or("", |trial| trial.metric.name()).to_owned();
            row.tell_standard_errors = trial.map_or(f64::NAN, |trial| trial.standard_errors);
        }
    }
}

/// Ranks the models of a campaign, and sets the preferred model, its rivals and the outcome in their rows.
fn rank(mut models: Vec<(&mut ComparisonRow, &FitRow)>) {
    for (row, _) in &mut models {
        row.rank = 0;
        row.preferred = false;
        row.rival = false;
        row.outcome = Outcome::NoFit;
    }
    let (mut models, without_fit): (Vec<_>, Vec<_>) =
        models.into_iter().partition(|(row, _)| row.criterion.is_finite());
    // First by adequacy, then by the criterion.
    models.sort_by(|(a, fit_a), (b, fit_b)| {
        adequacy_rank(fit_a).cmp(&adequacy_rank(fit_b)).then(a.criterion.total_cmp(&b.criterion))
    });
    let Some((first, fit)) = models.first() else { return };
    let best = adequacy_rank(fit);
    let criterion = first.criterion;
    let has_lower = models.iter().any(|(row, _)| row.criterion < criterion);
    // Models with the same adequacy as the preferred model that have the lowest criterion in some replicates.
    let is_rival = |row: &ComparisonRow, fit: &FitRow| adequacy_rank(fit) == best && row.wins > 0.0;
    let others = models.iter().skip(1).filter(|(row, fit)| is_rival(row, fit));
    let is_clear = others.map(|(row, _)| row.wins).sum::<f64>() <= 1.0 - CLEAR_SHARE;
    let outcome = match (best, has_lower) {
        _ if models.len() == 1 => Outcome::OnlyOne,
        (2, _) => Outcome::NoneFits,
        (0, true) => Outcome::FitsAlone,
        (_, true) => Outcome::MayFit,
        _ if is_clear => Outcome::Clear,
        _ => Outcome::Unclear,
    };
    for (nth, (row, fit)) in models.into_iter().enumerate() {
        row.rank = nth as i64 + 1;
        row.preferred = nth == 0;
        row.outcome = outcome;
        row.rival = nth > 0 && !is_clear && is_rival(row, fit);
    }
    without_fit.into_iter().for_each(|(row, _)| row.outcome = outcome);
}

/// Returns the selection frequency of each model: the fraction of the replicates in which its criterion is the lowest,
/// divided equally among models with equal criteria. `criteria` has the replicates' criteria for each model. NaN for a
/// model without replicates.
fn selection_frequencies(criteria: &[Vec<f64>]) -> Vec<f64> {
    let replicates = criteria.iter().map(Vec::len).max().unwrap_or(0);
    let mut selected = vec![0.0; criteria.len()];
    for number in 0..replicates {
        let own: Vec<f64> =
            criteria.iter().map(|of| of.get(number).copied().unwrap_or(f64::INFINITY)).collect();
        let lowest = own.iter().copied().fold(f64::INFINITY, f64::min);
        let is_lowest = |criterion: f64| lowest.is_finite() && criterion <= lowest;
        let count = own.iter().filter(|criterion| is_lowest(**criterion)).count();
        for (selected, criterion) in selected.iter_mut().zip(&own) {
            if is_lowest(*criterion) {
                *selected += 1.0 / count as f64;
            }
        }
    }
    let models = selected.into_iter().zip(criteria);
    models
        .map(|(selected, own)| if own.is_empty() { f64::NAN } else { selected / replicates as f64 })
        .collect()
}

/// Ranks the adequacy of a model: 0 if adequate, 1 if unknown, 2 if inadequate.
fn adequacy_rank(fit: &FitRow) -> usize {
    match fit.adequate {
        Some(true) => 0,
        None => 1,
        Some(false) => 2,
    }
}

/// Returns the preferred model of a campaign, followed by the models that cannot be distinguished from it; empty if
/// there is no fit. `comparison` are the campaign's rows.
pub fn preferred(comparison: &[ComparisonRow]) -> Vec<Model> {
    let mut rows: Vec<_> = comparison.iter().filter(|row| row.preferred || row.rival).collect();
    rows.sort_by_key(|row| row.rank);
    rows.into_iter().map(|row| row.model).collect()
}

#[cfg(test)]
mod tests {
    use trilink_mechanics::Model;
    use trilink_tables::{
        Columns as _, Comparison, ContradictionKind, Misfit, MisfitRun, Resistance, Side,
        Undecided, UndecidedReason,
    };

    use super::*;
    use trilink_robot::metrics::{GaitMetrics, Metric};

    fn row(model: Model, j: f64, j_left_out: f64, wins: f64) -> ComparisonRow {
        let criterion = 100.0 * j.ln();
        let (free, terms) = (3, 12);
        let blank = ComparisonRow::blank();
        ComparisonRow { model, j, j_left_out, wins, criterion, free, terms, ..blank }
    }

    /// Returns the rows and fits after ranking by [`rank`].
    fn ranked(rows: &[ComparisonRow], fits: &[FitRow]) -> (Vec<ComparisonRow>, Vec<FitRow>) {
        let mut rows = rows.to_vec();
        let mut fits = fits.to_vec();
        rows.iter_mut().for_each(|row| row.replicates = 200);
        fits.iter_mut().zip(&rows).for_each(|(fit, row)| fit.model = row.model);
        rank(rows.iter_mut().zip(&fits).collect());
        (rows, fits)
    }

    fn sentence(rows: &[ComparisonRow], fits: &[FitRow]) -> String {
        let (rows, fits) = ranked(rows, fits);
        Comparison::new(&rows, &fits).expect("rows").to_string()
    }

    fn sentence_for(rows: &[ComparisonRow], adequate: &[Option<bool>]) -> String {
        let fit = |adequate: &Option<bool>| FitRow {
            adequate: *adequate,
            undecided: adequate.is_none().then(|| UndecidedReason::UnknownNoise.into()),
            lack_of_fit: if *adequate == Some(true) { 1.1 } else { 12.0 },
            lack_of_fit_limit: 1.5,
            misfit: match adequate {
                Some(_) => Misfit::off(vec![MisfitRun {
                    side: Side::Above,
                    metric: Metric::D,
                    campaign: String::new(),
                    least: 0.07,
                    most: 1.19,
                    largest: -0.59,
                    from_rad_s: 4.5,
                    to_rad_s: 6.0,
                }]),
                None => Misfit::rms(GaitMetrics { d_m: 0.12, ..GaitMetrics::MISSING }.into()),
            },
            ..FitRow::blank()
        };
        let fits: Vec<FitRow> = adequate.iter().map(fit).collect();
        let contradiction = Some(Contradiction {
            kind: ContradictionKind::MissingLaw,
            trial: "push".to_owned(),
            missing: vec![Resistance::DryRoll],
            robot: String::new(),
            quantity: String::new(),
            unit: String::new(),
            measured: f64::NAN,
            configured: f64::NAN,
        });
        let mut rows = rows.to_vec();
        rows.iter_mut().for_each(|row| row.contradiction = contradiction.clone());
        sentence(&rows, &fits)
    }

    #[test]
    fn a_clear_winner_that_fits_is_preferred() {
        let rows = [row(Model::SKID, 0.4, 0.5, 0.02), row(Model::SKID_ROLL, 0.3, 0.35, 0.98)];
        assert_eq!(
            sentence_for(&rows, &[Some(false), Some(true)]),
            "The data prefer skid-roll: J = 0.3000 with 3 free parameters, Schwarz criterion 28.8 lower than that of \
             skid (J = 0.4000 with 3); lowest of all in 196 of 200 replicates; it fits (misfit 1.10 \
             times the noise, limit 1.50); it predicts left-out frequencies best (0.3500)."
        );
    }

    #[test]
    fn a_winner_that_does_not_fit_is_not_preferred() {
        let rows = [row(Model::SKID, 0.4, 0.5, 0.02), row(Model::SKID_ROLL, 0.3, 0.35, 0.98)];
        let none = sentence_for(&rows, &[Some(false), Some(false)]);
        assert!(none.starts_with("No model fits; skid-roll comes closest: J = 0.3000"), "{none}");
        assert!(
            none.contains(
                "; misfit 12.00 times the noise, limit 1.50; the measured d is 7.0 to 119 % above that of the model \
                 at 4.5 \
                 to 6 rad/s; trial push shows dry friction of rolling, which model skid-roll lacks; it predicts"
            ),
            "{none}"
        );
        assert!(!none.contains("prefer") && !none.contains("does not fit"), "{none}");
        let other = sentence_for(&rows, &[Some(true), Some(false)]);
        assert!(
            other
                .starts_with("skid fits; skid-roll has a lower Schwarz criterion but does not fit")
        );
        assert_eq!(other.matches("not fit").count(), 1, "{other}");
        let other = sentence_for(&rows, &[Some(true), None]);
        assert!(
            other.starts_with(
                "skid fits; skid-roll has a lower Schwarz criterion but may not fit: J"
            )
        );
        let other = sentence_for(&rows, &[None, Some(false)]);
        let start = "skid may fit; skid-roll has a lower Schwarz criterion but does not fit: J";
        assert!(other.starts_with(start) && other.contains("is unknown"), "{other}");
    }

    #[test]
    fn models_that_share_the_replicates_are_not_distinguished() {
        let rows = [row(Model::SKID, 0.31, 0.33, 0.4), row(Model::SKID_ROLL, 0.30, 0.35, 0.6)];
        let text = sentence_for(&rows, &[Some(true), Some(true)]);
        assert!(
            text.starts_with(
                "The data do not clearly prefer one model; skid-roll comes closest (not distinguishable from skid): J \
                 = 0.3000"
            ),
            "{text}"
        );
        assert!(text.contains("predicted better by skid (0.3300 against 0.3500)"), "{text}");
        let alike = [row(Model::SKID, 0.31, 0.34, 0.4), rows[1].clone()];
        let text = sentence_for(&alike, &[Some(true), Some(true)]);
        let said = "it predicts left-out frequencies as well as skid (0.3500 and 0.3400)";
        assert!(text.contains(said), "{text}");
        // An inadequate model is not a rival.
        let text = sentence_for(&rows, &[Some(false), Some(true)]);
        assert!(text.starts_with("The data prefer skid-roll: J"), "{text}");
        let text = sentence_for(&rows, &[Some(false), Some(false)]);
        let none = "No model fits; skid-roll comes closest (not distinguishable from skid): J";
        assert!(text.starts_with(none), "{text}");
    }

    #[test]
    fn the_preferred_model_is_named_with_its_rivals() {
        let rows = [row(Model::SKID, 0.31, 0.33, 0.4), row(Model::SKID_ROLL, 0.30, 0.35, 0.6)];
        let preferred_of = |adequate: [bool; 2]| {
            let fits =
                adequate.map(|adequate| FitRow { adequate: Some(adequate), ..FitRow::blank() });
            preferred(&ranked(&rows, &fits).0)
        };
        assert_eq!(preferred_of([true; 2]), [Model::SKID_ROLL, Model::SKID]);
        assert_eq!(preferred_of([false, true]), [Model::SKID_ROLL]);
        assert_eq!(preferred_of([true, false]), [Model::SKID]);
        assert!(preferred(&rows).is_empty());
    }

    #[test]
    fn a_model_with_more_parameters_and_a_lower_j_alone_is_not_preferred() {
        let poorer = ComparisonRow {
            criterion: -200.0,
            j_extrapolated: 0.4,
            extrapolated_above_rad_s: 4.5,
            ..row(Model::SKID_ROLL, 0.31, 0.33, 0.97)
        };
        let richer =
            ComparisonRow { free: 6, criterion: -190.0, j_extrapolated: 0.3, ..poorer.clone() };
        let richer = ComparisonRow { wins: 0.03, ..richer };
        let richer = ComparisonRow { model: Model::new("coulomb-viscous"), j: 0.29, ..richer };
        let text = sentence_for(&[richer.clone(), poorer.clone()], &[Some(true), Some(true)]);
        let start = "The data prefer skid-roll: J = 0.3100 with 3 free parameters, Schwarz criterion 10.0 lower than \
                     that of coulomb-viscous (J = 0.2900 with 6)";
        assert!(text.starts_with(start), "{text}");
        let extrapolated = "; if only frequencies up to 4.5 rad/s are fitted, coulomb-viscous predicts higher \
                            frequencies better (0.3000 against 0.4000)";
        assert!(text.contains(extrapolated), "{text}");
        let trivially = ComparisonRow { j_extrapolated: 0.39, ..richer };
        let text = sentence_for(&[trivially, poorer], &[Some(true), Some(true)]);
        assert!(!text.contains("if only frequencies up to"), "{text}");
    }

    #[test]
    fn models_that_were_not_extrapolated_are_not_compared_by_extrapolation() {
        let other = ComparisonRow {
            j_extrapolated: 4.2379,
            extrapolated_above_rad_s: 4.5,
            ..row(Model::SKID, 0.4, 0.5, 0.02)
        };
        let rows = [other, row(Model::SKID_ROLL, 0.3, f64::NAN, 0.98)];
        let text = sentence_for(&rows, &[Some(false), Some(true)]);
        assert!(!text.contains("NaN") && !text.contains("predicted"), "{text}");
    }

    #[test]
    fn a_sentence_leaves_out_missing_numbers() {
        let rows = [row(Model::SKID, 0.4, 0.5, 0.4), row(Model::SKID_ROLL, 0.3, 0.35, 0.6)];
        let extrapolated = |(nth, row): (usize, ComparisonRow)| ComparisonRow {
            j_extrapolated: 1.0 - 0.1 * nth as f64,
            extrapolated_above_rad_s: 4.5,
            ..row
        };
        let rows: Vec<ComparisonRow> = rows.into_iter().enumerate().map(extrapolated).collect();
        let all = [Some(true), Some(false), None];
        for adequate in all.into_iter().flat_map(|one| all.map(|other| [one, other])) {
            for part in 0..8 {
                for lacking in 0..2 {
                    let mut rows = rows.clone();
                    let ComparisonRow {
                        j,
                        criterion,
                        wins,
                        j_left_out,
                        j_extrapolated,
                        extrapolated_above_rad_s,
                        ..
                    } = &mut rows[lacking];
                    if let Some(number) =
                        [j, criterion, wins, j_left_out, j_extrapolated, extrapolated_above_rad_s]
                            .into_iter()
                            .nth(part)
                    {
                        *number = f64::NAN;
                    }
                    let mut fits = adequate.map(|adequate| FitRow {
                        adequate,
                        lack_of_fit: 1.1,
                        lack_of_fit_limit: 1.5,
                        ..FitRow::blank()
                    });
                    match part {
                        6 => fits[lacking].lack_of_fit = f64::NAN,
                        7 => fits[lacking].lack_of_fit_limit = f64::NAN,
                        _ => {}
                    }
                    let text = sentence(&rows, &fits);
                    let is_whole = !text.contains("NaN")
                        && ["; ;", ";.", ": ;", "()", "  "].iter().all(|gap| !text.contains(gap));
                    assert!(is_whole, "{part} {lacking} {adequate:?}: {text}");
                }
            }
        }
    }

    #[test]
    fn with_filtered_trials_the_adequacy_is_not_known() {
        let rows = [row(Model::SKID, 0.4, 0.5, 0.02), row(Model::SKID_ROLL, 0.3, 0.35, 0.98)];
        let filtered = Undecided::new(UndecidedReason::Filtered, "1 of 4 trials");
        let repeats = Undecided::new(UndecidedReason::NoRepeats, "2.00 rad/s");
        for (why, text) in [
            (None, "whether it fits is unknown"),
            (
                Some(UndecidedReason::FewMeasurements.into()),
                "because there are no more measurements than free",
            ),
            (
                Some(filtered),
                "because coordinates were filtered before the export in 1 of 4 trials (W026: ",
            ),
            (Some(repeats), "by as much; repeated trials at 2.00 rad/s would show whether they do"),
        ] {
            let fit = FitRow { undecided: why, ..FitRow::blank() };
            let found = sentence(&rows, &[fit.clone(), fit]);
            assert!(found.contains(text) && !found.contains("it fits ("), "{found}");
        }
    }

    #[test]
    fn a_model_without_a_fit_does_not_compete() {
        let rows =
            [row(Model::NO_SKID, f64::NAN, f64::NAN, f64::NAN), row(Model::SKID, 0.3, 0.4, 1.0)];
        assert_eq!(
            sentence_for(&rows, &[None, None]),
            "Only skid has been fitted: J = 0.3000; whether it fits is unknown, because the noise is unknown: the RMS \
             error of the model is 12 % in d; trial push shows dry friction of rolling, which model skid lacks."
        );
        assert!(sentence_for(&rows, &[None, Some(false)]).contains("it does not fit"));
        assert_eq!(sentence_for(&rows[..1], &[None]), "No model could be fitted to this campaign.");
    }

    #[test]
    fn each_replicate_selects_the_lowest_criterion() {
        let selected = selection_frequencies(&[
            vec![1.0, 2.0, 3.0, 1.0],
            Vec::new(),
            vec![2.0, 1.0, 2.0, 2.0],
        ]);
        assert_eq!((selected[0], selected[2]), (0.5, 0.5));
        assert!(selected[1].is_nan());
        assert!(selection_frequencies(&[Vec::new(), Vec::new()]).iter().all(|of| of.is_nan()));
        // Models that pass through all measurements are equal, and a model without a fit is never selected.
        let equal = vec![-130.0, -130.0];
        let none = vec![f64::INFINITY, f64::NAN];
        assert_eq!(selection_frequencies(&[equal.clone(), equal, none.clone()]), [0.5, 0.5, 0.0]);
        assert_eq!(selection_frequencies(&[none]), [0.0]);
    }

    #[test]
    fn fits_to_some_of_the_trials_say_so() {
        let starts = [0, 1, 13].map(|trials| {
            let fit = FitRow { trials, ..FitRow::blank() };
            let trials_without_metrics = 13 - trials;
            let row = ComparisonRow { trials_without_metrics, ..row(Model::SKID, 0.3, 0.4, 1.0) };
            sentence(&[row], &[fit]).split(" has ").next().map(str::to_owned)
        });
        let all = "Only skid";
        let some = "Fitted to 1 of 13 trials: the others have no metrics. Only skid";
        assert_eq!(starts.each_ref().map(Option::as_deref), [Some(all), Some(some), Some(all)]);
    }
}
