//! Inputs of a fit from the configuration, and its free parameters.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::Serialize;
use trilink_robot::decay::DecayLaw;
use trilink_robot::{AnyGait, AnyRobot, Chain, ChainNumber, Model, Parameter, Quantity, RollLaw};
use trilink_statistics::{Estimate, mean};
use trilink_tables::config::{
    Campaign, Config, Fit, Free, GaitConfig, GaitInput, ModelConfig, NamedEntry, ParameterSource,
    RobotConfig, Weights,
};
use trilink_tables::trial::TrialKind;
use trilink_tables::{
    Contradiction, ContradictionKind, CycleRow, Resistance, RobotParameterRow, RobotQuantity,
    UnlikeRepeats, hash,
};

use super::simulate::{SetupError, campaign_of, unknown_model};
use super::{FitData, FitKey, Measurement, Protocol};

/// Deviation of a measured robot parameter from its configured value, in standard errors of the measurement, above
/// which the two contradict each other, provided that [`MAX_LOG_RATIO`] is exceeded as well.
const MAX_STANDARD_ERRORS: f64 = 5.0;
/// Magnitude of the logarithm of the ratio of a measured robot parameter to its configured value above which the two
/// contradict each other, provided that [`MAX_STANDARD_ERRORS`] is exceeded as well.
const MAX_LOG_RATIO: f64 = 0.05;

/// Configuration that the fit of one model to one campaign depends on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FitInput {
    pub campaign: NamedEntry<FitCampaign>,
    /// Model to fit; its own list of free parameters is cleared if the campaign has one.
    pub model: NamedEntry<ModelConfig, Model>,
    pub robot: NamedEntry<RobotConfig>,
    pub gait: NamedEntry<GaitConfig>,
    /// Settings of the fit. Settings that the fit does not read, such as the bounds of fixed parameters, have their
    /// default values.
    pub fit: Fit,
}

/// Configuration keys of a campaign that a fit reads.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FitCampaign {
    pub weights: Weights,
    /// Parameters that the campaign leaves free in this model; `None` if the configuration does not list them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free: Option<Free>,
}

/// Function that reads the estimate of a quantity from a row for joint-release or coast-down trials.
type ReadEstimate = fn(&RobotParameterRow) -> Estimate;

/// Quantities of a joint that its releases measure.
const OF_JOINT: [(Quantity, ReadEstimate); 2] = [
    (Quantity::Stiffness, |row| row.stiffness_nm_rad),
    (Quantity::Damping, |row| row.damping_nm_s_rad),
];

/// Quantities whose sums over the wheels coast-downs measure.
const OF_WHEELS: [(Quantity, ReadEstimate); 2] =
    [(Quantity::Roll, |row| row.roll_sum_kg_s), (Quantity::RollDry, |row| row.roll_dry_sum_n)];

/// Robot parameter that joint-release or coast-down trials measure.
struct MeasuredParameter {
    parameter: Parameter,
    /// Number of the joint whose releases measure the parameter; `None` if every trial may measure it.
    joint: Option<i64>,
    estimate: ReadEstimate,
}

impl MeasuredParameter {
    /// Returns the parameters of a robot that its trials can measure.
    fn all(robot: &AnyRobot) -> Vec<Self> {
        let joints = (0..robot.joints()).map(|joint| (joint, Some(joint as i64 + 1)));
        let joints: Vec<_> = match robot.three_links() {
            Some(_) => vec![(0, None)],
            None => joints.collect(),
        };
        let of_joints = OF_JOINT.into_iter().flat_map(|(quantity, estimate)| {
            joints.iter().map(move |&(index, joint)| Self {
                parameter: robot.of_free_joint(quantity, index),
                joint,
                estimate,
            })
        });
        let of_wheels = OF_WHEELS.map(|(quantity, estimate)| Self {
            parameter: quantity.sum(),
            joint: None,
            estimate,
        });
        of_joints.chain(of_wheels).collect()
    }

