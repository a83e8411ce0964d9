//! Adding links: an `<L>` point joins exactly one `<M>` point, and a link two different ones.

use std::collections::HashMap;
use std::sync::Arc;

use super::checks::Rule;
use super::kinds::{But, Contact, Error, Side};
use super::{LinkKind, Network};
use crate::law::{Entry, Law, Row};

/// A law that links of a network have, whatever its numbers.
#[derive(Clone, Debug)]
pub struct LawUse {
    /// Its operations; see [`Law::rows`].
    pub rows: Vec<Row>,
    /// Links alone in their run.
    pub alone: usize,
    /// Links in longer runs.
    pub in_runs: usize,
}

impl Network {
    /// Add a spring of stiffness `k` [N/m] and a damper `z` [N·s/m] between MATs `a` and `b` (REF; RES without Z, FRO
    /// without K), `rest` [m] long at rest; returns its index.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where `k` or `z` is negative, a number is not finite, or the ends
    /// cannot be joined.
    pub fn spring(
        &mut self,
        name: &str,
        a: usize,
        b: usize,
        k: f64,
        z: f64,
        rest: f64,
    ) -> Result<usize, Error> {
        self.check(
            name,
            &[
                ("K", k, Rule::NotNegative),
                ("Z", z, Rule::NotNegative),
                ("rest", rest, Rule::Finite),
            ],
        )?;
        self.link(name, LinkKind::Ref, a, b, [k, z, rest])
    }

    /// Add a one-sided contact of the striker `a` on `b`, which closes where the gap is 0; returns its index.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where a number is out of range or the ends cannot be joined.
    pub fn but(&mut self, name: &str, a: usize, b: usize, but: But) -> Result<usize, Error> {
        let But { k, z, gap, .. } = but;
        self.check(
            name,
            &[
                ("K", k, Rule::NotNegative),
                ("Z", z, Rule::NotNegative),
                ("gap", gap, Rule::Finite),
            ],
        )?;
        if !(1.0..=8.0).contains(&but.exponent) {
            return Err(self.refused(name, "the exponent of a contact must be from 1 to 8"));
        }
        if but.contact == Contact::Magic {
            self.check_magic(name, &but)?;
        }
        // d = x_b - x_a - rest: from below the penetration is -d with rest = -gap, from above d with
        // rest = gap.
        let rest = match but.side {
            Side::Below => -gap,
            Side::Above => gap,
        };
        self.link(name, LinkKind::But(but), a, b, [k, z, rest])
    }

    fn check_magic(&self, name: &str, but: &But) -> Result<(), Error> {
        let bounces = but.restitution > 0.0 && but.restitution <= 1.0;
        if !bounces || !(2..=10_000).contains(&but.steps) {
            let message =
                "a magic contact takes a restitution above 0, at most 1, and 2 steps or more";
            return Err(self.refused(name, message));
        }
        if but.exponent != 1.0 {
            return Err(self.refused(name, "a magic contact is linear: its exponent is 1"));
        }
        if but.clamp && but.restitution < 1.0 {
            let message = "a magic contact with a restitution below 1 has to pull at the exit: take clamp away";
            return Err(self.refused(name, message));
        }
        Ok(())
    }

    /// Add a non-linear link (LNL) between MATs `a` and `b`, `rest` [m] long at rest; returns its index.
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module where `rest` is not finite or the ends cannot be joined.
    pub fn lnl(
        &mut self,
        name: &str,
        a: usize,
        b: usize,
        law: Arc<Law>,
        rest: f64,
    ) -> Result<usize, Error> {
        self.check(name, &[("rest", rest, Rule::Finite)])?;
        self.link(name, LinkKind::Lnl(law), a, b, [0.0, 0.0, rest])
    }

    fn link(
        &mut self,
        name: &str,
        kind: LinkKind,
        a: usize,
        b: usize,
        [k, z, rest]: [f64; 3],
    ) -> Result<usize, Error> {
        if a >= self.n_mat() || b >= self.n_mat() {
            return Err(self.refused(name, "joins a module that is not there"));
        }
        if a == b {
            return Err(self.refused(name, "a link joins two different points"));
        }
        self.room(name, 1)?;
        let first = self.n_lia;
        self.add_run(kind, a, b, 1, [k, z, rest]);
        let name = self.full(name);
        self.names.add_links(first, 1, false, name);
        Ok(first)
    }

    /// Every different law that native code could compute.
    pub fn laws(&self) -> Vec<LawUse> {
        let mut laws: Vec<LawUse> = Vec::new();
        let mut known: HashMap<Vec<Row>, usize> = HashMap::new();
        for run in &self.runs {
            let LinkKind::Lnl(law) = &run.kind else {
                continue;
            };
            let Some(rows) = law.rows() else { continue };
            let at = *known.entry(rows).or_insert_with_key(|rows| {
                laws.push(LawUse {
                    rows: rows.clone(),
                    alone: 0,
                    in_runs: 0,
                });
                laws.len() - 1
            });
            match run.len {
                1 => laws[at].alone += 1,
                len => laws[at].in_runs += len,
            }
        }
        laws
    }

    /// Let the laws with the rows of each pair be computed by native code.
    ///
    /// # Safety
    /// Each pair is what [`Law::set_native`] asks for.
    pub unsafe fn set_native(&mut self, entries: &HashMap<Vec<Row>, Entry>) {
        for run in &mut self.runs {
            if let LinkKind::Lnl(law) = &mut run.kind
                && let Some(entry) = law.rows().and_then(|rows| entries.get(&rows))
            {
                // SAFETY: the caller's.
                unsafe { Arc::make_mut(law).set_native(*entry) };
            }
        }
    }
}
