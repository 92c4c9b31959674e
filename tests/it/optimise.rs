//! Tests of optimal gaits: no other gait is better, and the reported values are correct.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde_json::Value;
use trilink_base::cancel::CancelToken;
use trilink_fit::optimise::{Bounds, Command, MapOverlay, Objective, Search, SearchResult};
use trilink_mechanics::{Laws, Problem, Solver};
use trilink_robot::{ChainNumber, CommandNumber, Model};
use trilink_synth::{Recipe, synthesise};
use trilink_tables::MapPoint;
use trilink_tables::config::{Config, GaitInput};

use crate::common::fitted::{CAMPAIGN, folder};
use crate::common::{succeed, text, trilink, was_up_to_date};

const CAMPAIGNS: [&str; 3] = ["kinematic-symmetric", "kinematic-skewed", "semi-passive-symmetric"];
/// Maximum relative improvement that another gait may achieve over an optimum.
const BETTER: f64 = 1e-6;

fn bounds() -> Bounds {
    Bounds {
        omega_rad_s: [0.5, 8.0],
        amplitude_rad: [0.1, 0.8],
        rotor_amplitude_rad: [0.1, 0.8],
        angle_rad: 1.2,
        rate_rad_s: 5.0,
        power_w: None,
        torque_nm: None,
        least: None,
    }
}

fn run(search: &Search) -> SearchResult {
    search.run(&CancelToken::default()).unwrap()
}

fn problem(campaign: &str) -> Problem {
    let (robot, gait) = Config::default().campaign_setup(campaign).unwrap();
    Problem::new(robot, gait, Laws::SKID_ROLL, 3.0)
}

/// Returns the amplitude of joint 1 or 2 as a command.
fn amplitude(joint: usize) -> Command {
    Command::Number(ChainNumber::Command(joint - 1, CommandNumber::Amplitude))
}

fn is_amplitude(command: &Command) -> bool {
    [1, 2].map(amplitude).contains(command)
}

/// Returns the objective for these values of the free commands; `None` outside the bounds or if the model has no
/// periodic solution.
fn value(search: &Search, solver: &mut Solver, values: &[f64]) -> Option<f64> {
    let mut problem = search.problem.clone();
    for (command, value) in search.free.iter().zip(values) {
        command.set(&mut problem, *value);
    }
    let is_within = problem.gait.joints.iter().flatten().all(|of| {
        of.peak_angle_rad() <= search.bounds.angle_rad
            && of.peak_rate_rad() * problem.omega_rad_s <= search.bounds.rate_rad_s
    });
    if !is_within {
        return None;
    }
    let metrics = solver.solve(&problem, 1e-9).ok()?;
    let work_j = solver.steady_motion(metrics).ok()?.work_j;
    Some(search.objective.value(metrics.d_m, metrics.v_m_s, work_j))
}

/// Returns the better of two values of an objective.
fn better(objective: Objective, a: f64, b: f64) -> f64 {
    if objective.is_minimised() { a.min(b) } else { a.max(b) }
}

fn assert_not_better(search: &Search, found: f64, other: f64, what: &str) {
    let by = if search.objective.is_minimised() { found / other } else { other / found };
    assert!(by <= 1.0 + BETTER, "{what} {}: {found}, and {other} elsewhere", search.objective);
}

#[test]
fn no_point_of_a_grid_is_better_for_any_objective() {
    const POINTS: usize = 15;
    let cases: Vec<(&str, Objective)> = CAMPAIGNS
        .into_iter()
        .flat_map(|of| Objective::ALL.into_iter().map(move |objective| (of, objective)))
        .collect();
    cases.into_par_iter().for_each(|(campaign, objective)| {
        let problem = problem(campaign);
        let amplitude =
            Command::all(&problem).into_iter().find(|of| *of != Command::Omega).unwrap();
        let free = vec![Command::Omega, amplitude];
        let search = Search { problem, objective, free, bounds: bounds(), starts: 4 };
        let found = run(&search);
        let best = found.best().unwrap_or_else(|| panic!("{campaign} {objective}"));
        let mut solver = Solver::default();
        let mut known = if objective.is_minimised() { f64::INFINITY } else { 0.0 };
        for i in 0..POINTS * POINTS {
            let part = |i: usize, [low, high]: [f64; 2]| {
                low + (high - low) * i as f64 / (POINTS - 1) as f64
            };
            let values = [
                part(i / POINTS, search.bounds.omega_rad_s),
                part(i % POINTS, search.bounds.amplitude_rad),
            ];
            if let Some(value) = value(&search, &mut solver, &values) {
                known = better(objective, known, value);
            }
        }
        assert_not_better(&search, best.value, known, campaign);
    });
}

