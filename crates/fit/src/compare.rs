//! Which of a campaign's models the measurements prefer, and by how much.

use trilink_base::text::known;
use trilink_robot::Model;
use trilink_tables::{ComparisonRow, FitRow, Misfit};

use super::Fitted;
use super::resampler::Resampler;
use super::tell_apart::{Noise, Tell};

/// Part of the replicates from which on a model is clearly preferred.
const CLEARLY: f64 = 0.95;

/// Predictions whose objectives differ by less than this part are as good as each other.
const ALIKE: f64 = 0.05;

/// Completes the rows of a comparison of a campaign, with so many trials `without` metrics, by what needs all
/// of its models. Where none is known to fit, what `contradicts` the configuration by the nearest one is said.
pub(super) fn complete(
    models: &mut [Fitted],
    without: usize,
    resampler: &Resampler,
    replicates: usize,
    contradicts: impl Fn(Model) -> Option<String>,
) {
    let criteria =
        |model: &Fitted| model.bootstrap.iter().map(|row| row.criterion_resampled).collect();
    let frequencies = selection_frequencies(&models.iter().map(criteria).collect::<Vec<_>>());
    for (model, frequency) in models.iter_mut().zip(frequencies) {
        model.comparison.iter_mut().for_each(|row| row.wins = frequency);
    }
    let both = models.iter().flat_map(|model| model.comparison.iter().zip(&model.fits));
    let ranked = ranked(both.collect());
    let preferred = ranked.first().map(|(row, _)| row.model);
    let filtered = resampler.measurements.iter().filter(|of| of.is_filtered).count();
    let sentence = fitted_to(resampler.measurements.len(), without)
        + &sentence(&ranked, replicates, filtered, contradicts);
    let is_preferred = |model: &&Fitted| model.fits.iter().any(|fit| Some(fit.model) == preferred);
    let best = models.iter().find(is_preferred).map_or(&[][..], |best| &best.predictions);
    let noise = Noise::new(resampler);
    let tell = |model: &Fitted| noise.tell(best, &model.predictions);
    let tells: Vec<Option<Tell>> = models.iter().map(tell).collect();
    for (model, tell) in models.iter_mut().zip(tells) {
        for row in &mut model.comparison {
            row.sentence.clone_from(&sentence);
            row.preferred = Some(row.model) == preferred;
            // Rows of a former run may have one from when another model was preferred.
            let tell = tell.as_ref().filter(|_| !row.preferred);
            row.tell_omega_rad_s = tell.map_or(f64::NAN, |tell| tell.omega_rad_s);
            row.tell_metric = tell.map_or("", |tell| tell.metric).to_owned();
            row.tell_standard_errors = tell.map_or(f64::NAN, |tell| tell.standard_errors);
        }
    }
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

/// A model as it compares with the others, and as it was fitted.
type Candidate<'f> = (&'f ComparisonRow, &'f FitRow);

/// How a model fits: it does, that is not known, it does not.
fn rank(fit: &FitRow) -> usize {
    [Some(true), None].iter().position(|adequate| *adequate == fit.adequate).unwrap_or(2)
}

/// The models that have a fit, the preferred one first: those that fit before others, and by their
/// criterion.
fn ranked(mut models: Vec<Candidate>) -> Vec<Candidate> {
    models.retain(|(row, _)| row.criterion.is_finite());
    models.sort_by(|(a, fit_a), (b, fit_b)| {
        rank(fit_a).cmp(&rank(fit_b)).then(a.criterion.total_cmp(&b.criterion))
    });
    models
}

/// Models that fit as well as the preferred one, and have the lowest criterion in so many replicates
/// that it is not clearly so; none where it is.
fn rivals<'f>(ranked: &[Candidate<'f>]) -> Vec<&'f ComparisonRow> {
    let Some((&(_, fit), others)) = ranked.split_first() else { return Vec::new() };
    let rivals = others.iter().filter(|(row, other)| rank(other) == rank(fit) && row.wins > 0.0);
    let rivals: Vec<&ComparisonRow> = rivals.map(|(row, _)| *row).collect();
    let wins: f64 = rivals.iter().map(|row| row.wins).sum();
    if wins <= 1.0 - CLEARLY { Vec::new() } else { rivals }
}

/// Of one campaign's rows: the preferred model and after it those that it is not told apart from; none
/// without a fit.
pub fn preferred(comparison: &[ComparisonRow], fits: &[FitRow]) -> Vec<Model> {
    let fit_of = |row: &ComparisonRow| fits.iter().find(|fit| fit.model == row.model);
    let both = comparison.iter().filter_map(|row| Some((row, fit_of(row)?)));
    let ranked = ranked(both.collect());
    let first = ranked.first().map(|(row, _)| *row).into_iter();
    first.chain(rivals(&ranked)).map(|row| row.model).collect()
}

