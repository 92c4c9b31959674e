//! Synthetic tables, like those of a run on the paper's three campaigns, with values close to the paper's.

use std::path::Path;

use trilink_mechanics::{FromRest, Model, MotionStatus};
use trilink_robot::decay::DecayLaw;
use trilink_robot::metrics::{GaitMetrics, padded};
use trilink_robot::{ByParameter, Parameter, Quantity};
use trilink_statistics::Estimate;
use trilink_tables::config::{Config, GaitInput};
use trilink_tables::trial::TrialKind;
use trilink_tables::{
    BootstrapRow, CheckRow, Columns, ComparisonRow, DecayFit, FitNotes, FitRow, FitStatus,
    JointGait, LawStatus, Misfit, MisfitRun, NoIntervalReason, NoPrecisionReason, Numbered,
    Outcome, PrecisionRow, PredictionRow, PredictionSource, ProfileRow, Provenance,
    RobotParameterRow, Severity, SharedFitRow, Sharing, Side, StartRow, TrialRow, TrialStatus,
};

use super::recording;

pub(crate) const SKEWED: &str = "kinematic-skewed";
pub(crate) const SYMMETRIC: &str = "kinematic-symmetric";
pub(crate) const SEMI_PASSIVE: &str = "semi-passive-symmetric";

/// Name of the synthetic joint-release trial.
pub(crate) const RELEASE: &str = "release-r1";

const OMEGA_RAD_S: [f64; 12] = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.9, 4.5, 5.0, 5.5, 6.0];

/// Displacement d (m) and skid ratios sigma of wheels 0, 1, 2 at each frequency in [`OMEGA_RAD_S`].
type Measured = [[f64; 4]; 12];

const SKEWED_MEASURED: Measured = [
    [0.1058, 0.01371, 0.00630, 0.00546],
    [0.1029, 0.01721, 0.00790, 0.00736],
    [0.1032, 0.02283, 0.00990, 0.00976],
    [0.1006, 0.02648, 0.01213, 0.01206],
    [0.1075, 0.03139, 0.01551, 0.01402],
    [0.0960, 0.03349, 0.01744, 0.01621],
    [0.0987, 0.03838, 0.01900, 0.01905],
    [0.0971, 0.04071, 0.02014, 0.01920],
    [0.0933, 0.04453, 0.02215, 0.02298],
    [0.0905, 0.04865, 0.02591, 0.02402],
    [0.0886, 0.05444, 0.02591, 0.02551],
    [0.0879, 0.05566, 0.02896, 0.02710],
];

const SYMMETRIC_MEASURED: Measured = [
    [0.4228, 0.02960, 0.04311, 0.03662],
    [0.4357, 0.02842, 0.04554, 0.03712],
    [0.4642, 0.02954, 0.04322, 0.03803],
    [0.4781, 0.03049, 0.04330, 0.04000],
    [0.4746, 0.03127, 0.04390, 0.04221],
    [0.4854, 0.03207, 0.04030, 0.04241],
    [0.4646, 0.02917, 0.04051, 0.04148],
    [0.4510, 0.03045, 0.04122, 0.04191],
    [0.4725, 0.02991, 0.04054, 0.04311],
    [0.4668, 0.02961, 0.03810, 0.04386],
    [0.4595, 0.03078, 0.03898, 0.04664],
    [0.4868, 0.03174, 0.03707, 0.04935],
];

const SEMI_PASSIVE_MEASURED: Measured = [
    [0.3387, 0.02181, 0.02435, 0.06900],
    [0.5546, 0.01610, 0.01805, 0.05007],
    [0.4785, 0.01149, 0.01335, 0.03348],
    [0.4452, 0.00836, 0.00964, 0.02495],
    [0.3951, 0.00628, 0.00852, 0.01940],
    [0.3315, 0.00501, 0.00714, 0.01501],
    [0.3037, 0.00431, 0.00629, 0.01159],
    [0.2521, 0.00382, 0.00531, 0.00983],
    [0.2308, 0.00297, 0.00483, 0.00764],
    [0.1958, 0.00255, 0.00410, 0.00626],
    [0.1654, 0.00214, 0.00402, 0.00505],
    [0.1440, 0.00175, 0.00369, 0.00430],
];

