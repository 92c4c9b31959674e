//! Robots that may be the true one as well as that of a fit.

use trilink_robot::Robot;

use super::intervals::Widths;

/// Robots with the coefficients of refits; what differs between them is how far what follows from the
/// fit may be off.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Alternatives {
    /// Of the bootstrap's replicates.
    pub replicates: Vec<Robot>,
    /// Of the fits without each block of frequencies.
    pub blocks: Vec<Robot>,
    /// With each assumption off by its standard deviation.
    pub assumed: Vec<Robot>,
    /// Of the fit to the measured gait, where the command drives the model.
    pub gait: Option<Robot>,
}

impl Alternatives {
    /// All of them, the replicates first.
    pub fn all(&self) -> impl Iterator<Item = &Robot> {
        self.replicates.iter().chain(&self.blocks).chain(&self.assumed).chain(&self.gait)
    }

    /// 95 % limits of a number that is `fitted` by the fit and `found` by each of all; those that are
    /// missing do not count. NaN without a replicate.
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
            Widths::of_changes(replicates, &changes(blocks), &changes(assumed), by_gait).total;
        [fitted - below, fitted + above]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_have_the_scatter_and_what_is_systematic() {
        let robot = Robot::kinematic();
        let alternatives = Alternatives {
            replicates: vec![robot.clone(); 41],
            blocks: Vec::new(),
            assumed: vec![robot.clone()],
            gait: Some(robot),
        };
        assert_eq!(alternatives.all().count(), 43);
        // From -1 to 1, of which 95 % are from -0.95 to 0.95.
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
