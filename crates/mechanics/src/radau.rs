//! Radau IIA collocation rule: stiffly accurate, L-stable, order `2 STAGES - 1`.
//!
//! Reference: E. Hairer and G. Wanner, *Solving Ordinary Differential Equations II*, 2nd ed.,
//! Springer 1996, section IV.5.

use std::sync::LazyLock;

use nalgebra::SMatrix;

/// Number of collocation stages of each element (time step).
pub(crate) const STAGES: usize = 5;

/// Collocation nodes on `[0, 1]`: zeros of `P_s(2x - 1) - P_{s-1}(2x - 1)`, where `P_n` is the Legendre
/// polynomial of degree n and `s` is [`STAGES`].
const NODES: [f64; STAGES] =
    [0.0571041961145177, 0.2768430136381238, 0.5835904323689167, 0.8602401356562195, 1.0];

/// Coefficients of the Radau IIA collocation rule on the element `[0, 1]`.
#[derive(Debug, Clone)]
pub(crate) struct Radau {
    /// Positions of the stages in the element `[0, 1]`; the last is 1.
    pub nodes: [f64; STAGES],
    /// `differentiate[j][l]`: weight of the value at stage `l` in the derivative at stage `j`.
    pub differentiate: [[f64; STAGES]; STAGES],
    /// `differentiate_start[j]`: weight of the value at the element's start in the derivative at stage `j`.
    pub differentiate_start: [f64; STAGES],
    /// `integrate[j][l]`: weight of the derivative at stage `l` in the increment from the element's start to
    /// stage `j`; the last row is the quadrature rule of the whole element.
    pub integrate: [[f64; STAGES]; STAGES],
    /// Weights of the values at the start and at the stages in the Legendre coefficients of the element's
    /// polynomial: one row for each of the degrees `STAGES - 2` to `STAGES`.
    pub spectrum: [[f64; STAGES + 1]; 3],
    /// Barycentric weights of the points that the element's polynomial interpolates: the start, then the
    /// stages.
    pub barycentric: [f64; STAGES + 1],
}

/// Coefficients of the Radau IIA collocation rule, computed on first use.
pub(crate) static RADAU: LazyLock<Radau> = LazyLock::new(Radau::compute);

impl Radau {
    fn compute() -> Self {
        let nodes = NODES;
        let mut points = [0.0; STAGES + 1];
        points[1..].copy_from_slice(&nodes);
        let barycentric: [f64; STAGES + 1] = std::array::from_fn(|j| {
            let others = points.iter().enumerate().filter(|(l, _)| *l != j);
            1.0 / others.map(|(_, point)| points[j] - point).product::<f64>()
        });
        // Derivatives of the Lagrange polynomials at the points.
        let slope = |j: usize, l: usize| barycentric[l] / barycentric[j] / (points[j] - points[l]);
        let mut differentiate = [[0.0; STAGES]; STAGES];
        let mut differentiate_start = [0.0; STAGES];
        for j in 0..STAGES {
            differentiate_start[j] = slope(j + 1, 0);
            for l in (0..STAGES).filter(|l| *l != j) {
                differentiate[j][l] = slope(j + 1, l + 1);
            }
            differentiate[j][j] = -differentiate_start[j] - differentiate[j].iter().sum::<f64>();
        }
        let matrix = SMatrix::<f64, STAGES, STAGES>::from_fn(|j, l| differentiate[j][l]);
        let inverse =
            matrix.try_inverse().expect("the collocation matrix of distinct points is invertible");
        let integrate = std::array::from_fn(|j| std::array::from_fn(|l| inverse[(j, l)]));
        let legendre = SMatrix::<f64, { STAGES + 1 }, { STAGES + 1 }>::from_fn(|l, degree| {
            legendre(degree, 2.0 * points[l] - 1.0)
        });
        let inverse = legendre
            .try_inverse()
            .expect("the interpolation matrix of distinct points is invertible");
        let spectrum =
            std::array::from_fn(|k| std::array::from_fn(|l| inverse[(STAGES - 2 + k, l)]));
        Self { nodes, differentiate, differentiate_start, integrate, spectrum, barycentric }
    }

    /// Evaluates at `x` the polynomial that has the given `values` at the start of the element `[0, 1]` and
    /// at its stages.
    pub(crate) fn interpolate(&self, values: &[f64; STAGES + 1], x: f64) -> f64 {
        self.weights(x).iter().zip(values).map(|(weight, value)| weight * value).sum()
    }

    /// Returns the weights by which the values at the start and at the stages contribute to the value of the
    /// element's polynomial at the point `x`.
    pub(crate) fn weights(&self, x: f64) -> [f64; STAGES + 1] {
        let mut weights = [0.0; STAGES + 1];
        for (l, weight) in weights.iter_mut().enumerate() {
            let point = if l == 0 { 0.0 } else { self.nodes[l - 1] };
            if x == point {
                return std::array::from_fn(|other| if other == l { 1.0 } else { 0.0 });
            }
            *weight = self.barycentric[l] / (x - point);
        }
        let sum: f64 = weights.iter().sum();
        weights.map(|weight| weight / sum)
    }
}

/// Evaluates the Legendre polynomial of the given degree at `t`.
fn legendre(degree: usize, t: f64) -> f64 {
    let mut before = 0.0;
    let mut value = 1.0;
    for k in 1..=degree {
        let k = k as f64;
        let next = ((2.0 * k - 1.0) * t * value - (k - 1.0) * before) / k;
        before = value;
        value = next;
    }
    value
}

/// Returns the root of `function` by `steps` bisections of an interval at whose ends the function has
/// opposite signs.
pub(crate) fn bisect(
    function: impl Fn(f64) -> f64,
    mut low: f64,
    mut high: f64,
    steps: usize,
) -> f64 {
    let rises = function(high) > 0.0;
    for _ in 0..steps {
        let middle = 0.5 * (low + high);
        if (function(middle) > 0.0) == rises {
            high = middle;
        } else {
            low = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nodes_are_zeros_of_the_difference_of_legendre_polynomials() {
        let difference = |x: f64| {
            let t = 2.0 * x - 1.0;
            legendre(STAGES, t) - legendre(STAGES - 1, t)
        };
        for node in RADAU.nodes {
            assert!(difference(node).abs() < 1e-14, "{node}");
        }
        for node in &RADAU.nodes[..STAGES - 1] {
            let sides = [-1e-15, 1e-15].map(|aside| difference(node + aside));
            assert!(sides[0] * sides[1] < 0.0, "{node}: {sides:?}");
        }
    }

    #[test]
    fn polynomials_of_the_rules_order_are_integrated_exactly() {
        for power in 0..2 * STAGES as i32 - 1 {
            let weights = RADAU.integrate[STAGES - 1];
            let sum: f64 = RADAU.nodes.iter().zip(weights).map(|(x, w)| w * x.powi(power)).sum();
            assert!((sum - 1.0 / f64::from(power + 1)).abs() < 1e-14, "power {power}: {sum}");
        }
    }

    #[test]
    fn the_spectrum_is_of_legendre_coefficients() {
        for (k, weights) in RADAU.spectrum.iter().enumerate() {
            for degree in 0..=STAGES {
                let at_nodes = RADAU.nodes.map(|x| legendre(degree, 2.0 * x - 1.0));
                let at_start = legendre(degree, -1.0);
                let stages: f64 = weights[1..].iter().zip(at_nodes).map(|(w, p)| w * p).sum();
                let known = if degree == STAGES - 2 + k { 1.0 } else { 0.0 };
                assert!((weights[0] * at_start + stages - known).abs() < 1e-13);
            }
        }
    }
}
