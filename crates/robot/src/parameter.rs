//! Single numbers of a robot.

use std::fmt;
use std::ops::{Index, IndexMut};
use std::sync::LazyLock;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use trilink_base::Named;

use super::{Quantity, Robot, Unit};

/// A number of a robot: a [`Quantity`] of a wheel, a link or the whole robot, or the sum of a
/// quantity over the wheels. Its name is that of its column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Parameter {
    quantity: Quantity,
    /// Of the wheel or link; behind the last one that of their sum.
    place: u8,
}

/// What a parameter is called.
struct Names {
    column: String,
    key: String,
    label: String,
}

impl Parameter {
    /// How many a fit can free.
    const COUNT: usize = {
        let (mut count, mut i) = (0, 0);
        while i < Quantity::ALL.len() {
            count += Self::count_of(Quantity::ALL[i]);
            i += 1;
        }
        count
    };

    /// All that a fit can free, in the order of the tables.
    pub const ALL: [Self; Self::COUNT] = {
        let mut all = [Self::new(Quantity::H, 0); Self::COUNT];
        let (mut count, mut i) = (0, 0);
        while i < Quantity::ALL.len() {
            let mut place = 0;
            while place < Self::count_of(Quantity::ALL[i]) {
                all[count] = Self::new(Quantity::ALL[i], place);
                (count, place) = (count + 1, place + 1);
            }
            i += 1;
        }
        all
    };

    /// Of a quantity, how many a fit can free.
    const fn count_of(quantity: Quantity) -> usize {
        let of = quantity.definition();
        if of.is_fitted { quantity.count() + of.sum_label.is_some() as usize } else { 0 }
    }

    pub(super) const fn new(quantity: Quantity, place: usize) -> Self {
        Self { quantity, place: place as u8 }
    }

    /// What it is a number of.
    #[inline]
    pub const fn quantity(self) -> Quantity {
        self.quantity
    }

    /// Its place in [`Parameter::ALL`].
    #[inline]
    const fn index(self) -> usize {
        debug_assert!(self.quantity.definition().is_fitted, "no fit frees it");
        Self::FIRST[self.quantity as usize] + self.place as usize
    }

    /// The place of each quantity's first number.
    const FIRST: [usize; Quantity::ALL.len()] = {
        let mut first = [0; Quantity::ALL.len()];
        let mut i = 1;
        while i < Quantity::ALL.len() {
            first[i] = first[i - 1] + Self::count_of(Quantity::ALL[i - 1]);
            i += 1;
        }
        first
    };

    /// The wheel or link that it is of; `None` of a number of the robot and of a sum.
    pub fn wheel_or_link(self) -> Option<usize> {
        let place = usize::from(self.place);
        (self.quantity.count() > 1 && place < self.quantity.count()).then_some(place)
    }

    fn names(self) -> &'static Names {
        static NAMES: LazyLock<Vec<Vec<Names>>> = LazyLock::new(|| {
            let of = |quantity: Quantity| quantity.parameters().map(Parameter::new_names).collect();
            Quantity::ALL.into_iter().map(of).collect()
        });
        &NAMES[self.quantity as usize][usize::from(self.place)]
    }

    fn new_names(self) -> Names {
        let (stem, of) = (self.quantity.stem(), self.quantity.definition());
        let unit = match of.unit {
            Unit::One => String::new(),
            unit => format!("_{}", unit.name()),
        };
        match (self.wheel_or_link(), of.sum_label) {
            (Some(i), _) => Names {
                column: format!("{stem}{i}{unit}"),
                key: format!("{stem}{i}"),
                label: format!("{} {i}", of.label),
            },
            (None, Some(label)) => Names {
                column: format!("{stem}_sum{unit}"),
                key: stem.to_owned(),
                label: label.to_owned(),
            },
            (None, None) => Names {
                column: self.quantity.name().to_owned(),
                key: stem.to_owned(),
                label: of.label.to_owned(),
            },
        }
    }

    /// Its column in tables.
    pub fn name(self) -> &'static str {
        &self.names().column
    }

    /// Its name in lists of the configuration.
    pub fn key(self) -> &'static str {
        &self.names().key
    }

    /// Its name on a figure's axis.
    pub fn label(self) -> &'static str {
        &self.names().label
    }

    /// Its symbol in LaTeX.
    pub fn latex(self) -> String {
        let symbol = self.quantity.definition().latex;
        match self.wheel_or_link() {
            Some(i) => format!("{symbol}_{i}"),
            None if self.is_sum() => {
                let each = (0..self.quantity.count()).map(|i| format!("{symbol}_{i}"));
                each.collect::<Vec<_>>().join(" + ")
            }
            None => symbol.to_owned(),
        }
    }

    /// The unit of its values, as people write it.
    pub const fn unit(self) -> &'static str {
        self.quantity.definition().unit.symbol()
    }

    /// The power of omega that goes with it: a motion is the same per radian of phase at another
    /// frequency where every parameter that fits can free has grown by its power of that.
    pub fn power_of_omega(self) -> f64 {
        match self.quantity.definition().unit {
            Unit::Newton | Unit::NewtonMetrePerRadian => 2.0,
            Unit::One => 0.0,
            _ => 1.0,
        }
    }

    /// Whether a value of it is one of `other` too: the same, or the sum that it is part of.
    pub fn is_part_of(self, other: Self) -> bool {
        self == other || other.is_sum() && self.quantity == other.quantity
    }

    /// The sum that it is a part of.
    pub fn sum(self) -> Option<Self> {
        let has_sum = self.quantity.definition().sum_label.is_some();
        (has_sum && !self.is_sum()).then(|| self.quantity.sum())
    }

    /// Whether it is the sum of others.
    #[inline]
    pub fn is_sum(self) -> bool {
        usize::from(self.place) == self.quantity.count()
    }

    /// Its value in a robot, in SI units.
    pub fn of(self, robot: &Robot) -> f64 {
        let numbers = self.quantity.numbers(robot);
        numbers.get(usize::from(self.place)).copied().unwrap_or_else(|| numbers.iter().sum())
    }

    /// Gives it a value in a robot, in SI units. Without any resistance to keep the proportions of, the
    /// wheels share a sum equally.
    pub fn set(self, robot: &mut Robot, value: f64) {
        match usize::from(self.place) {
            place if place < self.quantity.count() => {
                self.quantity.numbers_mut(robot)[place] = value;
            }
            _ => {
                let shares = self.quantity.shares(robot).map(|share| share * value);
                self.quantity.numbers_mut(robot).copy_from_slice(&shares);
            }
        }
    }
}

