//! A robot, and how well it is known.

use serde::{Deserialize, Serialize};
use trilink_robot::{Gait, Laws, Parameter, Property, Robot};

/// Within which dry friction changes its sign, of robots that do not say, m/s.
const TRANSITION_M_S: f64 = 0.005;

/// A robot (Tables I and II). Arrays are links 0, 1, 2.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "super::known::RobotKeys")]
pub struct RobotConfig {
    pub h_m: f64,
    pub l_m: f64,
    pub b_m: f64,
    pub mass_kg: [f64; 3],
    pub inertia_kg_m2: [f64; 3],
    pub roll_kg_s: [f64; 3],
    pub skid_kg_s: [f64; 3],
    /// Dry friction across the wheels: N, or of `load_n`. Needed where a model knows it, as what
    /// follows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skid_dry_n: Option<[f64; 3]>,
    /// The same at low speeds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skid_static_n: Option<[f64; 3]>,
    /// The speed that is low.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stribeck_m_s: Option<f64>,
    /// Dry friction along the wheels: N, or of `load_n`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll_dry_n: Option<[f64; 3]>,
    /// Speed within which dry friction changes its sign.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transition_m_s: Option<f64>,
    /// What the wheels bear: then dry friction is in coefficients.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub load_n: Option<[f64; 3]>,
    /// Needed where a gait leaves a joint passive.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stiffness_nm_rad: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damping_nm_s_rad: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rest_angle_deg: Option<f64>,
    /// How well the parameters are known; what `h_m = { value = .., sd = .. }` says is here, too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub standard_deviation: Option<RobotDeviation>,
}

/// Standard deviations of a robot's parameters; 0 of what is taken as exact.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RobotDeviation {
    pub h_m: f64,
    pub l_m: f64,
    pub b_m: f64,
    pub mass_kg: [f64; 3],
    pub inertia_kg_m2: [f64; 3],
    pub roll_kg_s: [f64; 3],
    /// Of dry friction: N, or of `load_n`.
    pub skid_dry_n: [f64; 3],
    pub skid_static_n: [f64; 3],
    pub stribeck_m_s: f64,
    pub roll_dry_n: [f64; 3],
    pub transition_m_s: f64,
    pub stiffness_nm_rad: f64,
    pub damping_nm_s_rad: f64,
}

/// A key, its values, and what each of these is of.
type OfKey<'d> = (&'static str, &'d [f64], fn(usize) -> Property);

impl RobotDeviation {
    fn by_key(&self) -> [OfKey<'_>; 13] {
        use Property::{B, Coefficient, H, Inertia, L, Mass};
        let one = std::slice::from_ref;
        [
            ("h_m", one(&self.h_m), |_| H),
            ("l_m", one(&self.l_m), |_| L),
            ("b_m", one(&self.b_m), |_| B),
            ("mass_kg", &self.mass_kg, Mass),
            ("inertia_kg_m2", &self.inertia_kg_m2, Inertia),
            ("roll_kg_s", &self.roll_kg_s, |i| Coefficient(Parameter::ROLL[i])),
            ("skid_dry_n", &self.skid_dry_n, |i| Coefficient(Parameter::SKID_DRY[i])),
            ("skid_static_n", &self.skid_static_n, |i| Coefficient(Parameter::SKID_STATIC[i])),
            ("stribeck_m_s", one(&self.stribeck_m_s), |_| Coefficient(Parameter::Stribeck)),
            ("roll_dry_n", &self.roll_dry_n, |i| Coefficient(Parameter::ROLL_DRY[i])),
            ("transition_m_s", one(&self.transition_m_s), |_| Coefficient(Parameter::Transition)),
            ("stiffness_nm_rad", one(&self.stiffness_nm_rad), |_| {
                Coefficient(Parameter::Stiffness)
            }),
            ("damping_nm_s_rad", one(&self.damping_nm_s_rad), |_| Coefficient(Parameter::Damping)),
        ]
    }
}

impl RobotConfig {
    /// Dry friction of the wheels, N.
    fn dry_n(&self, of: [f64; 3]) -> [f64; 3] {
        let load_n = self.load_n.unwrap_or([1.0; 3]);
        std::array::from_fn(|wheel| of[wheel] * load_n[wheel])
    }