    fn is_of(&self, row: &RobotParameterRow) -> bool {
        self.joint.is_none_or(|joint| joint == row.joint)
    }
}

impl FitInput {
    /// Returns the inputs for all models of all campaigns, in the order of the configuration.
    pub fn all(config: &Config) -> Vec<Self> {
        let campaigns = config.campaign.iter();
        let fits =
            campaigns.flat_map(|(name, of)| of.models.iter().map(move |&model| (name, model)));
        fits.filter_map(|(campaign, model)| Self::new(config, campaign, model)).collect()
    }

    /// Returns the input for one model of one campaign; `None` if the configuration has no such campaign or model.
    pub fn new(config: &Config, campaign: &str, model: Model) -> Option<Self> {
        let Campaign { robot, gait, weights, free, .. } = config.campaign.get(campaign)?;
        let robot = NamedEntry::find(&config.robot, robot)?.map(RobotConfig::without_wheel_names);
        let gait = NamedEntry::find(&config.gait, gait)?;
        let value = FitCampaign { weights: *weights, free: free.get(&model).cloned() };
        let mut input = Self {
            campaign: NamedEntry { name: campaign.to_owned(), value },
            model: NamedEntry::find(&config.model, &model)?,
            robot,
            gait,
            fit: Fit { shared: None, ..config.fit.clone() },
        };
        if input.campaign.value.free.is_some() {
            input.model.value.free = None;
        }
        let free = input.free();
        let mut read = Config::default().fit;
        for one in &free {
            copy_bounds(&mut input.fit, &mut read, one.parameter);
        }
        let fit = &mut input.fit;
        for parameter in Parameter::ALL {
            copy_bounds(&mut read, fit, parameter);
        }
        if free.is_empty() {
            fit.starts = 1;
            fit.profiles = false;
        }
        if input.model.value.input.is_some() {
            fit.gait_input = read.gait_input;
        }
        Some(input)
    }

    /// Returns the input for one model of one campaign, like [`FitInput::new`].
    ///
    /// # Errors
    /// Returns an error if there is no such campaign or model, or if the robot lacks a parameter that the model needs.
    pub fn find(config: &Config, campaign: &str, model: &str) -> Result<Self, SetupError> {
        let path = Path::new("--model");
        let robot = campaign_of(config, campaign)?.robot;
        let input = Self::new(config, campaign, Model::new(model));
        let input = input.ok_or_else(|| unknown_model(config, model))?;
        config.check_laws(path, &robot, input.model.name)?;
        Ok(input)
    }

    pub fn key(&self) -> FitKey {
        FitKey::Own { campaign: self.campaign.name.clone(), model: self.model.name }
    }

    /// Returns the names of the campaign's trials that are unlike their repeats, which are not fitted.
    pub(crate) fn unlike_repeats(&self, data: &FitData) -> BTreeSet<String> {
        let trials = UnlikeRepeats::find(&data.trials).into_iter().map(|of| &data.trials[of.index]);
        let own = trials.filter(|trial| trial.campaign == self.campaign.name);
        own.map(|trial| trial.trial.clone()).collect()
    }

    /// Returns the measurements of the campaign's trials, sorted by [`Measurement::order`].
    pub fn measurements(&self, data: &FitData) -> Vec<Measurement> {
        let unlike = self.unlike_repeats(data);
        let trials = data
            .trials
            .iter()
            .filter(|trial| trial.campaign == self.campaign.name && !unlike.contains(&trial.trial));
        let mut measurements: Vec<Measurement> =
            trials.filter_map(|trial| Measurement::new(trial, self.fit.sigma)).collect();
        measurements.sort_by(Measurement::order);
        measurements
    }

    /// Counts the campaign's trials without usable metrics.
    pub fn trials_without_metrics(&self, data: &FitData) -> usize {
        let trials = data.trials.iter().filter(|trial| trial.campaign == self.campaign.name);
        trials.filter(|trial| Measurement::new(trial, self.fit.sigma).is_none()).count()
    }