impl Named for Parameter {
    fn first() -> Self {
        Self::ALL[0]
    }

    fn as_name(&self) -> &str {
        self.name()
    }

    fn of_name(name: &str) -> Option<Self> {
        let mut all = Quantity::ALL.into_iter().flat_map(Quantity::parameters);
        all.find(|parameter| parameter.name() == name)
    }
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(self.name())
    }
}

/// By its name.
impl Serialize for Parameter {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for Parameter {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        let unknown = || serde::de::Error::custom(format!("unknown parameter `{name}`"));
        Self::of_name(&name).ok_or_else(unknown)
    }
}

/// Something for every parameter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ByParameter<T>([T; Parameter::ALL.len()]);

impl ByParameter<f64> {
    /// Every value missing.
    pub const MISSING: Self = Self::splat(f64::NAN);
}

impl<T: Copy> ByParameter<T> {
    /// The same for every parameter.
    pub const fn splat(value: T) -> Self {
        Self([value; Parameter::ALL.len()])
    }
}

impl<T> ByParameter<T> {
    /// What `of` gives for every parameter.
    pub fn from_fn(of: impl FnMut(Parameter) -> T) -> Self {
        Self(Parameter::ALL.map(of))
    }

    /// Values in the order of [`Parameter::ALL`].
    pub const fn from_array(values: [T; Parameter::ALL.len()]) -> Self {
        Self(values)
    }

    /// Values in the order of [`Parameter::ALL`].
    pub const fn as_array(&self) -> &[T; Parameter::ALL.len()] {
        &self.0
    }

    /// In the order of [`Parameter::ALL`].
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.0.iter_mut()
    }

    /// In the order of [`Parameter::ALL`].
    pub fn iter(&self) -> impl Iterator<Item = (Parameter, &T)> {
        Parameter::ALL.into_iter().zip(&self.0)
    }
}

impl<T> Index<Parameter> for ByParameter<T> {
    type Output = T;
    fn index(&self, parameter: Parameter) -> &T {
        &self.0[parameter.index()]
    }
}

impl<T> IndexMut<Parameter> for ByParameter<T> {
    fn index_mut(&mut self, parameter: Parameter) -> &mut T {
        &mut self.0[parameter.index()]
    }
}

/// A map by column.
impl<T: Serialize> Serialize for ByParameter<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.iter())
    }
}

#[cfg(test)]
mod tests {
    use trilink_base::Named;

    use super::*;

    #[test]
    fn a_parameter_that_is_set_has_its_value() {
        for parameter in Parameter::ALL {
            let mut robot = Robot::semi_passive();
            parameter.set(&mut robot, 2.5);
            assert_eq!(parameter.of(&robot), 2.5, "{parameter:?}");
            assert_eq!(Parameter::of_name(parameter.name()), Some(parameter));
            let others = Parameter::ALL.into_iter().filter(|other| {
                let related = [other.is_part_of(parameter), parameter.is_part_of(*other)];
                !related.contains(&true)
            });
            for other in others {
                assert_eq!(other.of(&robot), other.of(&Robot::semi_passive()), "{other:?}");
            }
        }
    }

    #[test]
    fn a_sum_of_roll_resistances_keeps_their_proportions() {
        let mut robot = Robot::kinematic();
        Quantity::Roll.sum().set(&mut robot, 2.4);
        assert_eq!(robot.roll_kg_s, [1.2, 0.6, 0.6]);
        robot.roll_kg_s = [0.0; 3];
        Quantity::Roll.sum().set(&mut robot, 2.4);
        assert_eq!(robot.roll_kg_s.map(|roll| (roll * 10.0).round()), [8.0; 3]);
    }
}
