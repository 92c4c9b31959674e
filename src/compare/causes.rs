//! Causes of the differences between two runs: one sentence for all differences that one change in the laboratory
//! explains, such as a broken camera or a worn wheel.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use trilink_base::Named as _;
use trilink_base::numbers::{share, significant};
use trilink_robot::{Parameter, Per};
use trilink_statistics::median;
use trilink_tables::without_file;

use super::noise::inadequate;
use super::snapshot::{Record, Snapshot, number, text};
use super::{ADEQUATE, ComparisonResult, Difference, OBJECTIVE, RowId, Verdict};

/// Relative deviation up to which two frequencies, or two ratios of the same quantity, count as equal.
const SAME: f64 = 0.01;
/// Deviation of an angle up to which two gaits count as equal, rad.
const SAME_RAD: f64 = 0.05;
/// Maximum number of names in a list; the others are counted.
const MAX_NAMES: usize = 4;

/// Kind of a cause. Causes are listed in the order of the variants, because those of one kind may follow from those of
/// the kinds before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CauseKind {
    /// Recordings of several trials that failed or changed alike.
    Recordings,
    /// Robot parameters measured by coast-downs and releases.
    Robot,
    /// Models that were adequate and are not.
    Adequacy,
    /// Fitted coefficients.
    Coefficients,
    /// Recording of a single trial.
    Recording,
    /// Rows that only the baseline has.
    Vanished,
    /// Other values, grouped by table.
    Values,
}

/// Change in the laboratory, with the differences that it explains.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cause {
    pub kind: CauseKind,
    /// The likely cause and its evidence.
    pub sentence: String,
    /// Indices of the differences in the result of the comparison.
    pub differences: Vec<usize>,
}

/// Groups the differences out of tolerance and the vanished rows by cause, the most informative cause first.
pub(super) fn find(compared: &ComparisonResult, runs: [&Snapshot; 2]) -> Vec<Cause> {
    let out = (0..compared.differences.len())
        .filter(|index| compared.differences[*index].judgement.verdict == Verdict::Out);
    let mut search = Search { compared, runs, remaining: out.collect(), causes: Vec::new() };
    search.find_recordings();
    search.find_robots();
    search.find_inadequate_models();
    search.find_coefficients();
    search.find_vanished();
    search.find_values();
    // What changed in most recordings comes first; the causes of the other kinds are in order.
    search.causes.sort_by_key(|cause| {
        let is_recordings = cause.kind == CauseKind::Recordings;
        (cause.kind, Reverse(if is_recordings { cause.differences.len() } else { 0 }))
    });
    search.causes
}

struct Search<'r> {
    compared: &'r ComparisonResult,
    runs: [&'r Snapshot; 2],
    /// Indices of the differences out of tolerance that have no cause yet.
    remaining: BTreeSet<usize>,
    causes: Vec<Cause>,
}

