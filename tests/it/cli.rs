//! Tests of the command line.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::OnceLock;

use serde_json::{Value, json as value};
use tempfile::TempDir;
use trilink_mechanics::Model;
use trilink_robot::Quantity;
use trilink_tables::config::{Config, GaitInput};
use trilink_tables::{Columns as _, FitRow, Table};

use crate::common::{files, succeed, temporary, text, trilink};

const CAMPAIGNS: [&str; 2] = ["kinematic-symmetric", "semi-passive-symmetric"];
const TRIALS: [&str; 4] = [
    "kinematic-symmetric-0.50-r1",
    "kinematic-symmetric-3.90-r1",
    "semi-passive-symmetric-0.50-r1",
    "semi-passive-symmetric-3.90-r1",
];
const FIGURES: [&str; 27] = [
    "fig06",
    "fig11",
    "fig12",
    "fig13",
    "fig17",
    "kinematic-symmetric-sigma",
    "kinematic-symmetric-residuals",
    "kinematic-symmetric-starts",
    "kinematic-symmetric-profiles",
    "kinematic-symmetric-replicates",
    "fig03",
    "fig04",
    "fig05",
    "fig14",
    "semi-passive-symmetric-wheels",
    "fig15",
    "fig18",
    "semi-passive-symmetric-sigma",
    "semi-passive-symmetric-alpha",
    "semi-passive-symmetric-residuals",
    "semi-passive-symmetric-starts",
    "semi-passive-symmetric-profiles",
    "semi-passive-symmetric-replicates",
    "fig20",
    "fig08",
    "work",
    "truth",
];

/// Names of the demo's trials that are not gaits.
const DECAYS: [&str; 3] =
    ["kinematic-coast-down-r1", "semi-passive-joint-release-r1", "semi-passive-coast-down-r1"];

/// Demo with its results.
struct Demo {
    folder: TempDir,
    stdout: String,
    stderr: String,
}

/// Returns the demo that the tests share; no test changes it.
fn demo() -> &'static Demo {
    static DEMO: OnceLock<Demo> = OnceLock::new();
    DEMO.get_or_init(|| {
        let folder = temporary();
        write(folder.path(), "pipeline.toml", toml_of(&settings()));
        succeed(folder.path(), &["synth", "raw/demo", "--omega", "0.5,3.9", "--seed", "1"]);
        let output = trilink(folder.path(), &["demo"]);
        let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(0), "{stderr}");
        Demo { folder, stdout, stderr }
    })
}

/// Returns the configuration for two of the paper's campaigns with two models each.
fn settings() -> Config {
    let mut config = Config::default();
    config.campaign.retain(|name, _| CAMPAIGNS.contains(&name.as_str()));
    for campaign in config.campaign.values_mut() {
        campaign.models = vec![Model::NO_SKID, Model::SKID_ROLL];
    }
    // The measured symmetric gait crosses a singular shape, so that no motion without skid exists.
    config.fit.gait_input = GaitInput::Commanded;
    config.fit.starts = 2;
    config
}

fn toml_of(config: &Config) -> String {
    toml::to_string(config).expect("a configuration is TOML")
}

fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
    std::fs::write(path, content).expect("the file can be written");
}

fn empty_folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Creates a folder with the trials and configuration of the demo, but without results.
fn fresh_copy() -> TempDir {
    let folder = empty_folder();
    write(folder.path(), "pipeline.toml", toml_of(&settings()));
    for (name, bytes) in files(&demo().folder.path().join("raw/demo")) {
        write(&folder.path().join("raw/demo"), name.to_str().expect("a plain name"), bytes);
    }
    folder
}

fn derived(name: &str) -> Table {
    Table::read(&demo().folder.path().join("derived").join(name)).expect("a table")
}

fn json(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).expect("the file is there");
    serde_json::from_str(&text).expect("the file is JSON")
}

fn truth() -> Value {
    json(&demo().folder.path().join("raw/demo/truth.json"))
}

fn near(found: f64, known: f64, relative: f64) -> bool {
    (found - known).abs() <= relative * known.abs()
}

#[test]
fn the_demo_leaves_every_table_figure_and_record_and_nothing_else() {
    let mut expected = BTreeSet::new();
    const OF_FITS: [&str; 10] = [
        "fits",
        "alternative_fits",
        "starts",
        "profiles",
        "bootstrap",
        "comparison",
        "precision",
        "predictions",
        "residuals",
        "shared_fits",
    ];
    for table in ["trials", "checks", "robot_parameters"].into_iter().chain(OF_FITS) {
        expected.insert(format!("derived/{table}.parquet"));
    }
    for trial in TRIALS {
        for table in ["poses", "wheels", "cycles"] {
            expected.insert(format!("derived/{table}/{trial}.parquet"));
        }
    }
    for trial in DECAYS {
        for table in ["poses", "wheels"] {
            expected.insert(format!("derived/{table}/{trial}.parquet"));
        }
    }
    for figure in FIGURES {
        for extension in ["svg", "png", "pdf", "csv"] {
            expected.insert(format!("reports/figures/{figure}.{extension}"));
        }
    }
    for trial in TRIALS.iter().chain(&DECAYS) {
        expected.insert(format!("reports/trials/{trial}.html"));
    }
    let reports = [
        "index.html",
        "fits.json",
        "coefficients.tex",
        "cite.bib",
        "scorecard.json",
        "scorecard.html",
        "run.json",
        "history.html",
    ];
    expected.extend(reports.map(|name| format!("reports/{name}")));
    expected.insert("history.parquet".to_owned());
    let left = files(demo().folder.path());
    let made: BTreeSet<String> = left
        .keys()
        .map(|path| path.to_str().expect("a plain name").replace('\\', "/"))
        .filter(|name| !name.starts_with("raw/") && name != "pipeline.toml")
        .collect();
    assert_eq!(made, expected);
    assert!(left.values().all(|bytes| !bytes.is_empty()));
}