#[derive(Default)]
pub(crate) struct Tables {
    pub(crate) trials: Vec<TrialRow>,
    pub(crate) checks: Vec<CheckRow>,
    pub(crate) fits: Vec<FitRow>,
    pub(crate) predictions: Vec<PredictionRow>,
}

impl Tables {
    pub(crate) fn of_the_paper() -> Self {
        let mut tables = Self::default();
        let kinematic = [Model::NO_SKID, Model::NO_SKID_MEASURED, Model::SKID, Model::SKID_ROLL];
        let passive =
            [Model::NO_SKID, Model::NO_SKID_DAMPED, Model::NO_SKID_ROLL, Model::SKID_ROLL];
        let models: [(&str, &Measured, [Model; 4]); 3] = [
            (SKEWED, &SKEWED_MEASURED, kinematic),
            (SYMMETRIC, &SYMMETRIC_MEASURED, kinematic),
            (SEMI_PASSIVE, &SEMI_PASSIVE_MEASURED, passive),
        ];
        for (campaign, measured, models) in models {
            for (omega, &values) in OMEGA_RAD_S.iter().zip(measured) {
                tables.trials.push(trial(campaign, *omega, values));
            }
            for (nth, model) in models.into_iter().enumerate() {
                tables.fits.push(fit(campaign, model, nth));
                tables.predict(campaign, model, measured);
            }
        }
        tables
    }

    /// Writes all tables into the folder `derived`.
    pub(crate) fn write(&self, derived: &Path) {
        let provenance = Provenance { input: "made up".to_owned() };
        let write = |name: &str, table: trilink_tables::Table| {
            table.write(&derived.join(format!("{name}.parquet")), &provenance).expect("writes");
        };
        write("trials", TrialRow::to_table(&self.trials));
        write("checks", CheckRow::to_table(&self.checks));
        write("fits", FitRow::to_table(&self.fits));
        write("alternative_fits", FitRow::to_table(&self.alternatives()));
        write("shared_fits", SharedFitRow::to_table(&self.shared()));
        write("predictions", PredictionRow::to_table(&self.predictions));
        write("comparison", ComparisonRow::to_table(&self.comparison()));
        write("precision", PrecisionRow::to_table(&precision()));
        write("starts", StartRow::to_table(&self.starts()));
        write("profiles", ProfileRow::to_table(&self.profiles()));
        write("bootstrap", BootstrapRow::to_table(&self.bootstrap()));
        write("robot_parameters", RobotParameterRow::to_table(&self.robots()));
        for trial in &self.trials {
            recording::write(derived, trial);
        }
        recording::write_release(derived, RELEASE);
    }

    /// Returns a fit of one model to all campaigns of a robot together; the campaigns have different gaits.
    fn shared(&self) -> Vec<SharedFitRow> {
        let robot = "kinematic";
        let fits: Vec<&FitRow> = self
            .fits
            .iter()
            .filter(|fit| fit.campaign.starts_with(robot) && !fit.free.is_empty())
            .collect();
        let Some(first) = fits.first() else { return Vec::new() };
        let of_model = fits.iter().filter(|fit| fit.model == first.model);
        let campaigns: Vec<String> = of_model.map(|fit| fit.campaign.clone()).collect();
        vec![SharedFitRow {
            robot: robot.to_owned(),
            fit: FitRow {
                campaign: campaigns.join(" and "),
                j: 2.5 * first.j,
                sharing: Some(Sharing::Refused),
                ..(*first).clone()
            },
            j_separate: 2.0 * first.j,
            campaigns,
            rise: 0.25,
            rise_limit: 0.05,
            p_value: 0.001,
            not_tested: None,
            wheels: Vec::new(),
            joints: Vec::new(),
        }]
    }

