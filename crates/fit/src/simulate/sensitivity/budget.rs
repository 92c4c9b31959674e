//! First-order uncertainty budget of a prediction.
//!
//! Errors of robot parameters from the configuration or from other kinds of trials are independent, except that
//! parameters that were measured with one instrument share its error (GUM, F.1.2.3), of whose variance each is assigned
//! an equal part. If coefficients are
//! fitted, each such error also shifts the fit, which cancels part of the error's effect. The errors of the fitted
//! coefficients are correlated; their covariance is that of the bootstrap replicates.
//!
//! Reference: JCGM 100:2008, *Guide to the expression of uncertainty in measurement*, section 5.

use trilink_mechanics::Problem;
use trilink_robot::{AnyRobot, ChainNumber, Gait, Laws, Parameter, Quantity as RobotQuantity};
use trilink_tables::KnownFrom;
use trilink_tables::config::{ChainRobot, ThreeLinkRobot};

use super::quantity::Quantity;
use crate::PredictionBands;

/// Uncertainties of the quantities that influence the metrics.
#[derive(Debug, Clone, Default)]
pub(crate) struct InputUncertainty {
    pub(super) independent: Vec<IndependentError>,
    pub(super) fitted: Option<FittedCoefficients>,
}

/// Error that is independent of all others.
#[derive(Debug, Clone)]
pub(super) struct IndependentError {
    /// Quantities that share the error, with their standard deviations in SI units.
    pub(super) quantities: Vec<(Quantity, f64)>,
    source: KnownFrom,
    /// Shifts of the logarithms of the fitted coefficients if the quantities change by one standard deviation.
    pub(super) refit: Vec<f64>,
}

/// Fitted coefficients and the covariance of their logarithms.
#[derive(Debug, Clone)]
pub(super) struct FittedCoefficients {
    pub(super) coefficients: Vec<Parameter>,
    pub(super) covariance: Vec<Vec<f64>>,
}

impl InputUncertainty {
    /// Takes the standard deviations from the configuration, for all parameters that influence the metrics.
    pub(in crate::simulate) fn configured(robot: &ThreeLinkRobot, laws: Laws, gait: &Gait) -> Self {
        let errors = robot.errors(laws, gait).into_iter();
        Self::of_errors(
            errors.map(|shared| {
                shared.into_iter().map(|(of, sd)| (Quantity::Robot(of), sd)).collect()
            }),
        )
    }

    /// Takes the standard deviations of a chain's numbers from the configuration.
    pub(in crate::simulate) fn of_chain(robot: &ChainRobot) -> Self {
        Self::of_errors(
            robot.errors().into_iter().map(|shared| {
                shared.into_iter().map(|(of, sd)| (Quantity::Number(of), sd)).collect()
            }),
        )
    }

    fn of_errors(errors: impl Iterator<Item = Vec<(Quantity, f64)>>) -> Self {
        let independent = errors.map(|quantities| IndependentError {
            quantities,
            source: KnownFrom::Configured,
            refit: Vec::new(),
        });
        Self { independent: independent.collect(), fitted: None }
    }

    /// Takes the uncertainties from a fit: the covariance of its bootstrap replicates, and the standard deviations of
    /// the robot's assumed parameters. `measured` lists coefficients that are known from other kinds of trials.
    pub(in crate::simulate) fn fitted(
        bands: &PredictionBands,
        problem: &Problem,
        measured: &[Parameter],
    ) -> Self {
        let (coefficients, replicates) = bands.replicates();
        let covariance = covariance(replicates, coefficients.len());
        let independent = bands.assumed().filter_map(|(robot, shifts)| {
            let own = bands.robot();
            let changed = changed_quantities(problem, own, robot);
            let is_measured = match changed.first()? {
                Quantity::Robot(first) => measured.contains(first),
                _ => false,
            };
            let source = if is_measured { KnownFrom::Measured } else { KnownFrom::Configured };
            let [before, after] =
                [own, robot].map(|robot| Problem { robot: robot.clone(), ..problem.clone() });
            let quantities = changed.into_iter();
            let quantities = quantities.map(|of| (of, of.value(&after) - of.value(&before)));
            let quantities = quantities.collect();
            Some(IndependentError { quantities, source, refit: shifts.to_vec() })
        });
        Self {
            independent: independent.collect(),
            fitted: Some(FittedCoefficients { coefficients: coefficients.to_vec(), covariance }),
        }
    }

    /// Returns all uncertain quantities of a robot.
    pub(super) fn quantities(&self, robot: &AnyRobot) -> impl Iterator<Item = Quantity> {
        let own = self.independent.iter().flat_map(|of| of.quantities.iter().map(|(of, _)| *of));
        let fitted = self.fitted.iter().flat_map(|of| of.coefficients.iter().copied());
        own.chain(fitted.map(|of| Quantity::of(of, robot)))
    }
}

/// Maximum relative difference that is attributed to rounding.
const ROUNDING: f64 = 1e-9;