impl<'r> Search<'r> {
    /// Returns the remaining differences in a column of a table.
    fn in_column(&self, table: &str, column: &str) -> impl Iterator<Item = &'r Difference> {
        let all = self.remaining.iter().map(|index| &self.compared.differences[*index]);
        all.filter(move |difference| difference.table == table && difference.column == column)
    }

    /// Adds a cause that explains all remaining differences for which `is_explained` returns true.
    fn add(
        &mut self,
        kind: CauseKind,
        sentence: String,
        is_explained: impl Fn(&Difference) -> bool,
    ) {
        let differences: Vec<usize> = self
            .remaining
            .extract_if(.., |index| is_explained(&self.compared.differences[*index]))
            .collect();
        self.causes.push(Cause { kind, sentence, differences });
    }

    /// Adds a cause that explains all differences of some trials.
    fn add_recordings(&mut self, trials: &BTreeSet<&str>, sentence: String) {
        let is_one = trials.len() == 1;
        let kind = if is_one { CauseKind::Recording } else { CauseKind::Recordings };
        self.add(kind, sentence, |difference| {
            ["trials", "robot_parameters"].contains(&difference.table)
                && trials.contains(difference.row.as_str())
        });
    }

    /// Returns `trial NAME` for one trial and `N of M trials` for several.
    fn name_trials(&self, trials: &BTreeSet<&str>) -> String {
        match trials.first().filter(|_| trials.len() == 1) {
            Some(trial) => format!("trial {trial}"),
            None => {
                let all = self.compared.records.iter().filter(|row| row.table == "trials").count();
                format!("{} of {all} trials", trials.len())
            }
        }
    }

    fn find_recordings(&mut self) {
        let changed = |difference: &&Difference| {
            let values = difference.candidate.as_f64().zip(difference.baseline.as_f64());
            values.map(|(now, then)| now - then)
        };
        let coverage = self.in_column("trials", "coverage");
        let lost: Vec<_> = coverage.filter(|of| changed(of).is_some_and(|by| by < 0.0)).collect();
        if let Some((trials, [then, now])) = medians(&lost) {
            let failed = self.in_column("trials", "status").filter(|of| trials.contains(&*of.row));
            let failed = match failed.count() {
                0 => String::new(),
                count => format!("; {count} failed"),
            };
            let sentence = format!(
                "a camera may have failed or be covered: {} lack markers ({} of the marker positions recorded, {} in \
                 the baseline{failed})",
                self.name_trials(&trials),
                share(now),
                share(then)
            );
            self.add_recordings(&trials, sentence);
        }
        let residual = self.in_column("trials", "residual_mm");
        let moved: Vec<_> = residual.filter(|of| changed(of).is_some_and(|by| by > 0.0)).collect();
        if let Some((trials, [then, now])) = medians(&moved) {
            let sentence = format!(
                "a marker may have moved on its link or come loose: in {} the markers lie {} mm from the layout, {} mm \
                 in the baseline",
                self.name_trials(&trials),
                significant(now, 2),
                significant(then, 2)
            );
            self.add_recordings(&trials, sentence);
        }
        self.find_other_gaits();
        let failed: Vec<&str> =
            self.in_column("trials", "status").map(|of| of.row.as_str()).collect();
        let mut reasons: BTreeMap<String, BTreeSet<&str>> = BTreeMap::new();
        for trial in failed {
            let reason = reason(&self.runs[1].records("trials")[trial]);
            let digits = |c: char| c.is_ascii_digit() || c == '.';
            let pattern = reason.split(digits).filter(|part| !part.is_empty());
            reasons.entry(pattern.collect::<Vec<_>>().join("#")).or_default().insert(trial);
        }
        for trials in reasons.into_values() {
            let first = trials.first().copied().unwrap_or_default();
            let records = self.runs[1].records("trials");
            let is_same = |trial: &&str| reason(&records[*trial]) == reason(&records[first]);
            let example = if trials.iter().all(is_same) {
                String::new()
            } else {
                format!(", such as {first}")
            };
            let reason = reason(&records[first]);
            let sentence = format!("{} failed{example}: {reason}", self.name_trials(&trials));
            self.add_recordings(&trials, sentence);
        }
    }

    /// Finds failed trials whose gait is that of another failed trial, or whose frequency deviates by a common factor.
    fn find_other_gaits(&mut self) {
        let [then, now] = self.runs.map(|run| run.records("trials"));
        let failed = self.in_column("trials", "status").map(|of| of.row.as_str());
        let mut failed: Vec<&str> = failed.collect();
        let is_like = |trial: &str, other: &str| is_same_gait(&now[trial], &then[other]);
        while let Some((one, other)) = (0..failed.len()).find_map(|other| {
            let one = failed[..other].iter().position(|one| {
                let other = failed[other];
                is_like(one, other) && is_like(other, one) && !is_like(one, one)
            })?;
            Some((one, other))
        }) {
            let other = failed.remove(other);
            let one = failed.remove(one);
            let sentence = format!(
                "the files of trials {one} and {other} seem to be exchanged: each has the gait that the other trial \
                 has in the baseline"
            );
            self.add_recordings(&[one, other].into(), sentence);
        }
        let failed = failed.into_iter().filter_map(|trial| {
            let ratio =
                number(&now[trial], "omega_rad_s")? / number(&now[trial], "omega_commanded_rad_s")?;
            (ratio > 0.0 && !is_same(ratio, 1.0)).then_some((trial, ratio))
        });
        let (trials, ratios): (BTreeSet<&str>, Vec<f64>) = failed.unzip();
        let ratio = median(ratios.clone());
        if trials.len() > 1 && ratios.iter().all(|other| is_same(*other, ratio)) {
            let sentence = format!(
                "the frame rate seems to be wrong: in {} the gait has {} times the commanded frequency",
                self.name_trials(&trials),
                significant(ratio, 3)
            );
            self.add_recordings(&trials, sentence);
        }
    }

    fn find_robots(&mut self) {
        let mut robots: BTreeMap<&str, BTreeMap<&str, Vec<f64>>> = BTreeMap::new();
        for index in &self.remaining {
            let difference = &self.compared.differences[*index];
            let Some(trial) = self.runs[1].records(difference.table).get(&difference.row) else {
                continue;
            };
            if let Some(ratio) = ratio(difference).filter(|_| difference.table == ROBOTS) {
                let columns = robots.entry(text(trial, "robot")).or_default();
                columns.entry(difference.column.as_str()).or_default().push(ratio);
            }
        }
        // Robots with the same changes, which one cause explains, share a sentence.
        let mut alike: Vec<(Vec<&str>, BTreeMap<&str, f64>)> = Vec::new();
        for (robot, columns) in robots {
            let ratios: BTreeMap<&str, f64> =
                columns.into_iter().map(|(column, ratios)| (column, median(ratios))).collect();
            let same = alike.iter_mut().find(|(_, known)| {
                let rolls = known.get(ROLL).zip(ratios.get(ROLL));
                rolls.is_some_and(|(known, own)| is_same(*known, *own))
            });
            match same {
                Some((robots, known)) => {
                    robots.push(robot);
                    known.extend(ratios);
                }
                None => alike.push((vec![robot], ratios)),
            }
        }
        for (robots, ratios) in alike {
            let noun = if robots.len() == 1 { "robot" } else { "robots" };
            let names = format!("{noun} {}", listed(&robots));
            // The measured resistances and stiffnesses are proportional to the configured mass over the true mass.
            let mass = ratios.get(ROLL).map(|roll| 1.0 / roll);
            let is_inertia = ratios
                .get(STIFFNESS)
                .zip(mass)
                .map(|(stiffness, mass)| (1.0 / stiffness > 1.0) == (mass > 1.0));
            let cause = match (mass, is_inertia) {
                (Some(mass), is_inertia) if is_inertia != Some(false) => {
                    let [heavier, roll] =
                        if mass > 1.0 { ["heavier", "more"] } else { ["lighter", "less"] };
                    let or_roll = match is_inertia {
                        Some(true) => String::new(),
                        _ => format!(", or roll {roll} easily,"),
                    };
                    let by = share((mass - 1.0).abs());
                    format!("{names} may be {by} {heavier}{or_roll} than in the baseline")
                }
                _ => format!("measured parameters of {names} changed"),
            };
            let evidence = ratios.iter().filter(|(column, _)| {
                is_inertia != Some(true) || [ROLL, STIFFNESS].contains(column)
            });
            let evidence = evidence.map(|(column, ratio)| format!("{column} {}", change(*ratio)));
            let sentence = format!("{cause}: {}", evidence.collect::<Vec<_>>().join(", "));
            let records = self.runs[1].records(ROBOTS);
            self.add(CauseKind::Robot, sentence, |difference| {
                let trial = records.get(&difference.row).filter(|_| difference.table == ROBOTS);
                ratio(difference).is_some()
                    && trial.is_some_and(|trial| robots.contains(&text(trial, "robot")))
            });
        }
    }

    fn find_inadequate_models(&mut self) {
        let fits = self.runs[1].records("fits");
        let missing: BTreeMap<&str, Vec<&str>> = self
            .in_column("fits", OBJECTIVE)
            .filter(|difference| difference.candidate.is_null())
            .map(|difference| (text(&fits[&difference.row], "failure"), difference.row.as_str()))
            .fold(BTreeMap::new(), |mut all, (failure, fit)| {
                all.entry(failure).or_insert_with(Vec::new).push(fit);
                all
            });
        for (failure, rows) in missing {
            let sentence = format!("no fit of {}: {failure}", listed(&rows));
            self.add(CauseKind::Vanished, sentence, |difference| {
                difference.table == "fits" && rows.contains(&difference.row.as_str())
            });
        }
        let lost: BTreeSet<&str> = self
            .in_column("fits", ADEQUATE)
            .filter(|difference| difference.candidate.is_null())
            .map(|difference| difference.row.as_str())
            .collect();
        for row in lost {
            let reason = text(&fits[row], "undecided");
            let sentence = format!("whether {row} fits is no longer known: {reason}");
            self.add(CauseKind::Adequacy, sentence, |difference| {
                difference.table == "fits" && difference.column == ADEQUATE && difference.row == row
            });
        }
        let mut models: BTreeMap<(bool, &str), Vec<&Record>> = BTreeMap::new();
        let became: BTreeSet<&str> =
            self.in_column("fits", ADEQUATE).map(|of| of.row.as_str()).collect();
        for difference in self.in_column("fits", OBJECTIVE) {
            let fit = &fits[&difference.row];
            let is_inadequate = became.contains(difference.row.as_str());
            models.entry((!is_inadequate, text(fit, "model"))).or_default().push(fit);
        }
        for ((is_only_worse, model), of_model) in models {
            let campaigns: Vec<&str> = of_model.iter().map(|fit| text(fit, "campaign")).collect();
            let worst = of_model.iter().filter_map(|fit| {
                Some([number(fit, "lack_of_fit")?, number(fit, "lack_of_fit_limit")?])
            });
            let worst = worst.max_by(|a, b| a[0].total_cmp(&b[0])).map(|[ratio, limit]| {
                let most = if campaigns.len() > 1 { "up to " } else { "" };
                format!(" (misfit {most}{} x noise, limit {limit:.2})", significant(ratio, 3))
            });
            let verdict = if is_only_worse { "fits worse" } else { "fitted, and does not now" };
            let names = listed(&campaigns);
            let sentence = format!("{model} of {names} {verdict}{}", worst.unwrap_or_default());
            self.add(CauseKind::Adequacy, sentence, |difference| {
                let column = difference.column.as_str();
                difference.table == "fits"
                    && [ADEQUATE, OBJECTIVE].contains(&column)
                    && of_model.contains(&&fits[&difference.row])
            });
        }
    }

    fn find_coefficients(&mut self) {
        let fits = self.runs.map(|run| run.records("fits"));
        let change = |difference: &'r Difference| {
            let parameter = Parameter::of_name(&difference.column)?;
            let fit = fits[1].get(&difference.row).filter(|_| difference.table == "fits")?;
            let [campaign, model] = ["campaign", "model"].map(|column| text(fit, column));
            Some(CoefficientChange { campaign, model, parameter, ratio: ratio(difference)? })
        };
        let out = self.remaining.iter().map(|index| &self.compared.differences[*index]);
        let changes: Vec<CoefficientChange> = out.filter_map(change).collect();
        let inadequate = fits.map(inadequate);
        let judged = |parameter: Parameter| {
            let both = fits[1].values().filter(|fit| {
                let names = ["campaign", "model"].map(|column| text(fit, column));
                let is_free = text(fit, "free").split(", ").any(|free| free == parameter.name());
                is_free && !inadequate.iter().any(|all| all.contains(&names))
            });
            both.map(|fit| text(fit, "campaign")).collect::<BTreeSet<_>>().len()
        };
        // Variation between days widens the tolerance of coefficients, but campaigns that agree are evidence.
        let within = self.compared.differences.iter().filter(|of| !of.is_out());
        let within = within
            .filter_map(change)
            .filter(|of| !inadequate.iter().any(|all| all.contains(&[of.campaign, of.model])));
        let within: Vec<CoefficientChange> = within.collect();
        let has_means = self.remaining.iter().any(|i| self.compared.differences[*i].table == MEANS);
        if changes.is_empty() && has_means {
            let mut alike: BTreeMap<Parameter, Vec<CoefficientChange>> = BTreeMap::new();
            for change in &within {
                alike.entry(change.parameter).or_default().push(*change);
            }
            alike.retain(|parameter, changes| {
                let ratio = median(changes.iter().map(|change| change.ratio).collect());
                let campaigns: BTreeSet<&str> = changes.iter().map(|of| of.campaign).collect();
                campaigns.len() > 1
                    && campaigns.len() == judged(*parameter)
                    && (ratio - 1.0).abs() > MIN_CHANGE
                    && changes.iter().all(|change| is_same(change.ratio, ratio))
            });
            let alike: Vec<CoefficientChange> = alike.into_values().flatten().collect();
            for CoefficientCause { sentence, .. } in by_coefficient(&alike, judged) {
                let sentence = sentence + "; within tolerance, but the campaigns agree";
                let kind = CauseKind::Coefficients;
                self.causes.push(Cause { kind, sentence, differences: Vec::new() });
            }
        }
        for CoefficientCause { mut sentence, parameters, ratio } in by_coefficient(&changes, judged)
        {
            let alike = within
                .iter()
                .filter(|of| parameters.contains(&of.parameter) && is_same(of.ratio, ratio));
            let alike: BTreeSet<&str> = alike.map(|of| of.campaign).collect();
            if !alike.is_empty() {
                let alike = listed(&alike.into_iter().collect::<Vec<_>>());
                sentence += &format!("; alike, but within tolerance, in {alike}");
            }
            self.add(CauseKind::Coefficients, sentence, |difference| {
                difference.table == "fits"
                    && parameters.iter().any(|parameter| parameter.name() == difference.column)
            });
        }
    }

    fn find_vanished(&mut self) {
        for rows in by_table(&self.compared.vanished) {
            self.add(CauseKind::Vanished, format!("vanished from {rows}"), |_| false);
        }
    }

    fn find_values(&mut self) {
        // The differences are sorted: the first of a table is the largest.
        while let Some(first) = self.remaining.first() {
            let Difference { table, row, .. } = &self.compared.differences[*first];
            let largest = self.compared.differences[*first].sentence();
            let of_table = self.remaining.iter().map(|index| &self.compared.differences[*index]);
            let of_table: Vec<&Difference> = of_table.filter(|of| of.table == *table).collect();
            let rows: BTreeSet<&str> = of_table.iter().map(|of| of.row.as_str()).collect();
            let name = if *table == MEANS { "means of campaigns" } else { table };
            let sentence = match of_table.len() {
                1 => format!("{name}: {row}: {largest}"),
                count if rows.len() == 1 => format!("{name}: {row}: {count} values, {largest}"),
                count => format!(
                    "{name}: {count} values of {} rows, most of all {row}: {largest}",
                    rows.len()
                ),
            };
            self.add(CauseKind::Values, sentence, |difference| difference.table == *table);
        }
    }
}