    pub(crate) fn robots(&self) -> Vec<RobotParameterRow> {
        let release = RobotParameterRow {
            trial: RELEASE.to_owned(),
            joint: 1,
            inertia_kg_m2: 0.001734,
            damping_ratio: Estimate::new(0.19, 0.001),
            damping_ratio_decrement: Estimate::new(0.192, 0.002),
            rest_angle_rad: Estimate::new(0.0, f64::NAN),
            released_s: 0.5,
            decay_cosine_rad: 0.5,
            decay_sine_rad: 0.0,
            kind: TrialKind::JointRelease,
            robot: "semi-passive".to_owned(),
            natural_rad_s: Estimate::new(10.4, 0.02),
            stiffness_nm_rad: Estimate::new(0.1875, 0.0012),
            stiffness_configured_nm_rad: 0.188,
            damping_nm_s_rad: Estimate::new(0.00685, 0.00004),
            law: Some(DecayLaw::Viscous),
            viscous: DecayFit {
                misfit_rad: 0.002,
                misfit_over_noise: 1.04,
                f: 0.7,
                adequate: Some(true),
                stiffness_nm_rad: Estimate::new(0.1875, 0.0012),
                damping_nm_s_rad: Estimate::new(0.00685, 0.00004),
                ..DecayFit::blank()
            },
            coulomb: DecayFit {
                misfit_rad: 0.021,
                misfit_over_noise: 16.2,
                f: 1840.0,
                adequate: Some(false),
                stiffness_nm_rad: Estimate::new(0.1902, 0.0031),
                joint_dry_nm: Estimate::new(0.0046, 0.0002),
                ..DecayFit::blank()
            },
            misfit_over_noise_limit: 2.0,
            f_limit: 9.8,
            status: LawStatus::Ok,
            ..RobotParameterRow::blank()
        };
        vec![release]
    }

    /// Returns the alternative fits, which use the commanded gait, whereas the main fits use the measured gait.
    fn alternatives(&self) -> Vec<FitRow> {
        let models = Config::default().model;
        let has_input = |model| models.get(model).is_some_and(|model| model.input.is_some());
        let fits = self.fits.iter().filter(|fit| !has_input(&fit.model));
        fits.map(|fit| {
            let mut other = FitRow { gait_input: GaitInput::Commanded, ..fit.clone() };
            other.parameters[Quantity::Skid.parameter(0)] *= 1.02;
            other.adequate = Some(false);
            other
        })
        .collect()
    }

    fn comparison(&self) -> Vec<ComparisonRow> {
        self.fits
            .iter()
            .map(|fit| ComparisonRow {
                campaign: fit.campaign.clone(),
                model: fit.model,
                j: fit.j,
                j_d: 0.7 * fit.j,
                j_v: 0.1 * fit.j,
                j_sigma: 0.2 * fit.j,
                j_alpha: 0.0,
                j_left_out: 1.1 * fit.j,
                j_extrapolated: 1.2 * fit.j,
                extrapolated_above_rad_s: 4.5,
                free: fit.free.len() as i64,
                terms: 48,
                criterion: 96.0 * fit.j.ln(),
                wins: if fit.model == Model::SKID_ROLL { 0.985 } else { 0.005 },
                preferred: fit.model == Model::SKID_ROLL,
                rank: if fit.model == Model::SKID_ROLL { 1 } else { 2 },
                rival: false,
                outcome: Outcome::Clear,
                contradiction: None,
                replicates: 200,
                trials_without_metrics: 0,
                trials_filtered: 0,
                tell_omega_rad_s: if fit.model == Model::SKID_ROLL { f64::NAN } else { 5.6 },
                tell_metric: if fit.model == Model::SKID_ROLL { "" } else { "sigma1" }.to_owned(),
                tell_standard_errors: if fit.model == Model::SKID_ROLL { f64::NAN } else { 12.0 },
                status: fit.status,
            })
            .collect()
    }

