//! SQL conditions on rows, parsed by `sqlparser` and evaluated on columns in three-valued logic: comparisons with a
//! missing value are neither true nor false.

use std::panic::resume_unwind;
use std::thread;

use polars::prelude::{
    BooleanChunked, ChunkApply, ChunkCompareEq, ChunkCompareIneq, ChunkFillNullValue, ChunkSet,
    DataFrame, DataType, IntoSeries, NamedFrom, PlSmallStr, PolarsResult, Series, polars_bail,
};
use sqlparser::ast::{
    BinaryOperator as Op, Expr, FunctionArg, FunctionArgExpr, FunctionArguments, UnaryOperator,
    Value as Literal, ValueWithSpan,
};
use sqlparser::dialect::GenericDialect;
use sqlparser::parser::{Parser, ParserError};
use sqlparser::tokenizer::{Token, Tokenizer};

use super::cells::comparable;
use super::columns::ColumnInfo;
use super::no_column;

/// Maximum length of a condition, bytes.
const MAX_BYTES: usize = 8000;
/// Maximum nesting depth of the terms in a condition (`a or b or c` nests, too), to limit the use of the stack.
const MAX_DEPTH: usize = 400;
/// Stack size of the parser's thread. The parser recurses up to 50 levels and uses about ten kilobytes for each, which
/// is more than the stack of a program's main thread on Windows.
const STACK_BYTES: usize = 16 << 20;
/// Supported operators, for error messages.
const SUPPORTED: &str =
    "and, or, not, comparisons, + - * / %, abs(..), is null, in (..), between, like";

/// Parsed condition, with all the words in it, some of which are column names.
pub(super) type Parsed = (Expr, Vec<String>);

/// Parses a condition on a thread with a sufficient stack.
///
/// # Errors
/// Returns a message if the condition is too long or its syntax is invalid.
pub(super) fn parse(text: &str) -> Result<Parsed, String> {
    if text.len() > MAX_BYTES {
        return Err(format!("found {} bytes, but at most {MAX_BYTES} are allowed", text.len()));
    }
    thread::scope(|scope| {
        let thread = thread::Builder::new().stack_size(STACK_BYTES);
        let parsed =
            thread.spawn_scoped(scope, || parse_on_this_thread(text)).map_err(|e| e.to_string())?;
        parsed.join().unwrap_or_else(|panic| resume_unwind(panic))
    })
}

fn parse_on_this_thread(text: &str) -> Result<Parsed, String> {
    let tokens =
        Tokenizer::new(&GenericDialect {}, text).tokenize().map_err(|error| error.to_string())?;
    let words = tokens.iter().filter_map(|token| match token {
        Token::Word(word) => Some(word.value.clone()),
        _ => None,
    });
    let words = words.collect();
    let mut parser = Parser::new(&GenericDialect {}).with_tokens(tokens);
    let parsed = parser.parse_expr().map_err(|error| match error {
        ParserError::TokenizerError(message) | ParserError::ParserError(message) => message,
        ParserError::RecursionLimitExceeded => "too many parentheses".to_owned(),
    })?;
    match parser.peek_token().token {
        Token::EOF => Ok((parsed, words)),
        other => Err(format!("found `{other}` after `{parsed}`, needed `and` or `or`")),
    }
}

/// Evaluates a condition to a mask of the rows of a frame, or to a single value if the condition is the same for all
/// rows.
///
/// # Errors
/// Returns an error if a column or operator is unknown, or if a term has the wrong type.
pub(super) fn mask(
    parsed: &Expr,
    known: &[ColumnInfo],
    frame: &DataFrame,
) -> PolarsResult<BooleanChunked> {
    Evaluator { known, frame, depth: 0 }.truth(parsed)
}

/// Evaluator for the terms of a condition. A term that is the same in all rows is a series with a single value.
struct Evaluator<'t> {
    known: &'t [ColumnInfo],
    frame: &'t DataFrame,
    depth: usize,
}