/// Maximises or minimises the objective by differential evolution, `rand/1/bin`, and returns the best value.
///
/// Reference: R. Storn and K. Price, *Differential evolution*, J. Global Optim. 11 (1997) 341-359.
fn evolve(search: &Search, ranges: &[[f64; 2]], generations: usize) -> f64 {
    const POPULATION: usize = 30;
    const FACTOR: f64 = 0.7;
    const CROSSOVER: f64 = 0.8;
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut solver = Solver::default();
    let worst = if search.objective.is_minimised() { f64::INFINITY } else { 0.0 };
    let mut all: Vec<(Vec<f64>, f64)> = (0..POPULATION)
        .map(|_| {
            let values: Vec<f64> =
                ranges.iter().map(|[low, high]| random.random_range(*low..*high)).collect();
            let value = value(search, &mut solver, &values).unwrap_or(worst);
            (values, value)
        })
        .collect();
    for _ in 0..generations {
        for i in 0..POPULATION {
            let [a, b, c] = [(); 3].map(|()| random.random_range(0..POPULATION));
            let taken = random.random_range(0..ranges.len());
            let tried: Vec<f64> = (0..ranges.len())
                .map(|j| {
                    let moved = all[a].0[j] + FACTOR * (all[b].0[j] - all[c].0[j]);
                    let is_moved = j == taken || random.random::<f64>() < CROSSOVER;
                    if is_moved { moved.clamp(ranges[j][0], ranges[j][1]) } else { all[i].0[j] }
                })
                .collect();
            let value = value(search, &mut solver, &tried).unwrap_or(worst);
            if better(search.objective, value, all[i].1) == value {
                all[i] = (tried, value);
            }
        }
    }
    all.into_iter().map(|(_, value)| value).fold(worst, |a, b| better(search.objective, a, b))
}

#[test]
fn differential_evolution_over_five_commands_finds_no_better_gait() {
    for (objective, generations) in [(Objective::Speed, 25), (Objective::WorkPerMetre, 25)] {
        let problem = problem("kinematic-skewed");
        let mut free = Command::all(&problem);
        free.truncate(5);
        let Bounds { omega_rad_s, amplitude_rad, angle_rad, .. } = bounds();
        let ranges: Vec<[f64; 2]> = free
            .iter()
            .map(|of| match of {
                Command::Omega => omega_rad_s,
                of if is_amplitude(of) => amplitude_rad,
                _ => [-angle_rad, angle_rad],
            })
            .collect();
        assert_eq!(free.len(), 5);
        let search = Search { problem, objective, free, bounds: bounds(), starts: 8 };
        let found = run(&search);
        let known = evolve(&search, &ranges, generations);
        assert_not_better(&search, found.best().unwrap().value, known, "evolution");
    }
}

/// The optimum with two harmonics is at least as good as the optimum with one harmonic, as random gaits near it, and
/// as the best gait that differential evolution finds.
#[test]
fn two_harmonics_are_at_least_as_good_as_one_and_no_gait_nearby_is_better() {
    let cases =
        [("kinematic-skewed", Objective::Speed), ("kinematic-symmetric", Objective::WorkPerMetre)];
    for (campaign, objective) in cases {
        let problem = problem(campaign);
        let free = Command::all(&problem);
        let seconds = Command::with_second_harmonics(free.clone(), &problem);
        let one = Search { problem, objective, free, bounds: bounds(), starts: 2 };
        let two = Search { free: seconds, ..one.clone() };
        assert_eq!(two.free.len(), 10);
        let (found, of_two) = (run(&one), run(&two));
        let best = of_two.best().unwrap();
        assert_not_better(&two, best.value, found.best().unwrap().value, "one harmonic");
        for command in best.problem.gait.joints.iter().flatten() {
            assert!(command.peak_angle_rad() <= 1.2 * (1.0 + 1e-6), "{command:?}");
            let rate_rad_s = command.peak_rate_rad() * best.problem.omega_rad_s;
            assert!(rate_rad_s <= 5.0 * (1.0 + 1e-6), "{command:?}");
        }
        let (mut random, mut solver) = (ChaCha8Rng::seed_from_u64(3), Solver::default());
        for nth in 0..120 {
            let size = 10_f64.powf(-1.0 - 3.0 * f64::from(nth % 30) / 30.0);
            let mut off = |of: f64| of + size * random.random_range(-1.0..1.0);
            let values: Vec<f64> =
                two.free.iter().map(|command| off(command.value(&best.problem))).collect();
            let Bounds { omega_rad_s: [low, high], amplitude_rad: [least, most], .. } = bounds();
            let is_within = two.free.iter().zip(&values).all(|(command, value)| match command {
                Command::Omega => (low..=high).contains(value),
                of if is_amplitude(of) => (least..=most).contains(value),
                _ => true,
            });
            if let Some(value) = value(&two, &mut solver, &values).filter(|_| is_within) {
                assert_not_better(&two, best.value, value, "nearby");
            }
        }
        let ranges: Vec<[f64; 2]> = two
            .free
            .iter()
            .map(|command| match command {
                Command::Omega => bounds().omega_rad_s,
                of if is_amplitude(of) => bounds().amplitude_rad,
                of if of.is_second() => [-0.3, 0.3],
                _ => [-1.2, 1.2],
            })
            .collect();
        assert_not_better(&two, best.value, evolve(&two, &ranges, 10), "evolution");
    }
}

