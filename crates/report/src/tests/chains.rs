//! Tests of the report on campaigns whose robots are chains, beside a campaign of a robot with three links.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use trilink_mechanics::{FIT_ACCURACY, Laws, Pose, Problem, Sample};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{AnyRobot, ByParameter, Chain, Parameter, Quantity};
use trilink_statistics::Estimate;
use trilink_tables::{
    Clock, Coordinates, CycleRow, Fill, FitRow, FrameTexts, Frames as _, JointGait, LabelFault,
    Numbered, PoseFrames, PredictionRow, PredictionSource, WheelFrames, WheelVelocities,
    cycles_path, poses_path, wheels_path,
};

use super::made_up::SYMMETRIC;
use super::recording::save;
use super::*;

const TWISTCAR: &str = "twistcar";
const PASSIVE: &str = "passive";
const OMEGA_RAD_S: [f64; 2] = [2.0, 3.9];
const CYCLES: usize = 4;
/// Number of samples of the simulated cycle, which are the frames of the recordings.
const SAMPLES: usize = 120;

/// Returns the configuration of a robot with three links and of the robots of the gallery.
fn config_with(folder: &Path, robots: &[&str]) -> Config {
    let mut config = super::config(folder);
    config.campaign.retain(|name, _| name == SYMMETRIC);
    config.paths = Config::default().paths;
    let text = toml::to_string(&config).expect("a configuration") + &robots.concat();
    let path = folder.join("pipeline.toml");
    std::fs::write(&path, text).expect("writes");
    Config::load(&path).unwrap_or_else(|error| panic!("{error}"))
}

/// The first wheel of the twistcar is steered.
fn robots() -> [String; 2] {
    let twistcar = include_str!("../../../../docs/robots/twistcar.toml");
    let steered = twistcar.replacen("skid_kg_s = 50.0", "skid_kg_s = 50.0\nsteer_deg = 10.0", 1);
    [steered, include_str!("../../../../docs/robots/passive-snake.toml").to_owned()]
}

/// Returns the configuration of the chains alone.
pub(super) fn config_of_chains(folder: &Path) -> Config {
    let [twistcar, snake] = &robots();
    let mut config = config_with(folder, &[twistcar, snake]);
    config.campaign.retain(|name, _| name != SYMMETRIC);
    config
}

/// Returns shared tables of both chains.
fn of_chains() -> &'static OfChains {
    static SHARED: OnceLock<OfChains> = OnceLock::new();
    SHARED.get_or_init(|| {
        let config = config_of_chains(temporary().path());
        let mut all = OfChains::default();
        [TWISTCAR, PASSIVE].into_iter().for_each(|campaign| all.add(&config, campaign));
        all
    })
}

/// Returns the tables of both chains.
pub(super) fn few() -> MadeUp {
    let MadeUp { trials, checks, fits, predictions } = &of_chains().tables;
    MadeUp {
        trials: trials.clone(),
        checks: checks.clone(),
        fits: fits.clone(),
        predictions: predictions.clone(),
    }
}

/// Writes the tables of chains after they were changed, with the recordings of the trials as they were.
pub(super) fn write(tables: &MadeUp, derived: &Path) {
    tables.write(derived);
    for (trial, chain, samples) in &of_chains().recordings {
        write_recording(derived, trial, chain, samples);
    }
}

/// Tables of chains that move as the model skid-roll with their configured coefficients.
#[derive(Default)]
struct OfChains {
    tables: MadeUp,
    recordings: Vec<(TrialRow, Chain, Vec<Sample>)>,
}

