//! Robots that are consistent with the measurements, besides the fitted one.

use trilink_robot::AnyRobot;

use super::intervals::Widths;

/// Copies of a robot with coefficients from refits; the scatter among them gives the uncertainty of any
/// quantity computed from the fit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Alternatives {
    /// Robots with the coefficients of the bootstrap replicates.
    pub replicates: Vec<AnyRobot>,
    /// Robots with the coefficients of the fits that each leave out one block of frequencies.
    pub blocks: Vec<AnyRobot>,
    /// Robots, each with one uncertain parameter increased by its standard deviation and the coefficients refitted.
    pub assumed: Vec<AnyRobot>,
    /// Robot with the coefficients of a refit in which the measured gait, instead of the commanded one, drives the
    /// model; `None` if the measured gait drives the original fit as well, or if there is no such refit.
    pub gait: Option<AnyRobot>,
}

impl Alternatives {
    /// Returns all robots, the replicates first.
    pub fn all(&self) -> impl Iterator<Item = &AnyRobot> {
        self.replicates.iter().chain(&self.blocks).chain(&self.assumed).chain(&self.gait)
    }

    /// Returns the 95 % confidence limits of a quantity, given its value `fitted` for the fitted robot and its values
    /// `found` for the robots of [`Self::all`], in the same order; values that are not finite are left out. Both limits
    /// are NaN if there is no replicate.
    pub fn limits(&self, fitted: f64, found: &[f64]) -> [f64; 2] {
        let (replicates, rest) = found.split_at(self.replicates.len());
        let (blocks, rest) = rest.split_at(self.blocks.len());
        let (assumed, gait) = rest.split_at(self.assumed.len());
        let changes = |of: &[f64]| -> Vec<f64> {
            of.iter().map(|value| value - fitted).filter(|change| change.is_finite()).collect()
        };
        let replicates = changes(replicates);
        if replicates.is_empty() {
            return [f64::NAN; 2];
        }
        let by_gait = changes(gait).first().copied().unwrap_or(0.0);
        let [below, above] =
            Widths::from_changes(replicates, &changes(blocks), &changes(assumed), by_gait).total;
        [fitted - below, fitted + above]
    }
}

#[cfg(test)]
mod tests {
    use trilink_robot::Robot;

    use super::*;

    #[test]
    fn limits_combine_the_scatter_and_the_systematic_shifts() {
        let robot = AnyRobot::from(Robot::kinematic());
        let alternatives = Alternatives {
            replicates: vec![robot.clone(); 41],
            blocks: Vec::new(),
            assumed: vec![robot.clone()],
            gait: Some(robot),
        };
        assert_eq!(alternatives.all().count(), 43);
        // Uniform from -1 to 1: 95 % of the values lie between -0.95 and 0.95.
        let scatter = (0..41).map(|nth| 7.0 + f64::from(nth - 20) / 20.0);
        let found: Vec<f64> = scatter.chain([7.0, 7.0]).collect();
        let [low, high] = alternatives.limits(7.0, &found);
        assert!((low - 6.05).abs() < 1e-12 && (high - 7.95).abs() < 1e-12, "{low} {high}");
        let mut systematic = found.clone();
        (systematic[3], systematic[41], systematic[42]) = (f64::NAN, 7.5, 7.25);
        let [low, high] = alternatives.limits(7.0, &systematic);
        let common = 1.959964 * 0.5;
        assert!((low - (7.0 - 0.95_f64.hypot(common))).abs() < 0.03, "{low}");
        assert!((high - (7.25 + 0.95_f64.hypot(common))).abs() < 0.03, "{high}");
        let none = Alternatives::default().limits(7.0, &[]);
        assert!(none.iter().all(|limit| limit.is_nan()));
    }
}
