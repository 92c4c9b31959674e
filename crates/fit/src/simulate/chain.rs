//! Simulation of campaigns whose robot is a chain of links.

use std::path::Path;

use serde::{Serialize, Serializer};
use serde_json::{Map, Value};
use trilink_mechanics::{
    ChainMotion, ChainProblem, ChainSample, FromRest, MotionError, MotionStatus, REFERENCE_ACCURACY,
};
use trilink_robot::{Chain, GRAVITY_M_S2, Joint, Laws, Model};
use trilink_tables::config::Config;
use trilink_tables::{Column, Columns, Table};

use super::{SetupError, keys_of, known_laws};

/// Chain and gait of a campaign with the friction laws of a model.
#[derive(Debug, Clone)]
pub struct ChainSetup {
    pub chain: Chain,
    pub laws: Laws,
    pub model: Model,
    /// Keys and values of the robot in the configuration, as shown in answers.
    parameters: Map<String, Value>,
    /// Keys and values of the gait in the configuration, as shown in answers.
    gait: Map<String, Value>,
}

impl ChainSetup {
    /// Sets up a campaign whose robot is a chain; returns `None` if it is no campaign or its robot is not a chain.
    ///
    /// # Errors
    /// Returns an error if the model does not exist, or if a wheel lacks a coefficient that the model needs.
    pub fn new(config: &Config, campaign: &str, model: &str) -> Result<Option<Self>, SetupError> {
        let Some(chain) = config.chain_setup(campaign) else { return Ok(None) };
        let laws = known_laws(config, model)?;
        let model = Model::new(model);
        let names = &config.chains.campaign[campaign];
        config.check_chain_laws(Path::new("--model"), &names.robot, model)?;
        // As TOML, in which keys without a value are left out.
        let parameters = toml::Table::try_from(&config.chains.robot[&names.robot]);
        let gait = toml::Table::try_from(config.chain_gait(&names.gait));
        let [parameters, gait] = [parameters, gait].map(|table| keys_of(&table.ok()));
        Ok(Some(Self { chain, laws, model, parameters: parameters?, gait: gait? }))
    }

    /// Returns the problem to solve at a frequency.
    pub fn problem(&self, omega_rad_s: f64) -> ChainProblem {
        ChainProblem { chain: self.chain.clone(), laws: self.laws, omega_rad_s }
    }

    /// Returns the names of the links in the order in which columns number them.
    pub fn link_names(&self) -> Vec<&str> {
        let numbering = self.chain.numbering().into_iter();
        numbering.map(|link| self.chain.links[link].name.as_str()).collect()
    }