    /// Returns, by trial name, a hash of everything that the fit reads from the trial. The hash is computed from the
    /// debug format, which represents numbers exactly.
    pub fn trials(&self, data: &FitData) -> BTreeMap<String, String> {
        let measurements = self.measurements(data).into_iter();
        measurements
            .map(|measurement| {
                let cycles = data.cycles.get(&measurement.trial).map_or(&[][..], Vec::as_slice);
                let used: Vec<&CycleRow> = cycles.iter().filter(|row| row.used).collect();
                let hash = hash(format!("{measurement:?} {used:?}").as_bytes());
                (measurement.trial, hash)
            })
            .collect()
    }

    /// Returns the rows of joint-release and coast-down trials with measured parameters of the campaign's robot.
    fn robot_rows<'d>(&self, data: &'d FitData) -> impl Iterator<Item = &'d RobotParameterRow> {
        data.robots.iter().filter(|row| row.robot == self.robot.name)
    }

    /// Returns the rows of measured robot parameters that agree with the model's laws: those of coast-downs with the
    /// same law of rolling resistance, and those of joint releases without dry friction in the joint.
    fn applicable_rows<'d>(
        &self,
        data: &'d FitData,
    ) -> impl Iterator<Item = &'d RobotParameterRow> {
        let roll_law = match self.model.value.roll {
            RollLaw::None | RollLaw::Viscous => DecayLaw::Viscous,
            RollLaw::Coulomb => DecayLaw::Coulomb,
            RollLaw::CoulombViscous => DecayLaw::CoulombViscous,
        };
        self.robot_rows(data).filter(move |row| {
            let is_coast = row.kind == TrialKind::CoastDown;
            row.law == Some(if is_coast { roll_law } else { DecayLaw::Viscous })
        })
    }

    /// Returns a hash of everything that the fit reads from the measured robot parameters.
    pub fn robots(&self, data: &FitData) -> String {
        let rows: Vec<_> = self
            .robot_rows(data)
            .map(|row| {
                let [of_joint, of_wheels] =
                    [OF_JOINT, OF_WHEELS].map(|all| all.map(|(_, estimate)| estimate(row)));
                (row.law, [row.pooled_trials, row.joint], of_joint, of_wheels)
            })
            .collect();
        hash(format!("{rows:?}").as_bytes())
    }

    /// Returns the robot with its configured parameters, and the commanded gait.
    pub fn setup(&self) -> (AnyRobot, AnyGait) {
        self.robot.value.setup(&self.gait.value)
    }

    /// Returns the robot, and the list of those of its parameters that have measured values. If the configuration asks
    /// for measured values, each is the mean over the trials that measured the parameter; otherwise the list is empty.
    /// The wheels' shares of the rolling resistance stay as configured.
    pub(super) fn measured_robot(&self, data: &FitData) -> (AnyRobot, Vec<Parameter>) {
        let (mut robot, _) = self.setup();
        let mut measured = Vec::new();
        if self.fit.robot_parameters == ParameterSource::Configured {
            return (robot, measured);
        }
        for of in MeasuredParameter::all(&robot) {
            let rows = self.applicable_rows(data).filter(|row| of.is_of(row));
            let values = rows.map(|row| (of.estimate)(row).value);
            let mut values: Vec<f64> =
                values.filter(|value| *value > 0.0 && value.is_finite()).collect();
            // Sort, so that the mean does not depend on the order of the trials.
            values.sort_by(f64::total_cmp);
            if !values.is_empty() {
                robot.set(of.parameter, mean(values));
                measured.push(of.parameter);
            }
        }
        (robot, measured)
    }

    /// Returns a contradiction between the robot's trials and the model or the configuration: a resistance that the
    /// model lacks, or a parameter that differs from its configured value. `None` if there is no contradiction.
    pub fn contradiction(&self, data: &FitData) -> Option<Contradiction> {
        self.missing_law(data).or_else(|| self.wrong_number(data))
    }

    /// Returns the resistances that a trial of the robot shows but the model lacks; `None` if there is no such trial.
    fn missing_law(&self, data: &FitData) -> Option<Contradiction> {
        let roll = self.model.value.roll;
        self.robot_rows(data).find_map(|row| {
            let law = row.law?;
            let is_coast = row.kind == TrialKind::CoastDown;
            let resistances = [
                (Resistance::ViscousRoll, is_coast && law.is_viscous() && !roll.is_viscous()),
                (Resistance::DryRoll, is_coast && law.is_dry() && !roll.is_dry()),
                (Resistance::DryJoint, !is_coast && law.is_dry()),
            ];
            let missing: Vec<Resistance> = resistances
                .into_iter()
                .filter_map(|(resistance, is_missing)| is_missing.then_some(resistance))
                .collect();
            (!missing.is_empty()).then(|| Contradiction {
                kind: ContradictionKind::MissingLaw,
                trial: row.trial.clone(),
                missing,
                robot: self.robot.name.clone(),
                quantity: String::new(),
                unit: String::new(),
                measured: f64::NAN,
                configured: f64::NAN,
            })
        })
    }

    /// Returns the measured parameter that deviates most from its configured value; `None` if none deviates by more
    /// than both [`MAX_STANDARD_ERRORS`] and [`MAX_LOG_RATIO`], or if the fit uses the measured values.
    fn wrong_number(&self, data: &FitData) -> Option<Contradiction> {
        if self.fit.robot_parameters == ParameterSource::Measured {
            return None;
        }
        let quantities = self.applicable_rows(data).flat_map(|row| {
            row.quantities().map(move |of| (of.times_configured().ln().abs(), row, of))
        });
        let wrong = quantities.filter(|(log_ratio, _, of)| {
            let errors = (of.measured.value - of.configured).abs() / of.measured.se;
            errors > MAX_STANDARD_ERRORS && *log_ratio > MAX_LOG_RATIO && log_ratio.is_finite()
        });
        let (_, row, quantity) = wrong.max_by(|(a, ..), (b, ..)| a.total_cmp(b))?;
        let RobotQuantity { name, unit, measured, configured } = quantity;
        Some(Contradiction {
            kind: ContradictionKind::WrongNumber,
            trial: row.trial.clone(),
            missing: Vec::new(),
            robot: self.robot.name.clone(),
            quantity: name.to_owned(),
            unit: unit.to_owned(),
            measured: measured.value,
            configured,
        })
    }

    /// Returns, for each independent error of the robot's parameters, the robot with the parameters that have this
    /// error increased by their standard deviations. The standard deviations are configured or, if measured values are
    /// used, derived from the trials that measured the parameter.
    pub(super) fn perturbed_robots(&self, robot: &AnyRobot, data: &FitData) -> Vec<AnyRobot> {
        let increased = |error: Vec<(Parameter, f64)>| {
            let mut perturbed = robot.clone();
            for (parameter, deviation) in error {
                perturbed.set(parameter, robot.value(parameter) + deviation);
            }
            perturbed
        };
        let mut robots: Vec<AnyRobot> = match (&self.robot.value, robot) {
            (RobotConfig::ThreeLinks(config), _) => {
                let (_, gait) = self.setup();
                let errors = config.errors(self.model.value.laws(), &gait.into());
                errors.into_iter().map(increased).collect()
            }
            (RobotConfig::Chain(config), AnyRobot::Chain(chain)) => {
                let errors = config.errors().into_iter();
                errors.map(|error| perturbed_chain(chain, &error).into()).collect()
            }
            (RobotConfig::Chain(_), AnyRobot::ThreeLinks(_)) => Vec::new(),
        };
        if self.fit.robot_parameters == ParameterSource::Measured {
            for of in MeasuredParameter::all(robot) {
                // Trials whose parameter was estimated jointly have the same error.
                let rows = self.applicable_rows(data).filter(|row| of.is_of(row));
                let estimates =
                    rows.map(|row| ((of.estimate)(row), row.pooled_trials.max(1) as f64));
                let estimates = estimates.filter(|(of, _)| of.value > 0.0 && of.se > 0.0);
                let squares: Vec<f64> =
                    estimates.map(|(of, pooled)| pooled * of.se.powi(2)).collect();
                let error = squares.iter().sum::<f64>().sqrt() / squares.len() as f64;
                if error > 0.0 {
                    robots.push(increased(vec![(of.parameter, error)]));
                }
            }
        }
        robots
    }

    /// Returns the gait and the weights common to the campaign's trials.
    pub fn protocol(&self) -> Protocol {
        Protocol {
            name: self.campaign.name.clone(),
            gait: self.setup().1,
            weights: self.campaign.value.weights,
        }
    }

    /// Returns whether the measured or the commanded gait drives the model. Without a driven joint it is the commanded
    /// one, because the commands of other joints and of rotors are not measured.
    pub fn gait_input(&self) -> GaitInput {
        let configured = self.model.value.input.unwrap_or(self.fit.gait_input);
        if self.has_driven_joint() { configured } else { GaitInput::Commanded }
    }

    /// Returns the gait that does not drive the model; `None` if the configuration of the model fixes the gait or no
    /// joint is driven.
    pub fn other_gait_input(&self) -> Option<GaitInput> {
        let is_free = self.model.value.input.is_none() && self.has_driven_joint();
        is_free.then(|| self.gait_input().other())
    }

    fn has_driven_joint(&self) -> bool {
        self.setup().1.joints.iter().any(Option::is_some)
    }

    /// Returns the free parameters with their bounds: those that the campaign lists, or otherwise those of the model.
    /// Parameters that do not affect the model's solution are left out.
    pub fn free(&self) -> Vec<FreeParameter> {
        let model = &self.model.value;
        let (robot, gait) = self.setup();
        let listed = self.campaign.value.free.clone();
        let listed = listed.map_or_else(|| model.free(), |Free(listed)| listed).into_iter();
        let mut fit = self.fit.clone();
        listed
            .filter(|parameter| robot.depends_on(*parameter, model.laws(), &gait))
            .map(|parameter| {
                let quantity = parameter.quantity();
                let range = quantity.definition().range;
                let [low, high] = fit.bounds_mut(quantity).copied().unwrap_or(range);
                let has_dry_friction = quantity == Quantity::Skid && model.laws().skid.is_dry();
                let low = if has_dry_friction { DRY_BOUND_FACTOR * low } else { low };
                FreeParameter { parameter, bounds: [low, high] }
            })
            .collect()
    }
}