const ROBOTS: &str = "robot_parameters";
/// Column with the sum of the viscous roll resistances that a coast-down measures.
const ROLL: &str = "roll_sum_kg_s";
/// Table of the means over the trials of a campaign.
const MEANS: &str = "campaigns";
/// Minimum relative change of a coefficient within its tolerance that is a likely cause if all campaigns agree on it.
const MIN_CHANGE: f64 = 0.02;
/// Column with the stiffness of the passive joint that a release measures.
const STIFFNESS: &str = "stiffness_nm_rad";

fn is_same(one: f64, other: f64) -> bool {
    (one / other - 1.0).abs() <= SAME
}

/// Returns whether the measured gaits of two trials have the same frequency and, where they are known, offsets and
/// amplitudes of the joints.
fn is_same_gait(one: &Record, other: &Record) -> bool {
    let both = |column: &str| number(one, column).zip(number(other, column));
    let joints = ["phi1_offset_rad", "phi1_amplitude_rad", "phi2_offset_rad", "phi2_amplitude_rad"];
    both("omega_rad_s").is_some_and(|(one, other)| is_same(one, other))
        && joints.into_iter().filter_map(both).all(|(one, other)| (one - other).abs() < SAME_RAD)
}

/// Returns the trials of differences between numbers, and the medians of these numbers in the baseline and the
/// candidate; `None` without differences.
fn medians<'r>(differences: &[&'r Difference]) -> Option<(BTreeSet<&'r str>, [f64; 2])> {
    let trials: BTreeSet<&str> = differences.iter().map(|of| of.row.as_str()).collect();
    let values = |of: fn(&Difference) -> Option<f64>| {
        median(differences.iter().filter_map(|difference| of(difference)).collect())
    };
    let both = [values(|of| of.baseline.as_f64()), values(|of| of.candidate.as_f64())];
    (!trials.is_empty()).then_some((trials, both))
}