impl OfChains {
    fn add(&mut self, config: &Config, campaign: &str) {
        let chain = config.chain_setup(campaign).expect("a chain");
        for omega_rad_s in OMEGA_RAD_S {
            let laws = Laws::SKID_ROLL;
            let problem = Problem::new(chain.clone(), chain.gait(), laws, omega_rad_s);
            let metrics = problem.solve(FIT_ACCURACY).expect("a motion").metrics;
            let metrics_se = GaitMetrics {
                d_m: 0.01 * metrics.d_m,
                v_m_s: 0.01 * metrics.v_m_s,
                sigma: metrics.sigma.map(|sigma| 0.01 * sigma),
                alpha_rad: metrics.alpha_rad.map(|alpha_rad| 0.01 * alpha_rad),
                dtheta_rad: 0.001,
            };
            let debiased =
                |wheel: usize| Estimate::new(metrics.sigma[wheel], metrics_se.sigma[wheel]);
            let joint = |joint: usize| JointGait {
                offset_rad: 0.0 * metrics.alpha_rad[joint],
                amplitude_rad: metrics.alpha_rad[joint],
                ..JointGait::blank()
            };
            let blank = made_up::trial(campaign, omega_rad_s, [f64::NAN; 4]);
            let trial = TrialRow {
                omega_rad_s,
                cycles: CYCLES as i64 - 1,
                metrics,
                metrics_se,
                sigma_debiased: [0, 1, 2].map(debiased),
                gait: [0, 1].map(joint),
                more_sigma_debiased: Numbered((3..chain.links.len()).map(debiased).collect()),
                more_gait: Numbered((2..chain.joints.len()).map(joint).collect()),
                ..blank
            };
            for source in [PredictionSource::Curve, PredictionSource::Trial] {
                let is_trial = source == PredictionSource::Trial;
                self.tables.predictions.push(PredictionRow {
                    campaign: campaign.to_owned(),
                    model: Model::SKID_ROLL,
                    omega_rad_s,
                    source,
                    metrics,
                    status: MotionStatus::Stable,
                    from_rest: is_trial.then_some(FromRest::Reached),
                    ..PredictionRow::blank()
                });
            }
            let samples = problem.cycle(FIT_ACCURACY, SAMPLES).expect("a motion");
            self.recordings.push((trial.clone(), chain.clone(), samples));
            self.tables.trials.push(trial);
        }
        let robot = AnyRobot::Chain(chain);
        let free: Vec<Parameter> = (0..robot.joints() + 1)
            .map(|link| Quantity::Skid.parameter(link))
            .filter(|parameter| robot.value(*parameter).is_finite())
            .collect();
        self.tables.fits.push(FitRow {
            campaign: campaign.to_owned(),
            model: Model::SKID_ROLL,
            gait_input: trilink_tables::config::GaitInput::Commanded,
            parameters: ByParameter::from_fn(|of| robot.value(of)),
            adequate: Some(true),
            j: 0.1,
            starts: 4,
            starts_reached: 4,
            free,
            status: FitStatus::Ok,
            ..FitRow::blank()
        });
    }
}

/// Writes the poses, wheel velocities and cycles of a trial in which a cycle is repeated.
fn write_recording(derived: &Path, trial: &TrialRow, chain: &Chain, samples: &[Sample]) {
    let period_s = TAU / trial.omega_rad_s;
    let cycle = &samples[..SAMPLES];
    let mut start = Pose { x_m: 0.2, y_m: 0.1, theta_rad: 0.4 };
    let mut poses = Vec::new();
    for _ in 0..CYCLES {
        poses.extend(cycle.iter().map(|sample| start * sample.pose));
        start = start * samples[SAMPLES].pose;
    }
    let frames = poses.len();
    let links = chain.links.len();
    let repeated = |of: &dyn Fn(&Sample) -> f64| -> Vec<f64> {
        (0..CYCLES).flat_map(|_| cycle.iter().map(of)).collect()
    };
    let by_link = |of: fn(&Sample) -> &[f64]| -> Vec<Vec<f64>> {
        (0..links).map(|link| repeated(&|sample| of(sample)[link])).collect()
    };
    let clock = Clock {
        frame: (0..frames as i64).collect(),
        time_s: (0..frames).map(|i| period_s * i as f64 / SAMPLES as f64).collect(),
    };
    let texts = || FrameTexts::new((0..frames).map(|_| ()), |()| String::new());
    let fill = |link: usize| {
        let last = link + 1 == links;
        let of_frame = |i| if last && (40..60).contains(&i) { Fill::Rigid } else { Fill::Measured };
        (0..frames).map(of_frame).collect()
    };
    let table = PoseFrames {
        clock: clock.clone(),
        coordinates: Coordinates {
            x_m: poses.iter().map(|pose| pose.x_m).collect(),
            y_m: poses.iter().map(|pose| pose.y_m).collect(),
            theta_rad: poses.iter().map(|pose| pose.theta_rad).collect(),
            phi_rad: (0..links - 1).map(|joint| repeated(&|of| of.phi_rad[joint])).collect(),
        },
        residual_mm: (0..links).map(|link| vec![0.1 + 0.02 * link as f64; frames]).collect(),
        fill: (0..links).map(fill).collect(),
        outlier: (0..links).map(|_| vec![LabelFault::None; frames]).collect(),
        unseen: (0..links).map(|_| texts()).collect(),
        corrected: (0..links).map(|_| texts()).collect(),
    };
    save(&table.into_table(&trial.trial), &poses_path(derived, &trial.trial));
    let wheels = WheelFrames {
        clock,
        velocities: WheelVelocities {
            roll_m_s: Numbered(by_link(|sample| &sample.roll_m_s)),
            skid_m_s: Numbered(by_link(|sample| &sample.skid_m_s)),
        },
        errors: None,
    };
    save(&wheels.into_table(&trial.trial), &wheels_path(derived, &trial.trial));
    let cycles: Vec<CycleRow> = (0..CYCLES)
        .map(|i| CycleRow {
            trial: trial.trial.clone(),
            cycle: i as i64,
            start_s: i as f64 * period_s,
            metrics: trial.metrics,
            used: i > 0,
            ..CycleRow::blank()
        })
        .collect();
    save(&CycleRow::to_table(&cycles), &cycles_path(derived, &trial.trial));
}

