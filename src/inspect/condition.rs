//! Conditions on rows, parsed by `sqlparser`, in SQL's logic: what is missing is neither true nor
//! false.

use polars::prelude::{
    BooleanChunked, ChunkCompareEq, ChunkCompareIneq, ChunkFillNullValue, ChunkSet, DataFrame,
    DataType, IntoSeries, NamedFrom, PlSmallStr, PolarsResult, Series, polars_bail,
};
use sqlparser::ast::{BinaryOperator as Op, Expr, UnaryOperator, Value as Literal};
use sqlparser::dialect::GenericDialect;
use sqlparser::parser::{Parser, ParserError};
use sqlparser::tokenizer::Token;

use super::cells::comparable;
use super::columns::{ColumnInfo, Kind};
use super::no_column;

/// Bytes of a condition.
const LONGEST: usize = 8000;
/// Terms that lie within one another, as those of `a or b or c` do; thousands would not fit on
/// the stack.
const DEEPEST: usize = 400;
const KNOWN: &str = "and, or, not, comparisons, + - * /, is null, in (..), between, like";

/// A condition that fits a table.
#[derive(Debug)]
pub(super) struct Condition<'t> {
    parsed: Expr,
    known: &'t [ColumnInfo],
    /// Columns that it looks at.
    pub columns: Vec<String>,
}

impl<'t> Condition<'t> {
    /// Parses a condition on rows with these columns.
    ///
    /// # Errors
    /// A sentence on what is not understood, not known, or of the wrong kind.
    pub fn parse(text: &str, known: &'t [ColumnInfo]) -> Result<Self, String> {
        if text.len() > LONGEST {
            return Err(format!("found {} bytes, needed {LONGEST} at most", text.len()));
        }
        let plain = |error| match error {
            ParserError::TokenizerError(message) | ParserError::ParserError(message) => message,
            ParserError::RecursionLimitExceeded => "too many parentheses".to_owned(),
        };
        let mut parser = Parser::new(&GenericDialect {}).try_with_sql(text).map_err(plain)?;
        let parsed = parser.parse_expr().map_err(plain)?;
        match parser.peek_token().token {
            Token::EOF => {}
            other => return Err(format!("found `{other}` after `{parsed}`, needed and, or")),
        }
        // Without rows, it says what it needs.
        let frame = DataFrame::empty();
        let mut evaluator = Evaluator { known, frame: &frame, used: Vec::new(), depth: 0 };
        evaluator.truth(&parsed).map_err(|error| error.to_string())?;
        let columns = evaluator.used;
        Ok(Self { parsed, known, columns })
    }

    /// For which rows of a frame with [`Condition::columns`] it is true; a single value if for all
    /// or none.
    pub fn mask(&self, frame: &DataFrame) -> PolarsResult<BooleanChunked> {
        Evaluator { known: self.known, frame, used: Vec::new(), depth: 0 }.truth(&self.parsed)
    }
}

/// Evaluates terms of a condition as columns; what is the same in all rows is a single value.
struct Evaluator<'t> {
    known: &'t [ColumnInfo],
    /// A column that it lacks is taken to have no rows.
    frame: &'t DataFrame,
    used: Vec<String>,
    depth: usize,
}