#[test]
fn a_printed_gait_with_two_harmonics_is_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let begin = ["optimise", "kinematic-symmetric", "--model", "skid", "--maximise", "d"];
    let begin = [&begin[..], &["--free", "amplitude1", "second1", "--omega", "3"]].concat();
    let begin = [&begin[..], &["--starts", "1"]].concat();
    let printed = succeed(folder.path(), &[&begin[..], &["--gait-toml"]].concat());
    assert!(printed.contains("amplitude2_deg") && printed.contains("phase2_deg"), "{printed}");
    let rows: Value =
        serde_json::from_str(&succeed(folder.path(), &[&begin[..], &["--json"]].concat())).unwrap();
    let name = printed.split("[gait.").nth(1).unwrap().split(']').next().unwrap();
    let campaign = format!(
        "{printed}\n[campaign.best]\nrobot = \"kinematic\"\ngait = \"{name}\"\nmodels = [\"skid\"]\n\
         weights = {{ d = 10.0, v = 1.0, sigma = 1.0, alpha = 0.0 }}\n"
    );
    std::fs::write(folder.path().join("pipeline.toml"), campaign).unwrap();
    let simulate = ["simulate", "best", "--model", "skid", "--omega", "3", "--json"];
    let motion: Value = serde_json::from_str(&succeed(folder.path(), &simulate)).unwrap();
    let [d_m, known] = [&motion[0]["d_m"], &rows[0]["value"]].map(|of| of.as_f64().unwrap());
    assert!((d_m / known - 1.0).abs() < 1e-9, "{d_m} {known} {rows}");
    assert!(rows[0]["phi1_amplitude2_rad"].as_f64().unwrap() > 0.0, "{rows}");
}

#[test]
fn changes_at_an_interior_optimum_are_of_second_order() {
    let problem = problem("semi-passive-symmetric");
    let free = vec![Command::Omega];
    let objective = Objective::Speed;
    let search = Search { problem, objective, free, bounds: bounds(), starts: 4 };
    let found = run(&search);
    let best = found.best().unwrap();
    assert!(best.at_bound.is_empty(), "{:?}", best.at_bound);
    let mut solver = Solver::default();
    let omega = best.problem.omega_rad_s;
    let mut at = |omega: f64| value(&search, &mut solver, &[omega]).unwrap();
    let (less, more) = (at(omega * 0.999), at(omega * 1.001));
    assert!(less < best.value && more < best.value, "{less} {} {more}", best.value);
    // Sec. III: the semi-passive robot is fastest at about 4 rad/s.
    assert!((3.5..4.5).contains(&omega), "{omega}");
}

/// In the skewed gait, the rear joint exceeds the maximum angle, and its commands are not among those that the search
/// varies.
#[test]
fn a_limit_that_no_free_command_can_satisfy_is_ignored() {
    let problem = problem("kinematic-skewed");
    let free = vec![Command::Omega, amplitude(1)];
    for objective in Objective::ALL {
        let problem = problem.clone();
        let search = Search { problem, objective, free: free.clone(), bounds: bounds(), starts: 2 };
        let found = run(&search);
        let best = found.best().unwrap_or_else(|| panic!("{objective}"));
        let front = best.problem.gait.joints[0].unwrap();
        assert!(front.offset_rad + front.amplitude_rad <= 1.2 + 1e-6, "{objective} {front:?}");
    }
}

