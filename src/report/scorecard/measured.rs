//! Numbers that follow from the trials at hand: from the tables of `derived/`.

use serde::Deserialize;

use super::computed::{Found, lag_excess, optima_apart, optimum};
use super::paper::Paper;
use super::sweep::{self, Curve, Optimum, Point, Quantity};
use crate::config::SigmaKind;
use crate::metrics::GaitMetrics;
use crate::motion::{Model, MotionStatus};
use crate::report::tables::Tables;
use crate::robot::Parameter;
use crate::store::{PredictionSource, TrialRow, TrialStatus};

/// Part of the printed frequency that a trial may be off.
const NEAR: f64 = 0.02;
/// Model whose coefficients the paper prints.
const FITTED_MODEL: Model = Model::SkidRoll;

/// How a number is measured.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Measured {
    /// Mean over the trials at a frequency.
    At {
        campaign: String,
        omega_rad_s: f64,
        quantity: Quantity,
    },
    Optimum {
        campaign: String,
        quantity: Quantity,
    },
    OptimaApart {
        campaign: String,
        quantities: [Quantity; 2],
    },
    Spread {
        campaign: String,
        quantity: Quantity,
    },
    RatioOfMeans {
        campaign: String,
        over: String,
        quantities: Vec<Quantity>,
    },
    LeastRatio {
        campaign: String,
        over: String,
        quantity: Quantity,
    },
    /// How far one motion's phase between the joints is from the measured, less how far another's
    /// is, degrees.
    LagExcess {
        motion: String,
        over: String,
        campaign: String,
        omega_rad_s: f64,
    },
    /// Largest difference of a commanded joint's offset or amplitude from the command, degrees.
    GaitOffCommand {
        campaign: String,
        omega_rad_s: f64,
    },
    /// From joint-releases and coast-downs.
    Robot {
        robot: String,
        quantity: RobotQuantity,
    },
    /// Coefficient of the model `skid-roll`.
    Fit {
        campaign: String,
        parameter: String,
    },
    /// A model's objective, or a part of it, over the largest of others.
    ObjectiveRatio {
        campaign: String,
        model: Model,
        over: Vec<Model>,
        part: Part,
    },
    /// Part of the trials at whose frequencies a model has a motion.
    Existing {
        campaign: String,
        model: Model,
    },
}

/// What a release or a coast-down tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RobotQuantity {
    RestAngleDeg,
    DampingRatio,
    NaturalRadS,
    StiffnessNmRad,
    DampingNmSRad,
    RollSumKgS,
}

/// Part of an objective.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    J,
    JAlpha,
}

