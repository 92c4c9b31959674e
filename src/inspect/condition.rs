//! Conditions on rows: parsed by `sqlparser`, checked against a table's columns.

use sqlparser::ast::{BinaryOperator, Expr, UnaryOperator, Value as Literal};
use sqlparser::dialect::GenericDialect;
use sqlparser::parser::{Parser, ParserError};
use sqlparser::tokenizer::Token;

use super::columns::ColumnInfo;
use super::evaluate::{Arithmetic, Comparison, Node};
use super::value::{Kind, Value};
use crate::config::nearest;

/// Bytes of a condition.
const LONGEST: usize = 8000;
/// Terms that lie within one another, as those of `a or b or c` do; thousands would not fit on
/// the stack.
const DEEPEST: usize = 400;

/// A condition that fits a table.
#[derive(Debug, Clone)]
pub struct Condition {
    node: Node,
    /// Columns that it looks at, in the order of [`Condition::holds`]' cells.
    pub columns: Vec<String>,
}

/// A node and what it gives; `None` is the kind of `null`.
type Typed = (Node, Option<Kind>);

impl Condition {
    /// Parses a condition on rows with these columns.
    ///
    /// # Errors
    /// A sentence on what is not understood, not known, or of the wrong kind.
    pub fn parse(text: &str, columns: &[ColumnInfo]) -> Result<Self, String> {
        if text.len() > LONGEST {
            return Err(format!("found {} bytes, needed {LONGEST} at most", text.len()));
        }
        let mut parser = Parser::new(&GenericDialect {}).try_with_sql(text).map_err(plain)?;
        let parsed = parser.parse_expr().map_err(plain)?;
        match parser.peek_token().token {
            Token::EOF => {}
            other => return Err(format!("found `{other}` after `{parsed}`, needed and, or")),
        }
        let mut checker = Checker { columns, used: Vec::new(), depth: 0 };
        let node = checker.of_kind(&parsed, Kind::Boolean)?;
        Ok(Self { node, columns: checker.used })
    }

    /// Whether it holds for a row; `cell` gives the row's cell of one of [`Condition::columns`].
    pub fn holds<'t>(&'t self, cell: &dyn Fn(usize) -> &'t Value) -> bool {
        matches!(*self.node.value(cell), Value::Boolean(true))
    }
}

fn plain(error: ParserError) -> String {
    match error {
        ParserError::TokenizerError(message) | ParserError::ParserError(message) => message,
        ParserError::RecursionLimitExceeded => "too many parentheses".to_owned(),
    }
}

struct Checker<'t> {
    columns: &'t [ColumnInfo],
    used: Vec<String>,
    depth: usize,
}

