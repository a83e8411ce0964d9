//! A compiled expression: operations on registers, for one link or for a run of them.
//!
//! Every step writes its own register and reads earlier ones. An operation can thus process up to 256 links in one
//! plain loop, which the compiler turns into SIMD code. A single link goes through the same operations in the same
//! order, so its bits are the same.

mod few;
mod lanes;

use std::ops::{Deref, DerefMut};

use super::tree::{Binary, Node, Tree, Unary, choose, integer_exponent, integer_power};

/// Links per pass: a register is 2 KB, the dozen registers of a law stay in the L1 cache, and the 5 ns that starting a
/// loop takes hardly count.
pub(super) const LANES: usize = 256;

/// Numbers of one pass, aligned to cache lines, so that no vector crosses two.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Register([f64; LANES]);

impl Register {
    pub(super) fn filled(value: f64) -> Self {
        Self([value; LANES])
    }
}

impl Deref for Register {
    type Target = [f64; LANES];

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl DerefMut for Register {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.0
    }
}

/// Places that are evaluated together outside a run: lanes of the widest vector.
pub(super) const SHORT_LANES: usize = 8;

/// Values at these places, aligned to a cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct ShortVector(pub(super) [f64; SHORT_LANES]);

/// Register 0 holds d, 1 holds v, 2 + i the result of step i.
const FIRST_STEP_REGISTER: usize = 2;
const MAX_REGISTERS: usize = FIRST_STEP_REGISTER + super::parse::MAX_NODES;
/// Number of registers that is enough for most laws: a single link then touches a quarter of a kilobyte.
const REGISTERS_OF_MOST_LAWS: usize = 32;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    Constant(f64),
    /// A constant that may change: its number, and its value.
    Adjustable(usize, f64),
    Unary(Unary, usize),
    WholePower(i32, usize),
    Binary(Binary, usize, usize),
    Where(usize, usize, usize),
}

/// A compiled expression.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Program {
    steps: Vec<Step>,
    result: usize,
    reads_d: bool,
}

impl Program {
    /// Compile a tree: subexpressions that depend on neither d nor v are computed now, and equal expressions are
    /// computed once.
    pub(super) fn new(tree: &Tree) -> Self {
        let folded_values = fold(tree);
        let mut program = Self {
            steps: Vec::new(),
            result: 0,
            reads_d: tree.nodes.contains(&Node::Elongation),
        };
        program.result = program.emit(tree, &folded_values, tree.root);
        program
    }

    fn emit(&mut self, tree: &Tree, folded_values: &[Option<f64>], node: usize) -> usize {
        if let Some(value) = folded_values[node] {
            return self.register_of(Step::Constant(value));
        }
        let step = match tree.nodes[node] {
            Node::Elongation => return 0,
            Node::Velocity => return 1,
            Node::Number(value) => Step::Constant(value),
            Node::Adjustable(slot, value) => Step::Adjustable(slot, value),
            Node::Unary(operation, a) => Step::Unary(operation, self.emit(tree, folded_values, a)),
            Node::Binary(Binary::Power, a, b) if folded_values[b].and_then(integer_exponent).is_some() => {
                let exponent = folded_values[b].and_then(integer_exponent).unwrap_or_default();
                Step::WholePower(exponent, self.emit(tree, folded_values, a))
            }
            Node::Binary(operation, a, b) => {
                let a = self.emit(tree, folded_values, a);
                Step::Binary(operation, a, self.emit(tree, folded_values, b))
            }
            Node::Where(c, a, b) => {
                let c = self.emit(tree, folded_values, c);
                let a = self.emit(tree, folded_values, a);
                Step::Where(c, a, self.emit(tree, folded_values, b))
            }
        };
        self.register_of(step)
    }

    /// The register of an equal earlier step, or a new one.
    fn register_of(&mut self, step: Step) -> usize {
        let is_same_step = |other: &Step| match (other, &step) {
            // 0 and -0 compare equal, but are different constants.
            (Step::Constant(a), Step::Constant(b)) => a.to_bits() == b.to_bits(),
            (other, step) => other == step,
        };
        let step_index = self.steps.iter().position(is_same_step).unwrap_or_else(|| {
            self.steps.push(step);
            self.steps.len() - 1
        });
        FIRST_STEP_REGISTER + step_index
    }

