//! Tests of `claims.toml`, of values known from independent calculations, and of the verdicts.

use std::collections::BTreeSet;
use std::path::Path;

use trilink_mechanics::{MotionStatus, REFERENCE_ACCURACY, Solver};
use trilink_robot::{Model, Quantity};
use trilink_tables::Reader;
use trilink_tables::TrialStatus;
use trilink_tables::config::Config;

use super::verdict::Criterion;
use super::*;
use crate::tests::made_up::{self, Tables as MadeUp};

/// Returns the scorecard without any trials or fits.
fn alone() -> Vec<JudgedClaim> {
    scorecard(Arc::default(), Config::default().fit.sigma, false).expect("a scorecard")
}

fn with_tables(made_up: &MadeUp, is_synthetic: bool) -> Vec<JudgedClaim> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    made_up.write(folder.path());
    let tables = Arc::new(Tables::read(folder.path(), &Reader::default()).expect("tables"));
    scorecard(tables, Config::default().fit.sigma, is_synthetic).expect("a scorecard")
}

fn find<'e>(entries: &'e [JudgedClaim], id: &str) -> &'e JudgedClaim {
    entries.iter().find(|entry| entry.claim.id == id).unwrap_or_else(|| panic!("no claim {id}"))
}

const VERDICTS: [Verdict; 3] = [Verdict::Reproduced, Verdict::Differs, Verdict::NotTestable];

fn name(verdict: Verdict) -> String {
    let name = serde_json::to_value(verdict).expect("JSON");
    name.as_str().expect("a text").to_owned()
}

fn claims() -> Claims {
    Claims::load().expect("claims.toml")
}

#[test]
fn every_claim_has_a_unique_id_and_a_formula_for_its_value() {
    let claims = claims();
    let mut ids = BTreeSet::new();
    let mut parts: Vec<&str> = Vec::new();
    for claim in &claims.claim {
        let id = &claim.id;
        assert!(ids.insert(id), "{id} stands twice");
        assert!(id.bytes().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'-'));
        assert!(claim.claim.ends_with('.') && !claim.place.is_empty(), "{id}");
        if parts.last() != Some(&claim.part.as_str()) {
            assert!(!parts.contains(&claim.part.as_str()), "{} is in two places", claim.part);
            parts.push(&claim.part);
        }
        let judged = match claim.judged {
            Judged::Computed => claim.computed.is_some(),
            Judged::Measured => claim.measured.is_some(),
        };
        assert!(judged, "{id}");
        for also in &claim.also {
            assert!(also.text.contains("{}"), "{id}");
        }
    }
    assert!(parts.len() == 8);
}

/// Each claim of the paper is either in the scorecard or in `docs/paper-claims.md`, which lists the claims that tests
/// cover and those that no program can judge.
#[test]
fn every_claim_of_the_paper_is_in_the_scorecard_or_in_the_documentation() {
    let others = include_str!("../../../../docs/paper-claims.md");
    let rows = others.lines().filter_map(|line| line.strip_prefix("| "));
    let others = rows.filter_map(|row| row.split(" | ").next()).filter(|id| *id != "claim");
    let claims = claims();
    let mut all: Vec<&str> = claims.claim.iter().map(|claim| claim.id.as_str()).collect();
    all.extend(others);
    assert_eq!(all.len(), 130);
    assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), 130, "one stands twice");
}

#[test]
fn every_criterion_has_the_printed_value_that_it_needs() {
    for claim in claims().claim {
        let has_number = claim.printed.is_some();
        let has_interval = claim.measured.is_some_and(|formula| {
            formula.starts_with("coefficient") || formula.starts_with("travelled_mm(")
        });
        match claim.criterion {
            Criterion::Within(_) => assert!(has_number, "{}", claim.id),
            Criterion::ConfidenceInterval(_) => {
                assert!(has_number && has_interval, "{}", claim.id);
            }
            _ => {}
        }
    }
}

#[test]
fn every_motion_named_in_a_claim_is_defined_and_every_motion_is_used() {
    let claims = claims();
    let paper = Paper::new(claims.fitted, claims.motion);
    let formulas = claims.claim.iter().flat_map(|claim| {
        let also = claim.also.iter().map(|also| &also.computed);
        claim.computed.iter().chain(&claim.measured).chain(also)
    });
    // The functions of `paper` take the name of a motion as their first argument.
    let named = formulas.flat_map(|formula| formula.split("(paper, '").skip(1));
    let names = named.map(|rest| rest.split('\'').next().expect("a name").to_owned());
    let used: BTreeSet<String> = names.collect();
    for name in &used {
        assert!(paper.problem(name, 1.0).is_some(), "{name}");
    }
    assert_eq!(used, paper.motion.into_keys().collect());
}

