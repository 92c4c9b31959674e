//! Which of a campaign's models the measurements prefer, and by how much.

use trilink_robot::Model;
use trilink_tables::{ComparisonRow, Contradiction, FitRow, Outcome};

use super::Fitted;
use super::resampler::Resampler;
use super::tell_apart::{Noise, Tell};

/// Part of the replicates from which on a model is clearly preferred.
const CLEARLY: f64 = 0.95;

/// Completes the rows of a comparison of a campaign, with so many trials `without` metrics, by what needs all
/// of its models, and by what `contradicts` each.
pub(super) fn complete(
    models: &mut [Fitted],
    without: usize,
    resampler: &Resampler,
    replicates: usize,
    contradicts: impl Fn(Model) -> Option<Contradiction>,
) {
    let criteria =
        |model: &Fitted| model.bootstrap.iter().map(|row| row.criterion_resampled).collect();
    let frequencies = selection_frequencies(&models.iter().map(criteria).collect::<Vec<_>>());
    let filtered = resampler.measurements.iter().filter(|of| of.is_filtered).count();
    for (model, frequency) in models.iter_mut().zip(frequencies) {
        for row in &mut model.comparison {
            row.wins = frequency;
            row.contradiction = contradicts(row.model);
            row.replicates = replicates as i64;
            row.trials_without_metrics = without as i64;
            row.trials_filtered = filtered as i64;
        }
    }
    let both = models
        .iter_mut()
        .flat_map(|Fitted { comparison, fits, .. }| comparison.iter_mut().zip(&*fits));
    judge(both.collect());
    let is_preferred = |model: &&Fitted| model.comparison.iter().any(|row| row.preferred);
    let best = models.iter().find(is_preferred).map_or(&[][..], |best| &best.predictions);
    let noise = Noise::new(resampler);
    let tell = |model: &Fitted| noise.tell(best, &model.predictions);
    let tells: Vec<Option<Tell>> = models.iter().map(tell).collect();
    for (model, tell) in models.iter_mut().zip(tells) {
        for row in &mut model.comparison {
            // Rows of a former run may have one from when another model was preferred.
            let tell = tell.as_ref().filter(|_| !row.preferred);
            row.tell_omega_rad_s = tell.map_or(f64::NAN, |tell| tell.omega_rad_s);
            row.tell_metric = tell.map_or("", |tell| tell.metric.name()).to_owned();
            row.tell_standard_errors = tell.map_or(f64::NAN, |tell| tell.standard_errors);
        }
    }
}

/// Says of the rows of a campaign which model is preferred, and how clearly.
fn judge(mut models: Vec<(&mut ComparisonRow, &FitRow)>) {
    for (row, _) in &mut models {
        (row.rank, row.preferred, row.rival) = (0, false, false);
        row.outcome = Outcome::NoFit;
    }
    let (mut models, without_fit): (Vec<_>, Vec<_>) =
        models.into_iter().partition(|(row, _)| row.criterion.is_finite());
    // Those that fit before others, and by their criterion.
    models.sort_by(|(a, fit_a), (b, fit_b)| {
        adequacy_rank(fit_a).cmp(&adequacy_rank(fit_b)).then(a.criterion.total_cmp(&b.criterion))
    });
    let Some((first, fit)) = models.first() else { return };
    let (best, criterion) = (adequacy_rank(fit), first.criterion);
    let has_nearer = models.iter().any(|(row, _)| row.criterion < criterion);
    // Models that fit as well as the preferred one, and have the lowest criterion in so many replicates
    // that it is not clearly so.
    let is_rival = |row: &ComparisonRow, fit: &FitRow| adequacy_rank(fit) == best && row.wins > 0.0;
    let others = models.iter().skip(1).filter(|(row, fit)| is_rival(row, fit));
    let is_clear = others.map(|(row, _)| row.wins).sum::<f64>() <= 1.0 - CLEARLY;
    let outcome = match (best, has_nearer) {
        _ if models.len() == 1 => Outcome::OnlyOne,
        (2, _) => Outcome::NoneFits,
        (0, true) => Outcome::FitsAlone,
        (_, true) => Outcome::MayFit,
        _ if is_clear => Outcome::Clear,
        _ => Outcome::Unclear,
    };
    for (nth, (row, fit)) in models.into_iter().enumerate() {
        (row.rank, row.preferred, row.outcome) = (nth as i64 + 1, nth == 0, outcome);
        row.rival = nth > 0 && !is_clear && is_rival(row, fit);
    }
    without_fit.into_iter().for_each(|(row, _)| row.outcome = outcome);
}

