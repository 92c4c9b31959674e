//! Metrics of a gait cycle, measured or simulated (eq. 17 and 20).

use std::ops::{Index, IndexMut};

use serde::Serialize;
use trilink_base::named;

/// Metrics of one actuation cycle. Measured and simulated cycles use the same definitions, so their metrics
/// can be subtracted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GaitMetrics {
    /// Displacement of link 0's centre over the cycle (eq. 17 of the paper), m.
    pub d_m: f64,
    /// Mean speed `d / period` (eq. 17 of the paper), m/s.
    pub v_m_s: f64,
    /// Skid ratio of wheels 0, 1, 2 (eq. 20 of the paper): RMS skid velocity over `l omega`, where l is the
    /// side link length.
    pub sigma: [f64; 3],
    /// Half the peak-to-peak range of phi1, rad.
    pub alpha1_rad: f64,
    /// Net rotation of link 0 over the cycle, rad.
    pub dtheta_rad: f64,
}

impl GaitMetrics {
    /// Metrics that are all missing (NaN).
    pub const MISSING: Self = Self::splat(f64::NAN);

    /// Metrics that are all zero.
    pub const NONE: Self = Self::splat(0.0);

    const fn splat(value: f64) -> Self {
        Self { d_m: value, v_m_s: value, sigma: [value; 3], alpha1_rad: value, dtheta_rad: value }
    }
}

named! {
    /// Weight of one or more metrics in the objective (eq. 22 of the paper), named by its configuration key.
    pub enum WeightKey {
        D = "d",
        V = "v",
        Sigma = "sigma",
        Alpha = "alpha",
    }
}

impl WeightKey {
    /// Returns the metrics whose terms in the objective (eq. 22 of the paper) have this weight.
    pub fn metrics(self) -> impl Iterator<Item = Metric> {
        Metric::FITTED.into_iter().filter(move |metric| metric.definition().weight == Some(self))
    }
}

/// Physical dimension of a metric, which determines its units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    Length,
    Speed,
    Ratio,
    Angle,
}

impl Dimension {
    /// Returns the unit in table columns and the unit for display; empty for ratios.
    pub const fn units(self) -> [&'static str; 2] {
        match self {
            Self::Length => ["m", "mm"],
            Self::Speed => ["m/s", "mm/s"],
            Self::Ratio => [""; 2],
            Self::Angle => ["rad", "deg"],
        }
    }

    /// Adds the unit in table columns, if there is one, to the label of an axis.
    pub fn with_unit(self, label: &str) -> String {
        Self::labelled(label, self.units()[0])
    }

    /// Adds the unit for display, if there is one, to the label of an axis.
    pub fn with_shown_unit(self, label: &str) -> String {
        Self::labelled(label, self.units()[1])
    }

    fn labelled(label: &str, unit: &str) -> String {
        match unit {
            "" => label.to_owned(),
            _ => format!("{label} ({unit})"),
        }
    }

    /// Returns the factor that converts the unit in table columns to the unit for display.
    pub const fn shown_per_unit(self) -> f64 {
        match self {
            Self::Length | Self::Speed => 1e3,
            Self::Ratio => 1.0,
            Self::Angle => 180.0 / std::f64::consts::PI,
        }
    }
}

/// Definition of a metric: a row in the table of metrics.
#[derive(Debug, Clone, Copy)]
pub struct MetricDefinition {
    pub column: &'static str,
    /// Name of the column with the measured metric corrected for the bias due to marker noise; `None` if the
    /// metric is not corrected.
    pub debiased: Option<&'static str>,
    /// Name of a column that contains the metric in its display unit.
    pub shown_column: &'static str,
    pub symbol: &'static str,
    /// Symbol of the metric in plain ASCII letters.
    pub plain: &'static str,
    /// Label on a figure's axis, before the symbol.
    pub label: &'static str,
    /// Title of a figure's panel.
    pub title: &'static str,
    pub dimension: Dimension,
    /// Weight of the metric in the objective (eq. 22 of the paper); `None` if the metric has no term there.
    pub weight: Option<WeightKey>,
    /// Whether the metric is a magnitude: never negative and rarely near zero, so that deviations can be
    /// divided by it (eq. 21 of the paper).
    pub is_size: bool,
}