#[test]
fn fitted_values_agree_with_the_printed_values_in_the_claims() {
    let claims = claims();
    let printed = |id: &str| {
        let claim = claims.claim.iter().find(|claim| claim.id == id).expect("a claim");
        claim.printed.expect("a number")
    };
    let tables = [
        ("kinematic-skewed", "table1-fit-skewed"),
        ("kinematic-symmetric", "table1-fit-symmetric"),
        ("semi-passive-symmetric", "table2-fit"),
    ];
    for (campaign, prefix) in tables {
        for wheel in 0..3 {
            let fitted = claims.fitted[campaign][&format!("skid{wheel}_kg_s")];
            assert_eq!(fitted, printed(&format!("{prefix}-c{wheel}")));
        }
    }
    let spring = &claims.fitted["semi-passive-symmetric"];
    assert_eq!(spring["stiffness_nm_rad"], printed("table2-k-tau"));
    assert_eq!(spring["damping_nm_s_rad"], printed("table2-c-tau"));
}

#[test]
fn independently_known_values_are_reproduced() {
    let entries = alone();
    // Values from an independent derivation; for fig4-d, 1292.07 from the two-state equations of the constrained robot.
    let known = [
        ("fig6-v", 312.778, 0.05),
        ("fig9-d", 96.5092, 1e-3),
        ("fig11-d", 478.3597, 1e-3),
        ("fig14-d", 265.5048, 1e-3),
        ("fig4-d", 1292.0, 0.2),
    ];
    for (id, value, tolerance) in known {
        let found = find(&entries, id).computed.expect("a number");
        assert!((found - value).abs() <= tolerance, "{id}: {found}, known {value}");
    }
    let said = [
        ("fig4-d", "sum is 1.2 kg/s, the computed displacement is 356.684 mm;"),
        ("fig4-d", "with a sum of 0.233 kg/s, it is 729.137 mm."),
        ("fig4-d", "travels 588.798 mm in its second cycle and 755.157 mm in its third."),
        ("fig18-roll-enough", "d at 3.9 rad/s is 281.698 mm; the paper measured 263 mm."),
        ("good-agreement", "differs from the three published values by up to 9.46447 %."),
        ("fig14-d", "The computed value differs from the published one by 0.952400 %."),
        ("fig13-no-skid", "The displacement is 663.466 mm."),
        ("fig16-no-skid", "The displacement is 122.405 mm."),
        ("fig13-qualitative", "largest at 4.87106 rad/s, with a spread of 0."),
        (
            "fig13-optimum",
            "The displacement rises from 425.511 mm at 0.5 rad/s to 481.976 mm at 6 rad/s.",
        ),
    ];
    for (id, text) in said {
        assert!(find(&entries, id).remark.contains(text), "{id}: {}", find(&entries, id).remark);
    }
    let difference = find(&entries, "fig5-v-optimum").relative_difference.expect("a number");
    assert!((difference - (3.6978 / 4.0 - 1.0)).abs() < 1e-4, "{difference}");
}

/// `verdicts.txt` contains the verdicts without any trials, one `id: verdict` per line, in the order of the claims. If
/// a change to the solver alters a verdict, it alters what the paper's models predict.
#[test]
fn verdicts_agree_with_the_recorded_ones() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/scorecard/verdicts.txt");
    let record = std::fs::read_to_string(path).expect("the record");
    let found: Vec<String> = alone()
        .iter()
        .map(|entry| format!("{}: {}", entry.claim.id, name(entry.verdict)))
        .collect();
    let recorded: Vec<&str> = record.lines().collect();
    for line in found.iter().filter(|line| !recorded.contains(&line.as_str())) {
        eprintln!("not on record: {line}");
    }
    assert!(found == recorded, "{}", found.join("\n"));
}

#[test]
fn claims_known_to_agree_or_differ_get_that_verdict() {
    let entries = alone();
    for id in ["fig4-d", "fig13-optimum", "fig10-optimum", "low-damping"] {
        assert_eq!(find(&entries, id).verdict, Verdict::Differs, "{id}");
    }
    for id in ["fig6-v", "fig15-optimum", "fig5-v-optimum"] {
        assert_eq!(find(&entries, id).verdict, Verdict::Reproduced, "{id}");
    }
}

