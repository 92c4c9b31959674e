//! Numbers that follow from the paper's own parameters.

use std::collections::BTreeSet;

use serde::Deserialize;

use super::mechanics::Mechanics;
use super::moments::{self, Grown};
use super::paper::Paper;
use super::parameters::Tables;
use super::sweep::{self, Curves, Quantity};
use crate::motion::Solver;

/// A number, and what is to be said of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// NaN where there is none: no such motion, no optimum.
    pub value: f64,
    /// 95 % confidence limits of a fitted value; NaN where the interval is open.
    pub limits: Option<[f64; 2]>,
    pub note: String,
}

impl Found {
    pub fn new(value: f64) -> Self {
        Self { value, limits: None, note: String::new() }
    }

    pub fn with_note(value: f64, note: &str) -> Self {
        Self { note: note.to_owned(), ..Self::new(value) }
    }
}

/// How a number is computed. Motions are those of the data file; those without a frequency are
/// swept over the paper's.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Computed {
    Mechanics(Mechanics),
    Tables(Tables),
    At {
        motion: String,
        omega_rad_s: f64,
        quantity: Quantity,
    },
    /// One motion's over another's.
    Ratio {
        motion: String,
        over: String,
        omega_rad_s: f64,
        quantity: Quantity,
    },
    /// One motion's less another's.
    Excess {
        motion: String,
        over: String,
        omega_rad_s: f64,
        quantity: Quantity,
    },
    /// Deviation of the displacement from a printed one over the largest of others.
    DeviationRatio {
        motion: String,
        over: Vec<String>,
        omega_rad_s: f64,
        from_mm: f64,
    },
    /// Largest deviation of the displacements of motions from printed ones, per cent.
    LargestDeviation {
        motions: Vec<String>,
        omega_rad_s: f64,
        from_mm: Vec<f64>,
    },
    /// How many of these motions there are.
    Existing {
        motions: Vec<String>,
        omega_rad_s: f64,
    },
    Growth {
        motion: String,
        omega_rad_s: f64,
        of: Grown,
    },
    Crossings {
        motion: String,
        omega_rad_s: f64,
    },
    CrossingRates {
        motion: String,
        omega_rad_s: f64,
    },
    Lag {
        motion: String,
        omega_rad_s: f64,
    },
    /// How far the phase between the joints is from a third motion's, less how far another's is,
    /// degrees.
    LagExcess {
        motion: String,
        over: String,
        from: String,
        omega_rad_s: f64,
    },
    EnergyGap {
        motion: String,
        omega_rad_s: f64,
    },
    Coefficients {
        motion: String,
        omega_rad_s: f64,
    },
    /// Frequency of the largest value.
    Optimum {
        motion: String,
        quantity: Quantity,
    },
    OptimaApart {
        motion: String,
        quantities: [Quantity; 2],
    },
    /// Of the values over their mean, per cent.
    Spread {
        motion: String,
        quantity: Quantity,
    },
    Largest {
        motion: String,
        quantity: Quantity,
    },
    RatioOfMeans {
        motion: String,
        over: String,
        quantities: Vec<Quantity>,
    },
    LeastRatio {
        motion: String,
        over: String,
        quantity: Quantity,
    },
    /// Mean difference of two motions from 4 to 6 rad/s over that from 0.5 to 2.
    EffectHighOverLow {
        motion: String,
        over: String,
        quantity: Quantity,
    },
}

/// Stands beside an optimum at an end of the sweep.
pub const AT_THE_END: &str = "No maximum between the ends: largest at this one.";

impl Computed {
    /// Every motion that is named.
    pub fn motions(&self) -> Vec<&str> {
        match self {
            Self::Mechanics(_) | Self::Tables(_) => Vec::new(),
            Self::At { motion, .. }
            | Self::Growth { motion, .. }
            | Self::Crossings { motion, .. }
            | Self::CrossingRates { motion, .. }
            | Self::Lag { motion, .. }
            | Self::EnergyGap { motion, .. }
            | Self::Coefficients { motion, .. }
            | Self::Optimum { motion, .. }
            | Self::OptimaApart { motion, .. }
            | Self::Spread { motion, .. }
            | Self::Largest { motion, .. } => vec![motion],
            Self::Ratio { motion, over, .. }
            | Self::Excess { motion, over, .. }
            | Self::RatioOfMeans { motion, over, .. }
            | Self::LeastRatio { motion, over, .. }
            | Self::EffectHighOverLow { motion, over, .. } => vec![motion, over],
            Self::LagExcess { motion, over, from, .. } => vec![motion, over, from],
            Self::DeviationRatio { motion, over, .. } => {
                [motion].into_iter().chain(over).map(String::as_str).collect()
            }
            Self::Existing { motions, .. } | Self::LargestDeviation { motions, .. } => {
                motions.iter().map(String::as_str).collect()
            }
        }
    }

    /// Motions that are swept.
    pub fn swept(&self) -> BTreeSet<&str> {
        match self {
            Self::Optimum { .. }
            | Self::OptimaApart { .. }
            | Self::Spread { .. }
            | Self::Largest { .. }
            | Self::RatioOfMeans { .. }
            | Self::LeastRatio { .. }
            | Self::EffectHighOverLow { .. } => self.motions().into_iter().collect(),
            _ => BTreeSet::new(),
        }
    }

    /// The number; NaN where there is no such motion.
    pub fn find(&self, paper: &Paper<'_>, curves: &Curves) -> Found {
        self.try_find(paper, curves)
            .unwrap_or_else(|| Found::with_note(f64::NAN, "There is no such motion."))
    }