impl Measured {
    /// Why a folder that lacks what is needed gives no verdict.
    pub fn lacking(&self) -> &'static str {
        match self {
            Self::Robot { .. } => "The folder has no joint-release or coast-down of this robot.",
            Self::Fit { .. } | Self::ObjectiveRatio { .. } | Self::Existing { .. } => {
                "The folder has no such fit."
            }
            _ => "The folder has no such trials.",
        }
    }

    /// The number; `None` if the tables do not have what it takes.
    pub fn find(&self, paper: &Paper<'_>, tables: &Tables, sigma: SigmaKind) -> Option<Found> {
        let curve = |campaign: &str| measured_curve(tables, campaign, sigma);
        let value = match self {
            Self::At { campaign, omega_rad_s, quantity } => {
                point_near(&curve(campaign), *omega_rad_s)?.get(*quantity)
            }
            Self::Optimum { campaign, quantity } => {
                return Some(optimum(highest(&curve(campaign), *quantity)?));
            }
            Self::OptimaApart { campaign, quantities } => {
                let curve = curve(campaign);
                let [a, b] = quantities.map(|quantity| highest(&curve, quantity));
                return Some(optima_apart(a?, b?));
            }
            Self::Spread { campaign, quantity } => {
                sweep::spread_percent(several(&curve(campaign))?, *quantity)
            }
            Self::RatioOfMeans { campaign, over, quantities } => {
                let (a, b) = common(&curve(campaign), &curve(over), quantities)?;
                sweep::ratio_of_means(&a, &b, quantities)
            }
            Self::LeastRatio { campaign, over, quantity } => {
                let (a, b) = common(&curve(campaign), &curve(over), &[*quantity])?;
                sweep::least_ratio(&a, &b, *quantity)
            }
            Self::LagExcess { motion, over, campaign, omega_rad_s } => {
                let trials = trials_near(tables, campaign, *omega_rad_s);
                // The phases lie together: their mean may be taken about the first's.
                let lag = |row: &TrialRow| row.gait[0].phase_rad - row.gait[1].phase_rad;
                let first = lag(trials.first()?);
                let off = trials.iter().map(|row| wrapped(lag(row) - first)).sum::<f64>();
                let measured = (first + off / trials.len() as f64).to_degrees();
                lag_excess(paper, [motion, over], *omega_rad_s, measured)?
            }
            Self::GaitOffCommand { campaign, omega_rad_s } => {
                let (_, gait) = paper.config.campaign_setup(campaign)?;
                let off = trials_near(tables, campaign, *omega_rad_s).into_iter().map(|row| {
                    let commands = gait.joints.iter().zip(row.gait);
                    let off = commands.filter_map(|(joint, found)| {
                        let joint = (*joint)?;
                        let off = (found.offset_rad - joint.offset_rad).abs();
                        Some(off.max((found.amplitude_rad - joint.amplitude_rad).abs()))
                    });
                    off.fold(0.0, f64::max).to_degrees()
                });
                off.max_by(f64::total_cmp)?
            }
            Self::Robot { robot, quantity } => robot_quantity(tables, robot, *quantity)?,
            Self::Fit { campaign, parameter } => return fitted(tables, campaign, parameter),
            Self::ObjectiveRatio { campaign, model, over, part } => {
                let part = |model: &Model| {
                    let mut rows = tables.comparison.iter();
                    let row = rows.find(|row| row.campaign == *campaign && row.model == *model)?;
                    let value = match part {
                        Part::J => row.j,
                        Part::JAlpha => row.j_alpha,
                    };
                    Some(value).filter(|value| value.is_finite())
                };
                let others = over.iter().map(|model| part(model)).collect::<Option<Vec<f64>>>()?;
                let worst = others.into_iter().fold(0.0, f64::max);
                if worst == 0.0 {
                    return None;
                }
                part(model)? / worst
            }
            Self::Existing { campaign, model } => {
                let rows: Vec<bool> = tables
                    .predictions
                    .iter()
                    .filter(|row| row.campaign == *campaign && row.model == *model)
                    .filter(|row| row.source == PredictionSource::Trial)
                    .map(|row| matches!(row.status, MotionStatus::Stable | MotionStatus::Unstable))
                    .collect();
                if rows.is_empty() {
                    return None;
                }
                rows.iter().filter(|exists| **exists).count() as f64 / rows.len() as f64
            }
        };
        Some(Found::new(value)).filter(|found| found.value.is_finite())
    }
}

/// Trials of a campaign that have results.
fn trials<'t>(tables: &'t Tables, campaign: &str) -> impl Iterator<Item = &'t TrialRow> {
    let of = tables.trials.iter().filter(move |row| row.campaign == campaign);
    of.filter(|row| {
        let GaitMetrics { d_m, v_m_s, .. } = row.metrics;
        row.status != TrialStatus::Failed && d_m.is_finite() && v_m_s.is_finite()
    })
}

fn is_near(omega_rad_s: f64, printed_rad_s: f64) -> bool {
    (omega_rad_s - printed_rad_s).abs() <= NEAR * printed_rad_s
}

fn trials_near<'t>(tables: &'t Tables, campaign: &str, omega_rad_s: f64) -> Vec<&'t TrialRow> {
    let near = |row: &&TrialRow| is_near(row.omega_commanded_rad_s, omega_rad_s);
    trials(tables, campaign).filter(near).collect()
}

