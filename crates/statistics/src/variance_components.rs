//! Variance components of a linear mixed model by restricted maximum likelihood (REML).
//!
//! The model is `y = X beta + sum_i Z_i u_i + e`, where the elements of `u_i` are independent with the unknown variance
//! `theta_i >= 0` and `e` has a known covariance. The observations are given in blocks without random effects in common.
//! REML estimates the variances from those combinations of the observations that do not depend on `beta`, so that
//! variances from few observations are not biased. Maximisation is by Fisher scoring; a variance whose estimate would
//! be negative is set to zero.
//!
//! The variance of an estimate that depends on several components has the degrees of freedom of Satterthwaite's
//! approximation, [`VarianceComponents::degrees_of_freedom`].
//!
//! References: H. D. Patterson and R. Thompson, *Recovery of inter-block information when block sizes are unequal*,
//! Biometrika 58 (1971) 545; S. R. Searle, G. Casella and C. E. McCulloch, *Variance Components*, Wiley 1992, chapter
//! 6; F. G. Giesbrecht and J. C. Burns, *Two-stage analysis based on a mixed model*, Biometrics 41 (1985) 477.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

/// Maximum number of Fisher scoring steps.
const MAX_STEPS: usize = 40;
/// Maximum number of times that a step is halved because it would decrease the likelihood.
const MAX_HALVINGS: usize = 8;
/// Increase in the logarithm of the likelihood below which the search has converged.
const LIKELIHOOD_TOLERANCE: f64 = 1e-6;
/// Ratio to the largest eigenvalue below which an eigenvalue of a symmetric matrix counts as zero.
const RANK_TOLERANCE: f64 = 1e-10;
/// Maximum number of iterations for each eigenvalue of a matrix, as in LAPACK's `dsteqr`.
const MAX_EIGENVALUE_ITERATIONS: usize = 30;

/// Fraction of the information on a variance that must remain after the fixed effects for it to count as determined.
const IDENTIFIED: f64 = 1e-6;

/// Random effects of one component on consecutive observations of a block, independent of all other random effects.
#[derive(Debug, Clone)]
pub struct RandomEffects {
    /// Index of the first affected observation within the block.
    pub first: usize,
    /// Effects of unit size on the affected observations (rows); one column for each random effect.
    pub effects: DMatrix<f64>,
}

impl RandomEffects {
    /// Adds `variance` times the covariance of the observations due to effects of unit variance.
    fn add_covariance(&self, variance: f64, covariance: &mut DMatrix<f64>) {
        let count = self.effects.nrows();
        let mut own = covariance.view_mut((self.first, self.first), (count, count));
        own.gemm(variance, &self.effects, &self.effects.transpose(), 1.0);
    }

    /// Adds the product of a symmetric matrix and the covariance for unit variance to `product`.
    fn add_product(&self, matrix: &DMatrix<f64>, product: &mut DMatrix<f64>) {
        let count = self.effects.nrows();
        let by_effect = matrix.columns(self.first, count) * &self.effects;
        let mut own = product.columns_mut(self.first, count);
        own.gemm(1.0, &by_effect, &self.effects.transpose(), 1.0);
    }
}

/// Observations that share random effects with each other, but not with the observations of other blocks.
#[derive(Debug, Clone)]
pub struct Block {
    pub observations: DVector<f64>,
    /// Coefficients of the fixed effects `beta` (columns, the same in all blocks) for each observation (row).
    pub design: DMatrix<f64>,
    /// Known part of the covariance, which must be positive definite.
    pub known_covariance: DMatrix<f64>,
    /// Random effects of each variance component, in the order of the components.
    pub random_effects: Vec<Vec<RandomEffects>>,
}

/// Estimated variance components.
#[derive(Debug, Clone, PartialEq)]
pub struct VarianceComponents {
    /// Estimated variances `theta_i`.
    pub variances: Vec<f64>,
    /// Asymptotic covariance of the estimated variances.
    pub covariance: DMatrix<f64>,
    /// Whether the observations determine each variance. A variance that they do not determine, because the fixed
    /// effects absorb its random effects, is zero.
    pub is_identified: Vec<bool>,
}