impl Evaluator<'_> {
    fn series(&mut self, expr: &Expr) -> PolarsResult<Series> {
        if self.depth == MAX_DEPTH {
            polars_bail!(
                ComputeError: "more than {MAX_DEPTH} terms; use fewer, for example with `in (..)`"
            );
        }
        self.depth += 1;
        let series = self.term(expr);
        self.depth -= 1;
        series
    }

    fn term(&mut self, expr: &Expr) -> PolarsResult<Series> {
        match expr {
            Expr::Nested(inner) => self.series(inner),
            Expr::Identifier(name) => self.column(&name.value, name.quote_style),
            Expr::Value(value) => literal(&value.value),
            Expr::BinaryOp { left, op, right } => self.binary(left, op, right),
            other => self.predicate(other),
        }
    }

    fn binary(&mut self, left: &Expr, op: &Op, right: &Expr) -> PolarsResult<Series> {
        let truth = match op {
            Op::And => self.truth(left)? & self.truth(right)?,
            Op::Or => self.truth(left)? | self.truth(right)?,
            Op::Modulo => return remainder(&self.number(left)?, &self.number(right)?),
            Op::Plus | Op::Minus | Op::Multiply | Op::Divide => {
                return arithmetic(&self.number(left)?, op, &self.number(right)?);
            }
            Op::Eq | Op::NotEq | Op::Lt | Op::LtEq | Op::Gt | Op::GtEq => {
                self.compare(left, op, right)?
            }
            _ => polars_bail!(ComputeError: "`{op}` is not supported; supported are {SUPPORTED}"),
        };
        Ok(truth.into_series())
    }

    fn predicate(&mut self, expr: &Expr) -> PolarsResult<Series> {
        let truth = match expr {
            Expr::UnaryOp { op: UnaryOperator::Plus, expr } => return self.number(expr),
            Expr::UnaryOp { op: UnaryOperator::Minus, expr } => {
                let zero = Series::new(PlSmallStr::EMPTY, [0_i64]);
                return arithmetic(&zero, &Op::Minus, &self.number(expr)?);
            }
            Expr::UnaryOp { op: UnaryOperator::Not, expr } => !self.truth(expr)?,
            Expr::Function(function) if function.name.to_string().eq_ignore_ascii_case("abs") => {
                let FunctionArguments::List(list) = &function.args else {
                    polars_bail!(ComputeError: "found `{function}`, needed abs(..) of a number");
                };
                let [FunctionArg::Unnamed(FunctionArgExpr::Expr(of))] = &list.args[..] else {
                    polars_bail!(ComputeError: "found `{function}`, needed abs(..) of a number");
                };
                return absolute(&self.number(of)?);
            }
            Expr::IsNull(of) => self.series(of)?.is_null(),
            Expr::IsNotNull(of) => self.series(of)?.is_not_null(),
            Expr::IsTrue(of) => self.truth(of)?.fill_null_with_values(false)?,
            Expr::IsNotTrue(of) => !self.truth(of)?.fill_null_with_values(false)?,
            Expr::IsFalse(of) => !self.truth(of)?.fill_null_with_values(true)?,
            Expr::IsNotFalse(of) => self.truth(of)?.fill_null_with_values(true)?,
            Expr::Between { expr, negated, low, high } => {
                let above = self.compare(expr, &Op::GtEq, low)?;
                not_if(*negated, above & self.compare(expr, &Op::LtEq, high)?)
            }
            Expr::InList { expr, list, negated } => {
                let none = BooleanChunked::new(PlSmallStr::EMPTY, [false]);
                let is_in = list.iter().try_fold(none, |is_in, item| {
                    PolarsResult::Ok(is_in | self.compare(expr, &Op::Eq, item)?)
                });
                not_if(*negated, is_in?)
            }
            Expr::Like { negated, any: false, expr, pattern, escape_char: None } => {
                not_if(*negated, self.like(expr, pattern, str::to_owned)?)
            }
            Expr::ILike { negated, any: false, expr, pattern, escape_char: None } => {
                not_if(*negated, self.like(expr, pattern, str::to_lowercase)?)
            }
            other => {
                polars_bail!(ComputeError: "`{other}` is not supported; supported are {SUPPORTED}")
            }
        };
        Ok(truth.into_series())
    }

    /// Compares two terms of the same kind. NaN is unequal to every value and has no order.
    fn compare(&mut self, left: &Expr, op: &Op, right: &Expr) -> PolarsResult<BooleanChunked> {
        let [one, other] = [self.series(left)?, self.series(right)?];
        let dtype = match (one.dtype(), other.dtype()) {
            (DataType::Null, dtype) | (dtype, DataType::Null) => dtype,
            (dtype, other) if dtype == other => dtype,
            (found, other) if kind(found) == kind(other) => &DataType::Float64,
            (found, other) => {
                let [left_kind, right_kind] = [found, other].map(kind);
                polars_bail!(
                    ComputeError:
                    "`{left}` is {left_kind}, but `{right}` is {right_kind}; both must be of the \
                     same kind"
                );
            }
        };
        let [one, other] = match as_integers([&one, &other], [0.0; 2]) {
            Some(integers) => integers,
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

    /// Returns, for each row, whether a string matches a pattern, in which `%` stands for any characters and `_` for
    /// one. The function `case` is applied to both the string and the pattern, for example to ignore case.
    fn like(
        &mut self,
        text: &Expr,
        pattern: &Expr,
        case: fn(&str) -> String,
    ) -> PolarsResult<BooleanChunked> {
        let text = self.of_kind(text, &DataType::String)?;
        // A pattern that is not text has an error of its own.
        drop(self.of_kind(pattern, &DataType::String)?);
        let Expr::Value(ValueWithSpan { value: Literal::SingleQuotedString(found), .. }) = pattern
        else {
            polars_bail!(ComputeError: "found `{pattern}`, needed a pattern such as 'kinematic%'");
        };
        let pattern = case(found);
        let matches = text.str()?.iter().map(|text| {
            text.map(|text| trilink_base::pattern::matches(&pattern, &case(text), ['%', '_']))
        });
        Ok(matches.collect())
    }

    fn truth(&mut self, expr: &Expr) -> PolarsResult<BooleanChunked> {
        Ok(self.of_kind(expr, &DataType::Boolean)?.bool()?.clone())
    }

    fn number(&mut self, expr: &Expr) -> PolarsResult<Series> {
        self.of_kind(expr, &DataType::Float64)
    }

    /// Evaluates a term and checks that it is of the same kind (boolean, number or text) as `needed`.
    fn of_kind(&mut self, expr: &Expr, needed: &DataType) -> PolarsResult<Series> {
        let series = self.series(expr)?;
        let found = kind(series.dtype());
        let needed_kind = kind(needed);
        match series.dtype() {
            DataType::Null => series.cast(needed),
            _ if found == needed_kind => Ok(series),
            _ => polars_bail!(ComputeError: "`{expr}` is {found}, but must be {needed_kind}"),
        }
    }

    fn column(&self, name: &str, quote: Option<char>) -> PolarsResult<Series> {
        let message = match self.known.iter().find(|column| column.name == name) {
            Some(column) if column.dtype.is_some() => {
                return comparable(self.frame.column(name)?.as_materialized_series());
            }
            Some(column) => {
                format!("column `{name}`: values of type {} cannot be compared", column.type_name)
            }
            None if quote == Some('"') => {
                format!("no column \"{name}\": write text in single quotes, '{name}'")
            }
            None => no_column(name, self.known),
        };
        polars_bail!(ComputeError: "{message}")
    }
}

/// Returns the name of a type as it appears in messages.
fn kind(dtype: &DataType) -> &'static str {
    match dtype {
        DataType::Boolean => "a boolean",
        DataType::String => "text",
        _ => "a number",
    }
}