#[test]
fn limits_of_power_and_torque_are_satisfied_and_reported() {
    let problem = problem("kinematic-symmetric");
    let free = Command::all(&problem);
    let objective = Objective::Speed;
    let search = Search { problem, objective, free, bounds: bounds(), starts: 3 };
    let free_power_w = run(&search).best().unwrap().power_w();
    let power_w = 0.5 * free_power_w;
    let limited =
        Search { bounds: Bounds { power_w: Some(power_w), ..bounds() }, ..search.clone() };
    let found = run(&limited);
    let best = found.best().unwrap();
    assert!(best.power_w() <= power_w * (1.0 + 1e-6), "{} {power_w}", best.power_w());
    assert!(best.at_bound.iter().any(|of| of == "power"), "{:?}", best.at_bound);
    let largest = |problem: &Problem| {
        let mut solver = Solver::default();
        solver.solve(problem, 1e-10).unwrap();
        let samples = solver.cycle(240).unwrap();
        samples.iter().flat_map(|of| &of.torque_nm).fold(0.0, |a: f64, b| a.max(b.abs()))
    };
    let of_amplitudes =
        Search { free: vec![Command::Omega, amplitude(1), amplitude(2)], starts: 2, ..search };
    let torque_nm = 0.8 * largest(&run(&of_amplitudes).best().unwrap().problem);
    let limited =
        Search { bounds: Bounds { torque_nm: Some(torque_nm), ..bounds() }, ..of_amplitudes };
    let found = run(&limited);
    let best = found.best().unwrap();
    assert!(largest(&best.problem) <= torque_nm * (1.0 + 1e-5));
    assert!(best.at_bound.iter().any(|of| of == "torque"), "{:?}", best.at_bound);
}

#[test]
fn a_gait_that_is_pasted_gives_the_same_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let command = ["optimise", "semi-passive-symmetric", "--model", "skid-roll", "--maximise", "d"];
    let rows = succeed(folder.path(), &[&command[..], &["--starts", "3", "--json"]].concat());
    let rows: Value = serde_json::from_str(&rows).unwrap();
    let best = &rows[0];
    let entry = succeed(folder.path(), &[&command[..], &["--starts", "3", "--gait-toml"]].concat());
    let all = succeed(folder.path(), &["config", "show"]);
    assert!(!all.is_empty());
    let name = entry.lines().find_map(|line| line.strip_prefix("[gait.")).unwrap();
    let name = name.trim_end_matches(']');
    let defaults = include_str!("../../pipeline.toml");
    let config = defaults
        .replace("gait = \"passive-symmetric\"", &format!("gait = \"{name}\""))
        .replacen("[gait.skewed]", &format!("{entry}\n[gait.skewed]"), 1);
    std::fs::write(folder.path().join("pipeline.toml"), config).unwrap();
    let omega = best["omega_rad_s"].to_string();
    let simulated =
        ["simulate", "semi-passive-symmetric", "--model", "skid-roll", "--omega", &omega, "--json"];
    let simulated: Value = serde_json::from_str(&succeed(folder.path(), &simulated)).unwrap();
    let (one, other) = (best["d_m"].as_f64().unwrap(), simulated[0]["d_m"].as_f64().unwrap());
    assert!((one / other - 1.0).abs() < 1e-9, "{one} {other}");
}

#[test]
fn fitted_coefficients_are_those_of_the_preferred_model() {
    let line = ["optimise", CAMPAIGN, "--maximise", "v", "--free", "omega", "--starts", "2"];
    let found = |more: &[&str]| {
        let any_omega = ["--omega", "0.5..12", "--json"];
        let output = trilink(folder(), &[&line[..], &any_omega, more].concat());
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{said}");
        let rows: Vec<Value> = serde_json::from_str(&text(&output.stdout)).unwrap();
        (rows[0].clone(), said)
    };
    let (best, said) = found(&["--fitted", "--replicates", "4"]);
    assert!(said.contains("skid-roll, the preferred model of the comparison"), "{said}");
    assert_eq!(best["model"], "skid-roll");
    let number = |row: &Value, name: &str| row[name].as_f64().unwrap();
    for name in ["value", "omega_rad_s"] {
        let [low, high] = ["lo", "hi"].map(|side| number(&best, &format!("{name}_{side}")));
        assert!(low <= number(&best, name) && number(&best, name) <= high, "{name}: {best}");
    }
    assert!(number(&best, "value_lo") < number(&best, "value_hi"), "{best}");
    assert_eq!([&best["replicates"], &best["best_in"], &best["not_reached"]], [4, 4, 0]);
    assert!((-1e-6..1e-3).contains(&number(&best, "regret_hi")), "{best}");
    let (named, said) = found(&["--fitted", "--model", "skid-roll", "--replicates", "0"]);
    assert!(best["value"] == named["value"] && !said.contains("preferred"), "{said}");
    assert_eq!(named["no_interval"], "no-replicates");
    assert!(named["value_lo"].is_null() && named["replicates"].is_null(), "{named}");
    // The trials were synthesised with these coefficients.
    let (known, _) = found(&["--model", "skid-roll", "--set", "skid_kg_s=104,34,45"]);
    let v = |row: &Value| row["v_m_s"].as_f64().unwrap();
    assert!((v(&best) / v(&known) - 1.0).abs() < 0.01, "{best} {known}");
    assert!(known["adequate"].is_null() && best["adequate"] == true, "{best}");
}

