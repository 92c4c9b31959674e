//! Simulation of campaigns whose robot is a chain of links.

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value};
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::{
    Attractor, FromRest, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, Sample,
    SharpLimit, Solver, SteadyMotion,
};
use trilink_robot::metrics::Metric;
use trilink_robot::{Chain, ChainNumber, GRAVITY_M_S2, Joint, Laws, Model};
use trilink_tables::config::{Config, did_you_mean};
use trilink_tables::{Column, Columns, Extrapolation, Table};

use super::fitted::{FitSummary, FittedSetup, KnownFits};
use super::sensitivity::{InputUncertainty, Motion};
use super::trajectory::UNSETTLED_CYCLES;
use super::{Draws, Interval, Sensitivities, SetupError, keys_of, known_laws, sensitivities};
use crate::MeasuredRange;
use crate::bands::without_resample;

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
    /// Uncertainty of the chain's numbers according to the configuration.
    uncertainty: InputUncertainty,
    /// Fit from which the coefficients come; `None` for configured coefficients.
    pub(super) fitted: Option<FittedSetup>,
}

impl ChainSetup {
    /// Sets up a campaign whose robot is a chain; returns `None` if there is no such campaign or its robot has the short
    /// form for three links.
    ///
    /// # Errors
    /// Returns an error if the model does not exist, or if a wheel lacks a coefficient that the model needs.
    pub fn new(config: &Config, campaign: &str, model: &str) -> Result<Option<Self>, SetupError> {
        let Some(chain) = config.chain_setup(campaign) else { return Ok(None) };
        let laws = known_laws(config, model)?;
        let model = Model::new(model);
        let names = &config.chains.campaign[campaign];
        config.check_chain_laws(Path::new("--model"), &names.robot, model)?;
        let robot = &config.chains.robot[&names.robot];
        let uncertainty = InputUncertainty::of_chain(robot);
        // As TOML, in which keys without a value are left out.
        let parameters = toml::Table::try_from(robot);
        let gait = toml::Table::try_from(config.chain_gait(&names.gait));
        let [parameters, gait] = [parameters, gait].map(|table| keys_of(&table.ok()));
        let (parameters, gait) = (parameters?, gait?);
        Ok(Some(Self { chain, laws, model, parameters, gait, uncertainty, fitted: None }))
    }

    /// Replaces the coefficients by those that were fitted to the campaign's trials.
    ///
    /// # Errors
    /// Returns an error if there is no such fit or the fit failed.
    pub fn use_fit(
        &mut self,
        config: &Config,
        campaign: &str,
        fits: &KnownFits,
    ) -> Result<(), SetupError> {
        let fitted = FittedSetup::new(config, campaign, self.model, fits)?;
        for (parameter, value) in fitted.coefficients() {
            self.chain.set(parameter, value);
        }
        self.fitted = Some(fitted);
        Ok(())
    }

    /// Returns the summary of the fit that provides the coefficients; `None` for configured coefficients.
    pub fn fit(&self) -> Option<&FitSummary> {
        self.fitted.as_ref().map(|fitted| &fitted.summary)
    }

    /// Returns the range covered by the fitted trials, or the reason why it is unknown; `None` for configured
    /// coefficients.
    pub fn measured_range(&self) -> Option<Result<&MeasuredRange, &str>> {
        self.fitted.as_ref().map(FittedSetup::range)
    }

    /// Applies a setting `NAME=VALUE` of a number of the chain, in the unit of its name.
    ///
    /// # Errors
    /// Returns an error if the chain has no such number, or if the value is not one that it can have.
    pub fn set(&mut self, setting: &str) -> Result<(), SetupError> {
        let (name, value) = setting
            .split_once('=')
            .ok_or_else(|| format!("--set: found `{setting}`, needed NAME=VALUE"))?;
        let Some(number) = self.number(name) else {
            let names = self.number_names();
            let hint = did_you_mean(name, names.iter().map(String::as_str));
            return Err(format!("--set {setting}: the robot has no number `{name}`{hint}").into());
        };
        let parsed: f64 = value
            .parse()
            .map_err(|_| format!("--set {setting}: found `{value}`, needed a number"))?;
        if let Some(value) = self.chain.number_mut(number) {
            *value = parsed * number.in_si();
        }
        self.chain.check().map_err(|error| format!("--set {setting}: {error}"))?;
        Ok(())
    }