#[test]
fn the_demo_prints_the_fits_of_each_campaign_and_where_the_page_is() {
    let lines: Vec<&str> = demo().stdout.lines().collect();
    let fits = json(&demo().folder.path().join("reports/fits.json"));
    for campaign in CAMPAIGNS {
        let heading = lines.iter().position(|line| line.starts_with(&format!("{campaign}: ")));
        let block = &lines[heading.expect("a heading")..];
        assert!(block[0].contains(" fit"), "{}", block[0]);
        assert!(block[1].contains("misfit ratio") && block[1].contains("c_S0"), "{}", block[1]);
        // The table states whether a model is adequate, and marks the coefficients of inadequate models.
        for (model, line) in ["no-skid", "skid-roll"].into_iter().zip(&block[2..]) {
            let words: Vec<&str> = line.split_whitespace().collect();
            let mut fits = fits.as_array().expect("fits").iter();
            let fit = fits.find(|fit| fit["campaign"] == campaign && fit["model"] == model);
            let fit = fit.expect("a fit");
            let is_free = !fit["free"].as_array().expect("a list").is_empty();
            assert_eq!(words[0], model);
            match fit["adequate"].as_bool() {
                Some(true) => assert!(words[3] == "yes" && !line.contains('?'), "{line}"),
                Some(false) => assert!(words[3] == "no" && line.contains('?') == is_free, "{line}"),
                None => assert!(line.contains("not known"), "{line}"),
            }
        }
    }
    let page = lines[lines.len() - 1].strip_prefix("page: ").expect("the last line");
    assert!(page.ends_with("index.html"), "{page}");
    assert!(demo().folder.path().join(page).exists());
}

#[test]
fn the_demo_prints_measured_parameters_next_to_the_configured_ones() {
    let measured = derived("robot_parameters.parquet");
    assert_eq!(measured.values::<String>("trial").expect("names"), DECAYS);
    for (i, trial) in DECAYS.into_iter().enumerate() {
        let truth = &truth()["robots"][trial];
        for (column, name, bound) in [
            ("stiffness_nm_rad", "k_tau N m/rad", 0.02),
            ("damping_nm_s_rad", "c_tau N m s/rad", 0.05),
            ("roll_sum_kg_s", "sum c_R kg/s", 0.03),
        ] {
            let found = measured.values::<f64>(column).expect("numbers")[i];
            let heading = format!("{trial}: ");
            let mut lines = demo().stdout.lines().skip_while(|line| !line.starts_with(&heading));
            let basis = lines.next().expect("a heading");
            assert!(basis.contains("; no repeats: errors from noise alone"), "{basis}");
            let mut lines = lines.take_while(|line| line.starts_with("  "));
            let line = lines.find(|line| line.contains(name));
            let Some(known) = truth[column].as_f64() else {
                assert!(found.is_nan() && line.is_none(), "{trial} {column}");
                continue;
            };
            assert!(near(found, known, bound), "{trial} {column}: {found} {known}");
            let line = line.expect(name);
            let words: Vec<&str> = line.split_whitespace().collect();
            assert_eq!(words[words.len() - 5], format!("{found:.5}"));
            assert_eq!(words[words.len() - 1], format!("{known:.5}"));
        }
    }
}

#[test]
fn without_a_terminal_progress_is_plain_lines() {
    let stderr = &demo().stderr;
    assert!(!stderr.contains(['\r', '\x1b']), "{stderr}");
    for stage in ["ingest 7/7 ", "fit 4/4 ", "report 1/1 "] {
        assert!(stderr.lines().any(|line| line.starts_with(stage)), "{stderr}");
    }
    assert!(!stderr.contains("synth "), "trials that are there are not made again");
}

