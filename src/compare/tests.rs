//! Tests of comparisons between synthetic runs.

mod history;

use trilink_tables::config::Config;

use super::*;

/// Returns a synthetic run whose trials have the displacements `d_m` and whose only fit has the coefficient
/// `skid0_kg_s`.
fn run(d_m: &[f64], skid0_kg_s: f64) -> Snapshot {
    let number = |(name, value): (&str, f64)| (name.to_owned(), Json::from(value));
    let text = |name: &str, value: &str| (name.to_owned(), Json::from(value));
    let trial = |(i, d_m): (usize, &f64)| {
        let omega = ("omega_commanded_rad_s", 1.0 + i as f64);
        let numbers = [omega, ("d_m", *d_m), ("d_m_se", 0.001), ("cycles", 9.0)].map(number);
        let texts = [text("campaign", "symmetric"), text("status", "ok")];
        (format!("trial-{i}"), numbers.into_iter().chain(texts).collect())
    };
    let fit = [
        ("skid0_kg_s", skid0_kg_s),
        ("skid0_kg_s_lo", skid0_kg_s - 1.96),
        ("skid0_kg_s_hi", skid0_kg_s + 1.96),
        ("j", 1.0),
        ("solves", 100.0 * skid0_kg_s),
    ];
    let texts = [
        text("status", "ok"),
        text("campaign", "symmetric"),
        text("model", "skid-roll"),
        text("free", "skid0_kg_s"),
    ];
    let fit: Record = fit.map(number).into_iter().chain(texts).collect();
    let trials: Records = d_m.iter().enumerate().map(trial).collect();
    Snapshot {
        format: 1,
        version: "0.1.0".to_owned(),
        accepted: Vec::new(),
        stages: [("fit".to_owned(), 10.0)].into(),
        status: None,
        inputs: Default::default(),
        tables: [
            ("trials".to_owned(), trials),
            ("fits".to_owned(), [("symmetric skid-roll".to_owned(), fit)].into()),
        ]
        .into(),
    }
}

fn compared(baseline: &Snapshot, candidate: &Snapshot) -> ComparisonResult {
    compare(&Config::default().compare, baseline, candidate)
}

fn out(compared: &ComparisonResult) -> Vec<String> {
    compared.out().map(|d| format!("{} {} {}", d.table, d.row, d.column)).collect()
}

#[test]
fn the_same_run_does_not_differ() {
    let run = run(&[0.4, 0.41], 100.0);
    let compared = compared(&run, &run.clone());
    assert!(compared.passes() && compared.differences.is_empty());
    assert!(compared.cells > 10);
}

/// Returns a synthetic run whose fit has the columns `changes`.
fn run_with(changes: &[(&str, Json)]) -> Snapshot {
    let mut run = run(&[0.4, 0.41], 100.0);
    let fit = run.tables.get_mut("fits").unwrap().get_mut("symmetric skid-roll").unwrap();
    fit.extend(changes.iter().map(|(column, cell)| ((*column).to_owned(), cell.clone())));
    run
}

#[test]
fn the_objective_is_judged_by_what_noise_explains() {
    // Noise alone explains an objective of 2; the baseline had luck.
    let run_with_j = |j: f64| {
        let adequate = if j < 2.8 { "true" } else { "false" };
        let ratios = [("j", j.into()), ("lack_of_fit", (j / 2.0).into())];
        let verdict = [("lack_of_fit_limit", 1.4.into()), ("adequate", adequate.into())];
        run_with(&[ratios, verdict].concat())
    };
    let [baseline, better, noisy, on_the_edge, worse] = [1.0, 0.2, 2.6, 3.0, 8.0].map(run_with_j);
    for passing in [&better, &noisy, &on_the_edge] {
        let compared = compared(&baseline, passing);
        assert!(compared.passes(), "{:?}", out(&compared));
    }
    let worse = compared(&baseline, &worse);
    let mut both = out(&worse);
    both.sort();
    assert_eq!(both, ["fits symmetric skid-roll adequate", "fits symmetric skid-roll j"]);
    let sentence =
        "skid-roll of symmetric fitted, and does not now (misfit 4.00 x noise, limit 1.40)";
    assert_eq!(worse.causes[0].sentence, sentence);
    // Without known noise, nothing is known about chance.
    let unknown = compared(&run_with(&[("j", 1.0.into())]), &run_with(&[("j", 3.0.into())]));
    assert!(unknown.passes() && unknown.count(Verdict::NotJudged) == 1);
}

#[test]
fn a_verdict_on_a_model_that_is_lost_is_out_of_tolerance() {
    let run =
        |adequate: Json| run_with(&[("adequate", adequate), ("undecided", "no-repeats".into())]);
    let lost = compared(&run("true".into()), &run(Json::Null));
    assert_eq!(out(&lost), ["fits symmetric skid-roll adequate"]);
    let sentence = "whether symmetric skid-roll fits is no longer known: no-repeats";
    assert_eq!(lost.causes[0].sentence, sentence);
    let found = compared(&run(Json::Null), &run("true".into()));
    assert!(found.passes() && found.count(Verdict::NotJudged) == 1);
}

