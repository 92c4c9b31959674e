//! The axis about which two rigid bodies turn: symmetrical centre of rotation estimation (SCoRE,
//! Ehrig and others 2006), in the plane.

use nalgebra::Vector4;

use super::shape::Body;
use crate::stats::NormalEquations;

/// Where a joint is in the frames of the two bodies that it joins, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Joint {
    pub in_first: [f64; 2],
    pub in_second: [f64; 2],
    /// RMS distance of the two over the rows, mm.
    pub residual_mm: f64,
}

impl Joint {
    /// Least squares over the rows in which both bodies have a pose: `o_a + R_a p_a = o_b +
    /// R_b p_b` is linear in the two positions. `None` if the bodies do not turn against each
    /// other.
    pub fn between(first: &Body, second: &Body, is_used: &dyn Fn(usize) -> bool) -> Option<Self> {
        let mut equations = NormalEquations::new();
        for (row, fits) in first.fits.iter().zip(&second.fits).enumerate() {
            let (Some(a), Some(b)) = (fits.0.pose, fits.1.pose) else { continue };
            if !is_used(row) {
                continue;
            }
            let ((sa, ca), (sb, cb)) = (a.theta_rad.sin_cos(), b.theta_rad.sin_cos());
            let [x, y] = [0, 1].map(|axis| b.origin_mm[axis] - a.origin_mm[axis]);
            equations.add(&Vector4::new(ca, -sa, -cb, sb), x);
            equations.add(&Vector4::new(sa, ca, -sb, -cb), y);
        }
        let (positions, _) = equations.solve()?;
        // Two equations for each row.
        let mean_square = equations.residual_squares(&positions) / (0.5 * equations.count);
        Some(Self {
            in_first: [positions[0], positions[1]],
            in_second: [positions[2], positions[3]],
            residual_mm: mean_square.sqrt(),
        })
    }
}