    /// Solves for the steady-state motion at a frequency, or for the attractor reached from rest if `from_rest`.
    pub fn answer(&self, omega_rad_s: f64, from_rest: bool) -> ChainAnswer<'_> {
        let problem = self.problem(omega_rad_s);
        let first = problem.solve(REFERENCE_ACCURACY);
        let attractor = problem.settle(REFERENCE_ACCURACY);
        let cycles_to_settle = attractor.as_ref().ok().map(|attractor| attractor.cycles);
        let (motion, from_rest) = match (first, attractor) {
            (Ok(first), attractor) if !from_rest => {
                let reach = match attractor {
                    Ok(attractor) if attractor.is_found_by_solve => FromRest::Reached,
                    Ok(_) => FromRest::Another,
                    Err(_) => FromRest::Unsettled,
                };
                (Ok(first), Some(reach))
            }
            (_, Ok(attractor)) => (Ok(attractor.motion), Some(FromRest::Reached)),
            (Err(error), Err(MotionError::Unsettled { .. })) if !from_rest => (Err(error), None),
            (_, Err(error)) => (Err(error), None),
        };
        ChainAnswer { setup: self, omega_rad_s, motion, from_rest, cycles_to_settle }
    }

    /// Samples one steady-state cycle at `samples + 1` times.
    ///
    /// # Errors
    /// Returns an error if the model has no periodic solution.
    pub fn cycle(&self, omega_rad_s: f64, samples: usize) -> Result<Vec<ChainSample>, MotionError> {
        self.problem(omega_rad_s).cycle(REFERENCE_ACCURACY, samples)
    }

    /// Returns the table of cycles of this chain with their models and frequencies. Columns number links as
    /// [`Chain::numbering`] does and joints from 1, front to rear.
    pub fn trajectories(&self, cycles: &[(Model, f64, Vec<ChainSample>)]) -> Table {
        type Of = fn(&ChainSample) -> &Vec<f64>;
        let each = || cycles.iter().flat_map(|cycle| cycle.2.iter().map(move |of| (cycle, of)));
        let columns = &mut Vec::new();
        add(columns, "model", each().map(|(cycle, _)| cycle.0));
        add(columns, "omega_rad_s", each().map(|(cycle, _)| cycle.1));
        let mut number = |name: &str, value: &dyn Fn(&ChainSample) -> f64| {
            add(columns, name, each().map(|(_, of)| value(of)));
        };
        number("time_s", &|of| of.time_s);
        number("x_m", &|of| of.pose.x_m);
        number("y_m", &|of| of.pose.y_m);
        number("theta_rad", &|of| of.pose.theta_rad);
        let joints: [(&str, &str, Of); 3] = [
            ("phi", "_rad", |of| &of.phi_rad),
            ("phi", "_rate_rad_s", |of| &of.phi_rate_rad_s),
            ("torque", "_nm", |of| &of.torque_nm),
        ];
        let wheels: [(&str, &str, Of); 4] = [
            ("roll", "_m_s", |of| &of.roll_m_s),
            ("skid", "_m_s", |of| &of.skid_m_s),
            ("lateral", "_n", |of| &of.lateral_n),
            ("roll", "_n", |of| &of.roll_n),
        ];
        for (stem, unit, values) in joints {
            for joint in 0..self.chain.joints.len() {
                number(&format!("{stem}{}{unit}", joint + 1), &|of| values(of)[joint]);
            }
        }
        for (stem, unit, values) in wheels {
            for (n, link) in self.chain.numbering().into_iter().enumerate() {
                number(&format!("{stem}{n}{unit}"), &|of| values(of)[link]);
            }
        }
        number("power_w", &|of| of.power_w);
        number("loss_w", &|of| of.loss_w);
        Table::new(std::mem::take(columns))
    }
}

/// Steady-state motion of a [`ChainSetup`] at one frequency, or the reason why there is none.
#[derive(Debug)]
pub struct ChainAnswer<'a> {
    pub setup: &'a ChainSetup,
    pub omega_rad_s: f64,
    pub motion: Result<ChainMotion, MotionError>,
    pub from_rest: Option<FromRest>,
    /// Number of cycles after which the robot, started from rest, stays within 1 % of its steady-state motion; `None`
    /// if unknown.
    pub cycles_to_settle: Option<usize>,
}

/// Joints whose angles are among the numbers of a [`ChainAnswer`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Angles {
    All,
    /// Joints that are not driven.
    Free,
}