/// Returns a shared report on both chains and on a robot with three links; tests must not modify its files.
fn shared() -> &'static (tempfile::TempDir, Reported, Config) {
    static SHARED: OnceLock<(tempfile::TempDir, Reported, Config)> = OnceLock::new();
    SHARED.get_or_init(|| {
        let folder = temporary();
        let [twistcar, snake] = &robots();
        let config = config_with(folder.path(), &[twistcar, snake]);
        let mut tables = MadeUp::of_the_paper();
        tables.trials.retain(|row| row.campaign == SYMMETRIC && row.omega_rad_s > 5.0);
        tables.fits.retain(|row| row.campaign == SYMMETRIC);
        tables.predictions.retain(|row| row.campaign == SYMMETRIC);
        let MadeUp { trials, fits, predictions, .. } = few();
        tables.trials.extend(trials);
        tables.fits.extend(fits);
        tables.predictions.extend(predictions);
        write(&tables, &folder.path().join("derived"));
        let reported = report(&config).unwrap_or_else(|error| panic!("{error}"));
        (folder, reported, config)
    })
}

fn page_of(campaign: &str) -> String {
    read(&shared().0.path().join(format!("reports/trials/{campaign}-3.90-r1.html")))
}

/// Returns the text of a page from a heading to the next section.
fn section<'p>(page: &'p str, id: &str) -> &'p str {
    let from = page.find(&format!("id=\"{id}\"")).unwrap_or_else(|| panic!("no {id}"));
    let rest = &page[from..];
    &rest[..rest.find("</section>").unwrap_or(rest.len())]
}

#[test]
fn trial_pages_of_chains_list_the_wheels_and_joints_of_the_robot_alone() {
    let [car, snake] = [TWISTCAR, PASSIVE].map(page_of);
    let results = section(&snake, "results");
    for row in ["σ₀, body wheel", "σ₁, head wheel", "σ₂, tail wheel", "α₃", "Amplitude of φ₃"]
    {
        assert!(results.contains(&format!("<th scope=\"row\">{row}</th>")), "{row}");
    }
    assert!(!results.contains("σ₃") && !results.contains("fin") && !results.contains("middle"));
    let results = section(&car, "results");
    assert!(results.contains("σ₁, rear wheel, ") || results.contains("σ₁, rear wheel<"));
    for absent in ["σ₂", "α₂", "φ₂"] {
        assert!(!results.contains(absent), "{absent}");
    }
    let gaps = section(&snake, "gaps");
    assert!(gaps.contains("<th scope=\"row\">3: fin</th>"));
    assert_eq!(section(&car, "gaps").matches("<th scope=\"row\">").count(), 2);
    let cycles = section(&snake, "cycles");
    let heads = "σ₀<br><small>body</small></th><th scope=\"col\" class=\"n\">σ₁<br><small>head</small></th><th \
                 scope=\"col\" class=\"n\">σ₂<br><small>tail</small></th><th scope=\"col\" class=\"n\">α₁ \
                 <small>deg</small></th><th scope=\"col\" class=\"n\">α₂ <small>deg</small></th>";
    assert!(cycles.contains(heads) && !cycles.contains("σ₃"));
    assert!(snake.contains("Skid velocity of wheel 2 (tail)") && !snake.contains("of wheel 3"));
    assert!(snake.contains("Path of the body link") && snake.contains("Joint angle φ₃"));
    assert!(car.contains("Roll velocity of wheel 1 (rear)") && !car.contains("wheel 2"));
}