/// Returns the ratio of the candidate's value to the baseline's value, if both are numbers and not zero.
fn ratio(difference: &Difference) -> Option<f64> {
    let ratio = difference.candidate.as_f64()? / difference.baseline.as_f64()?;
    (ratio.is_finite() && ratio != 0.0).then_some(ratio)
}

/// Returns the reason why a trial failed, without the name of its file.
fn reason(trial: &Record) -> &str {
    without_file(text(trial, "message"), text(trial, "file"))
}

/// Formats a ratio as a relative change.
fn change(ratio: f64) -> String {
    let sign = if ratio > 1.0 { '+' } else { '\u{2212}' };
    format!("{sign}{}", share((ratio - 1.0).abs()))
}

/// Returns names as a list in words; names beyond the first few are counted.
fn listed(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [name] => (*name).to_owned(),
        [first @ .., last] if names.len() <= MAX_NAMES => {
            format!("{} and {last}", first.join(", "))
        }
        _ => format!("{} and {} more", names[..MAX_NAMES].join(", "), names.len() - MAX_NAMES),
    }
}

/// Lists rows by table, such as `trials: a and b`; counts the rows of a table that has many of them.
pub fn by_table(rows: &[RowId]) -> Vec<String> {
    let lists = rows.chunk_by(|one, other| one.table == other.table).map(|rows| {
        let names: Vec<&str> = rows.iter().map(|row| row.row.as_str()).collect();
        let RowId { table, row } = &rows[0];
        match names.len() {
            ..=MAX_NAMES => format!("{table}: {}", listed(&names)),
            count => format!("{table}: {count} rows, such as {row}"),
        }
    });
    lists.collect()
}