/// The program has to assume values that the paper does not state; other assumptions give the same verdicts.
#[test]
fn no_verdict_depends_on_a_value_that_the_paper_does_not_state() {
    let verdict = |id: &str, change: &dyn Fn(&mut paper::MotionSpec)| {
        let Claims { fitted, mut motion, claim } = claims();
        let claim = claim.into_iter().find(|claim| claim.id == id).expect("a claim");
        let formula = claim.computed.clone().expect("a formula");
        let used = motion.iter_mut().filter(|(name, _)| formula.contains(&format!("'{name}'")));
        used.for_each(|(_, spec)| change(spec));
        let trials = Trials { tables: Arc::default(), sigma: Config::default().fit.sigma };
        judge(claim, &Formulas::new(Paper::new(fitted, motion), trials), false).verdict
    };
    for amplitude2_deg in [20.0, 29.0, 29.9, 31.0, 40.0] {
        let ellipse = |spec: &mut paper::MotionSpec| spec.amplitude2_deg = Some(amplitude2_deg);
        for id in ["fig17-singular", "fig11-ellipse"] {
            assert_eq!(verdict(id, &ellipse), Verdict::Reproduced, "{id}: {amplitude2_deg}");
        }
    }
    for damping_nm_s_rad in [0.0, 1e-5, 1e-4, 0.001, 0.003, 0.006] {
        for model in ["no-skid", "no-skid-roll", "skid", "skid-roll"] {
            let change = |spec: &mut paper::MotionSpec| {
                spec.model = Model::new(model);
                spec.set = [("damping_nm_s_rad".to_owned(), damping_nm_s_rad)].into();
            };
            let verdict = verdict("low-damping", &change);
            assert_eq!(verdict, Verdict::Differs, "{model}: {damping_nm_s_rad}");
        }
    }
}

/// The remark on `low-damping` states where the damping decides whether the symmetric motion of skid-roll is stable.
#[test]
fn damping_decides_on_the_symmetry_of_the_motion_in_a_narrow_range_of_frequencies_alone() {
    let Claims { fitted, mut motion, .. } = claims();
    for name in ["passive-simulation", "passive-hardly-damped"] {
        motion.get_mut(name).expect("a motion").model = Model::new("skid-roll");
    }
    let paper = Paper::new(fitted, motion);
    // Near the transition, the solver also finds the symmetric motion that has become unstable.
    let is_lost = |name: &str, omega_rad_s: f64| {
        let problem = paper.problem(name, omega_rad_s).expect("a motion");
        let mut solver = Solver::default();
        solver.solve(&problem, REFERENCE_ACCURACY).expect("a motion");
        solver.status().expect("a motion") != MotionStatus::Stable
    };
    for (omega_rad_s, expected) in [
        (6.0, [false, false]),
        (11.44, [false, false]),
        (11.46, [false, true]),
        (11.5, [false, true]),
        (11.62, [false, true]),
        (11.64, [true, true]),
        (11.7, [true, true]),
    ] {
        let found =
            ["passive-simulation", "passive-hardly-damped"].map(|name| is_lost(name, omega_rad_s));
        assert_eq!(found, expected, "{omega_rad_s} rad/s");
    }
}

