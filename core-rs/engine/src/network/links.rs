//! Adding links: an `<L>` point joins exactly one `<M>` point, and a link two different ones.

use std::collections::HashMap;
use std::sync::Arc;

use super::checks::Rule;
use super::error::Error;
use super::parameters::{But, Contact, Side};
use super::{Bristle, Dry, LinkKind, Network};
use crate::law::{Entry, Law, Row};

/// Number of links of a network whose laws consist of the same operations, whatever their constants are.
#[derive(Clone, Debug)]
pub struct LawUse {
    /// The operations; see [`Law::rows`].
    pub rows: Vec<Row>,
    /// Number of links that are alone in their run.
    pub n_single_links: usize,
    /// Number of links in longer runs.
    pub n_run_links: usize,
}

impl Network {
    /// Add a spring of stiffness `k` [N/m] and a damper `z` [N·s/m] between MATs `a` and `b` (REF; RES without Z, FRO
    /// without K), `rest` [m] long at rest; returns its index.
    ///
    /// ```
    /// use ergon_engine::Network;
    ///
    /// let mut network = Network::new();
    /// let (a, b) = (network.mas("a", 1e-3, 0.0, 0.0)?, network.sol("b", 0.0)?);
    /// network.spring("s", a, b, 500.0, 0.01, 0.0)?; // 500 N/m, 10 mN·s/m
    /// assert_eq!((network.n_mat(), network.n_lia(), network.degree(a)), (2, 1, 1));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if `k` or `z` is negative, a number is not finite, or the ends
    /// cannot be joined.
    pub fn spring(&mut self, name: &str, a: usize, b: usize, k: f64, z: f64, rest: f64) -> Result<usize, Error> {
        self.check(
            name,
            &[
                ("K", k, Rule::NotNegative),
                ("Z", z, Rule::NotNegative),
                ("rest", rest, Rule::Finite),
            ],
        )?;
        self.add_link(name, LinkKind::Ref, a, b, [k, z, rest])
    }