fn literal(literal: &Literal) -> PolarsResult<Series> {
    let name = PlSmallStr::EMPTY;
    Ok(match literal {
        Literal::Number(digits, _) => {
            if let Ok(whole) = digits.parse::<i64>() {
                Series::new(name, [whole])
            } else if let Ok(whole) = digits.parse::<u64>() {
                Series::new(name, [whole])
            } else if let Ok(number) = digits.parse::<f64>() {
                Series::new(name, [number])
            } else {
                polars_bail!(ComputeError: "found `{digits}`, needed a number")
            }
        }
        Literal::SingleQuotedString(text) => Series::new(name, [text.as_str()]),
        Literal::Boolean(boolean) => Series::new(name, [*boolean]),
        Literal::Null => Series::new_null(name, 1),
        other => {
            polars_bail!(ComputeError: "`{other}` is not supported; supported are {SUPPORTED}")
        }
    })
}

fn not_if(negated: bool, truth: BooleanChunked) -> BooleanChunked {
    if negated { !truth } else { truth }
}

/// Adds, subtracts, multiplies or divides two columns. Uses integers if both columns are integers, the operation is not
/// a division and the result fits an integer type; otherwise uses floats. A division by zero gives a missing value.
fn arithmetic(one: &Series, op: &Op, other: &Series) -> PolarsResult<Series> {
    let calculate = |[one, other]: [&Series; 2]| match op {
        Op::Plus => one + other,
        Op::Minus => one - other,
        Op::Multiply => one * other,
        _ => one / other,
    };
    let [float, mut divisor] = [one.cast(&DataType::Float64)?, other.cast(&DataType::Float64)?];
    if *op == Op::Divide {
        let numbers = divisor.f64()?;
        divisor = numbers.set(&numbers.equal(0.0), None)?.into_series();
        return calculate([&float, &divisor]);
    }
    let rounded = calculate([&float, &divisor])?;
    let range = [rounded.min::<f64>()?, rounded.max::<f64>()?].map(Option::unwrap_or_default);
    match as_integers([one, other], range) {
        Some([one, other]) => calculate([&one, &other]),
        None => Ok(rounded),
    }
}