#[test]
fn an_optimum_beyond_the_trials_of_the_fit_says_so() {
    let line = ["optimise", CAMPAIGN, "--fitted", "--maximise", "d", "--starts", "2"];
    let run = |more: &[&str]| {
        let output = trilink(folder(), &[&line[..], more].concat());
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{said}");
        (text(&output.stdout), said)
    };
    let found = |more: &[&str]| {
        let (printed, said) = run(&[more, &["--replicates", "0", "--json"]].concat());
        let rows: Vec<Value> = serde_json::from_str(&printed).unwrap();
        (rows, said)
    };
    let beyond = "omega 9 rad/s (trials cover 1 to 5)";
    let own = tempfile::tempdir().unwrap();
    let [table, figure] =
        ["o.csv", "o.svg"].map(|name| own.path().join(name).display().to_string());
    let free = ["--free", "amplitude1", "--omega", "9"];
    let files = ["--table", &table, "--figure", &figure];
    let (rows, said) = found(&[&free[..], &files].concat());
    assert_eq!(rows[0]["extrapolated"], true);
    assert!(rows[0]["beyond_trials"].as_str().unwrap().starts_with(beyond), "{}", rows[0]);
    assert!(said.contains("extrapolated beyond the trials of the fit") && said.contains(beyond));
    let csv = std::fs::read_to_string(table).unwrap();
    assert!(csv.lines().next().unwrap().contains(",extrapolated,beyond_trials,"), "{csv}");
    let svg = std::fs::read_to_string(figure).unwrap();
    assert!(svg.contains("optimum, extrapolated"), "{svg}");
    let (printed, _) = run(&[&free[..], &["--replicates", "0"]].concat());
    assert!(printed.contains(&format!("extrapolated: {beyond}")), "{printed}");
    let (toml, _) = run(&[&free[..], &["--replicates", "0", "--gait-toml"]].concat());
    assert!(toml.contains(&format!("# extrapolated: {beyond}")), "{toml}");
    let within = ["--free", "omega", "--omega", "1..5"];
    let (rows, said) = found(&within);
    assert_eq!(
        (&rows[0]["extrapolated"], &rows[0]["beyond_trials"]),
        (&false.into(), &Value::Null)
    );
    assert!(!said.contains("extrapolated"), "{said}");
    // Without a range, the search hardly leaves that of the trials.
    let (rows, said) = found(&["--free", "omega"]);
    assert!(said.contains("the search stays within 0.833 to 6.000 rad/s"), "{said}");
    let omega_rad_s = rows[0]["omega_rad_s"].as_f64().unwrap();
    assert!((0.833..=6.0 + 1e-9).contains(&omega_rad_s), "{}", rows[0]);
    let (_, said) = found(&["--free", "amplitude1", "--omega", "4"]);
    assert!(said.contains("the search stays within amplitudes of 25.0 to 36.0 degrees"), "{said}");
    let front = ["--pareto", "v", "--free", "omega", "--omega", "1..9", "--json"];
    let (printed, said) = run(&front);
    let rows: Vec<Value> = serde_json::from_str(&printed).unwrap();
    for row in &rows {
        let is_beyond = row["omega_rad_s"].as_f64().unwrap() > 5.0 * 1.005;
        assert_eq!(row["extrapolated"], is_beyond, "{row}");
    }
    let is_any = rows.iter().any(|row| row["extrapolated"] == true);
    assert_eq!(said.contains("extrapolated"), is_any, "{said}");
    // Configured coefficients have no range of fitted trials, so nothing is extrapolated.
    let configured = ["optimise", CAMPAIGN, "--model", "skid-roll", "--maximise", "d", "--json"];
    let printed = succeed(folder(), &[&configured[..], &free, &["--starts", "2"]].concat());
    let rows: Vec<Value> = serde_json::from_str(&printed).unwrap();
    assert!(rows[0]["extrapolated"].is_null(), "{}", rows[0]);
}