#[test]
fn the_tables_have_the_documented_columns() {
    let metrics = "d_m v_m_s sigma0 sigma1 sigma2 alpha1_rad dtheta_rad";
    let trial = TRIALS[0];
    let parameters = "skid0_kg_s skid1_kg_s skid2_kg_s roll0_kg_s roll1_kg_s roll2_kg_s \
                      roll_sum_kg_s skid_dry0_n skid_dry1_n skid_dry2_n skid_static0_n \
                      skid_static1_n skid_static2_n stribeck_m_s skid_power0_n skid_power1_n \
                      skid_power2_n skid_exponent0 skid_exponent1 skid_exponent2 roll_dry0_n \
                      roll_dry1_n roll_dry2_n roll_dry_sum_n transition_m_s stiffness_nm_rad \
                      damping_nm_s_rad";
    let prefixed = |prefix: &str| {
        let names = parameters.split_whitespace().map(|name| format!("{prefix}{name}"));
        names.collect::<Vec<_>>().join(" ")
    };
    let limits = |name: &str| {
        format!(
            "{name}_lo {name}_hi {name}_scatter {name}_systematic {name}_u_a {name}_u_b {name}_dof \
             {name}_coverage_factor"
        )
    };
    let limits = parameters.split_whitespace().map(limits).collect::<Vec<_>>().join(" ");
    let of_law = |law: &str| {
        let values = "roll_sum_kg_s roll_dry_sum_n stiffness_nm_rad damping_nm_s_rad joint_dry_nm";
        let values = values.split(' ').map(|name| format!("{law}_{name} {law}_{name}_se"));
        let fit = "misfit_m misfit_rad misfit_over_noise f adequate";
        let fit = fit.split(' ').map(|name| format!("{law}_{name}"));
        fit.chain(values).collect::<Vec<_>>().join(" ")
    };
    let laws = ["viscous", "coulomb", "coulomb_viscous"].map(of_law).join(" ");
    let misfit = |nth: usize| {
        let parts = "side metric campaign least most largest from_rad_s to_rad_s";
        parts.split(' ').map(|part| format!("misfit{nth}_{part} ")).collect::<String>()
    };
    let misfit: String = (0..3).map(misfit).collect();
    const SHARED: &str = "shared_fits.parquet";
    let fits = format!(
        "campaign model gait_input {parameters} {limits} no_interval no_interval_of free measured identifiable \
         practically_not structurally_not law_is_like law_is_like0_kg_s law_is_like1_kg_s law_is_like2_kg_s at_bound j lack_of_fit lack_of_fit_limit \
         lack_of_fit_d lack_of_fit_v lack_of_fit_sigma lack_of_fit_alpha \
         autocorrelation autocorrelation_limit runs runs_limit adequate undecided undecided_of {misfit} misfit_rms_d misfit_rms_v misfit_rms_sigma0 misfit_rms_sigma1 \
         misfit_rms_sigma2 misfit_rms_alpha1 sharing raw_skid_trials unlike_repeats missing_metrics \
         few_frequencies single_day \
         trials starts starts_reached starts_failed resumed solves status failure"
    );
    for (name, columns) in [
        (
            format!("poses/{trial}.parquet"),
            "trial frame time_s x_m y_m theta_rad phi1_rad phi2_rad residual0_mm residual1_mm \
             residual2_mm fill0 fill1 fill2 outlier0 outlier1 outlier2 unseen0 unseen1 unseen2 \
             corrected0 corrected1 corrected2"
                .to_owned(),
        ),
        (
            format!("wheels/{trial}.parquet"),
            "trial frame time_s roll0_m_s roll1_m_s roll2_m_s skid0_m_s skid1_m_s skid2_m_s"
                .to_owned(),
        ),
        (
            format!("cycles/{trial}.parquet"),
            format!(
                "trial cycle start_s {metrics} phi1_offset_rad phi1_amplitude_rad phi1_phase_rad \
                 phi2_offset_rad phi2_amplitude_rad phi2_phase_rad used reason"
            ),
        ),
        (
            "trials.parquet".to_owned(),
            "trial folder day id file campaign kind omega_commanded_rad_s omega_rad_s omega_rad_s_se cycles d_m \
             d_m_se v_m_s v_m_s_se sigma0 sigma0_se sigma1 sigma1_se sigma2 sigma2_se \
             sigma0_debiased sigma0_debiased_se sigma1_debiased sigma1_debiased_se \
             sigma2_debiased sigma2_debiased_se alpha1_rad alpha1_rad_se dtheta_rad \
             dtheta_rad_se phi1_offset_rad phi1_amplitude_rad phi1_phase_rad \
             phi1_harmonics_rad phi1_offset_rad_se phi1_amplitude_rad_se phi1_phase_rad_se \
             phi2_offset_rad phi2_amplitude_rad phi2_phase_rad phi2_harmonics_rad \
             phi2_offset_rad_se phi2_amplitude_rad_se phi2_phase_rad_se heading_rad coverage residual_mm noise_white smoothing_window smoothing_left1 \
             smoothing_left2 smoothing_left3 status message"
                .to_owned(),
        ),
        (
            "robot_parameters.parquet".to_owned(),
            format!(
                "trial kind robot law joint inertia_kg_m2 natural_rad_s natural_rad_s_se \
                 damping_ratio damping_ratio_se damping_ratio_decrement \
                 damping_ratio_decrement_se rest_angle_rad rest_angle_rad_se \
                 rest_angle_configured_rad released_s decay_cosine_rad decay_sine_rad \
                 stiffness_nm_rad stiffness_nm_rad_se stiffness_configured_nm_rad \
                 damping_nm_s_rad damping_nm_s_rad_se damping_configured_nm_s_rad joint_dry_nm \
                 joint_dry_nm_se mass_kg decay_1_s decay_1_s_se roll_sum_kg_s roll_sum_kg_s_se \
                 roll_sum_configured_kg_s roll0_kg_s roll0_kg_s_se roll1_kg_s roll1_kg_s_se \
                 roll2_kg_s roll2_kg_s_se roll_dry_sum_n roll_dry_sum_n_se \
                 roll_dry_sum_configured_n heading_rad roll_correlation slope_along_rad \
                 slope_along_rad_se slope_x_rad slope_x_rad_se slope_y_rad slope_y_rad_se \
                 slope_status pooled_trials {laws} misfit_over_noise_limit f_limit repeats status"
            ),
        ),
        ("checks.parquet".to_owned(), "trial check severity value limit message".to_owned()),
        ("fits.parquet".to_owned(), fits.clone()),
        ("alternative_fits.parquet".to_owned(), fits.clone()),
        (
            SHARED.to_owned(),
            format!("robot campaigns wheels joints {fits} j_separate rise rise_limit p_value not_tested not_tested_of"),
        ),
        (
            "starts.parquet".to_owned(),
            format!(
                "campaign model start {} {} j solves stopped",
                prefixed("began_"),
                prefixed("ended_")
            ),
        ),
        (
            "profiles.parquet".to_owned(),
            format!("campaign model parameter value {parameters} j limit_j"),
        ),
        (
            "bootstrap.parquet".to_owned(),
            format!("campaign model replicate {parameters} j criterion_resampled solves stopped"),
        ),
        (
            "comparison.parquet".to_owned(),
            "campaign model j j_d j_v j_sigma j_alpha j_left_out j_extrapolated \
             extrapolated_above_rad_s free terms criterion wins rank preferred rival tell_omega_rad_s tell_metric \
             tell_standard_errors status outcome contradiction contradiction_trial contradiction_missing \
             contradiction_robot contradiction_quantity contradiction_unit contradiction_measured \
             contradiction_configured replicates trials_without_metrics trials_filtered"
                .to_owned(),
        ),
        (
            "precision.parquet".to_owned(),
            "campaign metric trials days repeatability repeatability_dof reproducibility reproducibility_dof \
             no_repeatability no_reproducibility"
                .to_owned(),
        ),
        (
            "predictions.parquet".to_owned(),
            format!(
                "campaign model trial omega_rad_s source {} no_interval no_interval_of j status from_rest",
                metrics.split(' ').map(|of| format!("{of} {of}_lo {of}_hi")).collect::<Vec<_>>().join(" ")
            ),
        ),
        (
            "residuals.parquet".to_owned(),
            "campaign model trial omega_rad_s metric measured predicted residual standard_error noise \
             residual_standard_errors"
                .to_owned(),
        ),
    ] {
        let table = derived(&name);
        let found = table.frame.get_column_names();
        let expected: Vec<&str> = columns.split_whitespace().collect();
        assert_eq!(found, expected, "{name}");
        // The demo has no fits to several campaigns.
        assert_eq!(table.is_empty(), name == SHARED, "{name}");
    }
}