/// Selection frequency of each model: the part of the replicates in which its criterion is the
/// lowest, of which models that are equal have equal parts; `criteria` are those of all models'
/// replicates. Missing without any.
fn selection_frequencies(criteria: &[Vec<f64>]) -> Vec<f64> {
    let replicates = criteria.iter().map(Vec::len).max().unwrap_or(0);
    let mut won = vec![0.0; criteria.len()];
    for number in 0..replicates {
        let at = |of: &Vec<f64>| of.get(number).copied().unwrap_or(f64::INFINITY);
        let lowest = criteria.iter().map(at).fold(f64::INFINITY, f64::min);
        let first = |of: &Vec<f64>| lowest.is_finite() && at(of) <= lowest;
        let share = 1.0 / criteria.iter().filter(|of| first(of)).count() as f64;
        let winners = won.iter_mut().zip(criteria).filter(|(_, of)| first(of));
        winners.for_each(|(won, _)| *won += share);
    }
    let part = |(won, of): (f64, &Vec<f64>)| match of.is_empty() {
        true => f64::NAN,
        false => won / replicates as f64,
    };
    won.into_iter().zip(criteria).map(part).collect()
}

/// How a model fits: it does, that is not known, it does not.
fn adequacy_rank(fit: &FitRow) -> usize {
    [Some(true), None].iter().position(|adequate| *adequate == fit.adequate).unwrap_or(2)
}

/// Of one campaign's rows: the preferred model and after it those that it is not told apart from; none
/// without a fit.
pub fn preferred(comparison: &[ComparisonRow]) -> Vec<Model> {
    let mut rows: Vec<_> = comparison.iter().filter(|row| row.preferred || row.rival).collect();
    rows.sort_by_key(|row| row.rank);
    rows.into_iter().map(|row| row.model).collect()
}

#[cfg(test)]
mod tests {
    use trilink_mechanics::Model;
    use trilink_tables::{
        Columns as _, Comparison, ContradictionKind, Misfit, MisfitRms, MisfitRun, Resistance, Side,
    };

    use super::*;
    use trilink_robot::metrics::Metric;

    fn row(model: Model, j: f64, j_left_out: f64, wins: f64) -> ComparisonRow {
        let criterion = 100.0 * j.ln();
        let (free, terms) = (3, 12);
        let blank = ComparisonRow::blank();
        ComparisonRow { model, j, j_left_out, wins, criterion, free, terms, ..blank }
    }

    /// The rows and fits as [`judge`] leaves them.
    fn judged(rows: &[ComparisonRow], fits: &[FitRow]) -> (Vec<ComparisonRow>, Vec<FitRow>) {
        let (mut rows, mut fits) = (rows.to_vec(), fits.to_vec());
        rows.iter_mut().for_each(|row| row.replicates = 200);
        fits.iter_mut().zip(&rows).for_each(|(fit, row)| fit.model = row.model);
        judge(rows.iter_mut().zip(&fits).collect());
        (rows, fits)
    }

    fn sentence(rows: &[ComparisonRow], fits: &[FitRow]) -> String {
        let (rows, fits) = judged(rows, fits);
        Comparison::new(&rows, &fits).expect("rows").to_string()
    }