#[test]
fn a_model_that_is_inadequate_in_either_run_is_listed_and_not_judged() {
    let run_with = |skid0_kg_s: f64, d_m: f64, adequate: &str| {
        let mut run = run_with(&[("adequate", adequate.into()), ("skid0_kg_s", skid0_kg_s.into())]);
        let names = [("campaign", "symmetric"), ("model", "skid-roll")];
        let names = names.map(|(column, name)| (column.to_owned(), Json::from(name)));
        let numbers = [("d_m", d_m), ("interval_d_m", 0.001)];
        let numbers = numbers.map(|(column, value)| (column.to_owned(), Json::from(value)));
        let prediction = names.into_iter().chain(numbers).collect();
        let predictions = [("symmetric skid-roll 2.00 rad/s".to_owned(), prediction)].into();
        run.tables.insert("predictions".to_owned(), predictions);
        run
    };
    let compared =
        |then: &str, now: &str| compared(&run_with(100.0, 0.4, then), &run_with(200.0, 0.5, now));
    for [then, now] in [["false", "false"], ["true", "false"], ["false", "true"]] {
        let compared = compared(then, now);
        assert!(compared.passes(), "{:?}", out(&compared));
        assert!(compared.count(Verdict::NotJudged) >= 2);
    }
    assert_eq!(out(&compared("true", "true")).len(), 2);
}

#[test]
fn trials_vary_by_more_than_their_cycles() {
    let with_noise = |d_m: f64| {
        let mut run = run(&[d_m], 100.0);
        let trial = run.tables.get_mut("trials").unwrap().get_mut("trial-0").unwrap();
        trial.insert("d_m_between".to_owned(), 0.012.into());
        run
    };
    let shifted = |by_m: f64| compared(&with_noise(0.4), &with_noise(0.4 + by_m));
    assert!(!compared(&run(&[0.4], 100.0), &run(&[0.45], 100.0)).passes());
    assert!(shifted(0.05).passes(), "{:?}", out(&shifted(0.05)));
    assert_eq!(out(&shifted(0.15)), ["trials trial-0 d_m", "campaigns symmetric d_m"]);
}

#[test]
fn noise_is_within_tolerance_and_a_change_is_listed() {
    let baseline = run(&[0.4, 0.41], 100.0);
    let noisy = compared(&baseline, &run(&[0.402, 0.409], 101.0));
    assert!(noisy.passes(), "{:?}", out(&noisy));
    assert_eq!(noisy.count(Verdict::Within), 4);
    let changed = compared(&baseline, &run(&[0.4, 0.41], 110.0));
    assert_eq!(out(&changed), ["fits symmetric skid-roll skid0_kg_s"]);
    let one = changed.out().next().unwrap();
    assert!((one.judgement.errors.unwrap() - 10.0 / 2.0_f64.sqrt()).abs() < 1e-9);
    let sentence =
        "skid0_kg_s: 110.000, baseline 100.000 (+10.00 %, 7.1 standard errors, limit 8.49)";
    assert_eq!(one.sentence(), sentence);
}

#[test]
fn a_small_shift_of_all_trials_shows_in_their_mean() {
    let before: Vec<f64> = (0..30).map(|i| 0.4 + 0.001 * f64::from(i)).collect();
    let after: Vec<f64> = before.iter().map(|d_m| d_m + 0.003).collect();
    let shifted = compared(&run(&before, 100.0), &run(&after, 100.0));
    assert_eq!(out(&shifted), ["campaigns symmetric d_m"]);
}

#[test]
fn rows_that_appear_are_listed_and_those_that_vanish_fail() {
    let few = run(&[0.4], 100.0);
    let many = run(&[0.4, 0.41], 100.0);
    let grown = compared(&few, &many);
    assert!(grown.passes());
    assert_eq!(grown.appeared[0].name(), "trials: trial-1");
    let shrunk = compared(&many, &few);
    assert!(!shrunk.passes());
    assert_eq!(shrunk.vanished[0].name(), "trials: trial-1");
}

#[test]
fn a_table_that_only_one_run_has_is_one_entry() {
    let with = run(&[0.4, 0.41], 100.0);
    let mut without = with.clone();
    without.tables.remove("fits");
    assert_eq!(compared(&without, &with).appeared[0].name(), "fits: all 1 rows");
    let vanished = compared(&with, &without);
    assert_eq!(vanished.vanished[0].name(), "fits: all 1 rows");
    assert!(!vanished.passes());
}

#[test]
fn missing_values_and_other_statuses_fail_unless_the_trial_is_still_used() {
    let baseline = run(&[0.4, 0.41], 100.0);
    let change = |column: &str, cell: Json| {
        let mut candidate = baseline.clone();
        let trials = candidate.tables.get_mut("trials").unwrap();
        trials.get_mut("trial-0").unwrap().insert(column.to_owned(), cell);
        out(&compared(&baseline, &candidate))
    };
    assert_eq!(change("d_m", Json::Null), ["trials trial-0 d_m"]);
    assert_eq!(change("status", Json::from("failed")), ["trials trial-0 status"]);
    assert!(change("status", Json::from("flagged")).is_empty());
    // A trial that failed in the baseline has recovered.
    let mut failed = baseline.clone();
    let trial = failed.tables.get_mut("trials").unwrap().get_mut("trial-0").unwrap();
    trial.extend([("d_m".to_owned(), Json::Null), ("status".to_owned(), "failed".into())]);
    assert!(compared(&failed, &baseline).passes());
}