    /// Returns the names of the chain's numbers.
    pub fn number_names(&self) -> Vec<String> {
        let numbers = self.chain.numbers().into_iter();
        numbers.map(|number| self.chain.number_name(number)).collect()
    }

    fn number(&self, name: &str) -> Option<ChainNumber> {
        let mut numbers = self.chain.numbers().into_iter();
        numbers.find(|number| self.chain.number_name(*number) == name)
    }

    /// Returns the setup with a number of the chain set to a value in the unit of its name; `None` if the name is unknown.
    pub fn with_number(&self, name: &str, value: f64) -> Option<Self> {
        let number = self.number(name)?;
        let mut setup = self.clone();
        *setup.chain.number_mut(number)? = value * number.in_si();
        Some(setup)
    }

    /// Computes the sensitivities of the metrics to all numbers of the chain on which they depend, and the uncertainty
    /// budgets, as [`Setup::sensitivities`](super::Setup::sensitivities) does for a robot of three links.
    ///
    /// # Errors
    /// Returns an error if the computation is cancelled.
    pub fn sensitivities(
        &self,
        omegas_rad_s: &[f64],
        from_rest: bool,
        fits: Option<&KnownFits>,
        draws: Option<Draws>,
        cancel: &CancelToken,
    ) -> Result<Sensitivities, Cancelled> {
        let motion = |omega_rad_s: f64| {
            let problem = self.problem(omega_rad_s);
            let extrapolation = self.extrapolation(&problem);
            Motion { problem, model: self.model, metrics: self.metrics(), extrapolation }
        };
        let known = (&self.uncertainty, fits.zip(self.fitted.as_ref()));
        sensitivities(&motion, omegas_rad_s, from_rest, known, draws, cancel)
    }

    /// Adds confidence limits of the metrics, or the reason why there are none, to answers that this setup computed with
    /// the same `from_rest`; does nothing for configured coefficients. `fits` must come from [`KnownFits::read`] with
    /// `bands`.
    pub fn add_bands(&self, answers: &mut [&mut ChainAnswer], from_rest: bool, fits: &KnownFits) {
        let Some(fitted) = &self.fitted else { return };
        let robot = self.chain.clone().into();
        let result = fitted.with_bands(&robot, &fits.data, |bands| {
            answers.par_iter_mut().for_each(|answer| {
                let problem = self.problem(answer.omega_rad_s);
                let mut solver = Solver::default();
                let mut metrics = solver.solve(&problem, REFERENCE_ACCURACY);
                if from_rest {
                    let attractor = solver.attractor(&problem, metrics, REFERENCE_ACCURACY);
                    metrics = attractor.map(|attractor| attractor.motion.metrics);
                }
                let limits = metrics.and_then(|metrics| bands.limits(solver, &problem, metrics));
                answer.interval = Some(match limits {
                    Ok([lower, upper]) => Interval { lower, upper, no_interval: None },
                    Err(error) => Interval::unknown(without_resample(&error)),
                });
            });
        });
        if let Err(reason) = result {
            for answer in answers {
                answer.interval = Some(Interval::unknown(reason.clone()));
            }
        }
    }

    /// Returns whether a problem lies outside the range of the fitted trials; blank for configured coefficients.
    pub(super) fn extrapolation(&self, problem: &Problem) -> Extrapolation {
        let fitted = self.fitted.as_ref();
        fitted.map_or_else(Extrapolation::blank, |fitted| fitted.extrapolation(problem))
    }

