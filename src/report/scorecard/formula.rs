//! How the numbers are found that claims are judged by.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use serde::Deserialize;

use super::curve::{self, Optimum, Point, Quantity};
use super::cycle::{self, CycleQuantity};
use super::paper::{Paper, TableNumber};
use super::trials::{self, Part, RobotQuantity};
use super::verdict::Found;
use crate::config::SigmaKind;
use crate::motion::Solver;
use crate::report::tables::Tables;
use crate::robot::Model;
use crate::stats::wrap;

/// How a number is found. `of`, `over` and `from` name motions of the paper, which are computed,
/// or campaigns, which the trials at hand measured.
///
/// - At one frequency: a quantity; one motion's over another's, or less it; the deviation of the
///   displacement from a printed one over the largest of others; the largest such deviation, per
///   cent; how many of the motions exist; what happens within a cycle; how far the phase between
///   the joints is from a third motion's, less how far another's is, degrees.
/// - Over the frequencies: where a quantity is largest; how far apart two such frequencies are;
///   the difference of the largest and the least value over the mean, per cent; the largest value;
///   the ratio of the means; the least ratio; the mean difference of two motions from 4 to 6 rad/s
///   over that from 0.5 to 2.
/// - Of the tables of `derived/`: the largest difference of a commanded joint's offset or amplitude
///   from the command, degrees; what releases and coast-downs measure; a coefficient of the model
///   `skid-roll`; a model's objective, or a part of it, over the largest of others; the part of the
///   trials at whose frequencies a model has a motion.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Formula {
    Tables(TableNumber),
    At { of: String, omega_rad_s: f64, quantity: Quantity },
    Ratio { of: String, over: String, omega_rad_s: f64, quantity: Quantity },
    Excess { of: String, over: String, omega_rad_s: f64, quantity: Quantity },
    DeviationRatio { of: String, over: Vec<String>, omega_rad_s: f64, from_mm: f64 },
    LargestDeviation { of: Vec<String>, omega_rad_s: f64, from_mm: Vec<f64> },
    Existing { of: Vec<String>, omega_rad_s: f64 },
    Cycle { of: String, omega_rad_s: f64, quantity: CycleQuantity },
    LagExcess { of: String, over: String, from: String, omega_rad_s: f64 },
    Optimum { of: String, quantity: Quantity },
    OptimaApart { of: String, quantities: [Quantity; 2] },
    Spread { of: String, quantity: Quantity },
    Largest { of: String, quantity: Quantity },
    RatioOfMeans { of: String, over: String, quantities: Vec<Quantity> },
    LeastRatio { of: String, over: String, quantity: Quantity },
    EffectHighOverLow { of: String, over: String, quantity: Quantity },
    GaitOffCommand { campaign: String, omega_rad_s: f64 },
    Robot { robot: String, quantity: RobotQuantity },
    Fit { campaign: String, parameter: String },
    ObjectiveRatio { campaign: String, model: Model, over: Vec<Model>, part: Part },
    ExistingShare { campaign: String, model: Model },
}

/// The paper's motions and the tables of the trials at hand, of which formulas are.
pub struct Sources<'t> {
    paper: Paper,
    tables: &'t Tables,
    sigma: SigmaKind,
    /// By motion and campaign, found when asked for.
    curves: BTreeMap<String, OnceLock<Vec<Point>>>,
}

impl<'t> Sources<'t> {
    /// `sigma` says which skid ratios of the trials count.
    pub fn new(paper: Paper, tables: &'t Tables, sigma: SigmaKind) -> Self {
        let names = paper.motion.keys().chain(paper.config.campaign.keys());
        let curves = names.map(|name| (name.clone(), OnceLock::new())).collect();
        Self { paper, tables, sigma, curves }
    }

    fn is_computed(&self, name: &str) -> bool {
        self.paper.motion.contains_key(name)
    }

    /// Points in the order of frequency.
    fn curve(&self, name: &str) -> Option<&[Point]> {
        let find = || match self.is_computed(name) {
            true => curve::sweep(&self.paper, name),
            false => trials::curve(self.tables, name, self.sigma),
        };
        Some(self.curves.get(name)?.get_or_init(find))
    }

    fn at(&self, name: &str, omega_rad_s: f64, quantity: Quantity) -> Option<f64> {
        let point = match self.paper.problem(name, omega_rad_s) {
            Some(problem) => &Point::solve(&mut Solver::default(), &problem)?,
            None => trials::nearest(self.curve(name)?, omega_rad_s)?,
        };
        Some(point.get(quantity))
    }

    fn lag_deg(&self, name: &str, omega_rad_s: f64) -> Option<f64> {
        match self.paper.problem(name, omega_rad_s) {
            Some(problem) => cycle::lag_deg(&problem),
            None => trials::lag_deg(self.tables, name, omega_rad_s),
        }
    }

    fn optimum(&self, name: &str, quantity: Quantity) -> Option<Optimum> {
        curve::optimum(self.curve(name)?, quantity, !self.is_computed(name))
    }

    /// What two curves give together at the frequencies that both have.
    fn compare<T>(
        &self,
        [of, over]: [&str; 2],
        quantities: &[Quantity],
        compare: impl FnOnce(&[Point], &[Point]) -> T,
    ) -> Option<T> {
        let (a, b) = curve::common(self.curve(of)?, self.curve(over)?, quantities)?;
        Some(compare(&a, &b))
    }
}

