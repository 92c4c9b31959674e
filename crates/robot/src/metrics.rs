//! Metrics of a gait cycle, measured or simulated (eq. 17 and 20).

use std::ops::{Index, IndexMut};

use serde::ser::{Serialize, SerializeMap as _, Serializer};
use trilink_base::named;

use super::{MAX_JOINTS, MAX_LINKS};

/// Metrics of one actuation cycle. Measured and simulated cycles use the same definitions, so their metrics
/// can be subtracted. Metrics that a robot lacks are missing (NaN), and missing metrics are equal to each other.
#[derive(Debug, Clone, Copy)]
pub struct GaitMetrics {
    /// Displacement of link 0's origin over the cycle (eq. 17 of the paper), m.
    pub d_m: f64,
    /// Mean speed `d / period` (eq. 17 of the paper), m/s.
    pub v_m_s: f64,
    /// Skid ratio of the wheels by the number of the link (eq. 20 of the paper): RMS skid velocity over `l omega`, where
    /// l is the side link length, or [`Chain::skid_length_m`](super::Chain::skid_length_m).
    pub sigma: [f64; MAX_LINKS],
    /// Half the peak-to-peak range of the joint angles from front to rear, rad.
    pub alpha_rad: [f64; MAX_JOINTS],
    /// Net rotation of link 0 over the cycle, rad.
    pub dtheta_rad: f64,
}

impl GaitMetrics {
    /// Metrics that are all missing (NaN).
    pub const MISSING: Self = Self::splat(f64::NAN);

    /// Metrics that are all zero.
    pub const NONE: Self = Self::splat(0.0);

    const fn splat(value: f64) -> Self {
        Self {
            d_m: value,
            v_m_s: value,
            sigma: [value; MAX_LINKS],
            alpha_rad: [value; MAX_JOINTS],
            dtheta_rad: value,
        }
    }
}

impl GaitMetrics {
    /// Returns the metrics of a robot of three links in the order of [`Metric::OF_THREE_LINKS`].
    #[inline]
    pub const fn to_array(self) -> [f64; Metric::OF_THREE_LINKS.len()] {
        let Self { d_m, v_m_s, sigma: [sigma0, sigma1, sigma2, ..], dtheta_rad, .. } = self;
        [d_m, v_m_s, sigma0, sigma1, sigma2, self.alpha_rad[0], dtheta_rad]
    }

    /// Creates the metrics of a robot of three links from values in the order of [`Metric::OF_THREE_LINKS`].
    #[inline]
    pub const fn from_array(values: [f64; Metric::OF_THREE_LINKS.len()]) -> Self {
        let [d_m, v_m_s, sigma0, sigma1, sigma2, alpha1_rad, dtheta_rad] = values;
        let mut metrics = Self { d_m, v_m_s, dtheta_rad, ..Self::MISSING };
        (metrics.sigma[0], metrics.sigma[1], metrics.sigma[2]) = (sigma0, sigma1, sigma2);
        metrics.alpha_rad[0] = alpha1_rad;
        metrics
    }
}

/// Returns the values, followed by missing ones (NaN).
pub fn padded<const N: usize>(values: &[f64]) -> [f64; N] {
    std::array::from_fn(|i| values.get(i).copied().unwrap_or(f64::NAN))
}

impl PartialEq for GaitMetrics {
    fn eq(&self, other: &Self) -> bool {
        Metric::ALL.into_iter().all(|metric| {
            let (a, b) = (self[metric], other[metric]);
            a == b || a.is_nan() && b.is_nan()
        })
    }
}

