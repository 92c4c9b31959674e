//! Which of a campaign's models the measurements prefer, and by how much.

use super::Fitted;
use crate::store::{ComparisonRow, FitRow};

/// Part of the replicates from which on a model is clearly preferred.
const CLEARLY: f64 = 0.95;

/// Bayesian information criterion (BIC) `2 n ln J + k ln n` of `n` terms and `k` free parameters,
/// of a model whose weighted relative deviations are independent and have one Laplace
/// distribution (the mean absolute deviation is its estimate of scale). They are not independent:
/// d and v are nearly the same number, and a model's misfit is alike at neighbouring frequencies.
/// So only large differences count.
///
/// Reference: G. Schwarz, *Estimating the dimension of a model*, Ann. Statist. 6 (1978).
pub(super) fn bic(j: f64, terms: usize, free: usize) -> f64 {
    let terms = terms as f64;
    2.0 * terms * j.ln() + free as f64 * terms.ln()
}

/// Completes the rows of a campaign's comparison by what needs all of its models.
pub(super) fn complete(models: &mut [Fitted], replicates: usize) {
    let costs = |model: &Fitted| model.bootstrap.iter().map(|row| row.j).collect();
    let frequencies = selection_frequencies(&models.iter().map(costs).collect::<Vec<_>>());
    for (model, frequency) in models.iter_mut().zip(frequencies) {
        model.comparison.iter_mut().for_each(|row| row.wins = frequency);
    }
    let both = models.iter().flat_map(|model| model.comparison.iter().zip(&model.fits));
    let sentence = sentence(&both.collect::<Vec<_>>(), replicates);
    for row in models.iter_mut().flat_map(|model| &mut model.comparison) {
        row.sentence.clone_from(&sentence);
    }
}

/// Selection frequency of each model: the part of the replicates in which its objective is the
/// lowest; `costs` are those of all models' replicates. Missing without any.
fn selection_frequencies(costs: &[Vec<f64>]) -> Vec<f64> {
    let replicates = costs.iter().map(Vec::len).max().unwrap_or(0);
    let lowest = |number: usize| {
        let at = |model: &usize| costs[*model].get(number).copied().unwrap_or(f64::INFINITY);
        (0..costs.len()).min_by(|a, b| at(a).total_cmp(&at(b)))
    };
    let won: Vec<usize> = (0..replicates).filter_map(lowest).collect();
    let part = |(model, costs): (usize, &Vec<f64>)| match costs.is_empty() {
        true => f64::NAN,
        false => won.iter().filter(|won| **won == model).count() as f64 / replicates as f64,
    };
    costs.iter().enumerate().map(part).collect()
}

/// A model as it compares with the others, and as it was fitted.
type Candidate<'f> = (&'f ComparisonRow, &'f FitRow);