    /// Every standard deviation with its key, in SI units; 0 of what is exact.
    fn all_deviations(&self) -> Vec<(&'static str, Property, f64)> {
        let of = self.standard_deviation.unwrap_or_default();
        let in_newtons = RobotDeviation {
            skid_dry_n: self.dry_n(of.skid_dry_n),
            skid_static_n: self.dry_n(of.skid_static_n),
            roll_dry_n: self.dry_n(of.roll_dry_n),
            ..of
        };
        let of_key = |(key, values, property): OfKey| {
            let numbered = values.iter().copied().enumerate();
            numbered.map(|(i, value)| (key, property(i), value)).collect::<Vec<_>>()
        };
        in_newtons.by_key().into_iter().flat_map(of_key).collect()
    }

    /// Keys of standard deviations that are larger than what they are of, and how many times as large.
    pub(super) fn large_deviations(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let robot = self.to_robot();
        let all = self.all_deviations().into_iter();
        let times =
            all.map(move |(key, property, deviation)| (key, deviation / property.of(&robot)));
        times.filter(|(_, times)| *times > 1.0 && times.is_finite())
    }

    /// Standard deviations of what a motion depends on and is not exact, in SI units.
    pub fn deviations(&self, laws: Laws, gait: &Gait) -> Vec<(Property, f64)> {
        let all = self.all_deviations().into_iter().map(|(_, property, value)| (property, value));
        let is_known = |property: &Property| match property {
            Property::Coefficient(parameter) => laws.know(*parameter, gait),
            _ => true,
        };
        all.filter(|(property, value)| *value > 0.0 && is_known(property)).collect()
    }

    /// Keys of the numbers that are taken as exact, and what these are.
    pub fn exact(&self) -> Vec<(&'static str, Vec<Property>)> {
        let of = self.standard_deviation.unwrap_or_default();
        let by_key = of.by_key().into_iter();
        let exact = by_key.filter(|(_, values, _)| values.iter().all(|value| *value == 0.0));
        exact.map(|(key, values, of)| (key, (0..values.len()).map(of).collect())).collect()
    }

    /// The robot in SI units; a robot without a spring has none, nor one without dry friction any.
    pub fn to_robot(&self) -> Robot {
        let dry_n = |of: Option<[f64; 3]>| self.dry_n(of.unwrap_or_default());
        Robot {
            h_m: self.h_m,
            l_m: self.l_m,
            b_m: self.b_m,
            mass_kg: self.mass_kg,
            inertia_kg_m2: self.inertia_kg_m2,
            roll_kg_s: self.roll_kg_s,
            skid_kg_s: self.skid_kg_s,
            stiffness_nm_rad: self.stiffness_nm_rad.unwrap_or(0.0),
            damping_nm_s_rad: self.damping_nm_s_rad.unwrap_or(0.0),
            rest_angle_rad: self.rest_angle_deg.unwrap_or(0.0).to_radians(),
            skid_dry_n: dry_n(self.skid_dry_n),
            skid_static_n: dry_n(self.skid_static_n),
            stribeck_m_s: self.stribeck_m_s.unwrap_or(0.0),
            roll_dry_n: dry_n(self.roll_dry_n),
            transition_m_s: self.transition_m_s.unwrap_or(TRANSITION_M_S),
        }
    }

    /// Takes over the coefficients of a robot, and leaves what is not said and is nothing there.
    pub fn set_coefficients(&mut self, robot: &Robot) {
        let load_n = self.load_n.unwrap_or([1.0; 3]);
        let dry = |own: Option<[f64; 3]>, of_n: [f64; 3]| {
            let is_said = own.is_some() || of_n != [0.0; 3];
            let own = own.unwrap_or([f64::NAN; 3]);
            // What is the same stays as it was said.
            let of_wheel = |wheel: usize| match own[wheel] * load_n[wheel] == of_n[wheel] {
                true => own[wheel],
                false => of_n[wheel] / load_n[wheel],
            };
            is_said.then(|| std::array::from_fn(of_wheel))
        };
        let number =
            |own: Option<f64>, of: f64, unsaid: f64| (own.is_some() || of != unsaid).then_some(of);
        self.roll_kg_s = robot.roll_kg_s;
        self.skid_kg_s = robot.skid_kg_s;
        self.skid_dry_n = dry(self.skid_dry_n, robot.skid_dry_n);
        self.skid_static_n = dry(self.skid_static_n, robot.skid_static_n);
        self.roll_dry_n = dry(self.roll_dry_n, robot.roll_dry_n);
        self.stribeck_m_s = number(self.stribeck_m_s, robot.stribeck_m_s, 0.0);
        self.transition_m_s = number(self.transition_m_s, robot.transition_m_s, TRANSITION_M_S);
        self.stiffness_nm_rad = number(self.stiffness_nm_rad, robot.stiffness_nm_rad, 0.0);
        self.damping_nm_s_rad = number(self.damping_nm_s_rad, robot.damping_nm_s_rad, 0.0);
    }
}