/// Returns the quantities in which two robots differ and which affect the problem. Of robots of three links, where several components of a
/// quantity differ (such as the values for each wheel or joint) as a change of their sum or a common change of both
/// joints implies, the parameter that stands for the sum or for both joints is returned.
fn changed_quantities(problem: &Problem, robot: &AnyRobot, other: &AnyRobot) -> Vec<Quantity> {
    let (Some(robot), Some(other)) = (robot.three_links(), other.three_links()) else {
        let (Some(robot), Some(other)) = (robot.as_chain(), other.as_chain()) else {
            return Vec::new();
        };
        let numbers = robot.numbers().into_iter();
        let is_changed = |of: &ChainNumber| robot.number(*of) != other.number(*of);
        return numbers.filter(is_changed).map(Quantity::Number).collect();
    };
    let gait = Gait::from(problem.gait);
    let of_quantity = |quantity: RobotQuantity| {
        let components = (0..quantity.count()).map(|index| quantity.parameter(index));
        let changed: Vec<Parameter> = components
            .filter(|parameter| {
                problem.laws.is_relevant(*parameter, &gait)
                    && parameter.value_in(robot) != parameter.value_in(other)
            })
            .collect();
        let whole = changed.first().and_then(|first| first.whole()).filter(|whole| {
            let mut by_whole = robot.clone();
            whole.set(&mut by_whole, whole.value_in(other));
            let [found, needed] = [&by_whole, other].map(|of| quantity.numbers(of));
            found.iter().zip(needed).all(|(a, b)| (a - b).abs() <= ROUNDING * b.abs())
        });
        match whole {
            Some(whole) if changed.len() > 1 => vec![whole],
            _ => changed,
        }
    };
    RobotQuantity::ALL.into_iter().flat_map(of_quantity).map(Quantity::Robot).collect()
}

/// Returns the sample covariance matrix of the columns of `shifts`.
fn covariance(shifts: &[Vec<f64>], columns: usize) -> Vec<Vec<f64>> {
    let count = shifts.len() as f64;
    let means: Vec<f64> = (0..columns)
        .map(|column| shifts.iter().map(|row| row[column]).sum::<f64>() / count)
        .collect();
    let mut covariance = vec![vec![0.0; columns]; columns];
    for a in 0..columns {
        for b in 0..columns {
            let products = shifts.iter().map(|row| (row[a] - means[a]) * (row[b] - means[b]));
            covariance[a][b] = products.sum::<f64>() / (count - 1.0).max(1.0);
        }
    }
    covariance
}

/// Adds a contribution to the list; contributions with the same name are independent and are combined in quadrature.
fn add_contribution(all: &mut Vec<(String, Contribution)>, name: String, added: Contribution) {
    match all.iter_mut().find(|(known, _)| *known == name) {
        None => all.push((name, added)),
        Some((_, known)) => {
            *known = Contribution {
                deviation: known.deviation.hypot(added.deviation),
                source: added.source,
                contribution: known.contribution.hypot(added.contribution),
                variance_share: known.variance_share + added.variance_share,
            };
        }
    }
}

/// Uncertainty budget of one metric.
pub(super) struct Budget {
    contributions: Vec<(String, Contribution)>,
    /// Standard deviation of the metric; NaN if no uncertainty is known.
    pub deviation: f64,
}

/// Contribution of a quantity to the uncertainty of a metric.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contribution {
    /// Standard deviation of the quantity, in SI units.
    pub deviation: f64,
    pub source: KnownFrom,
    /// Standard deviation of the metric due to the error of this quantity, which it may share with others.
    pub contribution: f64,
    /// Fraction of the metric's variance that is due to this quantity.
    pub variance_share: f64,
}

impl Budget {
    /// Propagates the uncertainties, given the derivatives of the metric with respect to each quantity.
    pub(super) fn new(
        uncertainty: &InputUncertainty,
        problem: &Problem,
        derivative: &dyn Fn(Quantity) -> f64,
    ) -> Self {
        let Problem { robot, .. } = problem;
        let fitted = uncertainty.fitted.as_ref();
        let coefficients = fitted.map_or(&[][..], |fitted| &fitted.coefficients);
        // Derivatives with respect to the coefficients' logarithms.
        let slopes: Vec<f64> = coefficients
            .iter()
            .map(|of| derivative(Quantity::of(*of, robot)) * robot.value(*of))
            .collect();
        let change = |shifts: &[f64]| -> f64 {
            slopes.iter().zip(shifts).map(|(slope, shift)| slope * shift).sum()
        };
        let mut contributions: Vec<(String, Contribution)> = Vec::new();
        for IndependentError { quantities, source, refit } in &uncertainty.independent {
            let direct = quantities.iter().map(|(of, deviation)| derivative(*of) * deviation);
            let change = direct.sum::<f64>() + change(refit);
            for (quantity, deviation) in quantities {
                let contribution = Contribution {
                    deviation: deviation.abs(),
                    source: *source,
                    contribution: change.abs(),
                    variance_share: change.powi(2) / quantities.len() as f64,
                };
                add_contribution(&mut contributions, quantity.name(robot), contribution);
            }
        }
        for (index, coefficient) in coefficients.iter().enumerate() {
            let row = fitted.map_or(&[][..], |fitted| &fitted.covariance[index]);
            let deviation = row[index].sqrt();
            let contribution = Contribution {
                deviation: deviation * robot.value(*coefficient),
                source: KnownFrom::Fitted,
                contribution: (slopes[index] * deviation).abs(),
                variance_share: slopes[index] * change(row),
            };
            let name = Quantity::of(*coefficient, robot).name(robot);
            add_contribution(&mut contributions, name, contribution);
        }
        let variance: f64 = contributions.iter().map(|(_, of)| of.variance_share).sum();
        for (_, contribution) in &mut contributions {
            contribution.variance_share /= variance;
        }
        let deviation = if contributions.is_empty() { f64::NAN } else { variance.sqrt() };
        Self { contributions, deviation }
    }

    /// Returns the contribution of a quantity; `None` if its uncertainty is not known.
    pub(super) fn contribution(&self, name: &str) -> Option<&Contribution> {
        self.contributions.iter().find(|(known, _)| known == name).map(|(_, of)| of)
    }
}