/// Returns a chain with numbers increased by their standard deviations.
fn perturbed_chain(chain: &Chain, error: &[(ChainNumber, f64)]) -> Chain {
    let mut perturbed = chain.clone();
    for (number, deviation) in error {
        if let Some(number) = perturbed.number_mut(*number) {
            *number += deviation;
        }
    }
    perturbed
}

/// Copies the bounds for a parameter's quantity from one set of fit settings to another.
fn copy_bounds(from: &mut Fit, to: &mut Fit, parameter: Parameter) {
    let quantity = parameter.quantity();
    if let (Some(from), Some(to)) = (from.bounds_mut(quantity), to.bounds_mut(quantity)) {
        *to = *from;
    }
}

/// Factor applied to the lower bound of the viscous skid resistance in a model that also has dry friction. Near the
/// reduced bound the viscous resistance is negligible, so that only dry friction remains.
const DRY_BOUND_FACTOR: f64 = 0.01;
/// Relative distance from a bound within which a value counts as being at the bound.
const AT_BOUND: f64 = 1e-3;

/// Free parameter of a fit, with its bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeParameter {
    pub parameter: Parameter,
    pub bounds: [f64; 2],
}

impl FreeParameter {
    /// Returns whether a value is at the lower bound, and whether it is at the upper bound.
    pub fn is_at_bound(&self, value: f64) -> [bool; 2] {
        let [low, high] = self.bounds;
        [value < low * (1.0 + AT_BOUND), value > high * (1.0 - AT_BOUND)]
    }
}