#[test]
fn free_commands_may_be_named_with_their_units() {
    let folder = tempfile::tempdir().unwrap();
    let line =
        ["optimise", "kinematic-skewed", "--model", "skid-roll", "--maximise", "d", "--json"];
    let free = |names: &[&str]| {
        let rows =
            succeed(folder.path(), &[&line[..], &["--starts", "1", "--free"], names].concat());
        let rows: Vec<Value> = serde_json::from_str(&rows).unwrap();
        rows[0]["free"].clone()
    };
    assert_eq!(
        free(&["omega_rad_s", "amplitude1_deg,offset2_deg", "phase2_deg"]),
        free(&["omega", "amplitude1", "offset2", "phase2"])
    );
    assert_eq!(
        free(&["omega_rad_s", "second_amplitude1_deg", "second_phase1_deg"]),
        free(&["omega", "second1"])
    );
}

#[test]
fn a_figure_shows_the_optimum_among_the_gaits_around_it() {
    let problem = problem("kinematic-symmetric");
    let free = vec![Command::Omega];
    let objective = Objective::WorkPerMetre;
    let search = Search { problem, objective, free, bounds: bounds(), starts: 2 };
    let found = run(&search);
    let best = found.best().unwrap();
    let model = Model::new("skid-roll");
    let shown = MapOverlay { present: Some(best), ..MapOverlay::default() };
    let map = search.map(("any", model), best, shown, &CancelToken::default()).unwrap();
    let of = |point: MapPoint| map.iter().filter(move |row| row.point == point);
    assert!(map.iter().all(|row| row.x_command == "omega" && row.y_command.is_empty()));
    let place = of(MapPoint::Optimum).next().unwrap().x;
    assert!((place - best.problem.omega_rad_s).abs() < 1e-9, "{place}");
    assert_eq!(of(MapPoint::Present).next().unwrap().x, place);
    let at_best = of(MapPoint::Grid).find(|row| (row.x - place).abs() < 1e-9).unwrap().value;
    assert!((at_best / best.value - 1.0).abs() < 1e-7, "{at_best} {}", best.value);
    let known = of(MapPoint::Grid).map(|row| row.value).filter(|value| value.is_finite());
    let least = known.fold(f64::INFINITY, f64::min);
    assert!(least >= best.value * (1.0 - BETTER), "{least} {}", best.value);

    let folder = tempfile::tempdir().unwrap();
    let command = ["optimise", "semi-passive-symmetric", "--model", "skid-roll", "--maximise", "v"];
    let options = ["--free", "omega", "--starts", "2", "--figure", "optimum.svg"];
    succeed(folder.path(), &[&command[..], &options].concat());
    let svg = std::fs::read_to_string(folder.path().join("optimum.svg")).unwrap();
    assert!(svg.contains("optimum") && svg.contains("Actuation frequency"));
}

#[test]
fn invalid_searches_are_rejected_with_the_cause() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |arguments: &[&str], named: &[&str]| {
        let line = [&["optimise"], arguments].concat();
        let output = trilink(folder.path(), &line);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line:?}: {said}");
        for name in named {
            assert!(said.contains(name), "{line:?}: {said:?} does not name {name:?}");
        }
    };
    let of = ["kinematic-symmetric", "--model", "skid-roll"];
    let with = |more: &[&'static str]| [&of[..], more].concat();
    refused(&with(&["--maximise", "speed"]), &["found `speed`", "`v`"]);
    refused(&with(&["--minimise", "d"]), &["found `d`", "`work-per-metre`"]);
    refused(&of, &["--maximise"]);
    refused(&[of[0], "--maximise", "v"], &["--model"]);
    refused(
        &with(&["--maximise", "v", "--fitted"]),
        &["no pipeline.toml and no trials in the current folder", "trilink init"],
    );
    refused(&with(&["--maximise", "v", "--free", "phase1"]), &["only the difference"]);
    refused(
        &with(&["--maximise", "v", "--free", "omga"]),
        &[
            "found `omga`, needed one of `omega`, `amplitude1`, `amplitude2`, `offset1`, `offset2`, `phase2`, \
             `amplitudes`, `offsets`, `phases`, `seconds`; did you mean `omega`?",
        ],
    );
    refused(
        &with(&["--maximise", "v", "--free", "amplitudes"]),
        &["--omega: found a range, needed one frequency"],
    );
    refused(&with(&["--maximise", "v", "--omega", "6..2"]), &["the lower number first"]);
    refused(&with(&["--maximise", "v", "--angle-deg", "500"]), &["optimise.angle_deg", "179"]);
    refused(&["elsewhere", "--model", "skid", "--maximise", "v"], &["elsewhere"]);
    refused(
        &["semi-passive-symmetric", "--model", "skid-roll", "--maximise", "v", "--free", "phase2"],
        &["the phase of the only commanded joint has no effect on the motion"],
    );
    // Without friction the actuators do no work.
    refused(
        &["kinematic-skewed", "--model", "no-skid", "--maximise", "d-per-work", "--starts", "2"],
        &["no search found a motion that is within the bounds and in which the actuators do work"],
    );
}