/// Means over the trials at each commanded frequency. (Tables come in its order.)
fn measured_curve(tables: &Tables, campaign: &str, sigma: SigmaKind) -> Curve {
    let rows: Vec<&TrialRow> = trials(tables, campaign).collect();
    let groups = rows.chunk_by(|a, b| a.omega_commanded_rad_s == b.omega_commanded_rad_s);
    let mean_of = |group: &[&TrialRow]| {
        let mean = |value: &dyn Fn(&TrialRow) -> f64| {
            group.iter().map(|row| value(row)).sum::<f64>() / group.len() as f64
        };
        let wheel = |wheel: usize| mean(&|row| row.sigma(sigma)[wheel].value);
        let metrics = GaitMetrics {
            d_m: mean(&|row| row.metrics.d_m),
            v_m_s: mean(&|row| row.metrics.v_m_s),
            sigma: [wheel(0), wheel(1), wheel(2)],
            alpha1_rad: mean(&|row| row.metrics.alpha1_rad),
            dtheta_rad: mean(&|row| row.metrics.dtheta_rad),
        };
        let omega_rad_s = group[0].omega_commanded_rad_s;
        Point { omega_rad_s, metrics, floquet: f64::NAN, work_j: f64::NAN }
    };
    groups.map(mean_of).collect()
}

/// The point nearest to a printed frequency.
fn point_near(curve: &[Point], omega_rad_s: f64) -> Option<&Point> {
    let near = curve.iter().filter(|point| is_near(point.omega_rad_s, omega_rad_s));
    let off = |point: &Point| (point.omega_rad_s - omega_rad_s).abs();
    near.min_by(|a, b| off(a).total_cmp(&off(b)))
}

fn several(curve: &[Point]) -> Option<&[Point]> {
    (curve.len() >= 3).then_some(curve)
}

/// The points of two curves at the frequencies at which both have all these quantities.
fn common(a: &[Point], b: &[Point], quantities: &[Quantity]) -> Option<(Curve, Curve)> {
    let has = |point: &Point| quantities.iter().all(|quantity| point.get(*quantity).is_finite());
    let pairs = a.iter().filter_map(|point| {
        let other = b.iter().find(|other| other.omega_rad_s == point.omega_rad_s)?;
        (has(point) && has(other)).then_some((*point, *other))
    });
    let (a, b): (Curve, Curve) = pairs.unzip();
    (!a.is_empty()).then_some((a, b))
}

/// The frequency of the highest point. Measurements scatter: lower peaks do not count.
fn highest(curve: &[Point], quantity: Quantity) -> Option<Optimum> {
    let curve = several(curve)?;
    let by_value =
        |a: &usize, b: &usize| curve[*a].get(quantity).total_cmp(&curve[*b].get(quantity));
    let peak = (0..curve.len()).max_by(by_value)?;
    let is_inside = peak > 0 && peak + 1 < curve.len();
    Some(Optimum { omega_rad_s: curve[peak].omega_rad_s, is_inside })
}

fn wrapped(angle_rad: f64) -> f64 {
    super::moments::wrapped_deg(angle_rad).to_radians()
}

/// Mean over the trials that tell.
fn robot_quantity(tables: &Tables, robot: &str, quantity: RobotQuantity) -> Option<f64> {
    let of_robot = tables.robots.iter().filter(|row| row.robot == robot);
    let values: Vec<f64> = of_robot
        .map(|row| match quantity {
            RobotQuantity::RestAngleDeg => row.rest_angle_rad.value.to_degrees(),
            RobotQuantity::DampingRatio => row.damping_ratio.value,
            RobotQuantity::NaturalRadS => row.natural_rad_s.value,
            RobotQuantity::StiffnessNmRad => row.stiffness_nm_rad.value,
            RobotQuantity::DampingNmSRad => row.damping_nm_s_rad.value,
            RobotQuantity::RollSumKgS => row.roll_sum_kg_s.value,
        })
        .filter(|value| value.is_finite())
        .collect();
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// A coefficient that a fit left free, with its interval.
fn fitted(tables: &Tables, campaign: &str, parameter: &str) -> Option<Found> {
    let parameter = Parameter::of_column(parameter)?;
    let mut fits = tables.fits.iter();
    let fit = fits.find(|fit| {
        fit.campaign == campaign && fit.model == FITTED_MODEL && fit.free.contains(&parameter)
    })?;
    let value = fit.parameters[parameter];
    let limits = [fit.lower[parameter], fit.upper[parameter]];
    let limits = limits.iter().any(|limit| limit.is_finite()).then_some(limits);
    value.is_finite().then_some(Found { limits, ..Found::new(value) })
}