#[cfg(test)]
mod tests {
    use trilink_robot::Robot;
    use trilink_tables::Columns as _;

    use super::*;

    fn three_links(robot: &AnyRobot) -> Robot {
        robot.three_links().expect("three links").clone()
    }

    #[test]
    fn a_fit_reads_the_keys_of_its_own_model_and_of_no_other() {
        let campaign = "kinematic-symmetric";
        let of = |config: &Config| {
            let input = FitInput::new(config, campaign, Model::SKID).expect("the paper's");
            toml::to_string(&input).expect("the input of a fit can be serialised")
        };
        let mut config = Config::default();
        let before = of(&config);
        let model = |config: &mut Config, name, change: fn(&mut ModelConfig)| {
            change(config.model.get_mut(&name).expect("a default"));
        };
        model(&mut config, Model::SKID_ROLL, |other| other.free = None);
        assert_eq!(of(&config), before);
        model(&mut config, Model::SKID, |own| {
            own.free = Some(Free(vec![Quantity::Skid.parameter(1)]))
        });
        let with_free = of(&config);
        assert_ne!(with_free, before);
        model(&mut config, Model::SKID, |own| own.input = Some(GaitInput::Commanded));
        let with_input = of(&config);
        assert_ne!(with_input, with_free);
        config.fit.gait_input = GaitInput::Commanded;
        assert_eq!(of(&config), with_input);
        // The campaign's list takes precedence.
        let listed = Free(vec![Quantity::Skid.parameter(0)]);
        let free = &mut config.campaign.get_mut(campaign).expect("the paper's").free;
        free.insert(Model::SKID, listed);
        let with_list = of(&config);
        model(&mut config, Model::SKID, |own| {
            own.free = Some(Free(vec![Quantity::Skid.parameter(2)]))
        });
        assert_eq!(of(&config), with_list);
    }