impl Evaluator<'_> {
    fn series(&mut self, expr: &Expr) -> PolarsResult<Series> {
        if self.depth == DEEPEST {
            polars_bail!(ComputeError: "more than {DEEPEST} terms; needed fewer, such as `in (..)`");
        }
        self.depth += 1;
        let series = self.term(expr);
        self.depth -= 1;
        series
    }

    fn term(&mut self, expr: &Expr) -> PolarsResult<Series> {
        let truth = match expr {
            Expr::Nested(inner) => return self.series(inner),
            Expr::Identifier(name) => return self.column(&name.value, name.quote_style),
            Expr::Value(value) => return literal(&value.value),
            Expr::UnaryOp { op: UnaryOperator::Plus, expr } => {
                return self.of_kind(expr, Kind::Number);
            }
            Expr::UnaryOp { op: UnaryOperator::Minus, expr } => {
                let zero = Series::new(PlSmallStr::EMPTY, [0_i64]);
                return arithmetic(&zero, &Op::Minus, &self.of_kind(expr, Kind::Number)?);
            }
            Expr::BinaryOp { left, op, right } => return self.binary(left, op, right),
            Expr::UnaryOp { op: UnaryOperator::Not, expr } => !self.truth(expr)?,
            Expr::IsNull(of) => self.series(of)?.is_null(),
            Expr::IsNotNull(of) => self.series(of)?.is_not_null(),
            Expr::IsTrue(of) => self.truth(of)?.fill_null_with_values(false)?,
            Expr::IsNotTrue(of) => !self.truth(of)?.fill_null_with_values(false)?,
            Expr::IsFalse(of) => !self.truth(of)?.fill_null_with_values(true)?,
            Expr::IsNotFalse(of) => self.truth(of)?.fill_null_with_values(true)?,
            Expr::Between { expr, negated, low, high } => {
                let one = self.series(expr)?;
                let low = self.compare(expr, &one, &Op::GtEq, low)?;
                not_if(*negated, low & self.compare(expr, &one, &Op::LtEq, high)?)
            }
            Expr::InList { expr, list, negated } => {
                let one = self.series(expr)?;
                let mut is_in = BooleanChunked::new(PlSmallStr::EMPTY, [false]);
                for item in list {
                    is_in = is_in | self.compare(expr, &one, &Op::Eq, item)?;
                }
                not_if(*negated, is_in)
            }
            Expr::Like { negated, any: false, expr, pattern, escape_char: None } => {
                not_if(*negated, self.like(expr, pattern, str::to_owned)?)
            }
            Expr::ILike { negated, any: false, expr, pattern, escape_char: None } => {
                not_if(*negated, self.like(expr, pattern, str::to_lowercase)?)
            }
            other => polars_bail!(ComputeError: "`{other}` is not supported: {KNOWN}"),
        };
        Ok(truth.into_series())
    }

    fn binary(&mut self, left: &Expr, op: &Op, right: &Expr) -> PolarsResult<Series> {
        let truth = match op {
            Op::Eq | Op::NotEq | Op::Lt | Op::LtEq | Op::Gt | Op::GtEq => {
                let one = self.series(left)?;
                self.compare(left, &one, op, right)?
            }
            Op::And => self.truth(left)? & self.truth(right)?,
            Op::Or => self.truth(left)? | self.truth(right)?,
            Op::Plus | Op::Minus | Op::Multiply | Op::Divide => {
                let one = self.of_kind(left, Kind::Number)?;
                return arithmetic(&one, op, &self.of_kind(right, Kind::Number)?);
            }
            other => polars_bail!(ComputeError: "`{other}` is not supported: {KNOWN}"),
        };
        Ok(truth.into_series())
    }

    fn compare(
        &mut self,
        left: &Expr,
        one: &Series,
        op: &Op,
        right: &Expr,
    ) -> PolarsResult<BooleanChunked> {
        let other = self.series(right)?;
        match (Kind::of(one.dtype()), Kind::of(other.dtype())) {
            (Some(kind), Some(other)) if kind != other => polars_bail!(
                ComputeError: "`{left}` is {} and `{right}` is {}, needed two of a kind",
                kind.name(), other.name()
            ),
            _ => compare(one, op, &other),
        }
    }

    /// Whether a text is as a pattern says: `%` stands for any characters, `_` for one.
    fn like(
        &mut self,
        of: &Expr,
        pattern: &Expr,
        case: fn(&str) -> String,
    ) -> PolarsResult<BooleanChunked> {
        let text = self.of_kind(of, Kind::Text)?;
        let found = self.of_kind(pattern, Kind::Text)?;
        let Some(found) = found.str()?.iter().next().flatten() else {
            polars_bail!(ComputeError: "found `{pattern}`, needed a pattern such as 'kinematic%'");
        };
        let pattern = case(found);
        let is_like = |text: &str| crate::pattern::matches(&pattern, &case(text), ['%', '_']);
        Ok(text.str()?.iter().map(|text| text.map(is_like)).collect())
    }

    fn truth(&mut self, expr: &Expr) -> PolarsResult<BooleanChunked> {
        Ok(self.of_kind(expr, Kind::Boolean)?.bool()?.clone())
    }

    fn of_kind(&mut self, expr: &Expr, needed: Kind) -> PolarsResult<Series> {
        let series = self.series(expr)?;
        match Kind::of(series.dtype()) {
            None => series.cast(&needed.dtype()),
            Some(kind) if kind == needed => Ok(series),
            Some(kind) => {
                polars_bail!(ComputeError: "`{expr}` is {}, needed {}", kind.name(), needed.name())
            }
        }
    }

    fn column(&mut self, name: &str, quote: Option<char>) -> PolarsResult<Series> {
        let Some(column) = self.known.iter().find(|column| column.name == name) else {
            if quote == Some('"') {
                polars_bail!(
                    ComputeError: "no column \"{name}\": text stands in single quotes, '{name}'"
                );
            }
            polars_bail!(ComputeError: "{}", no_column(name, self.known));
        };
        let Some(kind) = column.kind else {
            polars_bail!(
                ComputeError: "column `{name}`: {} cannot be compared", column.type_name
            );
        };
        self.used.push(name.to_owned());
        match self.frame.column(name) {
            Ok(column) => comparable(column.as_materialized_series()),
            Err(_) => Ok(Series::new_empty(name.into(), &kind.dtype())),
        }
    }
}