#[test]
fn every_table_says_which_version_made_it_of_what_and_has_a_checksum() {
    for (path, bytes) in files(&demo().folder.path().join("derived")) {
        for key in ["trilink.version", "trilink.input", "trilink.blake3"] {
            let holds = bytes.windows(key.len()).any(|window| window == key.as_bytes());
            assert!(holds, "{}: {key}", path.display());
        }
    }
}

#[test]
fn frames_are_timed_from_the_first_and_fills_are_named() {
    for trial in TRIALS {
        let poses = derived(&format!("poses/{trial}.parquet"));
        let wheels = derived(&format!("wheels/{trial}.parquet"));
        let frames = poses.values::<i64>("frame").expect("frames");
        assert_eq!(frames, wheels.values::<i64>("frame").expect("frames"));
        for (frame, time_s) in frames.iter().zip(poses.values::<f64>("time_s").expect("times")) {
            assert_eq!(time_s, (frame - frames[0]) as f64 / 120.0);
        }
        for link in 0..3 {
            let fills = poses.values::<String>(&format!("fill{link}")).expect("fills");
            let known = ["measured", "rigid", "interpolated", "missing"];
            assert!(fills.iter().all(|fill| known.contains(&fill.as_str())));
        }
    }
}

#[test]
fn trials_stand_in_the_order_of_the_list() {
    let trials = derived("trials.parquet");
    assert_eq!(trials.values::<String>("trial").expect("names"), [&TRIALS[..], &DECAYS].concat());
}

#[test]
fn fitted_skid_coefficients_are_the_planted_ones_to_20_percent_or_marked() {
    let (fits, truth) = (derived("fits.parquet"), truth());
    let fits = FitRow::from_table(&fits).expect("fits");
    assert_eq!(fits.len(), 4);
    for fit in fits.iter().filter(|fit| fit.model == Model::SKID_ROLL) {
        let planted = &truth["campaigns"][&fit.campaign]["skid_kg_s"];
        for (i, skid) in Quantity::Skid.of_each().into_iter().enumerate() {
            assert!(fit.free.contains(&skid));
            let (found, known) = (fit.parameters[skid], planted[i].as_f64().expect("a number"));
            let told = near(found, known, 0.2) || !fit.identifiable.contains(&skid);
            assert!(told, "{} {skid:?}: {found} for {known}", fit.campaign);
        }
    }
}

#[test]
fn predictions_are_at_the_trials_frequencies_and_on_a_finer_grid() {
    let predictions = derived("predictions.parquet");
    let sources = predictions.values::<String>("source").expect("sources");
    let count = |wanted: &str| sources.iter().filter(|source| *source == wanted).count();
    assert_eq!(count("trial"), 8);
    assert!(count("curve") > 5 * count("trial"));
    assert_eq!(count("trial") + count("curve"), sources.len());
}