impl VarianceComponents {
    /// Estimates the variances of all components; `None` if there are no blocks, a known covariance is not positive
    /// definite, or a number is not finite.
    pub fn estimate(blocks: &[Block]) -> Option<Self> {
        let count = blocks.first()?.random_effects.len();
        let mut variances = starting_variances(blocks, count)?;
        let mut at = Likelihood::new(blocks, &variances)?;
        let is_identified: Vec<bool> =
            (0..count).map(|i| at.information[(i, i)] > IDENTIFIED * at.unprojected[i]).collect();
        for (variance, is_identified) in variances.iter_mut().zip(&is_identified) {
            if !is_identified {
                *variance = 0.0;
            }
        }
        at = Likelihood::new(blocks, &variances)?;
        for _ in 0..MAX_STEPS {
            let step = at.step(&variances, &is_identified)?;
            let mut fraction = 1.0;
            let mut next = None;
            for _ in 0..MAX_HALVINGS {
                let moved: Vec<f64> = variances
                    .iter()
                    .zip(&step)
                    .map(|(v, step)| (v + fraction * step).max(0.0))
                    .collect();
                let there = Likelihood::new(blocks, &moved);
                if let Some(there) = there.filter(|there| there.logarithm >= at.logarithm) {
                    next = Some((moved, there));
                    break;
                }
                fraction *= 0.5;
            }
            let Some((moved, there)) = next else { break };
            let gain = there.logarithm - at.logarithm;
            (variances, at) = (moved, there);
            if gain < LIKELIHOOD_TOLERANCE {
                break;
            }
        }
        let free: Vec<usize> = (0..count).filter(|i| is_identified[*i]).collect();
        let of_free = pseudo_inverse(&at.information.select_rows(&free).select_columns(&free))?;
        let mut covariance = DMatrix::zeros(count, count);
        for (row, i) in free.iter().enumerate() {
            for (column, j) in free.iter().enumerate() {
                covariance[(*i, *j)] = of_free[(row, column)];
            }
        }
        Some(Self { variances, covariance, is_identified })
    }

    /// Returns the degrees of freedom of the variance `known + sum_i weights_i theta_i` of an estimate; infinite if the
    /// variances do not contribute to it. `known_freedom` is the number of degrees of freedom of `known`.
    pub fn degrees_of_freedom(&self, weights: &[f64], known: f64, known_freedom: f64) -> f64 {
        let weights = DVector::from_column_slice(weights);
        let variance = known + weights.dot(&DVector::from_column_slice(&self.variances));
        let uncertainty =
            (&self.covariance * &weights).dot(&weights) + 2.0 * known.powi(2) / known_freedom;
        if uncertainty > 0.0 { 2.0 * variance.powi(2) / uncertainty } else { f64::INFINITY }
    }
}

/// Returns variances that each explain an equal part of the observations' deviations from the fixed effects.
fn starting_variances(blocks: &[Block], count: usize) -> Option<Vec<f64>> {
    let fixed = blocks[0].design.ncols();
    let mut normal = DMatrix::zeros(fixed, fixed);
    let mut right = DVector::zeros(fixed);
    for block in blocks {
        normal += block.design.tr_mul(&block.design);
        right += block.design.tr_mul(&block.observations);
    }
    let beta = pseudo_inverse(&normal)? * right;
    let squares: f64 =
        blocks.iter().map(|of| (&of.observations - &of.design * &beta).norm_squared()).sum();
    let shares = (0..count).map(|component| {
        let effects = blocks.iter().flat_map(|block| &block.random_effects[component]);
        let size: f64 = effects.map(|of| of.effects.norm_squared()).sum();
        if size > 0.0 { squares / size / count as f64 } else { 0.0 }
    });
    Some(shares.collect())
}

/// Restricted likelihood with its derivatives with respect to the variances.
struct Likelihood {
    logarithm: f64,
    score: DVector<f64>,
    /// Expected information.
    information: DMatrix<f64>,
    /// Expected information on each variance if there were no fixed effects.
    unprojected: DVector<f64>,
}