fn literal(literal: &Literal) -> PolarsResult<Series> {
    let name = PlSmallStr::EMPTY;
    Ok(match literal {
        Literal::Number(digits, _) => match (digits.parse::<i64>(), digits.parse::<u64>()) {
            (Ok(whole), _) => Series::new(name, [whole]),
            (_, Ok(whole)) => Series::new(name, [whole]),
            _ => match digits.parse::<f64>() {
                Ok(number) => Series::new(name, [number]),
                Err(_) => polars_bail!(ComputeError: "found `{digits}`, needed a number"),
            },
        },
        Literal::SingleQuotedString(text) => Series::new(name, [text.as_str()]),
        Literal::Boolean(boolean) => Series::new(name, [*boolean]),
        Literal::Null => Series::new_null(name, 1),
        other => polars_bail!(ComputeError: "`{other}` is not supported: {KNOWN}"),
    })
}

fn not_if(negated: bool, truth: BooleanChunked) -> BooleanChunked {
    if negated { !truth } else { truth }
}

/// Compares two columns of a kind. NaN differs from everything and has no order.
fn compare(one: &Series, op: &Op, other: &Series) -> PolarsResult<BooleanChunked> {
    let dtype = match (one.dtype(), other.dtype()) {
        (DataType::Null, dtype) | (dtype, DataType::Null) => dtype,
        (dtype, other) if dtype == other => dtype,
        _ => &DataType::Float64,
    };
    let wholes = [DataType::Int64, DataType::UInt64];
    let exact = wholes.iter().find_map(|whole| both_whole(one, other, whole));
    let [one, other] = match exact {
        Some(wholes) => wholes,
        None => [one.cast(dtype)?, other.cast(dtype)?],
    };
    let truth = match op {
        Op::Eq => one.equal(&other)?,
        Op::NotEq => one.not_equal(&other)?,
        Op::Lt => one.lt(&other)?,
        Op::LtEq => one.lt_eq(&other)?,
        Op::Gt => one.gt(&other)?,
        _ => one.gt_eq(&other)?,
    };
    if !one.dtype().is_float() {
        return Ok(truth);
    }
    let unordered = (one.is_nan()? | other.is_nan()?) & truth.is_not_null();
    truth.set(&unordered, Some(*op == Op::NotEq))
}

/// Whole numbers stay whole but for a quotient and for what no type holds; what is divided by
/// zero is missing.
fn arithmetic(one: &Series, op: &Op, other: &Series) -> PolarsResult<Series> {
    let calculate = |one: &Series, other: &Series| match op {
        Op::Plus => one + other,
        Op::Minus => one - other,
        Op::Multiply => one * other,
        _ => one / other,
    };
    let mut divisor = other.cast(&DataType::Float64)?;
    if *op == Op::Divide {
        let numbers = divisor.f64()?;
        divisor = numbers.set(&numbers.equal(0.0), None)?.into_series();
    }
    let result = calculate(&one.cast(&DataType::Float64)?, &divisor)?;
    let least = result.min::<f64>()?.unwrap_or(0.0);
    let greatest = result.max::<f64>()?.unwrap_or(0.0);
    // A little less than the types hold: the result is rounded.
    let wholes =
        [(DataType::Int64, -9.223_372e18, 9.223_372e18), (DataType::UInt64, 0.0, 1.8446744e19)];
    for (whole, low, high) in wholes {
        if *op != Op::Divide
            && least >= low
            && greatest <= high
            && let Some([one, other]) = both_whole(one, other, &whole)
        {
            return calculate(&one, &other);
        }
    }
    Ok(result)
}

/// Two columns as whole numbers of a type, if they are whole and it holds them.
fn both_whole(one: &Series, other: &Series, whole: &DataType) -> Option<[Series; 2]> {
    let cast = |series: &Series| match series.dtype().is_integer() {
        true => series.strict_cast(whole).ok(),
        false => None,
    };
    Some([cast(one)?, cast(other)?])
}