impl MetricDefinition {
    /// Returns the name of the metric in words, such as `Skid ratio of wheel 0 (middle)`.
    pub fn in_words(&self) -> String {
        if self.title.starts_with("Wheel") {
            format!("{} of {}", self.label, self.title.to_lowercase())
        } else {
            self.title.to_owned()
        }
    }
}

/// Defines the metrics and the table of their definitions.
macro_rules! metrics {
    ($(
        $metric:ident = $name:literal ($($field:tt)+) [$unit:literal, $shown_unit:literal]
        [$symbol:literal, $plain:literal] [$label:literal, $title:literal] $dimension:ident
        weight: $weight:expr, debiased: $debiased:expr, is_size: $is_size:literal;
    )*) => {
        named! {
            /// Metric of a gait cycle, identified by its short name. The metrics with a term in the objective
            /// (eq. 22 of the paper) come first, in the order of the terms. Since v is d over the period, d
            /// and v are a single measurement.
            pub enum Metric { $($metric = $name,)* }
        }

        const TABLE: &[MetricDefinition; Metric::ALL.len()] = &[$(MetricDefinition {
            column: concat!($name, $unit),
            debiased: $debiased,
            shown_column: concat!($name, $shown_unit),
            symbol: $symbol,
            plain: $plain,
            label: $label,
            title: $title,
            dimension: Dimension::$dimension,
            weight: $weight,
            is_size: $is_size,
        },)*];

        impl GaitMetrics {
            /// Returns the metrics in the order of [`Metric::ALL`].
            #[inline]
            pub const fn to_array(self) -> [f64; Metric::ALL.len()] {
                [$(self.$($field)+,)*]
            }

            /// Creates the metrics from values in the order of [`Metric::ALL`].
            #[inline]
            pub const fn from_array(values: [f64; Metric::ALL.len()]) -> Self {
                let mut metrics = Self::NONE;
                $(metrics.$($field)+ = values[Metric::$metric as usize];)*
                metrics
            }
        }

        impl Index<Metric> for GaitMetrics {
            type Output = f64;

            #[inline]
            fn index(&self, metric: Metric) -> &f64 {
                match metric { $(Metric::$metric => &self.$($field)+,)* }
            }
        }

        impl IndexMut<Metric> for GaitMetrics {
            #[inline]
            fn index_mut(&mut self, metric: Metric) -> &mut f64 {
                match metric { $(Metric::$metric => &mut self.$($field)+,)* }
            }
        }
    };
}

metrics! {
    D = "d" (d_m) ["_m", "_mm"] ["d", "d"] ["Displacement", "Displacement per cycle"] Length
        weight: Some(WeightKey::D), debiased: None, is_size: true;
    V = "v" (v_m_s) ["_m_s", "_mm_s"] ["v", "v"] ["Mean speed", "Mean speed"] Speed
        weight: Some(WeightKey::V), debiased: None, is_size: true;
    Sigma0 = "sigma0" (sigma[0]) ["", ""] ["σ₀", "sigma 0"] ["Skid ratio", "Wheel 0 (middle)"] Ratio
        weight: Some(WeightKey::Sigma), debiased: Some("sigma0_debiased"), is_size: true;
    Sigma1 = "sigma1" (sigma[1]) ["", ""] ["σ₁", "sigma 1"] ["Skid ratio", "Wheel 1 (front)"] Ratio
        weight: Some(WeightKey::Sigma), debiased: Some("sigma1_debiased"), is_size: true;
    Sigma2 = "sigma2" (sigma[2]) ["", ""] ["σ₂", "sigma 2"] ["Skid ratio", "Wheel 2 (rear)"] Ratio
        weight: Some(WeightKey::Sigma), debiased: Some("sigma2_debiased"), is_size: true;
    Alpha1 = "alpha1" (alpha1_rad) ["_rad", "_deg"] ["α₁", "alpha 1"] ["Amplitude", "Amplitude of joint 1"] Angle
        weight: Some(WeightKey::Alpha), debiased: None, is_size: true;
    Dtheta = "dtheta" (dtheta_rad) ["_rad", "_deg"] ["Δθ", "rotation"] ["Net rotation", "Rotation per cycle"] Angle
        weight: None, debiased: None, is_size: false;
}