/// Of how many of its trials a campaign's fits are, if not of all.
fn fitted_to(measured: usize, without: usize) -> String {
    match (measured, without) {
        (0, _) | (_, 0) => String::new(),
        _ => {
            let trials = measured + without;
            format!("Fitted to {measured} of {trials} trials: the others have no metrics. ")
        }
    }
}

/// Why the noise is unknown if trials are filtered.
fn filtered_why(filtered: usize) -> String {
    let trials = match filtered {
        1 => "1 trial was".to_owned(),
        several => format!("{several} trials were"),
    };
    format!(
        "{trials} filtered before the export (W026: export unfiltered), so that nothing tells the noise"
    )
}

/// The outcome of a campaign's comparison, in a sentence; so many of its trials are filtered.
fn sentence(
    ranked: &[Candidate],
    replicates: usize,
    filtered: usize,
    contradicts: impl Fn(Model) -> Option<String>,
) -> String {
    let Some(&(first, fit)) = ranked.first() else {
        return "No model of this campaign has a fit.".to_owned();
    };
    let lowest = |value: fn(&ComparisonRow) -> f64| {
        let known = ranked.iter().filter(|(row, _)| !value(row).is_nan());
        known.min_by(|(a, _), (b, _)| value(a).total_cmp(&value(b)))
    };
    let rivals = rivals(ranked);
    let is_clear = rivals.is_empty();
    let nearer = lowest(|row| row.criterion).filter(|(row, _)| row.model != first.model);
    let model = first.model;
    let mut text = match (rank(fit), nearer) {
        _ if ranked.len() == 1 => format!("Only {model} has a fit"),
        (2, _) => format!("None fits; {model} is the best of those"),
        (0, Some((nearer, fit))) => {
            let whether = if rank(fit) == 2 { "does not fit" } else { "may not fit" };
            format!("The data fit {model}; {} is nearer and {whether}", nearer.model)
        }
        (_, Some((nearer, _))) => {
            format!("{model} is nearest of those that may fit; {} does not fit", nearer.model)
        }
        _ if is_clear => format!("The data prefer {model}"),
        _ => format!("The data do not clearly prefer one model; {model} is nearest"),
    };
    if !is_clear {
        let names: Vec<&str> = rivals.iter().map(|row| row.model.name()).collect();
        text += &format!(" and not told apart from {}", names.join(", "));
    }
    text += &known([first.j], |[j]| format!(": J = {j:.4}"));
    if let Some((second, _)) = ranked.get(1) {
        let numbers = [first.criterion, second.criterion, second.j];
        text += &known(numbers, |[ours, other, j]| {
            format!(
                " with {} free, criterion {ours:.1} against {other:.1} of {} (J = {j:.4} with {})",
                first.free, second.model, second.free
            )
        });
    }
    if first.wins.is_finite() && ranked.len() > 1 {
        let won = (first.wins * replicates as f64).round();
        text += &format!(", the lowest in {won} of {replicates} replicates");
    }
    let FitRow { lack_of_fit, lack_of_fit_limit, .. } = fit;
    let misfit = fit.misfit.as_ref().map_or(String::new(), Misfit::to_string);
    let ratio = known([*lack_of_fit, *lack_of_fit_limit], |[ratio, limit]| {
        format!(
            "J is {ratio:.2} times what noise alone leaves, of which up to {limit:.2} would be noise"
        )
    });
    let reasons = match fit.adequate {
        Some(true) => vec![ratio],
        Some(false) => vec![ratio, misfit],
        None => vec![misfit],
    };
    let reasons =
        reasons.into_iter().filter(|reason| !reason.is_empty()).collect::<Vec<_>>().join("; ");
    let verdict = match fit.adequate {
        Some(true) => "it fits".to_owned(),
        Some(false) if ranked.len() == 1 => "it does not fit".to_owned(),
        // Said at the beginning.
        Some(false) => String::new(),
        None => {
            let why = match (first.terms <= first.free, filtered) {
                (true, _) => "there are no more measurements than free coefficients".to_owned(),
                (false, 0) => "nothing tells the noise".to_owned(),
                (false, filtered) => filtered_why(filtered),
            };
            format!("whether it fits is not known, since {why}")
        }
    };
    text += &match (&*verdict, &*reasons) {
        ("", "") => String::new(),
        ("", one) | (one, "") => format!("; {one}"),
        (verdict, reasons) if fit.adequate.is_none() => format!("; {verdict}: {reasons}"),
        (verdict, reasons) => format!("; {verdict} ({reasons})"),
    };
    let cause = contradicts(model).filter(|_| fit.adequate != Some(true));
    text += &cause.map_or(String::new(), |cause| format!("; {cause}"));
    if ranked.len() == 1 {
        return text + ".";
    }
    let is_alike = |ours: f64, best: f64| ours <= (1.0 + ALIKE) * best;
    if let Some((best, _)) = lowest(|row| row.j_left_out) {
        text += &known([first.j_left_out, best.j_left_out], |[ours, least]| match best.model {
            _ if best.model == model => {
                format!("; it predicts left-out frequencies best ({least:.4})")
            }
            other if is_alike(ours, least) => format!(
                "; it predicts left-out frequencies as well as {other} ({ours:.4} and {least:.4})"
            ),
            other => format!(
                "; left-out frequencies are predicted better by {other} ({least:.4} against \
                 {ours:.4})"
            ),
        });
    }
    if let Some((best, _)) = lowest(|row| row.j_extrapolated) {
        let numbers = [first.j_extrapolated, best.j_extrapolated, best.extrapolated_above_rad_s];
        text += &known(numbers, |[ours, least, above_rad_s]| match is_alike(ours, least) {
            true => String::new(),
            false => format!(
                "; fitted up to {above_rad_s} rad/s, what is above is predicted better by {} \
                 ({least:.4} against {ours:.4})",
                best.model
            ),
        });
    }
    text + "."
}

