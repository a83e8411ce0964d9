//! From text to a tree: the grammar of laws (V. Pratt, "Top down operator precedence", 1973).
//!
//! Operators bind as in Python: comparisons, then + -, then * /, then unary minus, then ** (from
//! the right). Nothing is ever evaluated as a program of another language.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use super::error::{LawError, LawField, nearest_word};
use super::token::{Kind, Token, tokens};
use super::tree::{Binary, Node, Tree, Unary};

/// Named constants of a law.
pub type Constants = BTreeMap<String, f64>;

/// Bounds of one expression; a typical law has one line and about ten nodes.
pub(super) const MAX_CHARACTERS: usize = 2_000;
pub(super) const MAX_NODES: usize = 256;
pub(super) const MAX_NESTING: usize = 64;

/// What a function does with its arguments.
enum Function {
    Unary(Unary),
    Binary(Binary),
    Where,
}

const FUNCTIONS: [(&str, Function); 9] = [
    ("where", Function::Where),
    ("abs", Function::Unary(Unary::Abs)),
    ("min", Function::Binary(Binary::Min)),
    ("max", Function::Binary(Binary::Max)),
    ("sqrt", Function::Unary(Unary::Sqrt)),
    ("sign", Function::Unary(Unary::Sign)),
    ("exp", Function::Unary(Unary::Exp)),
    ("tanh", Function::Unary(Unary::Tanh)),
    ("noise", Function::Unary(Unary::Noise)),
];

/// How tightly the infix operators bind; unary minus lies between * and **.
const INFIX: [(&str, Binary, u8); 11] = [
    ("<", Binary::Less, COMPARE),
    ("<=", Binary::LessEqual, COMPARE),
    (">", Binary::Greater, COMPARE),
    (">=", Binary::GreaterEqual, COMPARE),
    ("==", Binary::Equal, COMPARE),
    ("!=", Binary::NotEqual, COMPARE),
    ("+", Binary::Add, 2),
    ("-", Binary::Subtract, 2),
    ("*", Binary::Multiply, 3),
    ("/", Binary::Divide, 3),
    ("**", Binary::Power, POWER),
];
const COMPARE: u8 = 1;
const UNARY: u8 = 4;
const POWER: u8 = 5;

/// Whether a constant may not have this name, because the language uses it.
pub(super) fn is_reserved(name: &str) -> bool {
    name == "d" || name == "v" || FUNCTIONS.iter().any(|(function, _)| *function == name)
}

/// Parse one expression.
///
/// `open` names the constants that may change later, in the order of their numbers.
pub(super) fn parse(field: LawField, text: &str, constants: &Constants, open: &[String]) -> Result<Tree, LawError> {
    let text_length = text.chars().count();
    if text_length > MAX_CHARACTERS {
        let message = format!("An expression has at most {MAX_CHARACTERS} characters; this has {text_length}.");
        return Err(LawError::new(
            field,
            MAX_CHARACTERS,
            text_length - MAX_CHARACTERS,
            message,
        ));
    }
    let tokens = tokens(field, text)?;
    let mut parser = Parser {
        field,
        tokens,
        next: 0,
        nodes: Vec::new(),
        nesting: 0,
        constants,
        open,
    };
    let root = parser.expression(0)?;
    let next_token = parser.peek();
    match next_token.kind {
        Kind::End => Ok(Tree {
            nodes: parser.nodes,
            root,
        }),
        _ => Err(parser.unexpected(&next_token)),
    }
}

struct Parser<'a> {
    field: LawField,
    tokens: Vec<Token>,
    next: usize,
    nodes: Vec<Node>,
    nesting: usize,
    constants: &'a Constants,
    open: &'a [String],
}