impl Likelihood {
    fn new(blocks: &[Block], variances: &[f64]) -> Option<Self> {
        let count = variances.len();
        let fixed = blocks[0].design.ncols();
        let mut log_determinant = 0.0;
        let mut normal = DMatrix::zeros(fixed, fixed);
        let mut right = DVector::zeros(fixed);
        let mut inverses = Vec::with_capacity(blocks.len());
        for block in blocks {
            let mut covariance = block.known_covariance.clone();
            for (effects, variance) in block.random_effects.iter().zip(variances) {
                effects.iter().for_each(|of| of.add_covariance(*variance, &mut covariance));
            }
            let factor = Cholesky::new(covariance)?;
            log_determinant +=
                2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
            let inverse = factor.inverse();
            let weighted = &inverse * &block.design;
            normal += block.design.tr_mul(&weighted);
            right += weighted.tr_mul(&block.observations);
            inverses.push((inverse, weighted));
        }
        let (normal_inverse, normal_log_determinant) = inverse_and_log_determinant(&normal)?;
        let beta = &normal_inverse * right;
        let mut squares = 0.0;
        let mut score = DVector::zeros(count);
        let mut information = DMatrix::zeros(count, count);
        let mut unprojected = DVector::zeros(count);
        let mut by_fixed = vec![DMatrix::zeros(fixed, fixed); count];
        for (block, (inverse, weighted)) in blocks.iter().zip(&inverses) {
            let deviations = &block.observations - &block.design * &beta;
            let standardised = inverse * &deviations;
            squares += deviations.dot(&standardised);
            let projected = weighted * &normal_inverse * weighted.transpose();
            let size = deviations.len();
            // Products of the inverse covariance, and of its part due to the fixed effects, with the covariance of
            // each component.
            let products: Vec<[DMatrix<f64>; 2]> = block
                .random_effects
                .iter()
                .map(|effects| {
                    [inverse, &projected].map(|matrix| {
                        let mut product = DMatrix::zeros(size, size);
                        effects.iter().for_each(|of| of.add_product(matrix, &mut product));
                        product
                    })
                })
                .collect();
            for (i, effects) in block.random_effects.iter().enumerate() {
                score[i] -= 0.5 * (products[i][0].trace() - products[i][1].trace());
                for RandomEffects { first, effects } in effects {
                    let rows = effects.nrows();
                    score[i] +=
                        0.5 * effects.tr_mul(&standardised.rows(*first, rows)).norm_squared();
                    let loads = effects.tr_mul(&weighted.rows(*first, rows));
                    by_fixed[i] += loads.tr_mul(&loads);
                }
                unprojected[i] += 0.5 * trace_of_product(&products[i][0], &products[i][0]);
                for j in 0..=i {
                    let [own, projected] =
                        [0, 1].map(|k| trace_of_product(&products[i][k], &products[j][0]));
                    information[(i, j)] += 0.5 * own - projected;
                }
            }
        }
        let by_fixed: Vec<DMatrix<f64>> = by_fixed.iter().map(|of| &normal_inverse * of).collect();
        for i in 0..count {
            for j in 0..=i {
                information[(i, j)] += 0.5 * trace_of_product(&by_fixed[i], &by_fixed[j]);
                information[(j, i)] = information[(i, j)];
            }
        }
        let logarithm = -0.5 * (log_determinant + normal_log_determinant + squares);
        logarithm.is_finite().then_some(Self { logarithm, score, information, unprojected })
    }

    /// Returns the step of Fisher scoring in the variances; a variance of zero that the likelihood would make negative
    /// is not changed.
    fn step(&self, variances: &[f64], is_identified: &[bool]) -> Option<Vec<f64>> {
        let free: Vec<usize> = (0..variances.len())
            .filter(|&i| is_identified[i] && (variances[i] > 0.0 || self.score[i] > 0.0))
            .collect();
        let information = self.information.select_rows(&free).select_columns(&free);
        let own = pseudo_inverse(&information)? * self.score.select_rows(&free);
        let mut step = vec![0.0; variances.len()];
        free.iter().zip(own.iter()).for_each(|(i, own)| step[*i] = *own);
        Some(step)
    }
}

