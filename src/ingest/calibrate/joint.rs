//! The axis about which two rigid bodies turn: the point that is at rest in both.

use nalgebra::{Matrix4, Vector4};

use super::shape::Body;

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
    /// R_b p_b` is linear in the two places. `None` if the bodies do not turn against each other.
    pub fn between(first: &Body, second: &Body, is_used: &dyn Fn(usize) -> bool) -> Option<Self> {
        let (mut normal, mut right) = (Matrix4::<f64>::zeros(), Vector4::<f64>::zeros());
        let (mut count, mut squares) = (0.0, 0.0);
        for (row, [(a, ca, sa), (b, cb, sb)]) in rows(first, second) {
            if !is_used(row) {
                continue;
            }
            let apart = [b[0] - a[0], b[1] - a[1]];
            let equations = [
                (Vector4::new(ca, -sa, -cb, sb), apart[0]),
                (Vector4::new(sa, ca, -sb, -cb), apart[1]),
            ];
            for (row, value) in equations {
                normal.ger(1.0, &row, &row, 1.0);
                right.axpy(value, &row, 1.0);
                squares += value * value;
            }
            count += 1.0;
        }
        let places = normal.cholesky()?.solve(&right);
        let left = (squares - places.dot(&right)).max(0.0);
        Some(Self {
            in_first: [places[0], places[1]],
            in_second: [places[2], places[3]],
            residual_mm: (left / count).sqrt(),
        })
    }
}

type Placed = ([f64; 2], f64, f64);

/// The rows in which both bodies have a pose, with origin, cosine and sine of each.
fn rows<'b>(first: &'b Body, second: &'b Body) -> impl Iterator<Item = (usize, [Placed; 2])> + 'b {
    first.fits.iter().zip(&second.fits).enumerate().filter_map(|(row, (a, b))| {
        let placed = |fit: &crate::ingest::markers::labels::LinkFit| {
            let pose = fit.pose?;
            let (sin, cos) = pose.theta_rad.sin_cos();
            Some((pose.origin_mm, cos, sin))
        };
        Some((row, [placed(a)?, placed(b)?]))
    })
}