    #[test]
    fn viscous_skid_resistance_may_be_negligible_if_there_is_dry_friction() {
        let bounds = |name| {
            let config = Config::default();
            let input = FitInput::new(&config, "kinematic-skewed", Model::new(name));
            let free = input.expect("the paper's").free();
            let of = free.iter().find(|free| free.parameter == Quantity::Skid.parameter(1));
            of.expect("is free").bounds
        };
        assert_eq!(bounds("skid-roll"), [1.0, 1000.0]);
        assert_eq!(bounds("coulomb-viscous"), [0.01, 1000.0]);
    }

    #[test]
    fn only_parameters_of_the_model_are_uncertain() {
        let campaign = "kinematic-symmetric";
        let mut config = Config::default();
        let robot = config
            .robot
            .get_mut("kinematic")
            .and_then(RobotConfig::three_links_mut)
            .expect("the paper's");
        robot.set_load_n([8.0, 4.0, 4.0]);
        robot.set_deviation(Quantity::Transition, [0.002]);
        robot.set_deviation(Quantity::SkidDry, [0.0, 0.05, 0.0]);
        robot.set_deviation(Quantity::Damping, [0.001]);
        let robots = |name| {
            let input = FitInput::new(&config, campaign, Model::new(name)).expect("the paper's");
            let (robot, _) = input.setup();
            let others = input.perturbed_robots(&robot, &FitData::default());
            (others.iter().map(three_links).collect::<Vec<_>>(), three_links(&robot))
        };
        let (others, robot) = robots("coulomb");
        let deviations: Vec<[f64; 2]> = others
            .iter()
            .map(|other| {
                let transition_m_s = other.transition_m_s - robot.transition_m_s;
                [other.skid_dry_n[1] - robot.skid_dry_n[1], transition_m_s]
            })
            .collect();
        assert_eq!(deviations.len(), 2);
        let [dry, transition] = [deviations[0], deviations[1]];
        assert!((dry[0] - 0.2).abs() < 1e-12 && dry[1] == 0.0, "{deviations:?}");
        assert!((transition[1] - 0.002).abs() < 1e-12 && transition[0] == 0.0, "{deviations:?}");
        assert!(robots("skid-roll").0.is_empty());
    }