#[test]
fn no_gait_of_a_grid_dominates_a_pareto_front() {
    let free = vec![Command::Omega, amplitude(1)];
    let objective = Objective::Speed;
    let problem = problem("kinematic-symmetric");
    let search = Search { problem, objective, free, bounds: bounds(), starts: 3 };
    let other = Objective::WorkPerMetre;
    let front = search.front(other, &CancelToken::default()).unwrap();
    assert!(front.len() > 8 && front.iter().all(|of| of.is_reachable()), "{}", front.len());
    let both = |v: f64, work_per_metre: f64| [v, -work_per_metre];
    let of_front: Vec<[f64; 2]> =
        front.iter().map(|of| both(of.value, of.value_of(other))).collect();
    // The front is sorted from the fastest gait to the one that needs the least work.
    assert!(of_front.is_sorted_by(|a, b| a[0] > b[0] && a[1] < b[1]), "{of_front:?}");
    let Bounds { omega_rad_s, amplitude_rad, rate_rad_s, .. } = bounds();
    let at = |[low, high]: [f64; 2], part: usize| low + (high - low) * part as f64 / 14.0;
    for place in 0..225 {
        let mut problem = search.problem.clone();
        problem.omega_rad_s = at(omega_rad_s, place / 15);
        let amplitude_rad = at(amplitude_rad, place % 15);
        problem.gait.joints[0].as_mut().unwrap().amplitude_rad = amplitude_rad;
        if amplitude_rad * problem.omega_rad_s > rate_rad_s {
            continue;
        }
        let mut solver = Solver::default();
        let Ok(metrics) = solver.solve(&problem, 1e-9) else { continue };
        let work_j = solver.loss_j().unwrap();
        let found = both(metrics.v_m_s, work_j / metrics.d_m);
        // Between two gaits of the front, no gait is better than both in either objective.
        let is_covered = of_front.windows(2).any(|pair| {
            found[0] <= pair[0][0] * (1.0 + BETTER) && found[1] <= pair[1][1] * (1.0 - BETTER)
        });
        assert!(is_covered, "{found:?} {of_front:?}");
    }
}

#[test]
fn a_constraint_on_another_objective_limits_a_search() {
    let free = vec![Command::Omega];
    let objective = Objective::WorkPerMetre;
    let problem = problem("kinematic-symmetric");
    let search = Search { problem, objective, free, bounds: bounds(), starts: 2 };
    let slow = run(&search);
    let fast = run(&Search { objective: Objective::Speed, ..search.clone() });
    let [slow, fast] = [slow, fast].map(|of| of.best().unwrap().motion.metrics.v_m_s);
    let least = 0.5 * (slow + fast);
    let bounds = Bounds { least: Some((Objective::Speed, least)), ..bounds() };
    let found = run(&Search { bounds, ..search });
    let best = found.best().unwrap();
    assert!((best.motion.metrics.v_m_s / least - 1.0).abs() < 1e-6, "{best:?}");
    assert_eq!(best.at_bound, ["least"]);
}

