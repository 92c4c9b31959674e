//! What a condition says of a row, in SQL's logic: what is missing is neither true nor false.

use std::borrow::Cow;
use std::cmp::Ordering;

use super::value::Value;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Comparison {
    Equal,
    NotEqual,
    Less,
    AtMost,
    Greater,
    AtLeast,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arithmetic {
    Plus,
    Minus,
    Times,
    Over,
}

/// A part of a condition.
#[derive(Debug, Clone)]
pub enum Node {
    Literal(Value),
    /// The row's cell in one of the condition's columns; of a list its text.
    Column(usize),
    ListText(usize),
    Not(Box<Node>),
    And(Box<Node>, Box<Node>),
    Or(Box<Node>, Box<Node>),
    /// Whether one of these holds.
    Any(Vec<Node>),
    Compare(Comparison, Box<Node>, Box<Node>),
    Arithmetic(Arithmetic, Box<Node>, Box<Node>),
    IsMissing(Box<Node>),
    /// Whether it is this; what is missing is not.
    Is(bool, Box<Node>),
    Like {
        of: Box<Node>,
        pattern: String,
        any_case: bool,
    },
}

impl Node {
    /// Its value for a row of which `cell` gives the cells.
    pub fn value<'t>(&'t self, cell: &dyn Fn(usize) -> &'t Value) -> Cow<'t, Value> {
        let truth = |node: &'t Self| match *node.value(cell) {
            Value::Boolean(boolean) => Some(boolean),
            _ => None,
        };
        let boolean = |truth: Option<bool>| truth.map_or(Value::Missing, Value::Boolean);
        let value = match self {
            Self::Literal(value) => return Cow::Borrowed(value),
            Self::Column(place) => return Cow::Borrowed(cell(*place)),
            Self::ListText(place) => match cell(*place) {
                Value::Missing => Value::Missing,
                list => Value::Text(list.text()),
            },
            Self::Not(node) => boolean(truth(node).map(|holds| !holds)),
            Self::And(one, other) => boolean(all([truth(one), truth(other)])),
            Self::Or(one, other) => boolean(any([truth(one), truth(other)])),
            Self::Any(nodes) => boolean(any(nodes.iter().map(truth))),
            Self::Compare(how, one, other) => {
                let (one, other) = (one.value(cell), other.value(cell));
                let is_missing = *one == Value::Missing || *other == Value::Missing;
                boolean((!is_missing).then(|| how.holds(one.compare(&other))))
            }
            Self::Arithmetic(how, one, other) => how.value(&one.value(cell), &other.value(cell)),
            Self::IsMissing(node) => Value::Boolean(*node.value(cell) == Value::Missing),
            Self::Is(value, node) => Value::Boolean(truth(node) == Some(*value)),
            Self::Like { of, pattern, any_case } => match &*of.value(cell) {
                Value::Text(text) if *any_case => {
                    Value::Boolean(is_like(&pattern.to_lowercase(), &text.to_lowercase()))
                }
                Value::Text(text) => Value::Boolean(is_like(pattern, text)),
                _ => Value::Missing,
            },
        };
        Cow::Owned(value)
    }
}

/// Whether all hold: not if one does not, whatever is missing.
fn all(truths: [Option<bool>; 2]) -> Option<bool> {
    any(truths.map(|truth| truth.map(|holds| !holds))).map(|any| !any)
}

/// Whether one holds: so if one does, whatever is missing.
fn any(truths: impl IntoIterator<Item = Option<bool>>) -> Option<bool> {
    let mut is_known = true;
    for truth in truths {
        match truth {
            Some(true) => return Some(true),
            Some(false) => {}
            None => is_known = false,
        }
    }
    is_known.then_some(false)
}

impl Comparison {
    /// Whether it holds for values in this order; values without one are NaN.
    fn holds(self, order: Option<Ordering>) -> bool {
        let Some(order) = order else { return self == Self::NotEqual };
        match self {
            Self::Equal => order.is_eq(),
            Self::NotEqual => order.is_ne(),
            Self::Less => order.is_lt(),
            Self::AtMost => order.is_le(),
            Self::Greater => order.is_gt(),
            Self::AtLeast => order.is_ge(),
        }
    }
}

impl Arithmetic {
    /// Whole numbers stay whole but for a quotient; what is divided by zero is missing.
    fn value(self, one: &Value, other: &Value) -> Value {
        if let (Value::Whole(one), Value::Whole(other)) = (one, other) {
            let whole = match self {
                Self::Plus => one.checked_add(*other),
                Self::Minus => one.checked_sub(*other),
                Self::Times => one.checked_mul(*other),
                Self::Over => None,
            };
            if let Some(whole) = whole {
                return Value::Whole(whole);
            }
        }
        let (Some(one), Some(other)) = (one.number(), other.number()) else {
            return Value::Missing;
        };
        match self {
            Self::Plus => Value::Number(one + other),
            Self::Minus => Value::Number(one - other),
            Self::Times => Value::Number(one * other),
            Self::Over if other == 0.0 => Value::Missing,
            Self::Over => Value::Number(one / other),
        }
    }
}

/// Whether a text is as a pattern says: `%` stands for any characters, `_` for one.
fn is_like(pattern: &str, text: &str) -> bool {
    crate::pattern::matches(pattern, text, ['%', '_'])
}