#[test]
fn replays_of_chains_show_all_links_and_follow_the_predicted_motion() {
    let numbers = super::replay::numbers(&page_of(PASSIVE));
    assert_eq!(numbers["names"], serde_json::json!(["body", "head", "tail", "fin"]));
    assert_eq!(numbers["motions"][0]["phi"].as_array().map(Vec::len), Some(3));
    assert_eq!((&numbers["reference"], &numbers["length"]), (&1.into(), &5500.into()));
    assert!(numbers["wheels"][3].is_null() && numbers.get("half").is_none());
    let page = page_of(PASSIVE);
    assert!(page.contains("id=\"replay-link3\"") && !page.contains("id=\"replay-link4\""));
    assert_eq!(page.matches("class=\"link-wheels\"").count(), 3);
    assert!(page.contains("the body link moves "));
    // The measured motion is that of the model.
    assert!(page.contains("the prediction deviates by 0.0 mm and 0.0°."), "{page}");
    assert!(page.contains("skid-roll, fitted"));
    let page = page_of(TWISTCAR);
    let steered = &super::replay::numbers(&page)["wheels"];
    assert_eq!(
        *steered,
        serde_json::json!(["translate(0 0)rotate(10.00)", "translate(0 0)rotate(0.00)"])
    );
    // A chain that the tables do not describe has a page without a replay.
    let (folder, ..) = shared();
    let derived = folder.path().join("derived");
    let trial = format!("{TWISTCAR}-3.90-r1");
    let recording = crate::recording::Recording::read(&derived, &trial, 11, &Reader::default());
    let recording = recording.expect("tables").expect("are there");
    let row = &TrialRow { trial, omega_rad_s: 3.9, ..TrialRow::blank() };
    let input = ReportInput::new(&shared().2, BTreeSet::new());
    let replay = |robot| crate::replay::of_trial(row, &recording, robot, &input, None, None);
    assert!(replay(TWISTCAR).is_some() && replay(PASSIVE).is_none());
}