#[test]
fn saved_optima_are_on_the_page_until_the_model_is_fitted_again() {
    let folder = tempfile::tempdir().unwrap();
    let home = folder.path();
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == "semi-passive-symmetric");
    config.campaign.get_mut("semi-passive-symmetric").unwrap().models = vec![Model::SKID_ROLL];
    (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (1, 8, false);
    config.paths.start_at(home);
    let recipe = Recipe { omegas_rad_s: vec![2.0, 3.0, 4.0, 5.0], ..Recipe::new(1) };
    synthesise(&config, &config.paths.raw[0], &recipe, &|_| Ok(())).unwrap();
    let write = |config: &Config| {
        let Config { campaign, fit, .. } = config;
        let said = Config { campaign: campaign.clone(), fit: fit.clone(), ..Config::default() };
        std::fs::write(home.join("pipeline.toml"), toml::to_string(&said).unwrap()).unwrap();
    };
    write(&config);
    succeed(home, &["run"]);
    let page = || std::fs::read_to_string(home.join("reports/index.html")).unwrap();
    assert!(!page().contains("Best gaits"));
    let line = ["optimise", "semi-passive-symmetric", "--fitted", "--model", "skid-roll", "--free"];
    let keep = |what: &[&str]| {
        let search = ["omega", "--omega", "0.5..12", "--starts", "2", "--keep"];
        succeed(home, &[&line[..], &search, what].concat());
    };
    keep(&["--maximise", "v"]);
    keep(&["--minimise", "work-per-metre", "--replicates", "0"]);
    keep(&["--maximise", "v", "--replicates", "4"]);
    let rows = succeed(home, &["inspect", "optima", "--where", "rank = 1", "--json"]);
    let rows: Vec<Value> = serde_json::from_str(&rows).unwrap();
    let of = |name: &str| rows.iter().map(|row| row[name].clone()).collect::<Vec<_>>();
    assert_eq!(of("objective"), ["v", "work-per-metre"]);
    assert_eq!(of("replicates"), [Value::from(4), Value::Null]);
    let fits: Vec<Value> =
        serde_json::from_str(&succeed(home, &["inspect", "fits", "--json"])).unwrap();
    for name in ["skid1_kg_s", "stiffness_nm_rad"] {
        let [had, fitted] = [&rows[0], &fits[0]].map(|row| row[name].as_f64().unwrap());
        assert!((had / fitted - 1.0).abs() < 1e-9, "{name}: {had} {fitted}");
    }
    // Saved optima change nothing but the page.
    let figure = home.join("reports/figures/semi-passive-symmetric-optima.svg");
    assert!(!figure.exists());
    succeed(home, &["run"]);
    let text = page();
    assert!(text.contains("Best gaits") && !text.contains("Outdated"), "{text}");
    assert!(
        text.contains("This gait is best in 4 of 4 replicates")
            && text.contains("no replicates were requested")
    );
    assert!(figure.is_file());
    // The trials cover 2 to 5 rad/s.
    assert_eq!(of("extrapolated"), [false, true]);
    let beyond = "Extrapolated beyond the trials of the fit:</strong> omega 0.6749 rad";
    assert_eq!(text.matches("Extrapolated").count(), 1, "{text}");
    assert!(text.contains(beyond), "{text}");
    assert!(was_up_to_date(&trilink(home, &["run"])));
    // Second harmonics have intervals, too; here the maximum angle of the joint determines them in every replicate.
    let more = ["--free", "omega,second2", "--starts", "2", "--replicates", "4", "--json"];
    let ranges = ["--maximise", "v", "--omega", "0.5..12", "--amplitude-deg", "5..60"];
    let rows = succeed(home, &[&line[..line.len() - 1], &ranges, &more].concat());
    let rows: Vec<Value> = serde_json::from_str(&rows).unwrap();
    assert_eq!(rows[0]["at_bound"], "angle2");
    for (name, wide) in [
        ("omega_rad_s", 1e-5..1e-2),
        ("phi2_amplitude2_rad", 0.0..1e-9),
        ("phi2_phase2_rad", 0.0..1e-9),
    ] {
        let [low, value, high] = [&format!("{name}_lo"), name, &format!("{name}_hi")]
            .map(|name| rows[0][name].as_f64().unwrap());
        let is_held = low <= value && value <= high && wide.contains(&(high - low));
        assert!(is_held, "{name}: {low} {value} {high}");
    }
    // Optima for other coefficients.
    config.fit.gait_input = match config.fit.gait_input {
        GaitInput::Commanded => GaitInput::Measured,
        GaitInput::Measured => GaitInput::Commanded,
    };
    write(&config);
    succeed(home, &["run"]);
    assert!(page().contains("Outdated") && !figure.exists());
    // The page is written even if one table cannot be used.
    std::fs::copy(home.join("derived/starts.parquet"), home.join("derived/optima.parquet"))
        .unwrap();
    succeed(home, &["run"]);
    let text = page();
    assert!(!text.contains("Best gaits") && text.contains("`trilink optimise --keep`"));
}