/// Change of a coefficient in the fit of a model to a campaign.
#[derive(Clone, Copy)]
pub(super) struct CoefficientChange<'r> {
    pub campaign: &'r str,
    pub model: &'r str,
    pub parameter: Parameter,
    pub ratio: f64,
}

/// Change that several fits show alike.
pub(super) struct CoefficientCause {
    pub sentence: String,
    pub parameters: Vec<Parameter>,
    /// Median ratio of the values to those of the baseline.
    pub ratio: f64,
}

/// Groups changes of coefficients by coefficient, or by quantity if all wheels change alike. `judged` returns the
/// number of campaigns with an adequate fit of a coefficient.
pub(super) fn by_coefficient(
    changes: &[CoefficientChange],
    judged: impl Fn(Parameter) -> usize,
) -> Vec<CoefficientCause> {
    let mut groups: BTreeMap<Parameter, Vec<&CoefficientChange>> = BTreeMap::new();
    for change in changes {
        groups.entry(change.parameter).or_default().push(change);
    }
    let ratio = |of: &[&CoefficientChange]| median(of.iter().map(|change| change.ratio).collect());
    let mut causes: Vec<(usize, CoefficientCause)> = Vec::new();
    while let Some((&parameter, _)) = groups.first_key_value() {
        let quantity = parameter.quantity();
        let wheels: Vec<Parameter> = (0..quantity.count()).map(|i| quantity.parameter(i)).collect();
        let ratios = wheels.iter().map(|wheel| groups.get(wheel).map(|changes| ratio(changes)));
        let ratios: Option<Vec<f64>> = ratios.collect();
        let is_common = quantity.definition().per == Per::Wheel
            && ratios.is_some_and(|ratios| ratios.iter().all(|other| is_same(*other, ratios[0])));
        let parameters = if is_common { wheels } else { vec![parameter] };
        let of_all: Vec<&CoefficientChange> =
            parameters.iter().filter_map(|parameter| groups.remove(parameter)).flatten().collect();
        let campaigns: BTreeSet<&str> = of_all.iter().map(|change| change.campaign).collect();
        let models: BTreeSet<&str> = of_all.iter().map(|change| change.model).collect();
        let all = parameters.iter().map(|parameter| judged(*parameter)).max().unwrap_or(0);
        let campaigns_in_words = match campaigns.first().filter(|_| all <= 1) {
            Some(campaign) => (*campaign).to_owned(),
            None => format!("{} of {all} campaigns", campaigns.len()),
        };
        let mut sentence = format!(
            "{} {} in {campaigns_in_words} ({})",
            coefficient(&parameters),
            change(ratio(&of_all)),
            listed(&models.into_iter().collect::<Vec<_>>())
        );
        if is_common {
            let grip = if ratio(&of_all) > 1.0 { "stickier" } else { "more slippery" };
            sentence += &format!(": the floor or the tyres may be {grip}");
        }
        let ratio = ratio(&of_all);
        causes.push((campaigns.len(), CoefficientCause { sentence, parameters, ratio }));
    }
    causes.sort_by_key(|(campaigns, _)| Reverse(*campaigns));
    causes.into_iter().map(|(_, cause)| cause).collect()
}