#[test]
fn a_sentence_states_the_preferred_model_of_a_campaign() {
    let page = demo().folder.path().join("reports/index.html");
    let page = std::fs::read_to_string(page).expect("the page").replace("&#x2f;", "/");
    let fits = FitRow::from_table(&derived("fits.parquet")).expect("fits");
    for campaign in ["kinematic-symmetric", "semi-passive-symmetric"] {
        let heading = format!("{campaign}: ");
        let mut lines = demo().stdout.lines().skip_while(|line| !line.starts_with(&heading));
        let sentence = lines.find(|line| line.contains("skid-roll") && line.contains(": J = "));
        let sentence = sentence.expect("a sentence").trim_start();
        let known = [
            "The data prefer skid-roll: J = ",
            "Only skid-roll has been fitted: J = ",
            "No model fits; skid-roll comes closest: J = ",
        ];
        assert!(known.iter().any(|known| sentence.starts_with(known)), "{sentence}");
        let of_campaign = |fit: &&FitRow| fit.campaign == campaign && fit.model == Model::SKID_ROLL;
        let fit = fits.iter().find(of_campaign).expect("a fit");
        let ratio = format!("misfit {:.2} times the noise", fit.lack_of_fit);
        let fits = match (fit.adequate, sentence.starts_with("Only")) {
            (Some(true), _) => format!("; it fits ({ratio}"),
            (None, _) => "; whether it fits is unknown, because ".to_owned(),
            (_, true) => format!("; it does not fit ({ratio}"),
            _ => format!("; {ratio}"),
        };
        assert!(sentence.contains(&fits), "{sentence}");
        assert!(page.contains(sentence), "{sentence}");
    }
}

#[test]
fn the_record_counts_trials_and_names_fits_and_figures() {
    let record = json(&demo().folder.path().join("reports/run.json"));
    assert_eq!(record["trials"]["total"], 7);
    assert_eq!(record["trials"]["failed"], 0);
    assert_eq!(record["fits"].as_array().map(Vec::len), Some(4));
    assert_eq!(record["figures"], Value::from(FIGURES.to_vec()));
    let fits = json(&demo().folder.path().join("reports/fits.json"));
    assert_eq!(fits.as_array().map(Vec::len), Some(4));
}

#[test]
fn any_number_of_threads_gives_the_same_tables() {
    let folder = fresh_copy();
    let tables = ["1", "2"].map(|threads| {
        let mut config = settings();
        config.paths.derived = format!("derived-{threads}").into();
        write(folder.path(), "threads.toml", toml_of(&config));
        succeed(folder.path(), &["-c", "threads.toml", "--threads", threads, "ingest"]);
        files(&folder.path().join(&config.paths.derived))
    });
    assert_eq!(tables[0].len(), 21);
    assert!(tables[0] == tables[1]);
}

#[test]
fn the_stages_one_by_one_give_what_a_run_gives() {
    let folder = fresh_copy();
    for stage in ["ingest", "fit", "report"] {
        succeed(folder.path(), &[stage]);
    }
    let [stages, run] = [folder.path(), demo().folder.path()].map(|folder| {
        let mut left = files(folder);
        // These files contain the time at which they were written.
        for name in ["reports/run.json", "history.parquet", "reports/history.html"] {
            left.remove(Path::new(name));
        }
        left
    });
    assert_eq!(stages.keys().collect::<Vec<_>>(), run.keys().collect::<Vec<_>>());
    for (path, bytes) in stages {
        assert!(bytes == run[&path], "{}", path.display());
    }
}

#[test]
fn a_folder_named_on_the_command_line_is_run_instead_of_the_configured_one() {
    let folder = fresh_copy();
    std::fs::rename(folder.path().join("raw/demo"), folder.path().join("elsewhere"))
        .expect("the folder can move");
    let stdout = succeed(folder.path(), &["run", "elsewhere"]);
    assert!(stdout.contains("7 trials: "), "{stdout}");
    let record = json(&folder.path().join("reports/run.json"));
    assert_eq!(record["folders"], value!(["elsewhere"]));
}

#[test]
fn quiet_prints_only_results() {
    let folder = fresh_copy();
    for command in ["demo", "ingest", "fit", "report", "check"] {
        let output = trilink(folder.path(), &["--quiet", command]);
        assert_eq!(output.status.code(), Some(0));
        assert_eq!(text(&output.stderr), "", "{command}");
        assert!(!output.stdout.is_empty(), "{command}");
    }
}

#[test]
fn check_counts_trials_and_writes_nothing() {
    let folder = fresh_copy();
    let before = files(folder.path());
    let stdout = succeed(folder.path(), &["check"]);
    assert!(files(folder.path()) == before);
    assert!(stdout.ends_with("7 trials: 7 ok, 0 flagged, 0 failed\n"), "{stdout}");
    // JSON also lists the checks that found nothing.
    let json: Value = serde_json::from_str(&succeed(folder.path(), &["check", "--json"])).unwrap();
    let trials = json.as_array().unwrap();
    assert!(TRIALS.iter().all(|name| trials.iter().any(|trial| trial["trial"] == *name)));
    for (check, count) in [("W001 rate", 7), ("W012 swapped-labels", 7), ("W005 frequency", 4)] {
        let checks = trials.iter().flat_map(|trial| trial["checks"].as_array().unwrap());
        let found = checks.filter(|row| row["check"] == check && row["severity"] == "ok");
        assert_eq!(found.count(), count, "{check}");
    }
}

