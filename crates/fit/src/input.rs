//! What a fit reads of the configuration, and what that leaves free.

use std::collections::BTreeMap;

use serde::Serialize;
use trilink_robot::decay::DecayLaw;
use trilink_robot::{Model, Parameter, Quantity, Robot, RollLaw};
use trilink_statistics::{Estimate, mean};
use trilink_tables::config::{
    Config, Fit, Free, GaitConfig, GaitInput, ModelConfig, NamedEntry, ParameterSource,
    RobotConfig, Weights,
};
use trilink_tables::trial::TrialKind;
use trilink_tables::{
    Contradiction, ContradictionKind, CycleRow, Resistance, RobotParameterRow, RobotQuantity, hash,
};

use super::{FitData, FitKey, Measurement, Protocol};

/// What is measured of a robot and is not what is configured differs from it by more than so many
/// standard errors, and by more than this part.
const MOST_ERRORS: f64 = 5.0;
const MOST_PART: f64 = 0.05;

/// What one model of one campaign is fitted with.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FitInput {
    pub campaign: NamedEntry<FitCampaign>,
    /// Without its list of what is free where the campaign has one.
    pub model: NamedEntry<ModelConfig, Model>,
    pub robot: NamedEntry<RobotConfig>,
    pub gait: NamedEntry<GaitConfig>,
    /// What the fit does not read, such as bounds of what is not free, has its default.
    pub fit: Fit,
}

/// The keys of a campaign that a fit reads.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FitCampaign {
    pub weights: Weights,
    /// What the model leaves free, if the configuration says so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free: Option<Free>,
}

type Measured = (Parameter, fn(&RobotParameterRow) -> Estimate);

/// The parameters that joint-release and coast-down trials measure.
const MEASURED: [Measured; 4] = [
    (Quantity::Stiffness.one(), |row| row.stiffness_nm_rad),
    (Quantity::Damping.one(), |row| row.damping_nm_s_rad),
    (Quantity::Roll.sum(), |row| row.roll_sum_kg_s),
    (Quantity::RollDry.sum(), |row| row.roll_dry_sum_n),
];

impl FitInput {
    /// Those of all models of all campaigns, in the configuration's order.
    pub fn all(config: &Config) -> Vec<Self> {
        let campaigns = config.campaign.iter();
        let fits = campaigns.flat_map(|(name, of)| of.models.iter().map(move |&m| (name, m)));
        fits.filter_map(|(campaign, model)| Self::new(config, campaign, model)).collect()
    }

    /// Those of one model; `None` if there is no such campaign.
    pub fn new(config: &Config, campaign: &str, model: Model) -> Option<Self> {
        let of = config.campaign.get(campaign)?;
        let value = FitCampaign { weights: of.weights, free: of.free.get(&model).cloned() };
        let mut input = Self {
            campaign: NamedEntry { name: campaign.to_owned(), value },
            model: NamedEntry::of(&config.model, &model)?,
            robot: NamedEntry::of(&config.robot, &of.robot)?,
            gait: NamedEntry::of(&config.gait, &of.gait)?,
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
            (fit.starts, fit.profiles) = (1, false);
        }
        if input.model.value.input.is_some() {
            fit.gait_input = read.gait_input;
        }
        Some(input)
    }

    pub fn key(&self) -> FitKey {
        FitKey::Own { campaign: self.campaign.name.clone(), model: self.model.name }
    }

    /// What the campaign's trials measured, in order.
    pub fn measurements(&self, data: &FitData) -> Vec<Measurement> {
        let trials = data.trials.iter().filter(|trial| trial.campaign == self.campaign.name);
        let mut measurements: Vec<Measurement> =
            trials.filter_map(|trial| Measurement::new(trial, self.fit.sigma)).collect();
        measurements.sort_by(Measurement::order);
        measurements
    }

    /// How many trials the campaign has that measured nothing.
    pub fn trials_without_metrics(&self, data: &FitData) -> usize {
        let trials = data.trials.iter().filter(|trial| trial.campaign == self.campaign.name);
        trials.filter(|trial| Measurement::new(trial, self.fit.sigma).is_none()).count()
    }

    /// Hash of what the fit reads of each trial. Numbers are printed such that they can be told apart.
    pub fn trials(&self, data: &FitData) -> BTreeMap<String, String> {
        let of_trial = |measurement: Measurement| {
            let cycles = data.cycles.get(&measurement.trial).map_or(&[][..], Vec::as_slice);
            let used: Vec<&CycleRow> = cycles.iter().filter(|row| row.used).collect();
            let hash = hash(format!("{measurement:?} {used:?}").as_bytes());
            (measurement.trial, hash)
        };
        self.measurements(data).into_iter().map(of_trial).collect()
    }