impl Parser<'_> {
    fn peek(&self) -> Token {
        self.tokens[self.next].clone()
    }

    fn take(&mut self) -> Token {
        let next_token = self.peek();
        // The end token is never passed, so there is always a next token.
        self.next = (self.next + 1).min(self.tokens.len() - 1);
        next_token
    }

    fn push(&mut self, node: Node, token: &Token) -> Result<usize, LawError> {
        if self.nodes.len() == MAX_NODES {
            let message = format!("An expression has at most {MAX_NODES} numbers, names and operations.");
            return Err(self.error(token, message));
        }
        self.nodes.push(node);
        Ok(self.nodes.len() - 1)
    }

    /// Parse operators that bind at least as tightly as `least`.
    fn expression(&mut self, least: u8) -> Result<usize, LawError> {
        let mut left_node = self.operand()?;
        loop {
            let operator_token = self.peek();
            let Some((_, operation, binding)) = operator_token.row_of_sign(&INFIX, |row| row.0) else {
                return Ok(left_node);
            };
            if *binding < least {
                return Ok(left_node);
            }
            self.take();
            let right_node = if *binding == POWER {
                self.nested(&operator_token, |parser| parser.expression(UNARY))?
            } else {
                self.expression(binding + 1)?
            };
            left_node = self.push(Node::Binary(*operation, left_node, right_node), &operator_token)?;
            if *binding == COMPARE {
                self.refuse_chain()?;
            }
        }
    }

    /// Refuse `a < b < c`, which readers understand in two ways.
    fn refuse_chain(&self) -> Result<(), LawError> {
        let next_token = self.peek();
        match next_token.row_of_sign(&INFIX, |row| row.0) {
            Some((_, _, COMPARE)) => {
                let message = "Comparisons do not chain; multiply two of them: (a < b)*(b < c).";
                Err(self.error(&next_token, message.into()))
            }
            _ => Ok(()),
        }
    }

    fn operand(&mut self) -> Result<usize, LawError> {
        let operand_token = self.take();
        match &operand_token.kind {
            Kind::Number(value) => self.push(Node::Number(*value), &operand_token),
            Kind::Name(name) => self.named(name, &operand_token),
            Kind::Sign("-") => {
                let operand = self.nested(&operand_token, |parser| parser.expression(UNARY))?;
                self.push(Node::Unary(Unary::Negate, operand), &operand_token)
            }
            Kind::Sign("+") => self.nested(&operand_token, |parser| parser.expression(UNARY)),
            Kind::Sign("(") => {
                let inner_node = self.nested(&operand_token, |parser| parser.expression(0))?;
                self.expect(")", &operand_token)?;
                Ok(inner_node)
            }
            _ => Err(self.unexpected(&operand_token)),
        }
    }

    fn named(&mut self, name: &str, token: &Token) -> Result<usize, LawError> {
        let is_called = matches!(self.peek().kind, Kind::Sign("("));
        let function = FUNCTIONS.iter().find(|(known, _)| *known == name);
        match (function, is_called) {
            (Some((_, function)), true) => self.call(name, function, token),
            (Some(_), false) => {
                let message = format!("`{name}` is a function: write {name}( … ).");
                Err(self.error(token, message))
            }
            (None, true) => Err(self.unknown_function(name, token)),
            (None, false) => self.variable(name, token),
        }
    }

    fn variable(&mut self, name: &str, token: &Token) -> Result<usize, LawError> {
        match (name, self.constants.get(name)) {
            ("d", _) => self.push(Node::Elongation, token),
            ("v", _) if self.field == LawField::Damping => self.push(Node::Velocity, token),
            ("v", _) => {
                let message = "`v` is allowed only in `damping`, because a law stores energy by `d` alone.";
                Err(self.error(token, message.into()))
            }
            (_, Some(value)) => {
                let open_slot = self.open.iter().position(|open| open == name);
                let constant_node =
                    open_slot.map_or(Node::Number(*value), |open_slot| Node::Adjustable(open_slot, *value));
                self.push(constant_node, token)
            }
            (_, None) => {
                let message = format!("There is no constant `{}`.", shortened(name));
                let known = self.variables().chain(FUNCTIONS.iter().map(|(known, _)| *known));
                Err(self.error(token, message).with_suggestion(nearest_word(name, known)))
            }
        }
    }

    fn variables(&self) -> impl Iterator<Item = &str> {
        let rate_name = (self.field == LawField::Damping).then_some("v");
        self.constants
            .keys()
            .map(String::as_str)
            .chain(std::iter::once("d"))
            .chain(rate_name)
    }

    fn unknown_function(&self, name: &str, token: &Token) -> LawError {
        if is_reserved(name) || self.constants.contains_key(name) {
            let message = format!("`{name}` is a number, not a function; write {name}*( … ) to multiply.");
            return self.error(token, message);
        }
        let message = format!(
            "There is no function `{}`; laws have where, abs, min, max, sqrt, sign, exp, tanh and noise.",
            shortened(name)
        );
        let known = FUNCTIONS.iter().map(|(known, _)| *known);
        self.error(token, message).with_suggestion(nearest_word(name, known))
    }

    fn call(&mut self, name: &str, function: &Function, token: &Token) -> Result<usize, LawError> {
        let open_token = self.take();
        let mut arguments = Vec::new();
        if !matches!(self.peek().kind, Kind::Sign(")")) {
            loop {
                arguments.push(self.nested(&open_token, |parser| parser.expression(0))?);
                if !matches!(self.peek().kind, Kind::Sign(",")) {
                    break;
                }
                self.take();
            }
        }
        self.expect(")", &open_token)?;
        let call_node = match (function, arguments.as_slice()) {
            (Function::Unary(operation), [a]) => Node::Unary(*operation, *a),
            (Function::Binary(operation), [a, b]) => Node::Binary(*operation, *a, *b),
            (Function::Where, [c, a, b]) => Node::Where(*c, *a, *b),
            _ => {
                let argument_form = match function {
                    Function::Unary(_) => "one argument",
                    Function::Binary(_) => "two arguments",
                    Function::Where => "three arguments (condition, value if true, value if not)",
                };
                let message = format!("`{name}` takes {argument_form}; here are {}.", arguments.len());
                return Err(self.error(token, message));
            }
        };
        self.push(call_node, token)
    }

    fn expect(&mut self, sign: &str, opened: &Token) -> Result<(), LawError> {
        let next_token = self.peek();
        match next_token.kind {
            Kind::Sign(sign_read) if sign_read == sign => {
                self.take();
                Ok(())
            }
            Kind::End => Err(self.error(opened, "This parenthesis is never closed.".into())),
            _ => Err(self.unexpected(&next_token)),
        }
    }

    /// Parse one level deeper, if the nesting allows it.
    fn nested<T>(
        &mut self,
        token: &Token,
        inside: impl FnOnce(&mut Self) -> Result<T, LawError>,
    ) -> Result<T, LawError> {
        if self.nesting == MAX_NESTING {
            let message = format!("An expression is nested at most {MAX_NESTING} deep.");
            return Err(self.error(token, message));
        }
        self.nesting += 1;
        let inner_result = inside(self);
        self.nesting -= 1;
        inner_result
    }

    fn unexpected(&self, token: &Token) -> LawError {
        let message = match &token.kind {
            Kind::End if self.tokens.len() == 1 => "The expression is empty.".into(),
            Kind::End => "Something is missing at the end.".into(),
            Kind::Number(_) => "An operator is missing before this number.".into(),
            Kind::Name(name) => format!("An operator is missing before `{}`.", shortened(name)),
            Kind::Sign("(") => "An operator is missing before this parenthesis.".into(),
            Kind::Sign(sign) => format!("`{sign}` is not allowed here."),
        };
        self.error(token, message)
    }

    fn error(&self, token: &Token, message: String) -> LawError {
        LawError::new(self.field, token.offset, token.length, message)
    }
}

/// A name, shortened for a message.
fn shortened(name: &str) -> String {
    if name.chars().count() <= 32 {
        return name.to_owned();
    }
    name.chars().take(31).chain(std::iter::once('…')).collect()
}