    fn starts(&self) -> Vec<StartRow> {
        let fitted = self.fits.iter().filter(|fit| !fit.free.is_empty());
        let rows = fitted.flat_map(|fit| (0..8).map(move |start| (fit, start)));
        rows.map(|(fit, start)| StartRow {
            campaign: fit.campaign.clone(),
            model: fit.model,
            start,
            j: if start == 5 { 1.4 * fit.j } else { fit.j },
            ..StartRow::blank()
        })
        .collect()
    }

    fn profiles(&self) -> Vec<ProfileRow> {
        let mut rows = Vec::new();
        for fit in &self.fits {
            for (nth, &parameter) in fit.free.iter().enumerate() {
                for step in -9..=9 {
                    let offset = f64::from(step) * [0.01, 0.2, 0.3][nth];
                    let steep = if nth == 2 { 0.0 } else { [900.0, 0.4][nth] };
                    rows.push(ProfileRow {
                        campaign: fit.campaign.clone(),
                        model: fit.model,
                        parameter,
                        value: fit.parameters[parameter] * offset.exp(),
                        j: fit.j * (1.0 + steep * offset * offset),
                        limit_j: 1.1 * fit.j,
                        ..ProfileRow::blank()
                    });
                }
            }
        }
        rows
    }

    fn bootstrap(&self) -> Vec<BootstrapRow> {
        let fitted = self.fits.iter().filter(|fit| !fit.free.is_empty());
        let rows = fitted.flat_map(|fit| (0..100).map(move |replicate| (fit, replicate)));
        rows.map(|(fit, replicate)| {
            let phase = replicate as f64;
            let off = [phase.sin(), (1.3 * phase).sin(), (1.7 * phase).cos()];
            BootstrapRow {
                campaign: fit.campaign.clone(),
                model: fit.model,
                replicate,
                parameters: ByParameter::from_fn(|of| {
                    fit.parameters[of]
                        * (1.0
                            + 0.03
                                * off[Parameter::OF_ANY_ROBOT
                                    .iter()
                                    .position(|one| *one == of)
                                    .unwrap()
                                    % 3])
                }),
                j: fit.j,
                ..BootstrapRow::blank()
            }
        })
        .collect()
    }

    fn predict(&mut self, campaign: &str, model: Model, measured: &Measured) {
        let curve = (0..=55).map(|i| (PredictionSource::Curve, 0.5 + 0.1 * f64::from(i)));
        let trials = OMEGA_RAD_S.iter().map(|&omega| (PredictionSource::Trial, omega));
        for (source, omega) in curve.chain(trials) {
            let predicted = predicted(campaign, model, measured, omega);
            let row = prediction(campaign, model, omega, source, predicted);
            if model != Model::NO_SKID_MEASURED || source == PredictionSource::Trial {
                self.predictions.push(row);
            }
        }
    }
}

/// Returns made-up predictions of d (m) and of the three skid ratios sigma, which vary smoothly with frequency; `None`
/// where the model has no motion.
fn predicted(campaign: &str, model: Model, measured: &Measured, omega: f64) -> Option<[f64; 4]> {
    let smooth = |column: usize| {
        let weight = |at: f64| (-(at - omega).powi(2) / 0.6).exp();
        let weights: f64 = OMEGA_RAD_S.iter().map(|&at| weight(at)).sum();
        let terms = OMEGA_RAD_S.iter().zip(measured);
        terms.map(|(&at, row)| weight(at) * row[column]).sum::<f64>() / weights
    };
    let no_skid = |d| Some([d, 0.0, 0.0, 0.0]);
    match (campaign, model) {
        (SKEWED, Model::NO_SKID) => no_skid(0.122405),
        (SKEWED, Model::NO_SKID_MEASURED) => no_skid(0.1185 - 0.0012 * omega),
        (SYMMETRIC, Model::NO_SKID) => no_skid(0.663466),
        (SYMMETRIC, Model::NO_SKID_MEASURED) => None,
        (SEMI_PASSIVE, Model::NO_SKID) => (omega > 0.8).then_some([4.2 / omega, 0.0, 0.0, 0.0]),
        (SEMI_PASSIVE, Model::NO_SKID_DAMPED) => no_skid(smooth(0) * 1.12),
        (SEMI_PASSIVE, Model::NO_SKID_ROLL) => no_skid(smooth(0) * 1.06),
        (_, Model::SKID) => Some([smooth(0) * 1.03, smooth(1), smooth(2) * 0.9, smooth(3) * 1.1]),
        _ => Some([smooth(0), smooth(1), smooth(2), smooth(3)]),
    }
}

