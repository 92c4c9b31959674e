//! What one cycle of motion amounts to, measured or simulated (eq. 17 and 20).

use serde::Serialize;
use trilink_base::named;

/// Metrics of one actuation cycle. Measured and simulated cycles use the same
/// definitions, so their metrics can be subtracted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GaitMetrics {
    /// Displacement of link 0's centre over the cycle (eq. 17), m.
    pub d_m: f64,
    /// Mean speed `d / period` (eq. 17), m/s.
    pub v_m_s: f64,
    /// Skid ratio of wheels 0, 1, 2 (eq. 20): RMS skid velocity over `l omega`.
    pub sigma: [f64; 3],
    /// Half the peak-to-peak of phi1, rad.
    pub alpha1_rad: f64,
    /// Net rotation of link 0 over the cycle, rad.
    pub dtheta_rad: f64,
}

impl GaitMetrics {
    /// The metrics' columns, in the order of the fields.
    pub const COLUMNS: [&str; 7] =
        ["d_m", "v_m_s", "sigma0", "sigma1", "sigma2", "alpha1_rad", "dtheta_rad"];

    /// Columns of the skid ratios of wheels 0, 1, 2.
    pub const SIGMA_COLUMNS: [&str; 3] = [Self::COLUMNS[2], Self::COLUMNS[3], Self::COLUMNS[4]];

    /// Columns of measured skid ratios without what the markers' noise adds to them.
    pub const SIGMA_DEBIASED_COLUMNS: [&str; 3] =
        ["sigma0_debiased", "sigma1_debiased", "sigma2_debiased"];

    /// Every metric unknown.
    pub const MISSING: Self = Self {
        d_m: f64::NAN,
        v_m_s: f64::NAN,
        sigma: [f64::NAN; 3],
        alpha1_rad: f64::NAN,
        dtheta_rad: f64::NAN,
    };

    /// Every metric zero.
    pub const NONE: Self =
        Self { d_m: 0.0, v_m_s: 0.0, sigma: [0.0; 3], alpha1_rad: 0.0, dtheta_rad: 0.0 };

    /// The metrics in the order of the fields.
    #[inline]
    pub fn to_array(self) -> [f64; 7] {
        let [middle, front, rear] = self.sigma;
        [self.d_m, self.v_m_s, middle, front, rear, self.alpha1_rad, self.dtheta_rad]
    }

    /// The inverse of [`GaitMetrics::to_array`].
    #[inline]
    pub fn from_array(values: [f64; 7]) -> Self {
        let [d_m, v_m_s, sigma @ .., alpha1_rad, dtheta_rad] = values;
        Self { d_m, v_m_s, sigma, alpha1_rad, dtheta_rad }
    }
}

named! {
    /// What there is of a steady motion.
    pub enum MotionStatus {
        Stable = "stable",
        /// Stable, and one of two that are each other's mirror image half a period later: the one that
        /// is its own, as the commands are, is unstable.
        SymmetryBroken = "symmetry-broken",
        Unstable = "unstable",
        /// None: the gait crosses det W_b = 0 without meeting condition (5).
        Singular = "singular",
        /// None was found.
        Diverged = "diverged",
        /// None was looked for: the gait that drives it was not measured.
        Failed = "failed",
    }
}

impl MotionStatus {
    /// By the modulus of the largest Floquet multiplier, if there is one.
    #[inline]
    pub fn new(modulus: Option<f64>, is_symmetry_broken: bool) -> Self {
        match (modulus.is_some_and(|modulus| modulus >= 1.0), is_symmetry_broken) {
            (true, _) => Self::Unstable,
            (false, true) => Self::SymmetryBroken,
            (false, false) => Self::Stable,
        }
    }

    /// Whether a robot that is nearby gets into it.
    #[inline]
    pub fn is_stable(self) -> bool {
        matches!(self, Self::Stable | Self::SymmetryBroken)
    }

    /// Whether the robot gets into it from rest and stays in it.
    #[inline]
    pub fn is_reached_and_stays(self, from_rest: FromRest) -> bool {
        self.is_stable() && from_rest == FromRest::Reached
    }
}

named! {
    /// Where the robot goes from rest, seen from the motion that a solver finds without regard to that.
    pub enum FromRest {
        /// Into this motion.
        Reached = "reached",
        Another = "another",
        /// Into none.
        Unsettled = "unsettled",
    }
}

named! {
    /// What the motions of a branch have alike.
    pub enum BranchKind {
        /// Each is its own mirror image half a period later.
        Symmetric = "symmetric",
        /// Each repeats itself after a period, under commands that are not their own mirror image.
        Periodic = "periodic",
        /// One of two that are each other's mirror image half a period later.
        SymmetryBroken = "symmetry-broken",
        /// Each repeats itself after two periods.
        PeriodDoubled = "period-doubled",
    }
}

named! {
    /// What happens at a point of a branch.
    pub enum Bifurcation {
        /// The parameter turns round.
        Fold = "fold",
        /// Two branches begin, or end, the motions of which are each other's mirror image.
        SymmetryBreaking = "symmetry-breaking",
        /// A branch of twice the period begins, or ends.
        PeriodDoubling = "period-doubling",
        /// A pair of complex multipliers leaves the unit circle, or enters it (Neimark and Sacker).
        Torus = "torus",
    }
}

impl BranchKind {
    /// Periods of the command after which each motion repeats itself.
    #[inline]
    pub fn periods(self) -> i64 {
        if self == Self::PeriodDoubled { 2 } else { 1 }
    }
}