    fn of(rows: &[ComparisonRow], adequate: &[Option<bool>]) -> String {
        let fit = |adequate: &Option<bool>| FitRow {
            adequate: *adequate,
            lack_of_fit: if *adequate == Some(true) { 1.1 } else { 12.0 },
            lack_of_fit_limit: 1.5,
            misfit: match adequate {
                Some(_) => Misfit::off(vec![MisfitRun {
                    side: Side::Above,
                    metric: Metric::D,
                    campaign: String::new(),
                    least: 0.07,
                    most: 1.19,
                    from_rad_s: 4.5,
                    to_rad_s: 6.0,
                }]),
                None => Misfit::rms(MisfitRms { d: 0.12, ..MisfitRms::blank() }),
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
        let told = |row: &ComparisonRow| ComparisonRow {
            contradiction: contradiction.clone(),
            ..row.clone()
        };
        sentence(&rows.iter().map(told).collect::<Vec<_>>(), &fits)
    }

    #[test]
    fn a_clear_winner_that_fits_is_preferred() {
        let rows = [row(Model::SKID, 0.4, 0.5, 0.02), row(Model::SKID_ROLL, 0.3, 0.35, 0.98)];
        assert_eq!(
            of(&rows, &[Some(false), Some(true)]),
            "The data prefer skid-roll: J = 0.3000 with 3 free, criterion -120.4 against -91.6 of \
             skid (J = 0.4000 with 3), the lowest in 196 of 200 replicates; it fits (J is 1.10 \
             times what noise alone leaves, limit 1.50); it predicts \
             left-out frequencies best (0.3500)."
        );
    }

    #[test]
    fn a_winner_that_does_not_fit_is_not_preferred() {
        let rows = [row(Model::SKID, 0.4, 0.5, 0.02), row(Model::SKID_ROLL, 0.3, 0.35, 0.98)];
        let none = of(&rows, &[Some(false), Some(false)]);
        assert!(
            none.starts_with("None fits; skid-roll is the best of those: J = 0.3000"),
            "{none}"
        );
        assert!(
            none.contains(
                "; J is 12.00 times what noise alone leaves, limit 1.50; d \
                 is measured 7.0 to 119 % above the model at 4.5 to 6 rad/s; push shows dry \
                 friction of rolling, and skid-roll has none; it predicts"
            ),
            "{none}"
        );
        assert!(!none.contains("prefer") && !none.contains("does not fit"), "{none}");
        let other = of(&rows, &[Some(true), Some(false)]);
        assert!(other.starts_with("The data fit skid; skid-roll is nearer and does not fit"));
        assert_eq!(other.matches("not fit").count(), 1, "{other}");
        let other = of(&rows, &[Some(true), None]);
        assert!(other.starts_with("The data fit skid; skid-roll is nearer and may not fit: J"));
        let other = of(&rows, &[None, Some(false)]);
        let start = "skid is nearest of those that may fit; skid-roll does not fit: J";
        assert!(other.starts_with(start) && other.contains("is not known"), "{other}");
    }

    #[test]
    fn two_models_that_share_the_replicates_are_not_told_apart() {
        let rows = [row(Model::SKID, 0.31, 0.33, 0.4), row(Model::SKID_ROLL, 0.30, 0.35, 0.6)];
        let text = of(&rows, &[Some(true), Some(true)]);
        assert!(
            text.starts_with(
                "The data do not clearly prefer one model; skid-roll is nearest, not \
                 distinguished from skid: J = 0.3000"
            ),
            "{text}"
        );
        assert!(text.contains("predicted better by skid (0.3300 against 0.3500)"), "{text}");
        let alike = [row(Model::SKID, 0.31, 0.34, 0.4), rows[1].clone()];
        let text = of(&alike, &[Some(true), Some(true)]);
        let said = "it predicts left-out frequencies as well as skid (0.3500 and 0.3400)";
        assert!(text.contains(said), "{text}");
        // Of a model that does not fit it is told apart.
        let text = of(&rows, &[Some(false), Some(true)]);
        assert!(text.starts_with("The data prefer skid-roll: J"), "{text}");
        let text = of(&rows, &[Some(false), Some(false)]);
        let none = "None fits; skid-roll is the best of those, not distinguished from skid: J";
        assert!(text.starts_with(none), "{text}");
    }

    #[test]
    fn what_is_preferred_is_named_with_what_it_is_not_told_apart_from() {
        let rows = [row(Model::SKID, 0.31, 0.33, 0.4), row(Model::SKID_ROLL, 0.30, 0.35, 0.6)];
        let of = |adequate: [bool; 2]| {
            let fits =
                adequate.map(|adequate| FitRow { adequate: Some(adequate), ..FitRow::blank() });
            preferred(&judged(&rows, &fits).0)
        };
        assert_eq!(of([true; 2]), [Model::SKID_ROLL, Model::SKID]);
        assert_eq!(of([false, true]), [Model::SKID_ROLL]);
        assert_eq!(of([true, false]), [Model::SKID]);
        assert!(preferred(&rows).is_empty());
    }

    #[test]
    fn a_richer_model_that_is_nearer_in_j_alone_is_not_preferred() {
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
        let text = of(&[richer.clone(), poorer.clone()], &[Some(true), Some(true)]);
        let start = "The data prefer skid-roll: J = 0.3100 with 3 free, criterion -200.0 against \
                     -190.0 of coulomb-viscous (J = 0.2900 with 6)";
        assert!(text.starts_with(start), "{text}");
        let extrapolated = "; fitted up to 4.5 rad/s, frequencies above are predicted better by \
                            coulomb-viscous (0.3000 against 0.4000)";
        assert!(text.contains(extrapolated), "{text}");
        let trivially = ComparisonRow { j_extrapolated: 0.39, ..richer };
        let text = of(&[trivially, poorer], &[Some(true), Some(true)]);
        assert!(!text.contains("fitted up to"), "{text}");
    }

    #[test]
    fn what_was_not_extrapolated_is_not_compared() {
        let other = ComparisonRow {
            j_extrapolated: 4.2379,
            extrapolated_above_rad_s: 4.5,
            ..row(Model::SKID, 0.4, 0.5, 0.02)
        };
        let rows = [other, row(Model::SKID_ROLL, 0.3, f64::NAN, 0.98)];
        let text = of(&rows, &[Some(false), Some(true)]);
        assert!(!text.contains("NaN") && !text.contains("predicted"), "{text}");
    }

    #[test]
    fn a_sentence_leaves_out_what_is_missing() {
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
    fn of_filtered_trials_it_is_not_known_whether_a_model_fits() {
        let rows = [row(Model::SKID, 0.4, 0.5, 0.02), row(Model::SKID_ROLL, 0.3, 0.35, 0.98)];
        let fits = [FitRow::blank(), FitRow::blank()];
        for (filtered, why) in [
            (0, "since nothing tells the noise"),
            (1, "since 1 trial was filtered before the export (W026: "),
            (4, "since 4 trials were filtered before the export (W026: "),
        ] {
            let filtered_rows =
                rows.clone().map(|row| ComparisonRow { trials_filtered: filtered, ..row });
            let text = sentence(&filtered_rows, &fits);
            assert!(text.contains(why) && !text.contains("it fits ("), "{text}");
            assert_eq!(text.contains("export unfiltered"), filtered > 0, "{text}");
        }
    }

    #[test]
    fn a_model_without_a_fit_does_not_compete() {
        let rows =
            [row(Model::NO_SKID, f64::NAN, f64::NAN, f64::NAN), row(Model::SKID, 0.3, 0.4, 1.0)];
        assert_eq!(
            of(&rows, &[None, None]),
            "Only skid has a fit: J = 0.3000; whether it fits is not known, since nothing tells \
             the noise: the model is off by 12 % in d (RMS); push shows dry friction of rolling, and \
             skid has none."
        );
        let few = [rows[0].clone(), ComparisonRow { terms: 3, ..rows[1].clone() }];
        let text = of(&few, &[None, None]);
        assert!(text.contains("since there are no more measurements than free coefficients"));
        assert!(of(&rows, &[None, Some(false)]).contains("it does not fit"));
        assert_eq!(of(&rows[..1], &[None]), "No model of this campaign has a fit.");
    }

    #[test]
    fn each_replicate_is_won_by_its_lowest_criterion() {
        let won = selection_frequencies(&[
            vec![1.0, 2.0, 3.0, 1.0],
            Vec::new(),
            vec![2.0, 1.0, 2.0, 2.0],
        ]);
        assert_eq!((won[0], won[2]), (0.5, 0.5));
        assert!(won[1].is_nan());
        assert!(selection_frequencies(&[Vec::new(), Vec::new()]).iter().all(|won| won.is_nan()));
        // Models that go through all measurements are equal, and what cannot be fitted wins nothing.
        let (equal, none) = (vec![-130.0, -130.0], vec![f64::INFINITY, f64::NAN]);
        assert_eq!(selection_frequencies(&[equal.clone(), equal, none.clone()]), [0.5, 0.5, 0.0]);
        assert_eq!(selection_frequencies(&[none]), [0.0]);
    }

    #[test]
    fn fits_of_a_part_of_the_trials_say_so() {
        let starts = [0, 1, 13].map(|trials| {
            let fit = FitRow { trials, ..FitRow::blank() };
            let trials_without_metrics = 13 - trials;
            let row = ComparisonRow { trials_without_metrics, ..row(Model::SKID, 0.3, 0.4, 1.0) };
            sentence(&[row], &[fit]).split(" has ").next().map(str::to_owned)
        });
        let all = "Only skid";
        let part = "Fitted to 1 of 13 trials: the others have no metrics. Only skid";
        assert_eq!(starts.each_ref().map(Option::as_deref), [Some(all), Some(part), Some(all)]);
    }
}