/// The outcome of a campaign's comparison, in a sentence.
fn sentence(rows: &[Candidate], replicates: usize) -> String {
    let mut ranked: Vec<&Candidate> = rows.iter().filter(|(row, _)| row.j.is_finite()).collect();
    ranked.sort_by(|(a, _), (b, _)| a.j.total_cmp(&b.j));
    let Some(&&(first, fit)) = ranked.first() else {
        return "No model of this campaign has a fit.".to_owned();
    };
    let lowest = |value: fn(&ComparisonRow) -> f64| {
        let known = ranked.iter().map(|(row, _)| *row).filter(|row| !value(row).is_nan());
        known.min_by(|a, b| value(a).total_cmp(&value(b)))
    };
    let is_clear = first.wins.is_nan() || first.wins >= CLEARLY;
    let fits = ranked.iter().find(|(_, fit)| fit.adequate == Some(true));
    let mut text = match (fit.adequate, fits) {
        _ if ranked.len() == 1 => format!("Only {} has a fit", first.model),
        (Some(false), None) => format!("None fits; {} is the best of those", first.model),
        (Some(false), Some((row, _))) => {
            format!("The data fit {}; {} is nearer and does not fit", row.model, first.model)
        }
        _ if is_clear => format!("The data prefer {}", first.model),
        _ => format!("The data do not clearly prefer one model; {} is nearest", first.model),
    };
    text += &format!(": J = {:.4}", first.j);
    if let Some((second, _)) = ranked.get(1) {
        let below = 100.0 * (1.0 - first.j / second.j);
        text += &format!(", {below:.1} % below that of {} ({:.4})", second.model, second.j);
    }
    if first.wins.is_finite() && ranked.len() > 1 {
        let won = (first.wins * replicates as f64).round();
        text += &format!(", the lowest in {won} of {replicates} replicates");
    }
    let FitRow { lack_of_fit, lack_of_fit_limit, misfit, .. } = fit;
    let ratio = format!(
        "J is {lack_of_fit:.2} times what noise alone leaves, of which up to \
         {lack_of_fit_limit:.2} would be noise"
    );
    text += &match fit.adequate {
        Some(true) => format!("; it fits ({ratio})"),
        Some(false) if ranked.len() == 1 => format!("; it does not fit ({ratio}; {misfit})"),
        // Said at the beginning.
        Some(false) => format!("; {ratio}; {misfit}"),
        None => "; whether it fits is not known, since nothing tells the noise".to_owned(),
    };
    if ranked.len() == 1 {
        return text + ".";
    }
    if let Some(best) = lowest(|row| row.j_left_out) {
        text += &match best.model == first.model {
            true => format!("; it predicts left-out frequencies best ({:.4})", best.j_left_out),
            false => format!(
                "; left-out frequencies are predicted better by {} ({:.4} against {:.4})",
                best.model, best.j_left_out, first.j_left_out
            ),
        };
    }
    if let Some(best) = lowest(|row| row.criterion).filter(|best| best.model != first.model) {
        text += &format!("; with its free parameters counted, {} is preferred", best.model);
    }
    text + "."
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Model;
    use crate::store::Columns as _;

    fn row(model: Model, j: f64, j_left_out: f64, wins: f64) -> ComparisonRow {
        let criterion = bic(j, 60, 3);
        ComparisonRow { model, j, j_left_out, wins, criterion, ..ComparisonRow::blank() }
    }

    fn of(rows: &[ComparisonRow], adequate: &[Option<bool>]) -> String {
        let fit = |adequate: &Option<bool>| FitRow {
            adequate: *adequate,
            lack_of_fit: if *adequate == Some(true) { 1.1 } else { 12.0 },
            lack_of_fit_limit: 1.5,
            misfit: "d is measured 7.0 to 119 % above the model at 4.5 to 6 rad/s".to_owned(),
            ..FitRow::blank()
        };
        let fits: Vec<FitRow> = adequate.iter().map(fit).collect();
        sentence(&rows.iter().zip(&fits).collect::<Vec<_>>(), 200)
    }

    #[test]
    fn a_clear_winner_that_fits_is_preferred() {
        let rows = [row(Model::SKID, 0.4, 0.5, 0.02), row(Model::SKID_ROLL, 0.3, 0.35, 0.98)];
        assert_eq!(
            of(&rows, &[Some(false), Some(true)]),
            "The data prefer skid-roll: J = 0.3000, 25.0 % below that of skid (0.4000), the \
             lowest in 196 of 200 replicates; it fits (J is 1.10 times what noise alone leaves, \
             of which up to 1.50 would be noise); it predicts left-out frequencies best (0.3500)."
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
                 is measured 7.0 to 119 % above the model at 4.5 to 6 rad/s"
            ),
            "{none}"
        );
        assert!(!none.contains("prefer") && !none.contains("does not fit"), "{none}");
        let other = of(&rows, &[Some(true), Some(false)]);
        assert!(other.starts_with("The data fit skid; skid-roll is nearer and does not fit"));
        assert_eq!(other.matches("not fit").count(), 1, "{other}");
    }

    #[test]
    fn two_models_that_share_the_replicates_are_not_told_apart() {
        let rows = [row(Model::SKID, 0.31, 0.33, 0.4), row(Model::SKID_ROLL, 0.30, 0.35, 0.6)];
        let text = of(&rows, &[Some(true), Some(true)]);
        assert!(text.starts_with("The data do not clearly prefer one model; skid-roll is nearest"));
        assert!(text.contains("predicted better by skid (0.3300 against 0.3500)"), "{text}");
    }

    #[test]
    fn a_model_without_a_fit_does_not_compete() {
        let rows =
            [row(Model::NO_SKID, f64::NAN, f64::NAN, f64::NAN), row(Model::SKID, 0.3, 0.4, 1.0)];
        assert_eq!(
            of(&rows, &[None, None]),
            "Only skid has a fit: J = 0.3000; whether it fits is not known, since nothing tells \
             the noise."
        );
        assert!(of(&rows, &[None, Some(false)]).contains("it does not fit"));
        assert_eq!(of(&rows[..1], &[None]), "No model of this campaign has a fit.");
    }

    #[test]
    fn each_replicate_is_won_by_its_lowest_objective() {
        let won = selection_frequencies(&[
            vec![1.0, 2.0, 3.0, 1.0],
            Vec::new(),
            vec![2.0, 1.0, 2.0, 2.0],
        ]);
        assert_eq!((won[0], won[2]), (0.5, 0.5));
        assert!(
            won[1].is_nan()
                && selection_frequencies(&[Vec::new(), Vec::new()]).iter().all(|won| won.is_nan())
        );
    }

    #[test]
    fn a_free_parameter_costs_what_the_criterion_says() {
        assert!(bic(0.3, 60, 3) < bic(0.3, 60, 4));
        // Three more parameters have to lower 60 terms by a tenth.
        assert!(bic(0.3, 60, 3) > bic(0.28, 60, 3));
        assert!(bic(0.89 * 0.3, 60, 6) < bic(0.3, 60, 3));
        assert!(bic(0.91 * 0.3, 60, 6) > bic(0.3, 60, 3));
    }
}