/// Returns the name of one coefficient, or of the coefficients of all wheels, in words.
pub(super) fn coefficient(parameters: &[Parameter]) -> String {
    let quantity = parameters[0].quantity().definition();
    match parameters {
        [parameter] => match parameter.number().filter(|_| quantity.per == Per::Wheel) {
            Some(wheel) => {
                let label = quantity.label.to_lowercase();
                match ["middle", "front", "rear"].get(wheel) {
                    Some(link) => format!("{label} of the {link} wheel (wheel {wheel})"),
                    None => format!("{label} of wheel {wheel}"),
                }
            }
            None => parameter.label().to_lowercase(),
        },
        _ => format!("{} of all wheels", quantity.label.to_lowercase()),
    }
}

#[cfg(test)]
mod tests {
    use trilink_robot::Quantity;

    use super::*;

    #[test]
    fn changes_of_a_coefficient_in_several_campaigns_are_one_sentence() {
        let change = |campaign, wheel, ratio| CoefficientChange {
            campaign,
            model: "skid-roll",
            parameter: Quantity::Skid.parameter(wheel),
            ratio,
        };
        let sentences = |changes: &[CoefficientChange]| {
            let causes = by_coefficient(changes, |_| 3).into_iter();
            causes.map(|cause| cause.sentence).collect::<Vec<_>>()
        };
        let worn = [change("a", 1, 1.02), change("a", 0, 1.049), change("b", 0, 1.051)];
        assert_eq!(
            sentences(&worn),
            [
                "skid of the middle wheel (wheel 0) +5.0 % in 2 of 3 campaigns (skid-roll)",
                "skid of the front wheel (wheel 1) +2.0 % in 1 of 3 campaigns (skid-roll)",
            ]
        );
        let floor = [0, 1, 2].map(|wheel| change("a", wheel, 0.92 + 0.001 * wheel as f64));
        let expected = "skid of all wheels \u{2212}7.9 % in 1 of 3 campaigns (skid-roll): the floor or the tyres may \
                        be more slippery";
        assert_eq!(sentences(&floor), [expected]);
        let roll = CoefficientChange { parameter: Quantity::Roll.sum(), ..change("a", 0, 1.1) };
        assert_eq!(sentences(&[roll]), ["sum of roll +10.0 % in 1 of 3 campaigns (skid-roll)"]);
    }
}
