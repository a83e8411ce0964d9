//! A law as plain data for a compiler elsewhere: one row for each operation.

use super::program::{Program, Step};
use super::tree::{Binary, Unary};
use super::{Elastic, Law};

/// Operands below this are d and v.
pub(super) const FIRST_ROW: i32 = 2;

/// One operation: its name and its operands. Operand 0 is d, 1 is v, and 2 + i is the result of row i.
///
/// The operand of `constant` is the index of a number; the second operand of `whole_power` is the exponent itself.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Row {
    /// The operation.
    pub operation: &'static str,
    /// Its operands.
    pub operands: [i32; 3],
}

/// The rows of a whole law, damping and reach included, and its numbers. The last row is the force.
pub(super) struct Table {
    pub(super) rows: Vec<Row>,
    pub(super) constants: Vec<f64>,
}

impl Law {
    /// The law's operations, for [`Law::set_native`]; `None` if it is given by points, has open constants, or is faster
    /// without native code.
    ///
    /// Laws with equal rows differ only in their numbers, so they can share native code.
    pub fn rows(&self) -> Option<Vec<Row>> {
        self.table().map(|table| table.rows)
    }

    pub(super) fn table(&self) -> Option<Table> {
        if self.hardening_spring().is_some() || self.is_shared() || self.is_open {
            return None;
        }
        let mut table = Table {
            rows: Vec::new(),
            constants: Vec::new(),
        };
        let (mut d_operand, mut v_operand, mut reach_operand) = (0, 1, None);
        if self.reach != 1.0 {
            let divisor = table.push_constant(self.reach);
            d_operand = table.push("divide", [d_operand, divisor, 0]);
            if self.damping.is_some() {
                v_operand = table.push("divide", [v_operand, divisor, 0]);
            }
            reach_operand = Some(divisor);
        }
        let mut force_operand = match &self.elastic {
            Elastic::None => table.push_constant(0.0),
            Elastic::Expression { program, .. } => table.push_program(program, d_operand, v_operand),
            Elastic::Points(_) => return None,
        };
        if let Some(damping) = &self.damping {
            let damping = table.push_program(damping, d_operand, v_operand);
            force_operand = table.push("add", [force_operand, damping, 0]);
        }
        match reach_operand {
            Some(divisor) => table.push("divide", [force_operand, divisor, 0]),
            None => table.push("copy", [force_operand, 0, 0]),
        };
        Some(table)
    }
}

impl Table {
    fn push(&mut self, operation: &'static str, operands: [i32; 3]) -> i32 {
        self.rows.push(Row { operation, operands });
        FIRST_ROW + self.rows.len() as i32 - 1
    }

    fn push_constant(&mut self, value: f64) -> i32 {
        self.constants.push(value);
        self.push("constant", [self.constants.len() as i32 - 1, 0, 0])
    }

    /// Append a program that reads `d` and `v`; returns the operand that holds its value.
    fn push_program(&mut self, program: &Program, d: i32, v: i32) -> i32 {
        let mut operands = vec![d, v];
        for step in program.steps() {
            let step_operand = match *step {
                Step::Constant(value) | Step::Adjustable(_, value) => self.push_constant(value),
                Step::Unary(operation, a) => self.push(unary_name(operation), [operands[a], 0, 0]),
                Step::WholePower(n, a) => self.push("whole_power", [operands[a], n, 0]),
                Step::Binary(operation, a, b) => self.push(binary_name(operation), [operands[a], operands[b], 0]),
                Step::Where(c, a, b) => self.push("where", [operands[c], operands[a], operands[b]]),
            };
            operands.push(step_operand);
        }
        operands[program.result()]
    }
}

fn unary_name(operation: Unary) -> &'static str {
    match operation {
        Unary::Negate => "negate",
        Unary::Abs => "abs",
        Unary::Sqrt => "sqrt",
        Unary::Sign => "sign",
        Unary::Exp => "exp",
        Unary::Tanh => "tanh",
        Unary::Noise => "noise",
    }
}

fn binary_name(operation: Binary) -> &'static str {
    match operation {
        Binary::Add => "add",
        Binary::Subtract => "subtract",
        Binary::Multiply => "multiply",
        Binary::Divide => "divide",
        Binary::Power => "power",
        Binary::Min => "min",
        Binary::Max => "max",
        Binary::Less => "less",
        Binary::LessEqual => "less_equal",
        Binary::Greater => "greater",
        Binary::GreaterEqual => "greater_equal",
        Binary::Equal => "equal",
        Binary::NotEqual => "not_equal",
    }
}