/// Serializes the skid ratios as a list, and the metrics that only chains have only if they are not missing.
impl Serialize for GaitMetrics {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for metric in Metric::ALL {
            let is_listed = Metric::SIGMA.contains(&metric) && metric != Metric::Sigma0;
            if is_listed || !metric.is_of_three_links() && self[metric].is_nan() {
                continue;
            }
            if metric == Metric::Sigma0 {
                let known = self.sigma.iter().rposition(|sigma| !sigma.is_nan());
                let count = known.map_or(3, |last| last + 1);
                map.serialize_entry("sigma", &self.sigma[..count])?;
            } else {
                map.serialize_entry(metric.column(), &self[metric])?;
            }
        }
        map.end()
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
    Alpha1 = "alpha1" (alpha_rad[0]) ["_rad", "_deg"] ["α₁", "alpha 1"] ["Amplitude", "Amplitude of joint 1"] Angle
        weight: Some(WeightKey::Alpha), debiased: None, is_size: true;
    Sigma3 = "sigma3" (sigma[3]) ["", ""] ["σ₃", "sigma 3"] ["Skid ratio", "Wheel 3"] Ratio
        weight: Some(WeightKey::Sigma), debiased: Some("sigma3_debiased"), is_size: true;
    Sigma4 = "sigma4" (sigma[4]) ["", ""] ["σ₄", "sigma 4"] ["Skid ratio", "Wheel 4"] Ratio
        weight: Some(WeightKey::Sigma), debiased: Some("sigma4_debiased"), is_size: true;
    Sigma5 = "sigma5" (sigma[5]) ["", ""] ["σ₅", "sigma 5"] ["Skid ratio", "Wheel 5"] Ratio
        weight: Some(WeightKey::Sigma), debiased: Some("sigma5_debiased"), is_size: true;
    Sigma6 = "sigma6" (sigma[6]) ["", ""] ["σ₆", "sigma 6"] ["Skid ratio", "Wheel 6"] Ratio
        weight: Some(WeightKey::Sigma), debiased: Some("sigma6_debiased"), is_size: true;
    Sigma7 = "sigma7" (sigma[7]) ["", ""] ["σ₇", "sigma 7"] ["Skid ratio", "Wheel 7"] Ratio
        weight: Some(WeightKey::Sigma), debiased: Some("sigma7_debiased"), is_size: true;
    Alpha2 = "alpha2" (alpha_rad[1]) ["_rad", "_deg"] ["α₂", "alpha 2"] ["Amplitude", "Amplitude of joint 2"] Angle
        weight: Some(WeightKey::Alpha), debiased: None, is_size: true;
    Alpha3 = "alpha3" (alpha_rad[2]) ["_rad", "_deg"] ["α₃", "alpha 3"] ["Amplitude", "Amplitude of joint 3"] Angle
        weight: Some(WeightKey::Alpha), debiased: None, is_size: true;
    Alpha4 = "alpha4" (alpha_rad[3]) ["_rad", "_deg"] ["α₄", "alpha 4"] ["Amplitude", "Amplitude of joint 4"] Angle
        weight: Some(WeightKey::Alpha), debiased: None, is_size: true;
    Alpha5 = "alpha5" (alpha_rad[4]) ["_rad", "_deg"] ["α₅", "alpha 5"] ["Amplitude", "Amplitude of joint 5"] Angle
        weight: Some(WeightKey::Alpha), debiased: None, is_size: true;
    Alpha6 = "alpha6" (alpha_rad[5]) ["_rad", "_deg"] ["α₆", "alpha 6"] ["Amplitude", "Amplitude of joint 6"] Angle
        weight: Some(WeightKey::Alpha), debiased: None, is_size: true;
    Alpha7 = "alpha7" (alpha_rad[6]) ["_rad", "_deg"] ["α₇", "alpha 7"] ["Amplitude", "Amplitude of joint 7"] Angle
        weight: Some(WeightKey::Alpha), debiased: None, is_size: true;
    Dtheta = "dtheta" (dtheta_rad) ["_rad", "_deg"] ["Δθ", "rotation"] ["Net rotation", "Rotation per cycle"] Angle
        weight: None, debiased: None, is_size: false;
}

impl Metric {
    /// Metrics that have a term in the objective of the fits (eq. 22 of the paper).
    pub const FITTED: [Self; 2 + MAX_LINKS + MAX_JOINTS] =
        *Self::ALL.first_chunk().expect("there are more");

    /// Metrics of a robot of three links; tables have columns for these whatever the robots.
    pub const OF_THREE_LINKS: [Self; 7] =
        [Self::D, Self::V, Self::Sigma0, Self::Sigma1, Self::Sigma2, Self::Alpha1, Self::Dtheta];

    /// Skid ratios by the number of the link.
    pub const SIGMA: [Self; MAX_LINKS] = [
        Self::Sigma0,
        Self::Sigma1,
        Self::Sigma2,
        Self::Sigma3,
        Self::Sigma4,
        Self::Sigma5,
        Self::Sigma6,
        Self::Sigma7,
    ];

    /// Amplitudes of the joints from front to rear.
    pub const ALPHA: [Self; MAX_JOINTS] = [
        Self::Alpha1,
        Self::Alpha2,
        Self::Alpha3,
        Self::Alpha4,
        Self::Alpha5,
        Self::Alpha6,
        Self::Alpha7,
    ];

    /// Returns whether a robot of three links has the metric.
    pub fn is_of_three_links(self) -> bool {
        Self::OF_THREE_LINKS.contains(&self)
    }

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

impl ByFitted<f64> {
    /// Creates a collection from the values of a robot of three links: of d, v, the skid ratios and the amplitude of
    /// joint 1. All others are `other`.
    pub fn of_three_links(values: [f64; 6], other: f64) -> Self {
        let of = |metric| Metric::OF_THREE_LINKS.iter().position(|one| *one == metric);
        Self::from_fn(|metric| of(metric).map_or(other, |index| values[index]))
    }
}

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
        let metrics = GaitMetrics::from(ByMetric::<f64>::from_fn(|metric| metric as usize as f64));
        assert_eq!(metrics.to_array().map(|number| number as usize), [0, 1, 2, 3, 4, 5, 17]);
        let three_links = GaitMetrics::from_array(metrics.to_array());
        assert_eq!(three_links.to_array(), metrics.to_array());
        assert!(three_links.sigma[3].is_nan() && three_links.alpha_rad[1].is_nan());
        assert_eq!(three_links, three_links);
        assert_ne!(three_links, metrics);
        let json = serde_json::to_string(&three_links).expect("numbers");
        assert_eq!(
            json,
            r#"{"d_m":0.0,"v_m_s":1.0,"sigma":[2.0,3.0,4.0],"alpha1_rad":5.0,"dtheta_rad":17.0}"#
        );
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