impl Checker<'_> {
    fn typed(&mut self, expr: &Expr) -> Result<Typed, String> {
        if self.depth == DEEPEST {
            return Err(format!("more than {DEEPEST} terms; needed fewer, such as `in (..)`"));
        }
        self.depth += 1;
        let typed = self.term(expr);
        self.depth -= 1;
        typed
    }

    fn term(&mut self, expr: &Expr) -> Result<Typed, String> {
        let boolean = |node| Ok((node, Some(Kind::Boolean)));
        match expr {
            Expr::Nested(inner) => self.typed(inner),
            Expr::Identifier(name) => self.column(&name.value, name.quote_style),
            Expr::Value(value) => literal(&value.value),
            Expr::UnaryOp { op: UnaryOperator::Not, expr } => {
                boolean(Node::Not(self.of_kind(expr, Kind::Boolean)?.into()))
            }
            Expr::UnaryOp { op: UnaryOperator::Plus, expr } => {
                Ok((self.of_kind(expr, Kind::Number)?, Some(Kind::Number)))
            }
            Expr::UnaryOp { op: UnaryOperator::Minus, expr } => {
                let zero = Node::Literal(Value::Whole(0));
                let number = self.of_kind(expr, Kind::Number)?;
                let node = Node::Arithmetic(Arithmetic::Minus, zero.into(), number.into());
                Ok((node, Some(Kind::Number)))
            }
            Expr::BinaryOp { left, op, right } => self.binary(left, op, right),
            Expr::IsNull(of) => boolean(Node::IsMissing(self.typed(of)?.0.into())),
            Expr::IsNotNull(of) => {
                boolean(Node::Not(Node::IsMissing(self.typed(of)?.0.into()).into()))
            }
            Expr::IsTrue(of) => self.is(of, true, false),
            Expr::IsNotTrue(of) => self.is(of, true, true),
            Expr::IsFalse(of) => self.is(of, false, false),
            Expr::IsNotFalse(of) => self.is(of, false, true),
            Expr::Between { expr, negated, low, high } => {
                let low = self.compare(expr, Comparison::AtLeast, low)?;
                let high = self.compare(expr, Comparison::AtMost, high)?;
                boolean(not_if(*negated, Node::And(low.into(), high.into())))
            }
            Expr::InList { expr, list, negated } => {
                let equal =
                    |checker: &mut Self, one: &Expr| checker.compare(expr, Comparison::Equal, one);
                let nodes = list.iter().map(|one| equal(self, one)).collect::<Result<_, _>>()?;
                boolean(not_if(*negated, Node::Any(nodes)))
            }
            Expr::Like { negated, any: false, expr, pattern, escape_char: None } => {
                self.like(expr, pattern, *negated, false)
            }
            Expr::ILike { negated, any: false, expr, pattern, escape_char: None } => {
                self.like(expr, pattern, *negated, true)
            }
            other => Err(format!("`{other}` is not supported: {KNOWN}")),
        }
    }

    fn binary(&mut self, left: &Expr, op: &BinaryOperator, right: &Expr) -> Result<Typed, String> {
        use BinaryOperator as Op;
        let comparison = match op {
            Op::Eq => Comparison::Equal,
            Op::NotEq => Comparison::NotEqual,
            Op::Lt => Comparison::Less,
            Op::LtEq => Comparison::AtMost,
            Op::Gt => Comparison::Greater,
            Op::GtEq => Comparison::AtLeast,
            Op::And | Op::Or => {
                let one = self.of_kind(left, Kind::Boolean)?.into();
                let other = self.of_kind(right, Kind::Boolean)?.into();
                let is_and = *op == Op::And;
                let node = if is_and { Node::And(one, other) } else { Node::Or(one, other) };
                return Ok((node, Some(Kind::Boolean)));
            }
            Op::Plus | Op::Minus | Op::Multiply | Op::Divide => {
                let arithmetic = match op {
                    Op::Plus => Arithmetic::Plus,
                    Op::Minus => Arithmetic::Minus,
                    Op::Multiply => Arithmetic::Times,
                    _ => Arithmetic::Over,
                };
                let one = self.of_kind(left, Kind::Number)?.into();
                let other = self.of_kind(right, Kind::Number)?.into();
                return Ok((Node::Arithmetic(arithmetic, one, other), Some(Kind::Number)));
            }
            other => return Err(format!("`{other}` is not supported: {KNOWN}")),
        };
        Ok((self.compare(left, comparison, right)?, Some(Kind::Boolean)))
    }

    fn compare(&mut self, left: &Expr, how: Comparison, right: &Expr) -> Result<Node, String> {
        let (one, kind) = self.typed(left)?;
        let (other, other_kind) = self.typed(right)?;
        if let (Some(kind), Some(other_kind)) = (kind, other_kind)
            && kind != other_kind
        {
            let (name, other_name) = (kind.name(), other_kind.name());
            return Err(format!(
                "`{left}` is {name} and `{right}` is {other_name}, needed two of a kind"
            ));
        }
        Ok(Node::Compare(how, one.into(), other.into()))
    }

    fn is(&mut self, of: &Expr, value: bool, negated: bool) -> Result<Typed, String> {
        let node = self.of_kind(of, Kind::Boolean)?;
        Ok((not_if(negated, Node::Is(value, node.into())), Some(Kind::Boolean)))
    }

    fn like(
        &mut self,
        of: &Expr,
        pattern: &Expr,
        negated: bool,
        any_case: bool,
    ) -> Result<Typed, String> {
        let node = self.of_kind(of, Kind::Text)?;
        let pattern = match self.of_kind(pattern, Kind::Text)? {
            Node::Literal(Value::Text(pattern)) => pattern,
            _ => return Err(format!("found `{pattern}`, needed a pattern such as 'kinematic%'")),
        };
        let node = Node::Like { of: node.into(), pattern, any_case };
        Ok((not_if(negated, node), Some(Kind::Boolean)))
    }

    fn of_kind(&mut self, expr: &Expr, needed: Kind) -> Result<Node, String> {
        let (node, kind) = self.typed(expr)?;
        match kind {
            Some(kind) if kind != needed => {
                Err(format!("`{expr}` is {}, needed {}", kind.name(), needed.name()))
            }
            _ => Ok(node),
        }
    }

    fn column(&mut self, name: &str, quote: Option<char>) -> Result<Typed, String> {
        let Some(column) = self.columns.iter().find(|column| column.name == name) else {
            if quote == Some('"') {
                return Err(format!(
                    "no column \"{name}\": text stands in single quotes, '{name}'"
                ));
            }
            return Err(no_column(name, self.columns));
        };
        let Some(kind) = column.kind else {
            return Err(format!("column `{name}`: {} cannot be compared", column.type_name));
        };
        let place = self.used.iter().position(|used| used == name).unwrap_or_else(|| {
            self.used.push(name.to_owned());
            self.used.len() - 1
        });
        // A list compares as its text.
        Ok(match kind {
            Kind::List => (Node::ListText(place), Some(Kind::Text)),
            kind => (Node::Column(place), Some(kind)),
        })
    }
}

const KNOWN: &str = "and, or, not, comparisons, + - * /, is null, in (..), between, like";

/// That there is no such column, the nearest name and all of them.
pub(super) fn no_column(name: &str, columns: &[ColumnInfo]) -> String {
    let known: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
    let hint = nearest(name, known.iter().copied())
        .map_or(String::new(), |name| format!("; did you mean `{name}`?"));
    format!("no column `{name}`{hint} There are {}", known.join(", "))
}

fn not_if(negated: bool, node: Node) -> Node {
    if negated { Node::Not(node.into()) } else { node }
}

fn literal(literal: &Literal) -> Result<Typed, String> {
    let (value, kind) = match literal {
        Literal::Number(digits, _) => {
            let value = match digits.parse() {
                Ok(whole) => Value::Whole(whole),
                Err(_) => Value::Number(
                    digits.parse().map_err(|_| format!("found `{digits}`, needed a number"))?,
                ),
            };
            (value, Some(Kind::Number))
        }
        Literal::SingleQuotedString(text) => (Value::Text(text.clone()), Some(Kind::Text)),
        Literal::Boolean(boolean) => (Value::Boolean(*boolean), Some(Kind::Boolean)),
        Literal::Null => (Value::Missing, None),
        other => return Err(format!("`{other}` is not supported: {KNOWN}")),
    };
    Ok((Node::Literal(value), kind))
}