fn prediction(
    campaign: &str,
    model: Model,
    omega_rad_s: f64,
    source: PredictionSource,
    predicted: Option<[f64; 4]>,
) -> PredictionRow {
    let is_trial = source == PredictionSource::Trial;
    let metrics = |factor: f64| {
        let [d_m, sigma @ ..] = predicted.unwrap_or([f64::NAN; 4]).map(|of| factor * of);
        let v_m_s = d_m * omega_rad_s / std::f64::consts::TAU;
        GaitMetrics::from_array([d_m, v_m_s, sigma[0], sigma[1], sigma[2], 0.5, 0.0])
    };
    let is_known = model == Model::SKID_ROLL;
    PredictionRow {
        trial: String::new(),
        campaign: campaign.to_owned(),
        model,
        omega_rad_s,
        source,
        metrics: metrics(1.0),
        lower: metrics(if is_known { 0.98 } else { f64::NAN }),
        upper: metrics(if is_known { 1.03 } else { f64::NAN }),
        no_interval: (!is_known).then(|| NoIntervalReason::Inadequate.into()),
        j: if is_trial { 1.0 } else { f64::NAN },
        status: match predicted {
            Some(_) => MotionStatus::Stable,
            None => MotionStatus::Singular,
        },
        from_rest: predicted.filter(|_| is_trial).map(|_| FromRest::Reached),
    }
}

pub(crate) fn trial(campaign: &str, omega: f64, [d_m, sigma @ ..]: [f64; 4]) -> TrialRow {
    let v_m_s = d_m * omega / std::f64::consts::TAU;
    let offset_rad = if campaign == SKEWED { 0.78 } else { 0.0 };
    TrialRow {
        trial: format!("{campaign}-{omega:.2}-r1"),
        folder: "raw".to_owned(),
        day: "raw".to_owned(),
        id: format!("{campaign}-{omega:.2}-r1"),
        file: format!("{campaign}-{omega:.2}-r1.csv"),
        campaign: campaign.to_owned(),
        kind: TrialKind::Gait,
        omega_commanded_rad_s: omega,
        omega_rad_s: omega * 1.0004,
        omega_rad_s_se: 0.0003,
        cycles: 8,
        metrics: GaitMetrics {
            d_m,
            v_m_s,
            sigma: padded(&sigma),
            alpha_rad: padded(&[0.52]),
            dtheta_rad: 0.01,
        },
        metrics_se: GaitMetrics {
            d_m: 0.011 * d_m,
            v_m_s: 0.011 * v_m_s,
            sigma: padded(&sigma.map(|sigma| 0.02 * sigma)),
            alpha_rad: padded(&[0.001]),
            dtheta_rad: 0.001,
        },
        sigma_debiased: sigma.map(|sigma| Estimate::new(sigma, 0.02 * sigma)),
        gait: [
            JointGait {
                offset_rad,
                amplitude_rad: 0.51,
                phase_rad: 0.0,
                harmonics_rad: 0.002,
                ..JointGait::blank()
            },
            JointGait {
                offset_rad: -offset_rad,
                amplitude_rad: 0.5,
                phase_rad: -1.57,
                harmonics_rad: 0.002,
                ..JointGait::blank()
            },
        ],
        more_sigma_debiased: Numbered::default(),
        more_gait: Numbered::default(),
        heading_rad: 0.3,
        coverage: 0.9934,
        residual_mm: 0.1873,
        noise_white: Some(true),
        smoothing_window: 11,
        smoothing_left1: 0.99,
        smoothing_left2: 0.96,
        smoothing_left3: 0.91,
        status: TrialStatus::Ok,
        message: String::new(),
    }
}