    #[test]
    fn parameters_measured_with_one_instrument_are_changed_together() {
        let mut config = Config::default();
        let robot = config
            .robot
            .get_mut("kinematic")
            .and_then(RobotConfig::three_links_mut)
            .expect("the paper's");
        robot.set_deviation(Quantity::H, [0.0005]);
        robot.set_deviation(Quantity::B, [0.001]);
        robot.set_deviation(Quantity::Mass, [0.01, 0.002, 0.002]);
        robot.set_same(Quantity::H, "ruler");
        robot.set_same(Quantity::B, "ruler");
        let input = FitInput::new(&config, "kinematic-symmetric", Model::SKID_ROLL);
        let input = input.expect("the paper's");
        let (robot, _) = input.setup();
        let others = input.perturbed_robots(&robot, &FitData::default());
        let robot = three_links(&robot);
        let changes: Vec<[f64; 5]> = others
            .iter()
            .map(|other| {
                let other = three_links(other);
                let lengths = [other.h_m[1] - robot.h_m[1], other.b_m[0] - robot.b_m[0]];
                let masses = [0, 1, 2].map(|i| other.mass_kg[i] - robot.mass_kg[i]);
                [lengths[0], lengths[1], masses[0], masses[1], masses[2]]
            })
            .collect();
        let expected = [
            [0.0005, 0.001, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.01, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.002, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.002],
        ];
        assert_eq!(changes.len(), expected.len());
        for (found, expected) in changes.iter().flatten().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 1e-12, "{changes:?}");
        }
    }

    #[test]
    fn parameters_that_no_trial_measured_stay_as_configured() {
        let row = |robot: &str| RobotParameterRow {
            robot: robot.to_owned(),
            law: Some(DecayLaw::Viscous),
            ..RobotParameterRow::blank()
        };
        let coast = RobotParameterRow { kind: TrialKind::CoastDown, ..row("ours") };
        let found = |value: f64| Estimate { value, ..Estimate::MISSING };
        let rows = [
            RobotParameterRow { roll_sum_kg_s: found(0.9), ..coast.clone() },
            RobotParameterRow { roll_sum_kg_s: found(1.5), ..coast.clone() },
            RobotParameterRow { roll_sum_kg_s: found(9.0), law: None, ..coast.clone() },
            RobotParameterRow {
                roll_sum_kg_s: found(0.8),
                roll_dry_sum_n: found(0.3),
                law: Some(DecayLaw::CoulombViscous),
                ..coast.clone()
            },
            RobotParameterRow { stiffness_nm_rad: found(9.0), ..row("another") },
            RobotParameterRow { damping_nm_s_rad: found(0.01), ..row("ours") },
        ];
        let data = FitData { robots: rows.into(), ..FitData::default() };
        let campaign = "semi-passive-symmetric";
        let mut input =
            FitInput::new(&Config::default(), campaign, Model::SKID_ROLL).expect("the paper's");
        let (configured, _) = input.setup();
        assert_eq!(input.measured_robot(&data), (configured.clone(), Vec::new()));
        let configured = three_links(&configured);
        input.robot.name = "ours".to_owned();
        input.fit.robot_parameters = ParameterSource::Measured;
        let (robot, measured) = input.measured_robot(&data);
        let robot = three_links(&robot);
        assert_eq!(measured, [Quantity::Damping.one(), Quantity::Roll.sum()]);
        assert_eq!(robot.stiffness_nm_rad, configured.stiffness_nm_rad);
        assert_eq!(robot.damping_nm_s_rad, 0.01);
        for (found, expected) in robot.roll_kg_s.iter().zip([0.6, 0.3, 0.3]) {
            assert!((found - expected).abs() < 1e-12);
        }
        // A measured value that the fit uses is no contradiction; a law that the model lacks is one.
        let alike = data.robots.iter().filter(|row| row.law == Some(DecayLaw::Viscous));
        let alike = FitData { robots: alike.cloned().collect(), ..FitData::default() };
        assert_eq!(input.contradiction(&alike), None);
        let dry = input.contradiction(&data).expect("a law that is missing");
        assert_eq!(
            (dry.kind, dry.missing),
            (ContradictionKind::MissingLaw, vec![Resistance::DryRoll])
        );
        input.fit.robot_parameters = ParameterSource::Configured;
        let contradiction = |value: f64, se: f64, configured: f64| {
            let row = RobotParameterRow {
                trial: "push".to_owned(),
                roll_sum_kg_s: Estimate { value, se },
                roll_sum_configured_kg_s: configured,
                ..coast.clone()
            };
            input.contradiction(&FitData { robots: vec![row], ..FitData::default() })
        };
        let wrong = contradiction(1.375, 0.01, 1.2).expect("another number");
        assert_eq!((&*wrong.trial, &*wrong.quantity, &*wrong.robot), ("push", "sum c_R", "ours"));
        assert_eq!((wrong.measured, wrong.configured), (1.375, 1.2));
        // Cases: within five standard errors, within 5 %, without a standard error, not configured.
        for (value, se, configured) in
            [(1.375, 0.1, 1.2), (1.23, 0.001, 1.2), (1.375, f64::NAN, 1.2), (1.375, 0.01, f64::NAN)]
        {
            assert_eq!(contradiction(value, se, configured), None);
        }
        input.fit.robot_parameters = ParameterSource::Measured;
        // The trials determine a dry law of rolling resistance if they follow the model's law.
        input.model.value.roll = RollLaw::CoulombViscous;
        let (robot, measured) = input.measured_robot(&data);
        let robot = three_links(&robot);
        let [roll, roll_dry] = [robot.roll_kg_s, robot.roll_dry_n].map(|of| of.iter().sum::<f64>());
        assert!(measured.contains(&Quantity::RollDry.sum()), "{measured:?}");
        assert!((roll - 0.8).abs() < 1e-12 && (roll_dry - 0.3).abs() < 1e-12, "{roll} {roll_dry}");
    }

    #[test]
    fn releases_of_a_chain_measure_the_spring_of_their_joint() {
        let gallery = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/robots/elastic-snake.toml");
        let mut config = Config::load(Path::new(gallery)).unwrap();
        config.fit.robot_parameters = ParameterSource::Measured;
        let input = FitInput::new(&config, "elastic", Model::SKID_ROLL).unwrap();
        let of_joint = |joint: i64, stiffness_nm_rad: f64| RobotParameterRow {
            kind: TrialKind::JointRelease,
            robot: "elastic".to_owned(),
            law: Some(DecayLaw::Viscous),
            joint,
            stiffness_nm_rad: Estimate::new(stiffness_nm_rad, 0.01),
            ..RobotParameterRow::blank()
        };
        let robots = vec![of_joint(2, 0.6), of_joint(1, 0.3), of_joint(1, 0.5)];
        let data = FitData { robots, ..FitData::default() };
        let (robot, measured) = input.measured_robot(&data);
        let springs = [1, 2].map(|joint| Quantity::Stiffness.parameter(joint));
        assert_eq!(measured, springs);
        assert_eq!(springs.map(|one| robot.value(one)), [0.4, 0.6]);
        let perturbed = input.perturbed_robots(&robot, &data);
        let changes = perturbed.iter().map(|one| springs.map(|of| one.value(of) - robot.value(of)));
        for (change, expected) in changes.zip([[0.01 / 2_f64.sqrt(), 0.0], [0.0, 0.01]]) {
            assert!((0..2).all(|i| (change[i] - expected[i]).abs() < 1e-12), "{change:?}");
        }
        assert_eq!(perturbed.len(), 2);
        // Without a driven joint there is no measured gait.
        assert_eq!((input.gait_input(), input.other_gait_input()), (GaitInput::Commanded, None));
    }
}
