//! Cells of any table, and how they compare.

use std::cmp::Ordering;

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Boolean,
    /// Whole or not.
    Number,
    Text,
    List,
}

impl Kind {
    /// As messages name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Boolean => "a boolean",
            Self::Number => "a number",
            Self::Text => "text",
            Self::List => "a list",
        }
    }
}

/// A cell.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    Missing,
    Boolean(bool),
    Whole(i128),
    Number(f64),
    Text(String),
    List(Vec<Value>),
}

impl Value {
    /// As a number, if it is one.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Whole(whole) => Some(*whole as f64),
            Self::Number(number) => Some(*number),
            _ => None,
        }
    }

    /// In full, as CSV has it; what is missing is empty, a list's parts stand between commas.
    pub fn text(&self) -> String {
        match self {
            Self::Missing => String::new(),
            Self::Boolean(boolean) => boolean.to_string(),
            Self::Whole(whole) => whole.to_string(),
            Self::Number(number) => full(*number),
            Self::Text(text) => text.clone(),
            Self::List(list) => list.iter().map(Self::text).collect::<Vec<_>>().join(", "),
        }
    }

    /// Two values of a kind; `None` if one is missing or no number, or they are of two kinds.
    pub fn compare(&self, other: &Self) -> Option<Ordering> {
        match (self, other) {
            (Self::Boolean(one), Self::Boolean(other)) => Some(one.cmp(other)),
            (Self::Whole(one), Self::Whole(other)) => Some(one.cmp(other)),
            (Self::Text(one), Self::Text(other)) => Some(one.cmp(other)),
            (Self::List(_), Self::List(_)) => Some(self.text().cmp(&other.text())),
            _ => self.number()?.partial_cmp(&other.number()?),
        }
    }

    /// The order of sorted rows, downwards if `descending`; NaN and then what is missing come
    /// last either way.
    pub fn order(&self, other: &Self, descending: bool) -> Ordering {
        let rank = |value: &Self| match value {
            Self::Missing => 2,
            Self::Number(number) if number.is_nan() => 1,
            _ => 0,
        };
        let order = self.compare(other).unwrap_or(Ordering::Equal);
        let order = if descending { order.reverse() } else { order };
        rank(self).cmp(&rank(other)).then(order)
    }
}

/// A number that reads back as the same.
fn full(number: f64) -> String {
    match number == 0.0 || (1e-5..1e16).contains(&number.abs()) || !number.is_finite() {
        true => number.to_string(),
        false => format!("{number:e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_comes_last_upwards_and_downwards() {
        let values = [
            Value::Missing,
            Value::Number(2.5),
            Value::Whole(3),
            Value::Number(f64::NAN),
            Value::Whole(-1),
        ];
        for (descending, expected) in [(false, "-1 2.5 3 NaN "), (true, "3 2.5 -1 NaN ")] {
            let mut sorted = values.clone();
            sorted.sort_by(|one, other| one.order(other, descending));
            let texts: Vec<String> = sorted.iter().map(Value::text).collect();
            assert_eq!(texts.join(" "), expected);
        }
    }

    #[test]
    fn numbers_in_full_read_back_as_the_same() {
        for number in [0.1, -1.0 / 3.0, 1e-300, 6.02e23, 12.0, 0.0, 1.5e-7] {
            assert_eq!(full(number).parse(), Ok(number));
        }
        assert_eq!(full(1.5e-7), "1.5e-7");
        assert_eq!(full(663.466), "663.466");
    }
}