impl ChainAnswer<'_> {
    /// Returns the status of the motion.
    pub fn status(&self) -> MotionStatus {
        self.motion.as_ref().map_or_else(MotionError::status, ChainMotion::status)
    }

    /// Returns why there is no motion; `None` if there is one.
    pub fn reason(&self) -> Option<String> {
        self.motion.as_ref().err().map(MotionError::to_string)
    }

    /// Returns the numbers of the motion by the names of their columns; all are NaN without a motion, as are the skid
    /// ratio of a link without a wheel and the Floquet multiplier of a motion that has none.
    pub fn numbers(&self, angles: Angles) -> Vec<(String, f64)> {
        let chain = &self.setup.chain;
        let motion = self.motion.as_ref().ok();
        let of = |value: &dyn Fn(&ChainMotion) -> f64| motion.map_or(f64::NAN, value);
        let mut numbers = vec![
            ("d_m".to_owned(), of(&|motion| motion.metrics.d_m)),
            ("v_m_s".to_owned(), of(&|motion| motion.metrics.v_m_s)),
            ("dtheta_rad".to_owned(), of(&|motion| motion.metrics.dtheta_rad)),
        ];
        for (number, link) in chain.numbering().into_iter().enumerate() {
            numbers.push((format!("sigma{number}"), of(&|motion| motion.metrics.sigma[link])));
        }
        for (i, joint) in chain.joints.iter().enumerate() {
            if angles == Angles::All || matches!(joint, Joint::Free(_)) {
                let name = format!("alpha{}_rad", i + 1);
                numbers.push((name, of(&|motion| motion.metrics.alpha_rad[i])));
            }
        }
        let work_j = of(&|motion| motion.work_j);
        let work_j_m = of(&|motion| if motion.metrics.d_m > 0.0 { work_j / motion.metrics.d_m } else { f64::NAN });
        let mass_kg: f64 = chain.links.iter().map(|link| link.mass_kg).sum();
        numbers.extend([
            ("floquet".to_owned(), of(&|motion| motion.floquet.unwrap_or(f64::NAN))),
            ("work_j".to_owned(), work_j),
            ("work_j_m".to_owned(), work_j_m),
            ("cost_of_transport".to_owned(), work_j_m / (mass_kg * GRAVITY_M_S2)),
        ]);
        numbers
    }

    /// Returns the table of answers for one chain, with one row for each.
    pub fn to_table(answers: &[&Self]) -> Table {
        let columns = &mut Vec::new();
        let all = || answers.iter();
        add(columns, "model", all().map(|answer| answer.setup.model));
        add(columns, "omega_rad_s", all().map(|answer| answer.omega_rad_s));
        add(columns, "status", all().map(|answer| answer.status()));
        let numbers: Vec<_> = all().map(|answer| answer.numbers(Angles::Free)).collect();
        for (i, (name, _)) in numbers.first().into_iter().flatten().enumerate() {
            add(columns, name, numbers.iter().map(|of| of[i].1));
        }
        add(columns, "from_rest", all().map(|answer| answer.from_rest));
        let cycles = all().map(|answer| answer.cycles_to_settle.map(|cycles| cycles as i64));
        add(columns, "cycles_to_settle", cycles);
        add(columns, "reason", all().map(|answer| answer.reason().unwrap_or_default()));
        Table::new(std::mem::take(columns))
    }
}

/// Appends a column.
fn add<T: Columns>(columns: &mut Vec<Column>, name: &str, values: impl Iterator<Item = T>) {
    T::write_all(values.collect(), name, columns);
}

impl Serialize for ChainAnswer<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeMap as _;
        let ChainSetup { model, parameters, gait, .. } = self.setup;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("model", model)?;
        map.serialize_entry("omega_rad_s", &self.omega_rad_s)?;
        map.serialize_entry("status", &self.status())?;
        if let Some(reason) = self.reason() {
            map.serialize_entry("reason", &reason)?;
        }
        let (sigma, others): (Vec<_>, Vec<_>) = (self.numbers(Angles::All).into_iter())
            .partition(|(name, _)| name.starts_with("sigma"));
        for (name, number) in others {
            map.serialize_entry(&name, &number)?;
        }
        let sigma: Vec<f64> = sigma.into_iter().map(|(_, ratio)| ratio).collect();
        map.serialize_entry("sigma", &sigma)?;
        map.serialize_entry("from_rest", &self.from_rest)?;
        map.serialize_entry("cycles_to_settle", &self.cycles_to_settle)?;
        map.serialize_entry("links", &self.setup.link_names())?;
        map.serialize_entry("parameters", parameters)?;
        map.serialize_entry("gait", gait)?;
        map.end()
    }
}
