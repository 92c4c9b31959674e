//! What one cycle of motion amounts to, measured or simulated (eq. 17 and 20).

use std::ops::{Index, IndexMut};

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
    /// Every metric unknown.
    pub const MISSING: Self = Self::splat(f64::NAN);

    /// Every metric zero.
    pub const NONE: Self = Self::splat(0.0);

    const fn splat(value: f64) -> Self {
        Self { d_m: value, v_m_s: value, sigma: [value; 3], alpha1_rad: value, dtheta_rad: value }
    }
}

named! {
    /// A weight of eq. 22, by its key in the configuration.
    pub enum WeightKey {
        D = "d",
        V = "v",
        Sigma = "sigma",
        Alpha = "alpha",
    }
}

impl WeightKey {
    /// The metrics that have it.
    pub fn metrics(self) -> impl Iterator<Item = Metric> {
        let has = move |metric: &Metric| metric.definition().weight == Some(self);
        Metric::FITTED.into_iter().filter(has)
    }
}

/// What a metric is a measure of, which gives it its units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    Length,
    Speed,
    Ratio,
    Angle,
}

impl Dimension {
    /// Units of columns, and those that people are shown; ratios have none.
    pub const fn units(self) -> [&'static str; 2] {
        match self {
            Self::Length => ["m", "mm"],
            Self::Speed => ["m/s", "mm/s"],
            Self::Ratio => [""; 2],
            Self::Angle => ["rad", "deg"],
        }
    }

    /// How many of the latter one of the former is.
    fn shown_per_unit(self) -> f64 {
        match self {
            Self::Length | Self::Speed => 1e3,
            Self::Ratio => 1.0,
            Self::Angle => 1_f64.to_degrees(),
        }
    }
}

/// A row of the table of metrics.
#[derive(Debug, Clone, Copy)]
pub struct MetricDefinition {
    pub column: &'static str,
    /// Column of a measured one without what the markers' noise adds to it.
    pub debiased: Option<&'static str>,
    /// Column in the unit that people are shown.
    pub shown_column: &'static str,
    pub symbol: &'static str,
    /// The symbol in plain letters.
    pub plain: &'static str,
    /// Name on a figure's axis, before the symbol.
    pub label: &'static str,
    /// Title of a figure's panel.
    pub title: &'static str,
    pub dimension: Dimension,
    /// Its weight in eq. 22, if it has a term there.
    pub weight: Option<WeightKey>,
    /// Whether it is a size: never below 0, and hardly 0, so that eq. 21 can divide by it.
    pub is_size: bool,
}

/// Defines the metrics and their table.
macro_rules! metrics {
    ($(
        $metric:ident = $name:literal ($($field:tt)+) [$unit:literal, $shown_unit:literal]
        [$symbol:literal, $plain:literal] [$label:literal, $title:literal] $dimension:ident
        weight: $weight:expr, debiased: $debiased:expr, is_size: $is_size:literal;
    )*) => {
        named! {
            /// A metric of a cycle, by its short name; those of eq. 22 first, in its order. v is d over the
            /// period: both are one measurement.
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
            /// The metrics in the order of [`Metric::ALL`].
            #[inline]
            pub const fn to_array(self) -> [f64; Metric::ALL.len()] {
                [$(self.$($field)+,)*]
            }

            /// The inverse of [`GaitMetrics::to_array`].
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
    /// Those that have a term in eq. 22.
    pub const FITTED: [Self; 6] = *Self::ALL.first_chunk().expect("there are more");

    /// Skid ratios of wheels 0, 1, 2.
    pub const SIGMA: [Self; 3] = [Self::Sigma0, Self::Sigma1, Self::Sigma2];

    /// Its row of the table.
    pub const fn definition(self) -> &'static MetricDefinition {
        &TABLE[self as usize]
    }

    /// Its column.
    pub const fn column(self) -> &'static str {
        self.definition().column
    }

    /// Its value in the unit that people are shown.
    pub fn shown(self, metrics: &GaitMetrics) -> f64 {
        self.definition().dimension.shown_per_unit() * metrics[self]
    }

    /// The metric of this column.
    pub fn of_column(column: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|metric| metric.column() == column)
    }
}

/// A value for each metric, or for the first of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ByMetric<T, const N: usize = { Metric::ALL.len() }>([T; N]);

/// A value for each of [`Metric::FITTED`].
pub type ByFitted<T> = ByMetric<T, { Metric::FITTED.len() }>;

impl<T: Copy, const N: usize> ByMetric<T, N> {
    /// The same for every metric.
    pub const fn splat(value: T) -> Self {
        Self([value; N])
    }
}

impl<T, const N: usize> ByMetric<T, N> {
    /// What `of` gives for every metric.
    #[inline]
    pub fn from_fn(mut of: impl FnMut(Metric) -> T) -> Self {
        Self(std::array::from_fn(|i| of(Metric::ALL[i])))
    }

    /// The same with every value mapped.
    #[inline]
    pub fn map<U>(self, of: impl FnMut(T) -> U) -> ByMetric<U, N> {
        ByMetric(self.0.map(of))
    }

    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = (Metric, &T)> {
        Metric::ALL.into_iter().zip(&self.0)
    }

    #[inline]
    pub fn iter_mut(&mut self) -> impl Iterator<Item = (Metric, &mut T)> {
        Metric::ALL.into_iter().zip(&mut self.0)
    }

    /// The values alone.
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

/// Those that are not there are unknown.
impl<const N: usize> From<ByMetric<f64, N>> for GaitMetrics {
    #[inline]
    fn from(values: ByMetric<f64, N>) -> Self {
        let mut metrics = Self::MISSING;
        values.iter().for_each(|(metric, value)| metrics[metric] = *value);
        metrics
    }
}

named! {
    /// What there is of a steady motion.
    pub enum MotionStatus {
        Stable = "stable",
        /// Stable, and one of a pair that are each other's mirror image half a period later; the motion that
        /// is its own mirror image, as the commands are, is unstable.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_metric_has_a_place_and_names_of_its_own() {
        let numbers = std::array::from_fn(|i| i as f64);
        let metrics = GaitMetrics::from_array(numbers);
        assert_eq!(metrics.to_array(), numbers);
        assert_eq!((metrics.d_m, metrics.sigma, metrics.dtheta_rad), (0.0, [2.0, 3.0, 4.0], 6.0));
        for metric in Metric::ALL {
            let MetricDefinition { column, shown_column, debiased, dimension, weight, .. } =
                *metric.definition();
            assert_eq!(metrics[metric], metric as usize as f64);
            assert_eq!(Metric::FITTED.contains(&metric), weight.is_some());
            assert_eq!(Metric::of_column(column), Some(metric));
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