/// Returns the precision of two metrics of one campaign.
fn precision() -> [PrecisionRow; 2] {
    let d = PrecisionRow {
        campaign: SKEWED.to_owned(),
        metric: "d_m".to_owned(),
        trials: 8,
        days: 3,
        repeatability: 0.0123,
        repeatability_dof: 5.0,
        reproducibility: 0.0341,
        reproducibility_dof: 2.34,
        no_repeatability: None,
        no_reproducibility: None,
    };
    let v = PrecisionRow {
        metric: "v_m_s".to_owned(),
        days: 1,
        reproducibility: f64::NAN,
        no_reproducibility: Some(NoPrecisionReason::OneDay),
        ..d.clone()
    };
    [d, v]
}

pub(crate) fn fit(campaign: &str, model: Model, nth: usize) -> FitRow {
    const SKID: [Parameter; 3] = Quantity::Skid.of_each();
    let laws = Config::default().model[&model].laws();
    let skids = laws.skids();
    let rolls = laws.roll.is_viscous();
    let passive = campaign == SEMI_PASSIVE;
    let when = |has: bool, value: f64| if has { value } else { f64::NAN };
    let free: Vec<Parameter> = match model {
        _ if skids => Quantity::Skid.of_each().into(),
        Model::NO_SKID_DAMPED => vec![Quantity::Damping.one()],
        _ => Vec::new(),
    };
    let listed = |has: bool, parameter: Parameter| if has { vec![parameter] } else { Vec::new() };
    // Every possible verdict on adequacy occurs.
    let adequate = match model {
        Model::SKID_ROLL => Some(true),
        Model::NO_SKID_MEASURED => None,
        _ => Some(false),
    };
    let told = |value: f64| when(adequate.is_some(), value);
    let misfit = MisfitRun {
        side: Side::Above,
        metric: trilink_robot::metrics::Metric::D,
        campaign: String::new(),
        least: 0.07,
        most: 1.19,
        largest: -0.59,
        from_rad_s: 4.5,
        to_rad_s: 6.0,
    };
    FitRow {
        campaign: campaign.to_owned(),
        model,
        gait_input: Config::default().model[&model].input.unwrap_or(GaitInput::Measured),
        scatter: ByParameter::from_fn(|of| when(skids && [SKID[0], SKID[1]].contains(&of), 4.31)),
        systematic: ByParameter::from_fn(|of| match () {
            () if of == SKID[0] => when(skids, 5.27),
            () if of == SKID[1] => when(skids, 0.0),
            () => f64::NAN,
        }),
        type_a: ByParameter::from_fn(|of| when(skids && [SKID[0], SKID[1]].contains(&of), 2.1)),
        type_b: ByParameter::from_fn(|of| match () {
            () if of == SKID[0] => when(skids, 2.7),
            () if of == SKID[1] => when(skids, 0.0),
            () => f64::NAN,
        }),
        degrees_of_freedom: ByParameter::from_fn(|of| when(of == SKID[0] && skids, 31.4)),
        coverage_factor: ByParameter::from_fn(|of| when(of == SKID[0] && skids, 2.04)),
        no_interval: (passive && model == Model::NO_SKID_DAMPED)
            .then(|| NoIntervalReason::NotAskedFor.into()),
        lack_of_fit: told(if adequate == Some(true) { 1.04 } else { 23.7 }),
        lack_of_fit_limit: told(1.38),
        lack_of_fit_d: told(31.4),
        adequate,
        misfit: if adequate == Some(false) { Misfit::off(vec![misfit]) } else { None },
        notes: match campaign {
            SYMMETRIC => {
                FitNotes { raw_skid_trials: vec!["<one>".to_owned()], ..FitNotes::default() }
            }
            _ => FitNotes::default(),
        },
        parameters: ByParameter::from_fn(|of| match (of.quantity(), of.is_sum()) {
            _ if !of.is_of_three_links() => f64::NAN,
            _ if of == SKID[0] => when(skids, 104.21),
            _ if of == SKID[1] => when(skids, 34.072),
            _ if of == SKID[2] => when(skids, 1000.0),
            (Quantity::Roll, true) => when(rolls, 1.2),
            (Quantity::Roll, false) => {
                when(rolls, if of == Quantity::Roll.parameter(0) { 0.6 } else { 0.3 })
            }
            (Quantity::Stiffness, _) => when(passive, 0.188),
            (Quantity::Damping, _) => when(passive, 0.00712),
            _ => f64::NAN,
        }),
        lower: ByParameter::from_fn(|of| match () {
            () if of == SKID[0] => when(skids, 98.4),
            () if of == SKID[1] => when(skids, 21.3),
            () => f64::NAN,
        }),
        upper: ByParameter::from_fn(|of| when(skids && of == SKID[0], 111.9)),
        identifiable: listed(skids, SKID[0]),
        practically_not: listed(skids, SKID[1]),
        structurally_not: listed(skids, SKID[2]),
        at_bound: listed(skids, SKID[2]),
        starts: if free.is_empty() { 1 } else { 8 },
        free,
        j: when(model != Model::NO_SKID_MEASURED || campaign == SKEWED, 4.2031 / (1 + nth) as f64),
        solves: 1230 * nth as i64,
        status: FitStatus::Ok,
        ..FitRow::blank()
    }
}