#[test]
fn failed_trials_with_the_gaits_of_each_other_have_exchanged_files() {
    let with_offsets = |offsets_rad: [f64; 2], status: &str| {
        let mut run = run(&[0.4, 0.41], 100.0);
        for (trial, offset_rad) in
            run.tables.get_mut("trials").unwrap().values_mut().zip(offsets_rad)
        {
            trial.insert("omega_rad_s".to_owned(), 2.0.into());
            trial.insert("phi1_offset_rad".to_owned(), offset_rad.into());
            trial.insert("status".to_owned(), status.into());
        }
        run
    };
    let baseline = with_offsets([0.0, 0.8], "ok");
    let first = |offsets_rad: [f64; 2]| {
        let compared = compared(&baseline, &with_offsets(offsets_rad, "failed"));
        compared.causes[0].sentence.clone()
    };
    let exchanged = "the files of trials trial-0 and trial-1 seem to be exchanged: each has the gait that the other \
                     trial has in the baseline";
    assert_eq!(first([0.8, 0.0]), exchanged);
    for other in [[0.0, 0.8], [0.8, 0.8], [0.4, 0.0]] {
        assert!(!first(other).contains("exchanged"), "{}", first(other));
    }
}

#[test]
fn a_longer_run_time_fails_only_if_configured() {
    let baseline = run(&[0.4], 100.0);
    let mut candidate = baseline.clone();
    candidate.stages.insert("fit".to_owned(), 30.0);
    let named = compared(&baseline, &candidate);
    assert!(named.passes() && named.run_times[0].is_longer);
    let strict = Compare { run_time_fails: true, ..Config::default().compare };
    assert!(!compare(&strict, &baseline, &candidate).passes());
    candidate.stages.insert("fit".to_owned(), 14.0);
    assert!(compare(&strict, &baseline, &candidate).passes());
}

#[test]
fn a_saved_snapshot_is_read_back_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep/baseline.json");
    let mut saved = run(&[0.1 + 0.2, 1e-300, 0.46560407069451604], 1.0 / 3.0);
    let trials = saved.tables.get_mut("trials").unwrap();
    trials.get_mut("trial-0").unwrap().insert("sigma0".to_owned(), Json::Null);
    saved.accepted.push(Acceptance {
        time: trilink_tables::clock::utc_now(),
        reason: "new \"wheels\"".to_owned(),
        differences: 2,
    });
    saved.save(&path).unwrap();
    assert_eq!(Snapshot::load(&path).unwrap(), saved);
    std::fs::write(&path, "{\"format\":9,\"version\":\"\",\"tables\":{}}").unwrap();
    let message = Snapshot::load(&path).unwrap_err().to_string();
    assert!(
        message.ends_with("has format 9, but this version of trilink reads only format 1"),
        "{message}"
    );
    let message = Snapshot::load(std::path::Path::new("nowhere.json")).unwrap_err().to_string();
    assert!(message.contains("does not exist; `trilink compare --accept WHY` creates it"));
}

#[test]
fn output_files_list_differences_and_escape_names() {
    let baseline = run(&[0.4, 0.41], 100.0);
    let mut candidate = run(&[0.5, 0.41], 110.0);
    let odd: Record = [("status".to_owned(), Json::from("a<b & \"c\""))].into();
    let mut known = baseline.clone();
    for run in [&mut known, &mut candidate] {
        let trials = run.tables.get_mut("trials").unwrap();
        trials.insert("<odd>".to_owned(), odd.clone());
        trials.insert("bell \u{7}".to_owned(), odd.clone());
    }
    let trials = candidate.tables.get_mut("trials").unwrap();
    trials.get_mut("<odd>").unwrap().insert("status".to_owned(), Json::from("failed"));
    let compared = compared(&known, &candidate);
    let html = page(&compared, &known, &candidate, &Config::default().paths).unwrap();
    assert!(html.contains("trial-0") && html.contains("skid0_kg_s"), "{html}");
    assert!(html.contains("&lt;odd&gt;") && !html.contains("<odd>"));
    assert!(html.contains("Trials of symmetric"), "the curves that differ are drawn");
    let xml = junit(&compared).unwrap();
    assert!(xml.contains("<testsuite name=\"trials\" tests=\"4\" failures=\"2\">"), "{xml}");
    assert!(xml.contains("name=\"bell \\u{7}\""), "{xml}");
    assert!(xml.contains("name=\"&lt;odd&gt;\""), "{xml}");
    let json = to_json(&compared);
    assert_eq!(json["within_tolerance"], false);
    assert_eq!(json["differences"][0]["verdict"], "out");
}