/// Returns the trace of the product of two square matrices.
fn trace_of_product(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    a.iter().zip(b.transpose().iter()).map(|(a, b)| a * b).sum()
}

/// Returns the pseudo-inverse of a positive semidefinite matrix, which is scaled to a unit diagonal first; `None` if
/// the matrix is not finite.
pub fn pseudo_inverse(symmetric: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    inverse_and_log_determinant(symmetric).map(|(inverse, _)| inverse)
}

/// Returns [`pseudo_inverse`] and the logarithm of the product of the matrix's nonzero eigenvalues.
fn inverse_and_log_determinant(symmetric: &DMatrix<f64>) -> Option<(DMatrix<f64>, f64)> {
    if symmetric.is_empty() {
        return Some((symmetric.clone(), 0.0));
    }
    let scales: DVector<f64> =
        symmetric.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let scale = DMatrix::from_diagonal(&scales);
    let scaled = &scale * symmetric * &scale;
    let eigen = symmetric_eigen(scaled)?;
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let is_nonzero = |value: f64| value > RANK_TOLERANCE * largest;
    let inverses = eigen.eigenvalues.map(|value| if is_nonzero(value) { 1.0 / value } else { 0.0 });
    let inverse =
        &eigen.eigenvectors * DMatrix::from_diagonal(&inverses) * eigen.eigenvectors.transpose();
    let of_scaled: f64 =
        eigen.eigenvalues.iter().filter(|value| is_nonzero(**value)).map(|value| value.ln()).sum();
    let of_scales: f64 =
        scales.iter().filter(|scale| **scale > 0.0).map(|scale| 2.0 * scale.ln()).sum();
    Some((&scale * inverse * &scale, of_scaled - of_scales))
}

/// Returns the eigenvalues and eigenvectors of a symmetric matrix; `None` if it is not finite.
fn symmetric_eigen(symmetric: DMatrix<f64>) -> Option<SymmetricEigen<f64, Dyn>> {
    // The iteration would not end.
    if symmetric.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let iterations = MAX_EIGENVALUE_ITERATIONS * symmetric.nrows();
    SymmetricEigen::try_new(symmetric, f64::EPSILON, iterations)
}