impl Metric {
    /// Metrics that have a term in the objective of the fits (eq. 22 of the paper).
    pub const FITTED: [Self; 6] = *Self::ALL.first_chunk().expect("there are more");

    /// Skid ratios of wheels 0, 1, 2.
    pub const SIGMA: [Self; 3] = [Self::Sigma0, Self::Sigma1, Self::Sigma2];

    /// Returns the definition of the metric.
    pub const fn definition(self) -> &'static MetricDefinition {
        &TABLE[self as usize]
    }

    /// Returns whether relative deviations of the metric tell trials or cycles apart. Those of v would repeat those of
    /// d, and a metric whose mean may be zero has none.
    pub fn is_independent_size(self) -> bool {
        self != Self::V && self.definition().is_size
    }

    /// Returns the name of the metric's column in tables.
    pub const fn column(self) -> &'static str {
        self.definition().column
    }

    /// Returns the value of the metric in its display unit.
    pub fn shown(self, metrics: &GaitMetrics) -> f64 {
        self.definition().dimension.shown_per_unit() * metrics[self]
    }

    /// Returns the metric with the given column name.
    pub fn from_column(column: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|metric| metric.column() == column)
    }
}

/// One value for each metric of [`Metric::ALL`], or for each of its first `N` metrics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ByMetric<T, const N: usize = { Metric::ALL.len() }>([T; N]);

/// One value per metric of [`Metric::FITTED`].
pub type ByFitted<T> = ByMetric<T, { Metric::FITTED.len() }>;

impl<T: Copy, const N: usize> ByMetric<T, N> {
    /// Creates a collection that has the same value for every metric.
    pub const fn splat(value: T) -> Self {
        Self([value; N])
    }
}

impl<T, const N: usize> ByMetric<T, N> {
    /// Creates a collection by calling `value` for each metric.
    #[inline]
    pub fn from_fn(mut value: impl FnMut(Metric) -> T) -> Self {
        Self(std::array::from_fn(|i| value(Metric::ALL[i])))
    }

    /// Applies a function to each value.
    #[inline]
    pub fn map<U>(self, function: impl FnMut(T) -> U) -> ByMetric<U, N> {
        ByMetric(self.0.map(function))
    }

    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = (Metric, &T)> {
        Metric::ALL.into_iter().zip(&self.0)
    }

    #[inline]
    pub fn iter_mut(&mut self) -> impl Iterator<Item = (Metric, &mut T)> {
        Metric::ALL.into_iter().zip(&mut self.0)
    }

    /// Returns the values in the order of [`Metric::ALL`].
    #[inline]
    pub const fn values(&self) -> &[T; N] {
        &self.0
    }
}

impl<T, const N: usize> Index<Metric> for ByMetric<T, N> {
    type Output = T;

    #[inline]
    fn index(&self, metric: Metric) -> &T {
        &self.0[metric as usize]
    }
}

impl<T, const N: usize> IndexMut<Metric> for ByMetric<T, N> {
    #[inline]
    fn index_mut(&mut self, metric: Metric) -> &mut T {
        &mut self.0[metric as usize]
    }
}

impl<T, const N: usize> From<[T; N]> for ByMetric<T, N> {
    fn from(values: [T; N]) -> Self {
        Self(values)
    }
}

impl<const N: usize> From<GaitMetrics> for ByMetric<f64, N> {
    #[inline]
    fn from(metrics: GaitMetrics) -> Self {
        Self::from_fn(|metric| metrics[metric])
    }
}

/// Metrics beyond the first `N` are missing (NaN).
impl<const N: usize> From<ByMetric<f64, N>> for GaitMetrics {
    #[inline]
    fn from(values: ByMetric<f64, N>) -> Self {
        let mut metrics = Self::MISSING;
        values.iter().for_each(|(metric, value)| metrics[metric] = *value);
        metrics
    }
}