#[test]
fn claims_about_trials_and_fits_are_judged_by_them() {
    let mut tables = MadeUp::of_the_paper();
    let entries = with_tables(&tables, false);
    let d = find(&entries, "fig9-d");
    let trial = tables.trials.iter().find(|row| row.trial == "kinematic-skewed-3.90-r1");
    let row = trial.expect("a trial");
    assert_eq!(d.measured, Some(1e3 * row.metrics.d_m));
    // The printed 104.3 mm lie far outside the confidence interval of this trial.
    assert_eq!((d.judged_by, d.verdict), (Some(Judged::Measured), Verdict::Differs));
    let difference = d.relative_difference.expect("a number");
    assert!((difference - (1e3 * row.metrics.d_m / 104.3 - 1.0)).abs() < 1e-12);

    let inside = find(&entries, "table1-fit-symmetric-c0");
    assert_eq!((inside.measured, inside.verdict), (Some(1.02 * 104.21), Verdict::Reproduced));
    assert_eq!(inside.remark, "95 % interval 98.40 to 111.9.");
    let outside = find(&entries, "table1-fit-skewed-c0");
    assert_eq!((outside.judged_by, outside.verdict), (Some(Judged::Measured), Verdict::Differs));
    let open = find(&entries, "table1-fit-symmetric-c1");
    assert_eq!(open.verdict, Verdict::Reproduced);
    assert!(open.remark.contains("21.30 to ∞"), "{}", open.remark);
    let without = find(&entries, "table1-fit-symmetric-c2");
    assert_eq!((without.measured, without.verdict), (Some(1000.0), Verdict::NotTestable));
    assert_eq!(without.remark, "The value has no confidence interval.");

    let stiffness = find(&entries, "table2-k-tau");
    assert_eq!((stiffness.measured, stiffness.verdict), (Some(0.1875), Verdict::Differs));
    assert_eq!(find(&entries, "fig17-singular").measured, Some(0.0));
    let measured_gait = find(&entries, "fig16-measured-gait").measured.expect("a ratio");
    assert!((measured_gait - 1.5).abs() < 1e-12, "{measured_gait}");
    // These tables do not determine the noise of the amplitude, so no verdict is possible.
    assert_eq!(find(&entries, "alpha-accuracy").verdict, Verdict::NotTestable);

    // Repeated trials are averaged; failed trials are ignored.
    let again = |status: TrialStatus, d_m: f64| {
        let mut row = made_up::trial(made_up::SKEWED, 3.9, [d_m, 0.04, 0.02, 0.02]);
        row.status = status;
        row.trial += &format!("-{d_m}");
        row
    };
    tables.trials.extend([again(TrialStatus::Failed, 9.0), again(TrialStatus::Flagged, 0.2)]);
    let entries = with_tables(&tables, false);
    let mean = find(&entries, "fig9-d").measured.expect("a number");
    assert!((mean - 0.5 * (d.measured.expect("a number") + 200.0)).abs() < 1e-9, "{mean}");
    assert!(entries.iter().all(|entry| !entry.remark.contains("synthetic")));
}

#[test]
fn no_claim_about_the_experiment_is_judged_by_synthetic_trials() {
    let entries = with_tables(&MadeUp::of_the_paper(), true);
    assert!(entries.iter().all(|entry| entry.judged_by != Some(Judged::Measured)));
    for entry in entries.iter().filter(|entry| entry.claim.judged == Judged::Measured) {
        assert_eq!(entry.verdict, Verdict::NotTestable, "{}", entry.claim.id);
        assert!(entry.remark.contains("these trials are synthetic"), "{}", entry.claim.id);
    }
    // The value measured in synthetic trials is shown nevertheless.
    assert_eq!(find(&entries, "table1-fit-symmetric-c0").measured, Some(1.02 * 104.21));
}

/// A model with an additional free parameter never fits worse than the model that it contains, so the ratio of their
/// objectives J is no evidence for a claim.
#[test]
fn no_claim_compares_a_model_with_one_that_it_contains() {
    let contained =
        "'no-skid', 'j')\n    / fitted(trials, 'semi-passive-symmetric', 'no-skid-damped'";
    for claim in claims().claim {
        assert!(!claim.measured.is_some_and(|formula| formula.contains(contained)), "{}", claim.id);
    }
    // A fitted damping below that of the joint-release trials does not support the claim.
    let mut tables = MadeUp::of_the_paper();
    let damping = |tables: &MadeUp| find(&with_tables(tables, false), "fig18-damped").verdict;
    assert_eq!(damping(&tables), Verdict::Reproduced);
    for fit in tables.fits.iter_mut().filter(|fit| fit.model == Model::NO_SKID_DAMPED) {
        fit.parameters[Quantity::Damping.one()] = 0.005;
    }
    assert_eq!(damping(&tables), Verdict::Differs);
}