/// Returns the remainder of a division, with the sign of the dividend as in SQL.
fn remainder(one: &Series, other: &Series) -> PolarsResult<Series> {
    let quotient = arithmetic(one, &Op::Divide, other)?.f64()?.apply_values(f64::trunc);
    let quotient = quotient.into_series();
    let is_whole = [one, other].iter().all(|series| series.dtype().is_integer());
    let quotient = if is_whole { quotient.cast(&DataType::Int64)? } else { quotient };
    arithmetic(one, &Op::Minus, &arithmetic(other, &Op::Multiply, &quotient)?)
}

fn absolute(series: &Series) -> PolarsResult<Series> {
    if let Some([integers, _]) = as_integers([series, series], [0.0; 2]) {
        let is_signed = *integers.dtype() == DataType::Int64;
        return Ok(if is_signed {
            integers.i64()?.apply_values(i64::saturating_abs).into_series()
        } else {
            integers
        });
    }
    Ok(series.cast(&DataType::Float64)?.f64()?.apply_values(f64::abs).into_series())
}

/// Casts two integer columns to an integer type that holds their values and all numbers from `min` to `max`; `None` if
/// a column is not of integers or there is no such type. The limits of the types are rounded towards zero, because
/// `min` and `max` are themselves rounded.
fn as_integers(columns: [&Series; 2], [min, max]: [f64; 2]) -> Option<[Series; 2]> {
    let types =
        [(DataType::Int64, -9.223372e18, 9.223372e18), (DataType::UInt64, 0.0, 1.8446744e19)];
    types.into_iter().find_map(|(dtype, low, high)| {
        let [one, other] = columns.map(|series| {
            if series.dtype().is_integer() { series.strict_cast(&dtype).ok() } else { None }
        });
        (low <= min && max <= high).then_some([one?, other?])
    })
}