    /// The registers of a run, with constants in place.
    pub(super) fn registers(&self) -> Vec<Register> {
        self.filled(Register::filled)
    }

    /// The registers of a few places, with constants in place.
    pub(super) fn short_registers(&self) -> Vec<ShortVector> {
        self.filled(|value| ShortVector([value; SHORT_LANES]))
    }

    fn filled<R: Clone>(&self, fill: impl Fn(f64) -> R) -> Vec<R> {
        let mut registers = vec![fill(0.0); FIRST_STEP_REGISTER + self.steps.len()];
        for (step, register) in self.steps.iter().zip(&mut registers[FIRST_STEP_REGISTER..]) {
            if let Step::Constant(value) | Step::Adjustable(_, value) = step {
                *register = fill(*value);
            }
        }
        registers
    }

    /// Set an open constant to another value.
    pub(super) fn set(&mut self, slot: usize, value: f64) {
        for step in &mut self.steps {
            if let Step::Adjustable(open_slot, open_value) = step
                && *open_slot == slot
            {
                *open_value = value;
            }
        }
    }

    pub(super) fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// The register of the value: 0 is d, 1 is v, 2 + i is the result of step i.
    pub(super) fn result(&self) -> usize {
        self.result
    }

    /// Whether the value depends on d.
    pub(super) fn reads_d(&self) -> bool {
        self.reads_d
    }

    /// The value for one link.
    pub(super) fn value(&self, d: f64, v: f64) -> f64 {
        if FIRST_STEP_REGISTER + self.steps.len() <= REGISTERS_OF_MOST_LAWS {
            self.scalar::<REGISTERS_OF_MOST_LAWS>(d, v)
        } else {
            self.scalar::<MAX_REGISTERS>(d, v)
        }
    }

    fn scalar<const N: usize>(&self, d: f64, v: f64) -> f64 {
        let mut registers = [0.0; N];
        (registers[0], registers[1]) = (d, v);
        for (i, step) in self.steps.iter().enumerate() {
            registers[FIRST_STEP_REGISTER + i] = match *step {
                Step::Constant(value) | Step::Adjustable(_, value) => value,
                Step::Unary(operation, a) => operation.apply(registers[a]),
                Step::WholePower(n, a) => integer_power(registers[a], n),
                Step::Binary(operation, a, b) => operation.apply(registers[a], registers[b]),
                Step::Where(c, a, b) => choose(registers[c], registers[a], registers[b]),
            };
        }
        registers[self.result]
    }

    /// The values at a few places, with the bits of `value`; `registers` are this program's, with d and v loaded into 0
    /// and 1.
    pub(super) fn run_short<'r>(&self, registers: &'r mut [ShortVector]) -> &'r ShortVector {
        few::run(&self.steps, registers);
        &registers[self.result]
    }

    /// The values of the first `n` lanes; `registers` are this program's, with d and v loaded into 0 and 1.
    #[inline(always)]
    pub(super) fn run<'r>(&self, registers: &'r mut [Register], n: usize) -> &'r [f64] {
        lanes::run(&self.steps, registers, n);
        &registers[self.result][..n]
    }
}

/// The value of every node that depends on neither d nor v.
fn fold(tree: &Tree) -> Vec<Option<f64>> {
    let mut folded_values: Vec<Option<f64>> = Vec::with_capacity(tree.nodes.len());
    for node in &tree.nodes {
        folded_values.push(match *node {
            Node::Number(value) => Some(value),
            Node::Elongation | Node::Velocity | Node::Adjustable(..) => None,
            Node::Unary(operation, a) => folded_values[a].map(|a| operation.apply(a)),
            Node::Binary(operation, a, b) => folded_values[a]
                .zip(folded_values[b])
                .map(|(a, b)| operation.apply(a, b)),
            Node::Where(c, a, b) => folded_values[c]
                .zip(folded_values[a])
                .zip(folded_values[b])
                .map(|((c, a), b)| choose(c, a, b)),
        });
    }
    folded_values
}