#[test]
fn the_report_page_describes_chains_beside_a_robot_with_three_links() {
    let page = read(&shared().1.page);
    assert!(
        page.contains("<h1>Trials of wheeled robots</h1>") && !page.contains("three-link robot")
    );
    let trials = section(&page, "trials");
    for head in ["σ₀</th>", "σ₂</th>", "α₁<br>", "α₃<br>"] {
        assert!(trials.contains(head), "{head}");
    }
    assert!(!trials.contains("σ₃") && !trials.contains("α₄"));
    for group in [
        "passive <small>σ₀ body, σ₁ head, σ₂ tail</small>",
        "twistcar <small>σ₀ front, σ₁ rear</small>",
        "kinematic-symmetric <small>σ₀ middle, σ₁ front, σ₂ rear</small>",
    ] {
        assert!(trials.contains(&format!("colspan=\"15\">{group}</th>")), "{group}");
    }
    assert!(page.contains("Robot passive, gait head, 2 trials."));
    assert!(page.contains("Wheel 2 (tail)") && !page.contains("Wheel 3 (fin)"));
    let figures = &shared().1.figures;
    for stem in [
        "passive-simulated",
        "passive-from-rest",
        "passive-sweep",
        "passive-gait",
        "passive-wheels",
        "passive-alpha",
        "passive-models",
        "twistcar-simulated",
        "twistcar-from-rest",
        "twistcar-sweep",
        "twistcar-gait",
    ] {
        assert!(figures.iter().any(|figure| figure == stem), "{stem}: {figures:?}");
    }
    assert!(!figures.iter().any(|figure| figure == "twistcar-alpha"));
    let of_chains = shared().1.missing.iter().filter(|sentence| sentence.contains(PASSIVE));
    assert_eq!(of_chains.count(), 0);
    let folder = shared().0.path().join("reports/figures");
    let amplitudes = read(&folder.join("passive-alpha.csv"));
    let head = amplitudes.lines().next().expect("a head");
    assert!(head.contains("alpha2_deg") && head.contains("alpha3_deg"), "{head}");
    assert!(!head.contains("alpha1_deg"), "{head}");
    let residuals = read(&folder.join("passive-residuals.csv"));
    assert!(residuals.contains(",α₂,") && !residuals.contains(",α₁,"), "{residuals}");
    let profiles = read(&folder.join("passive-profiles.csv"));
    let head = profiles.lines().next().expect("a head");
    assert!(head.contains("skid_tail_kg_s") && !head.contains("skid2_kg_s"), "{head}");
    let simulated = read(&folder.join("passive-simulated.csv"));
    assert!(simulated.contains("wheel 2 (tail)") && !simulated.contains("wheel 3"));
    for (figure, columns, absent) in [
        ("passive-from-rest", "time_s,phi2_deg,phi3_deg,speed_mm_s,x_m,y_m", "phi1_deg"),
        ("passive-sweep", "d_mm,v_mm_s,alpha2_deg,alpha3_deg", "alpha1_deg"),
        ("twistcar-sweep", "d_mm,v_mm_s", "alpha1_deg"),
    ] {
        let drawn = read(&folder.join(format!("{figure}.csv")));
        let head = drawn.lines().next().expect("a head");
        assert!(head.contains(columns) && !head.contains(absent), "{head}");
    }
    let work = read(&folder.join("work.csv"));
    assert!(work.contains(PASSIVE) && work.contains(TWISTCAR), "{work}");
}

#[test]
fn a_report_on_one_chain_has_only_its_wheels() {
    let folder = temporary();
    let mut config = config_of_chains(folder.path());
    config.campaign.remove(PASSIVE);
    let mut tables = few();
    tables.trials.retain(|row| row.campaign == TWISTCAR);
    tables.fits.retain(|row| row.campaign == TWISTCAR);
    tables.predictions.retain(|row| row.campaign == TWISTCAR);
    tables.fits[0].free.push(Quantity::Roll.sum());
    write(&tables, &folder.path().join("derived"));
    let page = read(&report(&config).expect("reports").page);
    // With several campaigns, the figure of the work is among the comparisons.
    assert!(section(&page, "campaign-1").contains("id=\"fig-work\""));
    let latex = read(&folder.path().join("reports/coefficients.tex"));
    assert!(latex.contains("$c^R_0 + c^R_1$ (kg/s)"), "{latex}");
    assert!(page.contains("<h1>Trials of a wheeled robot</h1>"));
    let trials = section(&page, "trials");
    assert!(trials.contains(
        "σ<br><small>front</small></th><th scope=\"col\" class=\"n\">σ<br><small>rear</small></th>"
    ));
    assert!(!trials.contains("middle") && trials.contains("colspan=\"12\">twistcar</th>"));
}

#[test]
fn the_configuration_of_chains_is_printed_and_part_of_the_fingerprint() {
    let (folder, _, config) = shared();
    let input = ReportInput::new(config, BTreeSet::new());
    let path = folder.path().join("printed.toml");
    std::fs::write(&path, input.configuration()).expect("writes");
    let printed = Config::load(&path).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((&printed.robot, &printed.campaign), (&config.robot, &config.campaign));
    let fingerprint = |config: &Config| hash_of(&ReportInput::new(config, BTreeSet::new()));
    let mut changed = config.clone();
    let chain =
        changed.robot.get_mut(TWISTCAR).and_then(RobotConfig::chain_mut).expect("the robot");
    chain.links[0].mass_kg *= 1.1;
    assert_ne!(fingerprint(&changed), fingerprint(config));
    assert!(read(&shared().1.page).contains("[[robot.passive.links]]"));
}