#[test]
fn verdicts_follow_the_criterion() {
    let claims = claims();
    let by = |id: &str, value: f64, limits: Option<[f64; 2]>| {
        let claim = claims.claim.iter().find(|claim| claim.id == id).expect("a claim");
        let found = Found { limits, ..Found::new(value) };
        match claim.criterion.is_met(&found, claim.printed) {
            Some(true) => Verdict::Reproduced,
            Some(false) => Verdict::Differs,
            None => Verdict::NotTestable,
        }
    };
    assert_eq!(by("fig4-d", 729.49, None), Verdict::Reproduced);
    assert_eq!(by("fig4-d", 729.51, None), Verdict::Differs);
    assert_eq!(by("fig6-v", 349.9, None), Verdict::Reproduced);
    assert_eq!(by("fig6-v", 350.1, None), Verdict::Differs);
    assert_eq!(by("fig10-optimum", 6.0, None), Verdict::Differs);
    assert_eq!(by("fig10-optimum", 4.0, None), Verdict::Reproduced);
    assert_eq!(by("fig4-d", f64::NAN, None), Verdict::Differs);
    let c0 = "table1-fit-symmetric-c0";
    assert_eq!(by(c0, 110.0, Some([103.0, 120.0])), Verdict::Reproduced);
    assert_eq!(by(c0, 110.0, Some([104.4, f64::NAN])), Verdict::Reproduced);
    assert_eq!(by(c0, 110.0, Some([104.6, f64::NAN])), Verdict::Differs);
    assert_eq!(by(c0, 110.0, Some([f64::NAN, f64::NAN])), Verdict::Reproduced);
    assert_eq!(by(c0, 104.0, None), Verdict::NotTestable);
}

#[test]
fn optima_lie_inside_the_range_or_are_reported_at_an_end() {
    use super::curve::Curve;
    let highest = |d: &dyn Fn(f64) -> f64| {
        let omegas = (1..=12).map(|i| 0.5 * f64::from(i));
        let points = omegas.map(|omega_rad_s| (omega_rad_s, d(omega_rad_s))).collect();
        Curve { points, is_measured: false }.highest().expect("one")
    };
    let (peak, is_inside) = highest(&|omega| -(omega - 3.7).powi(2));
    assert!(is_inside && (peak - 3.7).abs() < 1e-12, "{peak:?}");
    assert_eq!(highest(&|omega| omega), (6.0, false));
    // A local maximum inside the range takes precedence over a higher end point.
    assert!(highest(&|omega| 9.0 / omega - (omega - 4.0).powi(2)).1);
    assert!(Curve { points: Vec::new(), is_measured: false }.highest().is_err());
}

/// A formula may lack data, which is reported as missing; a formula with an unknown name is a programming error.
#[test]
fn every_formula_has_a_value_or_reports_missing_data() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    MadeUp::of_the_paper().write(folder.path());
    let tables = Arc::new(Tables::read(folder.path(), &Reader::default()).expect("tables"));
    let Claims { fitted, motion, claim } = claims();
    let sigma = Config::default().fit.sigma;
    for tables in [tables, Arc::default()] {
        let paper = Paper::new(fitted.clone(), motion.clone());
        let formulas = Formulas::new(paper, Trials { tables, sigma });
        for claim in &claim {
            for formula in claim.computed.iter().chain(&claim.measured) {
                let Err(error) = formulas.find(formula) else { continue };
                let is_ratio_to_zero = claim.id == "alpha-accuracy";
                let is_missing = error.kind() == minijinja::ErrorKind::UndefinedError;
                assert!(is_missing || is_ratio_to_zero, "{formula}: {error:#}");
            }
        }
    }
}

#[test]
fn the_json_is_independent_of_thread_count_and_has_null_for_missing_values() {
    let bytes = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        crate::json(&pool.install(alone)).expect("JSON")
    };
    let one = bytes(1);
    assert!(one == bytes(4), "differs with the number of threads");
    let text = String::from_utf8(one).expect("text");
    assert!(!text.contains("NaN") && !text.contains("inf"));
    let entries: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let entries = entries.as_array().expect("an array");
    assert_eq!(entries.len(), claims().claim.len());
    for entry in entries {
        assert!(entry["measured"].is_null(), "{entry}");
        let verdict = entry["verdict"].as_str().expect("a verdict");
        assert!(VERDICTS.iter().any(|known| name(*known) == verdict), "{verdict}");
        let is_judged = verdict != "not testable here";
        assert_eq!(entry["judged_by"].is_null(), !is_judged, "{entry}");
        assert!(is_judged || !entry["remark"].as_str().expect("text").is_empty(), "{entry}");
    }
}

#[test]
fn every_claim_has_a_verdict_and_none_is_measured_without_trials() {
    let entries = alone();
    assert_eq!(
        VERDICTS
            .map(|verdict| entries.iter().filter(|entry| entry.verdict == verdict).count())
            .into_iter()
            .sum::<usize>(),
        entries.len()
    );
    assert!(entries.iter().all(|entry| entry.judged_by != Some(Judged::Measured)));
}