#[cfg(test)]
mod tests {
    use trilink_mechanics::Model;
    use trilink_tables::{Columns as _, MisfitRms, MisfitRun, Side};

    use super::*;

    const CAUSE: &str = "push measures twice what is configured";

    fn row(model: Model, j: f64, j_left_out: f64, wins: f64) -> ComparisonRow {
        let criterion = 100.0 * j.ln();
        let (free, terms) = (3, 12);
        let blank = ComparisonRow::blank();
        ComparisonRow { model, j, j_left_out, wins, criterion, free, terms, ..blank }
    }

    fn of(rows: &[ComparisonRow], adequate: &[Option<bool>]) -> String {
        let fit = |adequate: &Option<bool>| FitRow {
            adequate: *adequate,
            lack_of_fit: if *adequate == Some(true) { 1.1 } else { 12.0 },
            lack_of_fit_limit: 1.5,
            misfit: match adequate {
                Some(_) => Misfit::off(vec![MisfitRun {
                    side: Side::Above,
                    metric: "d".to_owned(),
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
        sentence(&ranked(rows.iter().zip(&fits).collect()), 200, 0, |_| Some(CAUSE.to_owned()))
    }

    #[test]
    fn a_clear_winner_that_fits_is_preferred() {
        let rows = [row(Model::SKID, 0.4, 0.5, 0.02), row(Model::SKID_ROLL, 0.3, 0.35, 0.98)];
        assert_eq!(
            of(&rows, &[Some(false), Some(true)]),
            "The data prefer skid-roll: J = 0.3000 with 3 free, criterion -120.4 against -91.6 of \
             skid (J = 0.4000 with 3), the lowest in 196 of 200 replicates; it fits (J is 1.10 \
             times what noise alone leaves, of which up to 1.50 would be noise); it predicts \
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
                "; J is 12.00 times what noise alone leaves, of which up to 1.50 would be noise; d \
                 is measured 7.0 to 119 % above the model at 4.5 to 6 rad/s; push measures twice \
                 what is configured; it predicts"
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
                "The data do not clearly prefer one model; skid-roll is nearest and not told \
                 apart from skid: J = 0.3000"
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
        let none = "None fits; skid-roll is the best of those and not told apart from skid: J";
        assert!(text.starts_with(none), "{text}");
    }

    #[test]
    fn what_is_preferred_is_named_with_what_it_is_not_told_apart_from() {
        let rows = [row(Model::SKID, 0.31, 0.33, 0.4), row(Model::SKID_ROLL, 0.30, 0.35, 0.6)];
        let of = |adequate: [bool; 2]| {
            let fit = |(row, adequate): (&ComparisonRow, bool)| FitRow {
                model: row.model,
                adequate: Some(adequate),
                ..FitRow::blank()
            };
            preferred(&rows, &rows.iter().zip(adequate).map(fit).collect::<Vec<_>>())
        };
        assert_eq!(of([true; 2]), [Model::SKID_ROLL, Model::SKID]);
        assert_eq!(of([false, true]), [Model::SKID_ROLL]);
        assert_eq!(of([true, false]), [Model::SKID]);
        assert!(preferred(&rows, &[]).is_empty());
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
        let extrapolated = "; fitted up to 4.5 rad/s, what is above is predicted better by \
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
                    let text =
                        sentence(&ranked(rows.iter().zip(&fits).collect()), 200, 0, |_| None);
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
        let ranked = ranked(rows.iter().zip(&fits).collect());
        for (filtered, why) in [
            (0, "since nothing tells the noise"),
            (1, "since 1 trial was filtered before the export (W026: "),
            (4, "since 4 trials were filtered before the export (W026: "),
        ] {
            let text = sentence(&ranked, 200, filtered, |_| None);
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
             the noise: the model is off by 12 % in d (RMS); push measures twice what is configured."
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
        let text = "Fitted to 1 of 13 trials: the others have no metrics. ";
        assert_eq!([0, 1, 13].map(|measured| fitted_to(measured, 13 - measured)), ["", text, ""]);
    }
}