#[test]
fn check_lists_the_content_and_problems_of_a_marker_file() {
    let folder = fresh_copy();
    let before = files(folder.path());
    let (trial, name) = (TRIALS[0], format!("raw/demo/{}.csv", TRIALS[0]));
    let sound = text(&before[Path::new(&name)]);
    let stdout = succeed(folder.path(), &["check", &name]);
    assert!(files(folder.path()) == before);
    let rows = sound.lines().count() - 5;
    let first: usize = sound.lines().nth(5).unwrap().split(',').next().unwrap().parse().unwrap();
    for line in [
        format!("{name}: can be ingested\n"),
        format!("\n  section Trajectories: 120 Hz, {rows} rows\n"),
        "\n  rate: 120 Hz\n".to_owned(),
        format!("\n  frames: {first} to {} in {rows} rows, 0 missing", first + rows - 1),
        "\n  markers: 10, seen in 9".to_owned(),
        "\n    Snake:M1 ".to_owned(),
        " gaps  link 2\n".to_owned(),
        ", median 1 frames (0.008 s), longest ".to_owned(),
        "\n1 files, of which 0 cannot be ingested\n".to_owned(),
    ] {
        assert!(stdout.contains(&line), "{line:?}: {stdout}");
    }

    let damaged = sound.replacen("\n120\r", "\n100\r", 1).replacen("Snake:F2", "Snake:G2", 1);
    write(folder.path(), "damaged.csv", damaged);
    let output = trilink(folder.path(), &["check", "damaged.csv", &name, "absent.csv"]);
    let stdout = text(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{stdout}");
    for line in [
        "damaged.csv: cannot be ingested\n",
        "  error: the file's frame rate is 100 Hz, but vicon.rate_hz is 120 Hz",
        "  error: the file has no marker `F2`, which markers.link1 of pipeline.toml requires",
        "  error: no such file\n",
        "\n3 files, of which 2 cannot be ingested\n",
    ] {
        assert!(stdout.contains(line), "{line:?}: {stdout}");
    }
    assert!(stdout.contains(trial));

    let output = trilink(folder.path(), &["check", "absent.csv", "gone.csv"]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(text(&output.stdout), "");
    let stderr = text(&output.stderr);
    assert!(
        stderr.ends_with("error: absent.csv: no such file\ngone.csv: no such file\n"),
        "{stderr}"
    );
    let output = trilink(folder.path(), &["check", "raw", &name]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("needed either trial folders or marker files"));
}

#[test]
fn check_prints_json_of_folders_and_of_files() {
    let folder = fresh_copy();
    let checked: Value = serde_json::from_str(&succeed(folder.path(), &["check", "--json"]))
        .expect("one JSON array");
    for (checked, trial) in checked.as_array().expect("an array").iter().zip(TRIALS) {
        assert_eq!(checked["trial"], trial);
        assert!(checked["cycles"].as_u64().is_some_and(|cycles| cycles >= 2));
        let coverage = checked["checks"].as_array().expect("checks").iter();
        let coverage: Vec<_> = coverage.filter(|c| c["check"] == "W003 coverage").collect();
        assert_eq!((coverage.len(), &coverage[0]["severity"]), (1, &Value::from("ok")));
    }
    let name = format!("raw/demo/{}.csv", TRIALS[0]);
    std::fs::remove_file(folder.path().join(format!("raw/demo/{}.csv", TRIALS[1]))).unwrap();
    let output = trilink(folder.path(), &["check", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let checked: Value = serde_json::from_str(&text(&output.stdout)).expect("one JSON array");
    assert_eq!(checked[1]["status"], "failed");
    assert_eq!(checked[1]["checks"][0]["check"], "E001 failed");
    assert_eq!(checked[1]["checks"][0]["value"], Value::Null);
    assert!(checked[1]["message"].as_str().is_some_and(|m| m.ends_with("no such file")));
    write(folder.path(), "empty.csv", "");
    let output = trilink(folder.path(), &["check", "--json", &name, "empty.csv"]);
    assert_eq!(output.status.code(), Some(1));
    let checked: Value = serde_json::from_str(&text(&output.stdout)).expect("one JSON array");
    assert_eq!(checked[0]["file"], name.as_str());
    assert_eq!(checked[0]["sections"][0]["rate_hz"], 120.0);
    assert_eq!(checked[0]["recording"]["markers"].as_array().map(Vec::len), Some(10));
    assert_eq!(checked[0]["recording"]["gaps"]["median_frames"], 1);
    assert_eq!(checked[0]["stops"], serde_json::json!([]));
    assert_eq!(checked[1]["recording"], Value::Null);
    let stop = "empty.csv: found an empty file, needed a `Trajectories` section";
    assert_eq!(checked[1]["stops"], serde_json::json!([stop]));
}

#[test]
fn virtual_markers_can_be_left_out_by_a_pattern() {
    let folder = fresh_copy();
    let (trial, name) = (TRIALS[1], format!("raw/demo/{}.csv", TRIALS[1]));
    let sound = std::fs::read_to_string(folder.path().join(&name)).unwrap();
    // A second subject has a virtual marker with the name of one of the robot's markers.
    let cells = |line: &str, cell: &str| format!("{line}{cell}\r\n");
    let ghost: String = sound
        .lines()
        .enumerate()
        .map(|(i, line)| match i {
            2 => cells(line, "V_Ghost:M1,,"),
            3 => cells(line, ",X,Y,Z"),
            4 => cells(line, ",mm,mm,mm"),
            0 | 1 => cells(line, ""),
            _ => cells(line, ",1,2,3"),
        })
        .collect();
    write(folder.path(), &name, ghost);
    let output = trilink(folder.path(), &["check", &name]);
    let stdout = text(&output.stdout);
    assert!(stdout.contains("the marker `M1` of markers.link0 matches the labels "), "{stdout}");

    let settings = std::fs::read_to_string(folder.path().join("pipeline.toml")).unwrap();
    let ignoring = settings.replacen("ignore = []", "ignore = [\"V_*\"]", 1);
    assert_ne!(ignoring, settings);
    write(folder.path(), "pipeline.toml", &ignoring);
    let stdout = succeed(folder.path(), &["check", &name]);
    let line = stdout.lines().find(|line| line.contains("V_Ghost:M1")).unwrap();
    assert!(line.ends_with("  ignored"), "{line}");
    succeed(folder.path(), &["ingest"]);
    let poses = format!("derived/poses/{trial}.parquet");
    let found = Table::read(&folder.path().join(&poses)).unwrap();
    let usual = Table::read(&demo().folder.path().join(&poses)).unwrap();
    assert_eq!(found.values::<f64>("x_m").unwrap(), usual.values::<f64>("x_m").unwrap());

    write(folder.path(), "pipeline.toml", ignoring.replacen("V_*", "F?", 1));
    let output = trilink(folder.path(), &["check"]);
    let stderr = text(&output.stderr);
    let said = "key `vicon.ignore`: found \"F?\", needed patterns that do not match `F1`";
    assert!(stderr.contains(said), "{stderr}");
}

#[test]
fn calibrated_markers_can_be_pasted_into_the_configuration() {
    let folder = fresh_copy();
    let before = files(folder.path());
    let arguments = ["ingest", "--calibrate", "kinematic-symmetric-3.90-r1"];
    let tables = succeed(folder.path(), &arguments);
    assert!(files(folder.path()) == before, "nothing is written");
    assert!(tables.contains("# h_m = 0.14") && tables.contains("; 0.14400 is configured ("));
    let pasted = std::fs::read_to_string(folder.path().join("pipeline.toml")).unwrap();
    let (others, _) = pasted.split_once("[markers").unwrap();
    write(folder.path(), "pasted.toml", format!("{others}\n{tables}"));
    let config = Config::load(&folder.path().join("pasted.toml")).unwrap();
    for (found, truth) in config.markers.links().iter().zip(Config::default().markers.links()) {
        assert_eq!(found.keys().collect::<Vec<_>>(), truth.keys().collect::<Vec<_>>());
        for (found, truth) in found.values().flatten().zip(truth.values().flatten()) {
            assert!((found - truth).abs() < 1.0, "{found} {truth}");
        }
    }
    let checked = succeed(folder.path(), &["check", "-c", "pasted.toml"]);
    assert!(checked.ends_with(", 0 failed\n"), "{checked}");

    let output = trilink(folder.path(), &["ingest", "--calibrate", "kinematic-symetric-3.90-r1"]);
    assert_eq!((output.status.code(), text(&output.stdout).as_str()), (Some(2), ""));
    let stderr = text(&output.stderr);
    assert!(stderr.contains("did you mean `kinematic-symmetric-3.90-r1`?"), "{stderr}");
}

/// Runs the program, asserts exit status 2, and returns its message.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = trilink(folder, arguments);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {stderr}");
    stderr
}

#[test]
fn a_list_of_another_length_is_refused_by_its_key_and_both_lengths() {
    let folder = empty_folder();
    let defaults = toml_of(&Config::default());
    let simulate = ["simulate", "kinematic-skewed", "--model", "skid", "--omega", "3"];
    for (old, new, message) in [
        (
            "mass_kg = [1.04, 0.2, 0.2]",
            "mass_kg = [1.2, 0.3, 0.3, 0.3, \"x\"]",
            "key `robot.kinematic.mass_kg`: found a list of length 5, needed a list of length 3",
        ),
        (
            "skid_bounds_kg_s = [1.0, 1000.0]",
            "skid_bounds_kg_s = [1.0, 10.0, 100.0]",
            "key `fit.skid_bounds_kg_s`: found a list of length 3, needed a list of length 2",
        ),
        (
            "M1 = [110.0, 35.0, 62.0]",
            "M1 = [110.0, 35.0, 62.0, 1.0]",
            "key `markers.link0.M1`: found a list of length 4, needed a list of length 3",
        ),
        (
            "b_m = 0.0685",
            "b_m = [0.0685, 0.001, 0.002]",
            "key `robot.kinematic.b_m`: found a list of length 3, needed a number or a list of length 2",
        ),
    ] {
        let changed = defaults.replacen(old, new, 1);
        assert_ne!(changed, defaults, "{old}");
        write(folder.path(), "pipeline.toml", changed);
        for command in [&["config", "check"][..], &simulate] {
            let said = refused(folder.path(), command);
            assert!(said.contains(message), "{said}");
        }
    }
    write(folder.path(), "pipeline.toml", &defaults);
    for (setting, message) in [
        ("mass_kg=1.2,0.3,0.3,0.3", "found a list of length 4, needed a list of length 3"),
        ("mass_kg=1.2,0.3", "found a list of length 2, needed a list of length 3"),
        ("mass_kg=1.2", "expected a list of length 3"),
        ("h_m=0.1,0.2", "found a list of length 2, needed a number"),
        // `skid_dry0` is the value for one of three wheels.
        ("skid_dry0=1,2", "found a list of length 2, needed a number"),
    ] {
        let said = refused(folder.path(), &[&simulate[..], &["--set", setting]].concat());
        assert!(said.contains(&format!("--set {setting}: ")) && said.contains(message), "{said}");
    }
    let list = "[[trial]]\nid = \"a\"\nfile = \"a.csv\"\nkind = \"gait\"\n\
                campaign = \"kinematic-skewed\"\nomega_rad_s = [3.0, 3.5]\n";
    write(folder.path(), "raw/demo/trials.toml", list);
    let message = "trials.toml, line 6: key `trial[0].omega_rad_s`: found a list of length 2, needed a number";
    for command in ["check", "run"] {
        let said = refused(folder.path(), &[command]);
        assert!(said.contains(message), "{said}");
    }
}

/// Creates a folder with the trials of a configuration, but without a `pipeline.toml`.
fn trials_of(settings: &str) -> TempDir {
    let folder = empty_folder();
    write(folder.path(), "other.toml", settings);
    let synth = ["-c", "other.toml", "-q", "synth", "raw", "--omega", "5", "--seed", "1"];
    succeed(folder.path(), &synth);
    folder
}

#[test]
fn without_a_configuration_trials_of_other_robots_are_rejected() {
    let small =
        &crate::common::SMALL[..crate::common::SMALL.find("[campaign.kinematic-skewed]").unwrap()];
    // One campaign unknown to the paper, and one of the paper's with other markers.
    let campaign = small.replace("campaign.kinematic-symmetric", "campaign.slalom");
    let markers = "[markers.link0]\nA1 = [80.0, 30.0, 60.0]\nA2 = [-80.0, 30.0, 60.0]\n\
                   [markers.link1]\nB1 = [40.0, 30.0, 55.0]\nB2 = [-40.0, -30.0, 55.0]\n\
                   [markers.link2]\nC1 = [-40.0, 30.0, 55.0]\nC2 = [40.0, -30.0, 55.0]\n";
    for (settings, why) in [
        (
            campaign.clone(),
            "0 of 1 trials match the robots of the paper's experiment: trials.toml, trial `slalom-5.00-r1`",
        ),
        (format!("{small}{markers}"), "whose labels are "),
    ] {
        let folder = trials_of(&settings);
        let before = files(folder.path());
        for command in [&["run", "raw"][..], &["run", "raw", "--dry-run"], &["ingest", "raw"]] {
            let said = refused(folder.path(), command);
            assert!(said.contains(why), "{said}");
            for way in ["no pipeline.toml", "-c FILE", "`trilink init raw`", "`trilink demo`"] {
                assert!(said.contains(way), "{said}");
            }
        }
        assert!(files(folder.path()) == before, "nothing is written");
        let checked = trilink(folder.path(), &["check", "raw"]);
        assert_eq!(checked.status.code(), Some(1));
        assert!(
            text(&checked.stderr)
                .contains("no pipeline.toml in the current folder: the paper's robots")
        );
        // Trials that were ingested with a configuration are not fitted without it.
        succeed(folder.path(), &["-c", "other.toml", "-q", "ingest"]);
        let before = files(folder.path());
        if settings == campaign {
            for command in ["fit", "report"] {
                let said = refused(folder.path(), &[command]);
                let why = "0 of 1 ingested trials belong to a campaign of the paper's experiment: found `slalom`";
                assert!(said.contains(why) && said.contains("`trilink init raw`"), "{said}");
            }
        }
        assert!(files(folder.path()) == before, "nothing is written");
    }
    // Marker files without a list of trials.
    let said = refused(empty_folder().path(), &["run", "raw"]);
    assert!(said.contains("no trials in the current folder") && said.contains("-c FILE"), "{said}");
}

#[test]
fn without_a_configuration_trials_of_the_paper_s_robots_are_ingested() {
    let small =
        &crate::common::SMALL[..crate::common::SMALL.find("[campaign.kinematic-skewed]").unwrap()];
    let folder = trials_of(small);
    let output = trilink(folder.path(), &["ingest", "raw"]);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert!(
        stderr.starts_with("no pipeline.toml in the current folder: the paper's robots"),
        "{stderr}"
    );
    let named = trilink(folder.path(), &["-c", "other.toml", "ingest"]);
    assert!(!text(&named.stderr).contains("no pipeline.toml"));
}

#[test]
fn every_subcommand_explains_itself() {
    let folder = empty_folder();
    let help = succeed(folder.path(), &["--help"]);
    for command in [
        "demo", "run", "ingest", "fit", "report", "check", "simulate", "optimise", "design",
        "synth",
    ] {
        assert!(help.contains(&format!("\n  {command} ")), "{command}: {help}");
        let help = succeed(folder.path(), &[command, "--help"]);
        assert!(help.contains(&format!("Usage: trilink {command}")), "{help}");
    }
    let version = succeed(folder.path(), &["--version"]);
    assert_eq!(version.trim(), format!("trilink {}", env!("CARGO_PKG_VERSION")));
}

#[test]
fn the_repository_s_pipeline_toml_has_the_defaults() {
    let home = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut expected = Config::default();
    expected.paths.start_at(home);
    let loaded = Config::load(&home.join("pipeline.toml")).expect("the file is well-formed");
    assert_eq!(loaded, expected);
}

#[test]
fn the_repository_s_pipeline_toml_has_every_key() {
    let file = include_str!("../../pipeline.toml");
    let written: toml::Table = file.parse().expect("TOML");
    let known: toml::Table = toml_of(&Config::default()).parse().expect("TOML");
    assert_eq!(keys("", &known), keys("", &written));
}

/// Returns the paths of all keys in a table and its subtables.
fn keys(path: &str, table: &toml::Table) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (key, value) in table {
        let key = format!("{path}{key}");
        if let Some(inner) = value.as_table() {
            found.extend(keys(&format!("{key}."), inner));
        }
        found.insert(key);
    }
    found
}