/// Returns a matrix whose product with its transpose is the covariance, to draw correlated errors; `None` if the
/// covariance is not finite.
pub fn covariance_root(covariance: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let eigen = symmetric_eigen(covariance)?;
    let deviations = eigen.eigenvalues.map(|variance| variance.max(0.0).sqrt());
    Some(eigen.eigenvectors * DMatrix::from_diagonal(&deviations))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns blocks of repeated observations that share one random effect and a common mean; the second component
    /// is the variance of single observations.
    fn one_way(groups: &[[f64; 4]]) -> Vec<Block> {
        let ones = DMatrix::from_element(4, 1, 1.0);
        let block = |values: &[f64; 4]| Block {
            observations: DVector::from_column_slice(values),
            design: ones.clone(),
            known_covariance: 1e-12 * DMatrix::identity(4, 4),
            random_effects: vec![
                vec![RandomEffects { first: 0, effects: ones.clone() }],
                (0..4)
                    .map(|first| RandomEffects { first, effects: DMatrix::identity(1, 1) })
                    .collect(),
            ],
        };
        groups.iter().map(block).collect()
    }

    const GROUPS: [[f64; 4]; 3] =
        [[1.0, 1.3, 0.9, 1.1], [2.2, 2.0, 2.5, 2.1], [0.2, 0.3, 0.6, 0.4]];

    /// Mean squares of the analysis of variance between and within the groups.
    fn mean_squares(groups: &[[f64; 4]]) -> [f64; 2] {
        let means: Vec<f64> = groups.iter().map(|of| crate::mean(*of)).collect();
        let total = crate::mean(means.iter().copied());
        let between: f64 = means.iter().map(|mean| 4.0 * (mean - total).powi(2)).sum();
        let within: f64 = groups
            .iter()
            .zip(&means)
            .flat_map(|(of, mean)| of.map(|value| (value - mean).powi(2)))
            .sum();
        let count = groups.len() as f64;
        [between / (count - 1.0), within / (3.0 * count)]
    }

    #[test]
    fn balanced_groups_have_the_variances_and_the_freedom_of_the_analysis_of_variance() {
        let found = VarianceComponents::estimate(&one_way(&GROUPS)).unwrap();
        let [between, within] = mean_squares(&GROUPS);
        let expected = [(between - within) / 4.0, within];
        for (found, expected) in found.variances.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
        }
        // The variance of the overall mean is that between the groups' means: two degrees of freedom.
        let freedom = found.degrees_of_freedom(&[1.0 / 3.0, 1.0 / 12.0], 0.0, f64::INFINITY);
        assert!((freedom - 2.0).abs() < 0.01, "{freedom}");
        let freedom = found.degrees_of_freedom(&[0.0, 1.0], 0.0, f64::INFINITY);
        assert!((freedom - 9.0).abs() < 0.05, "{freedom}");
        // A known variance of four degrees of freedom alone.
        assert_eq!(found.degrees_of_freedom(&[0.0, 0.0], 3.0, 4.0), 4.0);
    }

    #[test]
    fn a_variance_that_would_be_negative_is_zero() {
        let alike = [[1.0, 2.0, 3.0, 4.0], [4.0, 3.0, 2.0, 1.1], [2.0, 4.0, 1.0, 3.0]];
        let [between, within] = mean_squares(&alike);
        assert!(between < within);
        let found = VarianceComponents::estimate(&one_way(&alike)).unwrap();
        assert_eq!(found.variances[0], 0.0);
        // All observations are one sample then.
        let values = alike.as_flattened();
        let mean = crate::mean(values.iter().copied());
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / 11.0;
        assert!((found.variances[1] / variance - 1.0).abs() < 1e-3, "{found:?} {variance}");
    }

    #[test]
    fn a_variance_that_the_fixed_effects_absorb_is_not_identified() {
        let mut blocks = one_way(&GROUPS);
        for (group, block) in blocks.iter_mut().enumerate() {
            // Each group has a mean of its own.
            block.design =
                DMatrix::from_fn(4, GROUPS.len(), |_, column| f64::from(column == group));
        }
        let found = VarianceComponents::estimate(&blocks).unwrap();
        assert_eq!(found.is_identified, [false, true]);
        assert_eq!(found.variances[0], 0.0);
        let [_, within] = mean_squares(&GROUPS);
        assert!((found.variances[1] / within - 1.0).abs() < 1e-3, "{found:?} {within}");
        let freedom = found.degrees_of_freedom(&[1.0, 1.0], 0.0, f64::INFINITY);
        assert!((freedom - 9.0).abs() < 0.05, "{freedom}");
    }

    #[test]
    fn known_noise_is_not_attributed_to_the_components() {
        let mut blocks = one_way(&GROUPS);
        for block in &mut blocks {
            block.known_covariance = DMatrix::identity(4, 4);
        }
        let found = VarianceComponents::estimate(&blocks).unwrap();
        assert_eq!(found.variances[1], 0.0);
        blocks[0].known_covariance[(0, 0)] = -1.0;
        assert_eq!(VarianceComponents::estimate(&blocks), None);
    }

    #[test]
    fn numbers_that_are_not_finite_give_no_estimate() {
        for value in [f64::NAN, f64::INFINITY] {
            let mut observed = one_way(&GROUPS);
            observed[0].observations[0] = value;
            assert_eq!(VarianceComponents::estimate(&observed), None);
            let mut known = one_way(&GROUPS);
            known[0].known_covariance[(0, 0)] = value;
            assert_eq!(VarianceComponents::estimate(&known), None);
            assert_eq!(pseudo_inverse(&DMatrix::from_element(2, 2, value)), None);
        }
    }

    #[test]
    fn the_inverse_of_a_matrix_with_many_rows_is_found() {
        let size = 600;
        let covariance =
            DMatrix::from_fn(size, size, |row, column| 0.9f64.powi(row.abs_diff(column) as i32));
        let product = pseudo_inverse(&covariance).unwrap() * covariance;
        assert!((product - DMatrix::identity(size, size)).amax() < 1e-9);
    }
}