    fn try_find(&self, paper: &Paper<'_>, curves: &Curves) -> Option<Found> {
        let at = |motion: &str, omega_rad_s: f64, quantity: Quantity| {
            let point = sweep::solve(paper, &mut Solver::default(), motion, omega_rad_s)?;
            Some(point.get(quantity))
        };
        let curve = |motion: &str| curves.get(motion).filter(|curve| !curve.is_empty());
        let value = match self {
            Self::Mechanics(mechanics) => mechanics.value(),
            Self::Tables(tables) => tables.value(paper)?,
            Self::At { motion, omega_rad_s, quantity } => at(motion, *omega_rad_s, *quantity)?,
            Self::Ratio { motion, over, omega_rad_s, quantity } => {
                at(motion, *omega_rad_s, *quantity)? / at(over, *omega_rad_s, *quantity)?
            }
            Self::Excess { motion, over, omega_rad_s, quantity } => {
                at(motion, *omega_rad_s, *quantity)? - at(over, *omega_rad_s, *quantity)?
            }
            Self::DeviationRatio { motion, over, omega_rad_s, from_mm } => {
                let off = |motion: &String| {
                    Some((at(motion, *omega_rad_s, Quantity::DMm)? - from_mm).abs())
                };
                let others = over.iter().map(off).collect::<Option<Vec<f64>>>()?;
                off(motion)? / others.into_iter().fold(0.0, f64::max)
            }
            Self::LargestDeviation { motions, omega_rad_s, from_mm } => {
                let off = |(motion, from): (&String, &f64)| {
                    Some((at(motion, *omega_rad_s, Quantity::DMm)? / from - 1.0).abs())
                };
                let off = motions.iter().zip(from_mm).map(off).collect::<Option<Vec<f64>>>()?;
                100.0 * off.into_iter().fold(f64::NAN, f64::max)
            }
            Self::Existing { motions, omega_rad_s } => {
                let exists = |motion: &&String| {
                    sweep::solve(paper, &mut Solver::default(), motion, *omega_rad_s).is_some()
                };
                motions.iter().filter(exists).count() as f64
            }
            Self::Growth { motion, omega_rad_s, of } => {
                moments::growth(paper, motion, *omega_rad_s, *of)?
            }
            Self::Crossings { motion, omega_rad_s } => {
                moments::count_crossings(paper, motion, *omega_rad_s)?
            }
            Self::CrossingRates { motion, omega_rad_s } => {
                moments::crossing_rates(paper, motion, *omega_rad_s)?
            }
            Self::Lag { motion, omega_rad_s } => {
                moments::lag_deg(paper, motion, *omega_rad_s)?.abs()
            }
            Self::LagExcess { motion, over, from, omega_rad_s } => {
                let from = moments::lag_deg(paper, from, *omega_rad_s)?;
                lag_excess(paper, [motion, over], *omega_rad_s, from)?
            }
            Self::EnergyGap { motion, omega_rad_s } => {
                moments::energy_gap(paper, motion, *omega_rad_s)?
            }
            Self::Coefficients { motion, omega_rad_s } => {
                moments::coefficients(paper, motion, *omega_rad_s)?
            }
            Self::Optimum { motion, quantity } => {
                return Some(optimum(sweep::optimum(curve(motion)?, *quantity)?));
            }
            Self::OptimaApart { motion, quantities } => {
                let curve = curve(motion)?;
                let [a, b] = quantities.map(|quantity| sweep::optimum(curve, quantity));
                return Some(optima_apart(a?, b?));
            }
            Self::Spread { motion, quantity } => sweep::spread_percent(curve(motion)?, *quantity),
            Self::Largest { motion, quantity } => sweep::largest(curve(motion)?, *quantity),
            Self::RatioOfMeans { motion, over, quantities } => {
                sweep::ratio_of_means(curve(motion)?, curve(over)?, quantities)
            }
            Self::LeastRatio { motion, over, quantity } => {
                sweep::least_ratio(curve(motion)?, curve(over)?, *quantity)
            }
            Self::EffectHighOverLow { motion, over, quantity } => {
                sweep::effect_high_over_low(curve(motion)?, curve(over)?, *quantity)
            }
        };
        Some(Found::new(value))
    }
}

/// The frequency of an optimum, with a note where it is at an end.
pub fn optimum(optimum: sweep::Optimum) -> Found {
    Found::with_note(optimum.omega_rad_s, if optimum.is_inside { "" } else { AT_THE_END })
}

/// The distance of two optima; NaN where one is none.
pub fn optima_apart(a: sweep::Optimum, b: sweep::Optimum) -> Found {
    if a.is_inside && b.is_inside {
        return Found::new((a.omega_rad_s - b.omega_rad_s).abs());
    }
    Found::with_note(f64::NAN, "One of them has no maximum between the ends of the sweep.")
}

/// How far one motion's phase between the joints is from a phase, less how far another's is,
/// degrees.
pub fn lag_excess(
    paper: &Paper<'_>,
    motions: [&str; 2],
    omega_rad_s: f64,
    from_deg: f64,
) -> Option<f64> {
    let [a, b] = motions.map(|motion| moments::lag_deg(paper, motion, omega_rad_s));
    let off = |lag: f64| moments::wrapped_deg((lag - from_deg).to_radians()).abs();
    Some(off(a?) - off(b?))
}