/// Adds a trial that failed with the given message, and flags another trial because of a check, whose row is added too.
pub(crate) fn with_trouble(mut tables: Tables, message: &str) -> Tables {
    let mut failed = trial(SKEWED, 3.0, [f64::NAN; 4]);
    failed.trial = "kinematic-skewed-3.00-r2".to_owned();
    failed.status = TrialStatus::Failed;
    failed.message = message.to_owned();
    failed.omega_rad_s = f64::NAN;
    failed.omega_rad_s_se = f64::NAN;
    failed.coverage = f64::NAN;
    failed.residual_mm = f64::NAN;
    failed.cycles = 0;
    tables.trials.push(failed);
    let flagged = &mut tables.trials[5];
    flagged.status = TrialStatus::Flagged;
    flagged.message = "residual 0.62 mm, limit 0.5 mm".to_owned();
    tables.checks.push(CheckRow {
        trial: flagged.trial.clone(),
        check: "W003 residual".to_owned(),
        severity: Severity::Warning,
        value: 0.62,
        limit: 0.5,
        message: "residual 0.62 mm, limit 0.5 mm".to_owned(),
    });
    tables
}

/// Returns the contents of a `truth.json` whose true values are close to the values in the tables.
pub(crate) fn truth() -> String {
    let tables = Tables::of_the_paper();
    let trials: serde_json::Map<String, serde_json::Value> = tables
        .trials
        .iter()
        .map(|row| {
            let GaitMetrics { d_m, v_m_s, sigma, .. } = row.metrics;
            let truth = serde_json::json!({"d_m": d_m * 1.002, "v_m_s": v_m_s * 0.998,
                "sigma": sigma[..3], "alpha1_rad": 0.521, "gait": [null, null]});
            (row.trial.clone(), truth)
        })
        .collect();
    let campaign = serde_json::json!({"skid_kg_s": [104.0, 34.0, 45.0],
        "roll_kg_s": [0.6, 0.3, 0.3], "stiffness_nm_rad": null, "damping_nm_s_rad": null});
    let campaigns = serde_json::json!({SKEWED: campaign, SYMMETRIC: campaign});
    serde_json::json!({"synthetic": true, "seed": 1, "campaigns": campaigns, "trials": trials})
        .to_string()
}