    /// Add a one-sided contact of the striker `a` on `b`, which closes when `a` is beyond `b` by the gap; returns its
    /// index.
    ///
    /// ```
    /// use ergon_engine::Network;
    /// use ergon_engine::network::{But, Contact, Side};
    ///
    /// let mut network = Network::new();
    /// let hammer = network.mas("hammer", 1e-3, -2e-3, 1.0)?;
    /// let bell = network.mas("bell", 2e-3, 0.0, 0.0)?;
    /// let but = But {
    ///     k: 900.0, z: 0.1, gap: 1e-3, side: Side::Below, contact: Contact::Plain,
    ///     restitution: 1.0, steps: 2, exponent: 1.0, is_clamped: false,
    /// };
    /// let link = network.but("felt", hammer, bell, but)?;
    /// assert_eq!(network.link_name(link), "felt");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range or the ends cannot be joined.
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
        // d = x_b - x_a - rest. From below the penetration is -d with rest = -gap, from above it is d with rest = gap.
        let rest_length = match but.side {
            Side::Below => -gap,
            Side::Above => gap,
        };
        self.add_link(name, LinkKind::But(but), a, b, [k, z, rest_length])
    }

    fn check_magic(&self, name: &str, but: &But) -> Result<(), Error> {
        let bounces = but.restitution > 0.0 && but.restitution <= 1.0;
        if !bounces || !(2..=10_000).contains(&but.steps) {
            let message = "a magic contact needs a restitution above 0 and at most 1, and 2 steps or more";
            return Err(self.refused(name, message));
        }
        if but.exponent != 1.0 {
            return Err(self.refused(name, "a magic contact is linear, so its exponent must be 1"));
        }
        if but.is_clamped && but.restitution < 1.0 {
            let message = "a magic contact with a restitution below 1 has to pull at the exit: take clamp away";
            return Err(self.refused(name, message));
        }
        Ok(())
    }

    /// Add a non-linear link (LNL) between MATs `a` and `b`, `rest` [m] long at rest; returns its index.
    ///
    /// ```
    /// use std::sync::Arc;
    ///
    /// use ergon_engine::{Network, law::Law};
    ///
    /// let mut network = Network::new();
    /// let (a, b) = (network.mas("a", 1e-3, 0.0, 0.0)?, network.sol("b", 0.0)?);
    /// network.lnl("skin", a, b, Arc::new(Law::hardening(500.0, 1e8, 0.01)?), 0.0)?;
    /// assert_eq!(network.n_lia(), 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if `rest` is not finite or the ends cannot be joined.
    pub fn lnl(&mut self, name: &str, a: usize, b: usize, law: Arc<Law>, rest: f64) -> Result<usize, Error> {
        self.check(name, &[("rest", rest, Rule::Finite)])?;
        self.add_link(name, LinkKind::Lnl(law), a, b, [0.0, 0.0, rest])
    }

    /// Add a friction with memory (BRISTLE) between MATs `a` and `b`; returns its index.
    ///
    /// ```
    /// use ergon_engine::Network;
    /// use ergon_engine::network::Bristle;
    ///
    /// let mut network = Network::new();
    /// let (bow, string) = (network.sol("bow", 0.0)?, network.mas("string", 1e-3, 0.0, 0.0)?);
    /// let hair = Bristle {
    ///     stiffness: 1e5, damping: 0.2, viscosity: 0.1, level: 1.0, static_level: 1.5, speed: 0.05,
    /// };
    /// network.bristle("hair", bow, string, hair)?;
    /// assert_eq!(network.n_lia(), 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range, Fs is below Fc, or the ends cannot
    /// be joined.
    pub fn bristle(&mut self, name: &str, a: usize, b: usize, bristle: Bristle) -> Result<usize, Error> {
        let Bristle {
            stiffness,
            damping,
            viscosity,
            level,
            static_level,
            speed,
        } = bristle;
        self.check(
            name,
            &[
                ("sigma0", stiffness, Rule::Positive),
                ("sigma1", damping, Rule::NotNegative),
                ("sigma2", viscosity, Rule::NotNegative),
                ("Fc", level, Rule::Positive),
                ("Fs", static_level, Rule::Positive),
                ("vs", speed, Rule::Positive),
            ],
        )?;
        if static_level < level {
            return Err(self.refused(name, "Fs must be Fc or more"));
        }
        let bristle_kind = LinkKind::Bristle(bristle);
        self.add_link(name, bristle_kind, a, b, [stiffness, level, 0.0])
    }

    /// Add dry friction (DRY) between MATs `a` and `b`; returns its index.
    ///
    /// ```
    /// use ergon_engine::Network;
    /// use ergon_engine::network::Dry;
    ///
    /// let mut network = Network::new();
    /// let (ground, key) = (network.sol("ground", 0.0)?, network.mas("key", 0.4, 0.0, 0.1)?);
    /// let felt = Dry { level: 0.05, static_level: 0.08, speed: 4e-3 }; // 50 mN, 80 mN near rest
    /// network.dry("felt", ground, key, felt)?;
    /// assert_eq!(network.n_lia(), 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if a number is out of range or the ends cannot be joined.
    pub fn dry(&mut self, name: &str, a: usize, b: usize, dry: Dry) -> Result<usize, Error> {
        let Dry {
            level,
            static_level,
            speed,
        } = dry;
        self.check(
            name,
            &[
                ("F", level, Rule::Positive),
                ("static", static_level, Rule::Positive),
                ("speed", speed, Rule::Positive),
            ],
        )?;
        self.add_link(name, LinkKind::Dry(dry), a, b, [0.0, level, 0.0])
    }

    pub(super) fn add_link(
        &mut self,
        name: &str,
        kind: LinkKind,
        a: usize,
        b: usize,
        [k, z, rest]: [f64; 3],
    ) -> Result<usize, Error> {
        if a >= self.n_mat() || b >= self.n_mat() {
            return Err(self.refused(name, "joins a module that does not exist"));
        }
        if a == b {
            return Err(self.refused(name, "a link joins two different points"));
        }
        self.check_capacity(name, 1)?;
        let first_link = self.n_lia;
        self.add_run(kind, a, b, 1, [k, z, rest]);
        let name = self.full_name(name);
        self.names.add_links(first_link, 1, false, name);
        Ok(first_link)
    }

    /// Each distinct law that native code can compute, with the number of links that have it.
    pub fn laws(&self) -> Vec<LawUse> {
        let mut law_uses: Vec<LawUse> = Vec::new();
        let mut known_rows: HashMap<Vec<Row>, usize> = HashMap::new();
        for run in &self.runs {
            let LinkKind::Lnl(law) = &run.kind else {
                continue;
            };
            let Some(law_rows) = law.rows() else { continue };
            let law_index = *known_rows.entry(law_rows).or_insert_with_key(|law_rows| {
                law_uses.push(LawUse {
                    rows: law_rows.clone(),
                    n_single_links: 0,
                    n_run_links: 0,
                });
                law_uses.len() - 1
            });
            match run.len {
                1 => law_uses[law_index].n_single_links += 1,
                len => law_uses[law_index].n_run_links += len,
            }
        }
        law_uses
    }

    /// Let native code compute the laws that have these rows.
    ///
    /// # Safety
    /// Each entry fulfils for its rows what [`Law::set_native`] requires.
    pub unsafe fn set_native(&mut self, entries: &HashMap<Vec<Row>, Entry>) {
        for run in &mut self.runs {
            if let LinkKind::Lnl(law) = &mut run.kind
                && let Some(native_entry) = law.rows().and_then(|rows| entries.get(&rows))
            {
                // SAFETY: the caller guarantees what `set_native` requires.
                unsafe { Arc::make_mut(law).set_native(*native_entry) };
            }
        }
    }
}