    /// Returns the names of the columns of the metrics and of the work that have a derivative.
    fn metrics(&self) -> Vec<String> {
        let mut names: Vec<String> = ["d_m", "v_m_s", "dtheta_rad"].map(str::to_owned).to_vec();
        for (number, link) in self.chain.numbering().into_iter().enumerate() {
            if self.laws.skids() && self.chain.links[link].wheel.is_some() {
                names.push(format!("sigma{number}"));
            }
        }
        for (i, joint) in self.chain.joints.iter().enumerate() {
            if matches!(joint, Joint::Free(_)) {
                names.push(format!("alpha{}_rad", i + 1));
            }
        }
        names.push("work_j".to_owned());
        names
    }

    /// Returns the problem to solve at a frequency.
    pub fn problem(&self, omega_rad_s: f64) -> Problem {
        Problem::new(self.chain.clone(), self.chain.gait(), self.laws, omega_rad_s)
    }

    /// Returns the names of the links in the order in which columns number them.
    pub fn link_names(&self) -> Vec<&str> {
        let numbering = self.chain.numbering().into_iter();
        numbering.map(|link| self.chain.links[link].name.as_str()).collect()
    }

    /// Solves for the steady-state motion at a frequency, or for the attractor reached from rest if `from_rest`.
    pub fn answer(&self, omega_rad_s: f64, from_rest: bool) -> ChainAnswer<'_> {
        let problem = self.problem(omega_rad_s);
        let mut solver = Solver::default();
        let metrics = solver.solve(&problem, REFERENCE_ACCURACY);
        let first = metrics.clone().and_then(|metrics| solver.steady_motion(metrics));
        let attractor = solver.attractor(&problem, metrics, REFERENCE_ACCURACY);
        let cycles_to_settle = attractor.as_ref().ok().map(|attractor| attractor.cycles);
        let (motion, from_rest) = match (first, attractor) {
            (Ok(first), attractor) if !from_rest => {
                (Ok(first), Some(Attractor::from_rest(&attractor)))
            }
            (_, Ok(attractor)) => (Ok(attractor.motion), Some(FromRest::Reached)),
            (Err(error), Err(MotionError::Unsettled { .. })) if !from_rest => (Err(error), None),
            (_, Err(error)) => (Err(error), None),
        };
        let sharp_limit = motion
            .as_ref()
            .ok()
            .and_then(|_| problem.sharp_limit(REFERENCE_ACCURACY).ok().flatten());
        ChainAnswer {
            setup: self,
            omega_rad_s,
            motion,
            from_rest,
            cycles_to_settle,
            sharp_limit,
            interval: None,
        }
    }

    /// Samples a motion at `samples` times per cycle: one steady-state cycle, or, if `from_rest`, all cycles from rest up
    /// to the steady state and one more.
    ///
    /// # Errors
    /// Returns an error if the model has no periodic solution.
    pub fn sample_motion(
        &self,
        answer: &ChainAnswer,
        from_rest: bool,
        samples: usize,
    ) -> Result<Vec<Sample>, MotionError> {
        let problem = self.problem(answer.omega_rad_s);
        if !from_rest {
            return problem.cycle(REFERENCE_ACCURACY, samples);
        }
        let cycles = answer.cycles_to_settle.map_or(UNSETTLED_CYCLES, |cycles| cycles + 1);
        problem.cycles_from_rest(cycles, samples)
    }

    /// Returns the table of cycles of this chain with their models and frequencies. Columns number links as
    /// [`Chain::numbering`] does and joints from 1, front to rear.
    pub fn trajectories(&self, cycles: &[(Model, f64, Vec<Sample>)]) -> Table {
        type Of = fn(&Sample) -> &Vec<f64>;
        let each = || cycles.iter().flat_map(|cycle| cycle.2.iter().map(move |of| (cycle, of)));
        let columns = &mut Vec::new();
        add(columns, "model", each().map(|(cycle, _)| cycle.0));
        add(columns, "omega_rad_s", each().map(|(cycle, _)| cycle.1));
        let mut number = |name: &str, value: &dyn Fn(&Sample) -> f64| {
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
            for n in 0..self.chain.links.len() {
                number(&format!("{stem}{n}{unit}"), &|of| values(of)[n]);
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
    pub motion: Result<SteadyMotion, MotionError>,
    pub from_rest: Option<FromRest>,
    /// Number of cycles after which the robot, started from rest, stays within 1 % of its steady-state motion; `None`
    /// if unknown.
    pub cycles_to_settle: Option<usize>,
    /// Metrics at zero transition speed; `None` if no friction is dry, or if they could not be computed.
    pub sharp_limit: Option<SharpLimit>,
    /// Confidence limits of the metrics, if requested.
    pub interval: Option<Interval>,
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
        self.motion.as_ref().map_or_else(MotionError::status, SteadyMotion::status)
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
        let of = |value: &dyn Fn(&SteadyMotion) -> f64| motion.map_or(f64::NAN, value);
        let mut numbers = vec![
            ("d_m".to_owned(), of(&|motion| motion.metrics.d_m)),
            ("v_m_s".to_owned(), of(&|motion| motion.metrics.v_m_s)),
            ("dtheta_rad".to_owned(), of(&|motion| motion.metrics.dtheta_rad)),
        ];
        for number in 0..chain.links.len() {
            numbers.push((format!("sigma{number}"), of(&|motion| motion.metrics.sigma[number])));
        }
        for (i, joint) in chain.joints.iter().enumerate() {
            if angles == Angles::All || matches!(joint, Joint::Free(_)) {
                let name = format!("alpha{}_rad", i + 1);
                numbers.push((name, of(&|motion| motion.metrics.alpha_rad[i])));
            }
        }
        let work_j = of(&|motion| motion.work_j);
        let work_j_m = of(&|motion| {
            if motion.metrics.d_m > 0.0 { work_j / motion.metrics.d_m } else { f64::NAN }
        });
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
            let Some(metric) = Metric::from_column(name) else { continue };
            for (suffix, side) in [("lo", 0), ("hi", 1)] {
                let limit = |interval: &Interval| [interval.lower, interval.upper][side][metric];
                if all().any(|answer| answer.interval.is_some()) {
                    let limits = all().map(|of| of.interval.as_ref().map_or(f64::NAN, limit));
                    add(columns, &format!("{name}_{suffix}"), limits);
                }
            }
            for (suffix, side) in [("", 0), ("_uncertainty", 1)] {
                let sharp = |limit: &SharpLimit| [limit.metrics, limit.uncertainty][side][metric];
                if all().any(|answer| answer.sharp_limit.is_some()) {
                    let limits = all().map(|of| of.sharp_limit.as_ref().map_or(f64::NAN, sharp));
                    add(columns, &format!("sharp_limit_{name}{suffix}"), limits);
                }
            }
        }
        if all().any(|answer| answer.interval.is_some()) {
            let reasons =
                all().map(|of| of.interval.as_ref().and_then(|of| of.no_interval.clone()));
            add(columns, "no_interval{}", reasons);
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
        let ChainSetup { model, parameters, gait, fitted, .. } = self.setup;
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
        if let Some(limit) = &self.sharp_limit {
            map.serialize_entry("sharp_limit", limit)?;
        }
        if let Some(Interval { lower, upper, no_interval }) = &self.interval {
            map.serialize_entry("lower", lower)?;
            map.serialize_entry("upper", upper)?;
            map.serialize_entry("no_interval", no_interval)?;
        }
        map.serialize_entry("links", &self.setup.link_names())?;
        map.serialize_entry("parameters", parameters)?;
        if let Some(fitted) = fitted {
            let coefficients = fitted.coefficients().map(|(of, value)| (of.name(), value));
            map.serialize_entry("coefficients", &coefficients.collect::<BTreeMap<_, _>>())?;
        }
        map.serialize_entry("gait", gait)?;
        map.end()
    }
}