named! {
    /// Status of a steady-state motion, or the reason why there is none.
    pub enum MotionStatus {
        Stable = "stable",
        /// Stable, and one of a pair of motions that mirror each other with a shift of half a period; the
        /// motion with the half-period symmetry of the commands is unstable.
        SymmetryBroken = "symmetry-broken",
        Unstable = "unstable",
        /// No motion exists: the gait passes through a singular shape (det W_b = 0) without meeting condition
        /// (5) of the paper.
        Singular = "singular",
        /// No motion was found.
        Diverged = "diverged",
        /// No motion was computed, because the gait that drives the model was not measured.
        Failed = "failed",
    }
}

impl MotionStatus {
    /// Determines the status of a motion from the modulus of its largest Floquet multiplier; a motion without
    /// one (`None`) is stable.
    #[inline]
    pub fn new(modulus: Option<f64>, is_symmetry_broken: bool) -> Self {
        if modulus.is_some_and(|modulus| modulus >= 1.0) {
            Self::Unstable
        } else if is_symmetry_broken {
            Self::SymmetryBroken
        } else {
            Self::Stable
        }
    }

    /// Returns whether nearby motions converge to the motion with this status.
    #[inline]
    pub fn is_stable(self) -> bool {
        matches!(self, Self::Stable | Self::SymmetryBroken)
    }

    /// Returns whether the robot, starting from rest, reaches the motion with this status and stays in it.
    #[inline]
    pub fn is_reached_and_stays(self, from_rest: FromRest) -> bool {
        self.is_stable() && from_rest == FromRest::Reached
    }
}

named! {
    /// Attractor reached from rest, compared with the motion that the solver finds.
    pub enum FromRest {
        /// The attractor is the motion that the solver finds.
        Reached = "reached",
        /// The attractor is a different periodic motion.
        Another = "another",
        /// The robot does not settle into a periodic motion.
        Unsettled = "unsettled",
    }
}

named! {
    /// Symmetry and period of the motions on a branch.
    pub enum BranchKind {
        /// Each motion is its own mirror image shifted by half a period.
        Symmetric = "symmetric",
        /// Each motion has the period of the commands, which have no half-period symmetry.
        Periodic = "periodic",
        /// One of two branches whose motions mirror each other with a shift of half a period.
        SymmetryBroken = "symmetry-broken",
        /// Each motion has twice the period of the commands.
        PeriodDoubled = "period-doubled",
    }
}

named! {
    /// Bifurcation at a point of a branch.
    pub enum Bifurcation {
        /// The branch turns back in the parameter (saddle-node bifurcation).
        Fold = "fold",
        /// Two branches of mirror-image motions begin or end (pitchfork bifurcation).
        SymmetryBreaking = "symmetry-breaking",
        /// A branch with twice the period begins or ends (flip bifurcation).
        PeriodDoubling = "period-doubling",
        /// A complex-conjugate pair of Floquet multipliers crosses the unit circle (Neimark-Sacker
        /// bifurcation).
        Torus = "torus",
    }
}

impl BranchKind {
    /// Returns the number of command periods after which each motion repeats.
    #[inline]
    pub fn periods(self) -> i64 {
        if self == Self::PeriodDoubled { 2 } else { 1 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_metric_has_its_own_index_and_names() {
        let numbers = std::array::from_fn(|i| i as f64);
        let metrics = GaitMetrics::from_array(numbers);
        assert_eq!(metrics.to_array(), numbers);
        assert_eq!((metrics.d_m, metrics.sigma, metrics.dtheta_rad), (0.0, [2.0, 3.0, 4.0], 6.0));
        for metric in Metric::ALL {
            let MetricDefinition { column, shown_column, debiased, dimension, weight, .. } =
                *metric.definition();
            assert_eq!(metrics[metric], metric as usize as f64);
            assert_eq!(Metric::FITTED.contains(&metric), weight.is_some());
            assert_eq!(Metric::from_column(column), Some(metric));
            let with_unit = |unit: &str| match unit {
                "" => metric.name().to_owned(),
                unit => format!("{metric}_{}", unit.replace('/', "_")),
            };
            assert_eq!(column, with_unit(dimension.units()[0]));
            assert_eq!(shown_column, with_unit(dimension.units()[1]));
            assert!(debiased.is_none_or(|debiased| debiased == format!("{column}_debiased")));
        }
    }
}