    /// What trials of other kinds say of the robot.
    fn of_robot<'d>(&self, data: &'d FitData) -> impl Iterator<Item = &'d RobotParameterRow> {
        data.robots.iter().filter(|row| row.robot == self.robot.name)
    }

    /// Those that follow the model's laws: of rolling its own, in the joint no dry friction.
    fn robot_rows<'d>(&self, data: &'d FitData) -> impl Iterator<Item = &'d RobotParameterRow> {
        let of_roll = match self.model.value.roll {
            RollLaw::None | RollLaw::Viscous => DecayLaw::Viscous,
            RollLaw::Coulomb => DecayLaw::Coulomb,
            RollLaw::CoulombViscous => DecayLaw::CoulombViscous,
        };
        self.of_robot(data).filter(move |row| {
            let is_coast = row.kind == TrialKind::CoastDown;
            row.law == Some(if is_coast { of_roll } else { DecayLaw::Viscous })
        })
    }

    /// Hash of all of it.
    pub fn robots(&self, data: &FitData) -> String {
        let values = |row: &RobotParameterRow| (row.law, MEASURED.map(|(_, of)| of(row)));
        let rows: Vec<(Option<DecayLaw>, [Estimate; 4])> =
            self.of_robot(data).map(values).collect();
        hash(format!("{rows:?}").as_bytes())
    }

    /// The robot, if the configuration asks for it with the means over its trials, where there
    /// are any, of what these measure (the proportions of the roll resistances stay as
    /// configured); and which parameters these are.
    pub(super) fn measured_robot(&self, data: &FitData) -> (Robot, Vec<Parameter>) {
        let (mut robot, mut measured) = (self.robot.value.to_robot(), Vec::new());
        if self.fit.robot_parameters == ParameterSource::Configured {
            return (robot, measured);
        }
        for (parameter, of) in MEASURED {
            let values = self.robot_rows(data).map(|row| of(row).value);
            let mut values: Vec<f64> =
                values.filter(|value| *value > 0.0 && value.is_finite()).collect();
            // The mean does not depend on the order of the trials.
            values.sort_by(f64::total_cmp);
            if !values.is_empty() {
                parameter.set(&mut robot, mean(values));
                measured.push(parameter);
            }
        }
        (robot, measured)
    }

    /// What a trial tells of the robot that the model has not, or that is not what is configured.
    pub fn contradiction(&self, data: &FitData) -> Option<Contradiction> {
        self.missing_law(data).or_else(|| self.wrong_number(data))
    }

    /// What resists the motion of a trial, where nothing does so in the model.
    fn missing_law(&self, data: &FitData) -> Option<Contradiction> {
        let roll = self.model.value.roll;
        self.of_robot(data).find_map(|row| {
            let law = row.law?;
            let is_coast = row.kind == TrialKind::CoastDown;
            let parts = [
                (Resistance::ViscousRoll, is_coast && law.is_viscous() && !roll.is_viscous()),
                (Resistance::DryRoll, is_coast && law.is_dry() && !roll.is_dry()),
                (Resistance::DryJoint, !is_coast && law.is_dry()),
            ];
            let missing =
                parts.into_iter().filter_map(|(part, is_missing)| is_missing.then_some(part));
            let missing: Vec<Resistance> = missing.collect();
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

    /// A number that is not what is configured, the one by most: beyond [`MOST_ERRORS`] standard errors and
    /// [`MOST_PART`] of it. Nothing where what is measured is used.
    fn wrong_number(&self, data: &FitData) -> Option<Contradiction> {
        if self.fit.robot_parameters == ParameterSource::Measured {
            return None;
        }
        let off = |of: &RobotQuantity| of.times_configured().ln().abs();
        let is_off = |of: &RobotQuantity| {
            let errors = (of.measured.value - of.configured).abs() / of.measured.se;
            errors > MOST_ERRORS && off(of) > MOST_PART && off(of).is_finite()
        };
        let told = self.robot_rows(data).flat_map(|row| row.quantities().map(move |of| (row, of)));
        let told = told.filter(|(_, of)| is_off(of));
        let (row, of) = told.max_by(|(_, a), (_, b)| off(a).total_cmp(&off(b)))?;
        let RobotQuantity { name, unit, measured, configured } = of;
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

    /// The robot with each of its parameters in turn off by the standard deviation that the
    /// configuration gives, or the trials that measured it have.
    pub(super) fn uncertain_robots(&self, robot: &Robot, data: &FitData) -> Vec<Robot> {
        let off = |parameter: Parameter, deviation: f64| {
            let mut other = robot.clone();
            parameter.set(&mut other, parameter.of(robot) + deviation);
            other
        };
        let (laws, gait) = (self.model.value.laws(), self.gait.value.to_gait());
        let configured = self.robot.value.deviations(laws, &gait).into_iter();
        let mut robots: Vec<Robot> = configured.map(|(of, deviation)| off(of, deviation)).collect();
        if self.fit.robot_parameters == ParameterSource::Measured {
            for (parameter, of) in MEASURED {
                let found = self.robot_rows(data).map(of);
                let found = found.filter(|found| found.value > 0.0 && found.se > 0.0);
                let squares: Vec<f64> = found.map(|found| found.se.powi(2)).collect();
                let error = squares.iter().sum::<f64>().sqrt() / squares.len() as f64;
                if error > 0.0 {
                    robots.push(off(parameter, error));
                }
            }
        }
        robots
    }

    /// What the campaign's trials have in common.
    pub fn protocol(&self) -> Protocol {
        let (name, gait) = (self.campaign.name.clone(), self.gait.value.to_gait());
        Protocol { name, gait, weights: self.campaign.value.weights }
    }

    /// What drives the model.
    pub fn gait_input(&self) -> GaitInput {
        self.model.value.input.unwrap_or(self.fit.gait_input)
    }

    /// The parameters that the fit frees, with their bounds: those of the campaign's list, else the
    /// model's. What the motion does not depend on is left out.
    pub fn free(&self) -> Vec<FreeParameter> {
        let (model, gait) = (&self.model.value, self.gait.value.to_gait());
        let listed = self.campaign.value.free.clone();
        let listed = listed.map_or_else(|| model.free(), |Free(listed)| listed).into_iter();
        let known = listed.filter(|parameter| model.laws().know(*parameter, &gait));
        let mut fit = self.fit.clone();
        let free = |parameter: Parameter| {
            let quantity = parameter.quantity();
            let range = quantity.definition().range;
            let [low, high] = fit.bounds_mut(quantity).copied().unwrap_or(range);
            let is_beside_dry = quantity == Quantity::Skid && model.laws().skid.is_dry();
            let low = if is_beside_dry { BESIDE_DRY * low } else { low };
            FreeParameter { parameter, bounds: [low, high] }
        };
        known.map(free).collect()
    }
}

/// Takes over what bounds a parameter.
fn copy_bounds(from: &mut Fit, to: &mut Fit, parameter: Parameter) {
    let quantity = parameter.quantity();
    if let (Some(from), Some(to)) = (from.bounds_mut(quantity), to.bounds_mut(quantity)) {
        *to = *from;
    }
}

/// Part of its lower bound from which viscous skid resistance goes out beside dry friction: there it
/// may be as good as none, and the law that of dry friction alone.
const BESIDE_DRY: f64 = 0.01;
/// Relative distance from a bound that counts as at it.
const AT_BOUND: f64 = 1e-3;

/// A parameter that a fit leaves free, and its bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeParameter {
    pub parameter: Parameter,
    pub bounds: [f64; 2],
}

impl FreeParameter {
    /// At which of its bounds a value is: lower, upper.
    pub fn is_at_bound(&self, value: f64) -> [bool; 2] {
        let [low, high] = self.bounds;
        [value < low * (1.0 + AT_BOUND), value > high * (1.0 - AT_BOUND)]
    }
}

#[cfg(test)]
mod tests {
    use trilink_tables::Columns as _;

    use super::*;

    #[test]
    fn a_fit_reads_the_keys_of_its_own_model_and_of_no_other() {
        let campaign = "kinematic-symmetric";
        let of = |config: &Config| {
            let input = FitInput::new(config, campaign, Model::SKID).expect("the paper's");
            toml::to_string(&input).expect("plain data")
        };
        let mut config = Config::default();
        let before = of(&config);
        let model = |config: &mut Config, name, change: fn(&mut ModelConfig)| {
            change(config.model.get_mut(&name).expect("a default"));
        };
        model(&mut config, Model::SKID_ROLL, |other| other.free = None);
        assert_eq!(of(&config), before);
        model(&mut config, Model::SKID, |own| own.free = Some(Free(vec![Quantity::Skid.of(1)])));
        let with_free = of(&config);
        assert_ne!(with_free, before);
        model(&mut config, Model::SKID, |own| own.input = Some(GaitInput::Commanded));
        let with_input = of(&config);
        assert_ne!(with_input, with_free);
        config.fit.gait_input = GaitInput::Commanded;
        assert_eq!(of(&config), with_input);
        // The campaign's list goes first.
        let listed = Free(vec![Quantity::Skid.of(0)]);
        let free = &mut config.campaign.get_mut(campaign).expect("the paper's").free;
        free.insert(Model::SKID, listed);
        let with_list = of(&config);
        model(&mut config, Model::SKID, |own| own.free = Some(Free(vec![Quantity::Skid.of(2)])));
        assert_eq!(of(&config), with_list);
    }

    #[test]
    fn beside_dry_friction_viscous_resistance_may_be_as_good_as_none() {
        let bounds = |name| {
            let config = Config::default();
            let input = FitInput::new(&config, "kinematic-skewed", Model::new(name));
            let free = input.expect("the paper's").free();
            let of = free.iter().find(|free| free.parameter == Quantity::Skid.of(1));
            of.expect("is free").bounds
        };
        assert_eq!(bounds("skid-roll"), [1.0, 1000.0]);
        assert_eq!(bounds("coulomb-viscous"), [0.01, 1000.0]);
    }

    #[test]
    fn only_what_a_model_knows_of_the_robot_is_uncertain() {
        let campaign = "kinematic-symmetric";
        let mut config = Config::default();
        let robot = config.robot.get_mut("kinematic").expect("the paper's");
        robot.set_load_n([8.0, 4.0, 4.0]);
        robot.set_deviation(Quantity::Transition, [0.002]);
        robot.set_deviation(Quantity::SkidDry, [0.0, 0.05, 0.0]);
        robot.set_deviation(Quantity::Damping, [0.001]);
        let robots = |name| {
            let input = FitInput::new(&config, campaign, Model::new(name)).expect("the paper's");
            let robot = input.robot.value.to_robot();
            (input.uncertain_robots(&robot, &FitData::default()), robot)
        };
        let (others, robot) = robots("coulomb");
        let off = |other: &Robot| {
            let transition_m_s = other.transition_m_s - robot.transition_m_s;
            [other.skid_dry_n[1] - robot.skid_dry_n[1], transition_m_s]
        };
        let off: Vec<[f64; 2]> = others.iter().map(off).collect();
        assert_eq!(off.len(), 2);
        assert!((off[0][0] - 0.2).abs() < 1e-12 && off[0][1] == 0.0, "{off:?}");
        assert!((off[1][1] - 0.002).abs() < 1e-12 && off[1][0] == 0.0, "{off:?}");
        assert!(robots("skid-roll").0.is_empty());
    }

    #[test]
    fn what_the_trials_do_not_tell_stays_as_configured() {
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
        let configured = input.robot.value.to_robot();
        assert_eq!(input.measured_robot(&data), (configured.clone(), Vec::new()));
        input.robot.name = "ours".to_owned();
        input.fit.robot_parameters = ParameterSource::Measured;
        let (robot, measured) = input.measured_robot(&data);
        assert_eq!(measured, [Quantity::Damping.one(), Quantity::Roll.sum()]);
        assert_eq!(robot.stiffness_nm_rad, configured.stiffness_nm_rad);
        assert_eq!(robot.damping_nm_s_rad, 0.01);
        for (found, expected) in robot.roll_kg_s.iter().zip([0.6, 0.3, 0.3]) {
            assert!((found - expected).abs() < 1e-12);
        }
        // What is used is not said to be wrong, what the model does not know is.
        let alike = data.robots.iter().filter(|row| row.law == Some(DecayLaw::Viscous));
        let alike = FitData { robots: alike.cloned().collect(), ..FitData::default() };
        assert_eq!(input.contradiction(&alike), None);
        let dry = input.contradiction(&data).expect("a law that is missing");
        assert_eq!(
            (dry.kind, dry.missing),
            (ContradictionKind::MissingLaw, vec![Resistance::DryRoll])
        );
        input.fit.robot_parameters = ParameterSource::Configured;
        let told = |value: f64, se: f64, configured: f64| {
            let row = RobotParameterRow {
                trial: "push".to_owned(),
                roll_sum_kg_s: Estimate { value, se },
                roll_sum_configured_kg_s: configured,
                ..coast.clone()
            };
            input.contradiction(&FitData { robots: vec![row], ..FitData::default() })
        };
        let wrong = told(1.375, 0.01, 1.2).expect("another number");
        assert_eq!((&*wrong.trial, &*wrong.quantity, &*wrong.robot), ("push", "sum c_R", "ours"));
        assert_eq!((wrong.measured, wrong.configured), (1.375, 1.2));
        // Within the errors, within a few per cent, without an error, not configured.
        for (value, se, configured) in
            [(1.375, 0.1, 1.2), (1.23, 0.001, 1.2), (1.375, f64::NAN, 1.2), (1.375, 0.01, f64::NAN)]
        {
            assert_eq!(told(value, se, configured), None);
        }
        input.fit.robot_parameters = ParameterSource::Measured;
        // A model with dry rolling is told by trials that follow its law.
        input.model.value.roll = RollLaw::CoulombViscous;
        let (robot, measured) = input.measured_robot(&data);
        let [roll, roll_dry] = [robot.roll_kg_s, robot.roll_dry_n].map(|of| of.iter().sum::<f64>());
        assert!(measured.contains(&Quantity::RollDry.sum()), "{measured:?}");
        assert!((roll - 0.8).abs() < 1e-12 && (roll_dry - 0.3).abs() < 1e-12, "{roll} {roll_dry}");
    }
}