impl Formula {
    /// Why a folder that lacks what is needed gives no verdict.
    pub fn lacking(&self) -> &'static str {
        match self {
            Self::Robot { .. } => "The folder has no joint-release or coast-down of this robot.",
            Self::Fit { .. } | Self::ObjectiveRatio { .. } | Self::ExistingShare { .. } => {
                "The folder has no such fit."
            }
            _ => "The folder has no such trials.",
        }
    }

    /// The number; `None` if there is no such motion or the tables do not have what it takes.
    pub fn find(&self, sources: &Sources<'_>) -> Option<Found> {
        let tables = sources.tables;
        let at = |of: &str, omega: &f64, quantity| sources.at(of, *omega, quantity);
        let d_mm = |of: &str, omega: &f64| at(of, omega, Quantity::DMm);
        let value = match self {
            Self::Tables(number) => number.value(&sources.paper)?,
            Self::At { of, omega_rad_s, quantity } => at(of, omega_rad_s, *quantity)?,
            Self::Ratio { of, over, omega_rad_s, quantity } => {
                at(of, omega_rad_s, *quantity)? / at(over, omega_rad_s, *quantity)?
            }
            Self::Excess { of, over, omega_rad_s, quantity } => {
                at(of, omega_rad_s, *quantity)? - at(over, omega_rad_s, *quantity)?
            }
            Self::DeviationRatio { of, over, omega_rad_s, from_mm } => {
                let off = |name: &String| Some((d_mm(name, omega_rad_s)? - from_mm).abs());
                let others = over.iter().map(off).collect::<Option<Vec<f64>>>()?;
                off(of)? / others.into_iter().fold(0.0, f64::max)
            }
            Self::LargestDeviation { of, omega_rad_s, from_mm } => {
                let off = |(name, from): (&String, &f64)| {
                    Some((d_mm(name, omega_rad_s)? / from - 1.0).abs())
                };
                let off = of.iter().zip(from_mm).map(off).collect::<Option<Vec<f64>>>()?;
                100.0 * off.into_iter().fold(f64::NAN, f64::max)
            }
            Self::Existing { of, omega_rad_s } => {
                of.iter().filter(|name| d_mm(name, omega_rad_s).is_some()).count() as f64
            }
            Self::Cycle { of, omega_rad_s, quantity } => {
                quantity.find(&sources.paper.problem(of, *omega_rad_s)?)?
            }
            Self::LagExcess { of, over, from, omega_rad_s } => {
                let from_deg = sources.lag_deg(from, *omega_rad_s)?;
                let off = |name: &str| {
                    let lag_deg = sources.lag_deg(name, *omega_rad_s)?;
                    Some(wrap((lag_deg - from_deg).to_radians()).to_degrees().abs())
                };
                off(of)? - off(over)?
            }
            Self::Optimum { of, quantity } => {
                let Optimum { omega_rad_s, is_inside } = sources.optimum(of, *quantity)?;
                let at_end = "No maximum between the ends: largest at this one.";
                let note = if is_inside { "" } else { at_end };
                return Some(Found::with_note(omega_rad_s, note));
            }
            Self::OptimaApart { of, quantities } => {
                let [a, b] = quantities.map(|quantity| sources.optimum(of, quantity));
                let (a, b) = (a?, b?);
                if !(a.is_inside && b.is_inside) {
                    let note = "One of them has no maximum between the ends of the sweep.";
                    return Some(Found::with_note(f64::NAN, note));
                }
                (a.omega_rad_s - b.omega_rad_s).abs()
            }
            Self::Spread { of, quantity } => curve::spread_percent(sources.curve(of)?, *quantity)?,
            Self::Largest { of, quantity } => {
                let values = sources.curve(of)?.iter().map(|point| point.get(*quantity));
                values.fold(f64::NAN, f64::max)
            }
            Self::RatioOfMeans { of, over, quantities } => {
                sources.compare([of, over], quantities, |a, b| {
                    curve::ratio_of_means(a, b, quantities)
                })?
            }
            Self::LeastRatio { of, over, quantity } => {
                sources
                    .compare([of, over], &[*quantity], |a, b| curve::least_ratio(a, b, *quantity))?
            }
            Self::EffectHighOverLow { of, over, quantity } => {
                sources.compare([of, over], &[*quantity], |a, b| {
                    curve::effect_high_over_low(a, b, *quantity)
                })?
            }
            Self::GaitOffCommand { campaign, omega_rad_s } => {
                let (_, gait) = sources.paper.config.campaign_setup(campaign)?;
                trials::off_command_deg(tables, campaign, &gait, *omega_rad_s)?
            }
            Self::Robot { robot, quantity } => quantity.find(tables, robot)?,
            Self::Fit { campaign, parameter } => {
                return trials::fitted(tables, campaign, parameter);
            }
            Self::ObjectiveRatio { campaign, model, over, part } => {
                trials::objective_ratio(tables, campaign, *model, over, *part)?
            }
            Self::ExistingShare { campaign, model } => {
                trials::existing_share(tables, campaign, *model)?
            }
        };
        Some(Found::new(value))
    }
}
