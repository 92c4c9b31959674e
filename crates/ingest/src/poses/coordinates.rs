//! The robot's configuration over time.

use std::ops::RangeInclusive;

/// The robot's five coordinates over time; NaN where missing.
#[derive(Debug, Clone)]
pub(crate) struct Coordinates {
    /// Link 0's wheel axle, m.
    pub x_m: Vec<f64>,
    pub y_m: Vec<f64>,
    /// Heading of link 0, without jumps, rad.
    pub theta_rad: Vec<f64>,
    /// Joint angles phi1 and phi2, rad.
    pub phi_rad: [Vec<f64>; 2],
}

impl Coordinates {
    /// The same for each of the five series.
    pub(crate) fn map(&self, change: impl Fn(&[f64]) -> Vec<f64>) -> Self {
        Self {
            x_m: change(&self.x_m),
            y_m: change(&self.y_m),
            theta_rad: change(&self.theta_rad),
            phi_rad: [change(&self.phi_rad[0]), change(&self.phi_rad[1])],
        }
    }

    /// Number of frames.
    pub(crate) fn len(&self) -> usize {
        self.x_m.len()
    }

    /// Makes these frames missing.
    pub(crate) fn leave_out(&mut self, frames: RangeInclusive<usize>) {
        let Self { x_m, y_m, theta_rad, phi_rad: [phi1_rad, phi2_rad] } = self;
        for series in [x_m, y_m, theta_rad, phi1_rad, phi2_rad] {
            series[frames.clone()].fill(f64::NAN);
        }
    }
}
