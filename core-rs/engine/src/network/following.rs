//! Values that follow a MAT: constants of laws, and masses, that depend on the position of another MAT.

use std::sync::Arc;

use super::checks::Rule;
use super::error::Error;
use super::{LinkKind, MatKind, Network, Run};
use crate::law::{Law, LawText};

/// Most constants of one law that may follow: the certificate examines all combinations of their end values.
pub const FOLLOWING_MAX: usize = 4;

/// A value that depends on the position of a MAT: linear between two ends, and constant beyond them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Following {
    /// The MAT.
    pub mat: usize,
    /// Offset that is added to the position of the MAT [m].
    pub offset: f64,
    /// Distance that the MAT moves from one end to the other [m].
    pub span: f64,
    /// The value when the MAT is at -offset, and before.
    pub from: f64,
    /// The value when the MAT is at span - offset, and beyond.
    pub to: f64,
}

impl Following {
    /// The value when the MAT is at `x` [m]; `from` if `x` is NaN.
    #[inline]
    pub(crate) fn value(&self, x: f64) -> f64 {
        let span_share = ((x + self.offset) / self.span).clamp(0.0, 1.0).max(0.0);
        self.from + (self.to - self.from) * span_share
    }

    fn moved_to(self, local: impl Fn(usize) -> Option<usize>) -> Option<Self> {
        Some(Self {
            mat: local(self.mat)?,
            ..self
        })
    }
}

/// The law of a link in which some constants follow MATs.
#[derive(Clone, Debug, PartialEq)]
pub struct Followed {
    /// The law; these constants are its open ones, in the order of `by`.
    law: Arc<Law>,
    by: Arc<[Following]>,
}

impl Followed {
    /// The law with arbitrary values of its open constants; a copy of it is updated by [set](Self::set).
    pub(crate) fn law(&self) -> &Law {
        &self.law
    }

    /// Give the open constants of `law`, a copy, the values that belong to MATs at `x` [m].
    #[inline]
    pub(crate) fn set(&self, law: &mut Law, x: impl Fn(usize) -> f64) {
        for (slot, by) in self.by.iter().enumerate() {
            law.set(slot, by.value(x(by.mat)));
        }
    }

    /// The law when MATs are at `x` [m].
    pub(crate) fn law_for(&self, x: impl Fn(usize) -> f64) -> Law {
        let mut followed_law = (*self.law).clone();
        self.set(&mut followed_law, x);
        followed_law
    }

    /// The law with every combination of the end values of its open constants.
    pub(crate) fn corners(&self) -> impl Iterator<Item = Law> + '_ {
        (0..1_usize << self.by.len()).map(|ends| {
            let mut corner_law = (*self.law).clone();
            for (slot, by) in self.by.iter().enumerate() {
                corner_law.set(slot, if ends >> slot & 1 == 1 { by.to } else { by.from });
            }
            corner_law
        })
    }

    /// The MATs that the law follows.
    pub(crate) fn guides(&self) -> impl Iterator<Item = usize> + '_ {
        self.by.iter().map(|by| by.mat)
    }

    /// The same law in a network that numbers MATs differently; `None` if a MAT is missing there.
    pub(super) fn moved_to(&self, local: impl Fn(usize) -> Option<usize>) -> Option<Self> {
        let by = self.by.iter().map(|by| by.moved_to(&local));
        Some(Self {
            law: self.law.clone(),
            by: by.collect::<Option<_>>()?,
        })
    }
}

/// A MAT whose mass follows another MAT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowingMass {
    pub(crate) mat: usize,
    pub(crate) by: Following,
    /// The smallest value of the mass [kg]; the network stores this one.
    least: f64,
}

impl FollowingMass {
    /// Ratio of the mass in the network to the mass when MATs are at `x` [m]: at most 1.
    #[inline]
    pub(crate) fn lightness(&self, x: impl Fn(usize) -> f64) -> f64 {
        self.least / self.by.value(x(self.by.mat))
    }

    pub(super) fn moved_to(&self, local: impl Fn(usize) -> Option<usize>) -> Option<Self> {
        Some(Self {
            mat: local(self.mat)?,
            by: self.by.moved_to(local)?,
            ..*self
        })
    }
}

impl Network {
    /// MATs whose masses follow others, in order of declaration.
    pub fn following_masses(&self) -> &[FollowingMass] {
        &self.following_masses
    }

    /// Whether a constant of a law or a mass follows a MAT.
    pub fn follows(&self) -> bool {
        !self.following_masses.is_empty() || self.runs.iter().any(|run| run.followed().is_some())
    }

    /// Pairs of a MAT whose link or mass follows another MAT, and that other MAT.
    pub(crate) fn followed(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let link_guides = self.runs.iter().flat_map(|run| {
            let law_guides = run.followed().into_iter().flat_map(Followed::guides);
            law_guides.flat_map(|guide| [(run.a, guide), (run.b, guide)])
        });
        let mass_followers = self.following_masses.iter();
        link_guides.chain(mass_followers.map(|mass| (mass.mat, mass.by.mat)))
    }

    /// Add a link (LNL) between MATs `a` and `b`, `rest` [m] long at rest, in whose law the constants named in `by`
    /// follow MATs; returns its index.
    ///
    /// ```
    /// use ergon_engine::Network;
    /// use ergon_engine::law::LawText;
    /// use ergon_engine::network::Following;
    ///
    /// let mut network = Network::new();
    /// let (a, b) = (network.mas("a", 1e-3, 0.0, 0.0)?, network.sol("b", 0.0)?);
    /// let finger = network.mas("finger", 0.1, 0.0, 0.0)?;
    /// let text = LawText { law: Some("k*d"), ..LawText::default() };
    /// // From 100 N/m to 400 N/m while the finger goes a centimetre.
    /// let by = Following { mat: finger, offset: 0.0, span: 0.01, from: 100.0, to: 400.0 };
    /// network.following_lnl("tie", (a, b), &text, 0.0, &[("k".to_owned(), by)])?;
    /// assert!(network.follows());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if the law is invalid, a number is not finite, a MAT is missing,
    /// or too many constants follow.
    pub fn following_lnl(
        &mut self,
        name: &str,
        (a, b): (usize, usize),
        text: &LawText<'_>,
        rest: f64,
        by: &[(String, Following)],
    ) -> Result<usize, Error> {
        self.check(name, &[("rest", rest, Rule::Finite)])?;
        if by.len() > FOLLOWING_MAX {
            let message = format!("at most {FOLLOWING_MAX} constants of a law follow MATs");
            return Err(self.refused(name, &message));
        }
        let open_constants: Vec<String> = by.iter().map(|(constant, _)| constant.clone()).collect();
        let mut constants = text.constants.clone();
        for (constant, following) in by {
            self.check_following(name, following)?;
            constants.insert(constant.clone(), following.from);
        }
        let open_law = Law::new(&LawText {
            constants,
            open: &open_constants,
            ..text.clone()
        });
        let open_law = open_law.map_err(|error| self.refused(name, &error.to_string()))?;
        let followed = Followed {
            law: Arc::new(open_law),
            by: by.iter().map(|(_, following)| *following).collect(),
        };
        self.link(name, LinkKind::Followed(followed), a, b, [0.0, 0.0, rest])
    }

    /// Let the mass of a MAS follow a MAT.
    ///
    /// # Errors
    /// [`Error::Refused`] with its name if it is not a MAS, follows a MAT already, a mass is not above 0, a number is
    /// not finite, or the MAT is missing.
    pub fn follow_mass(&mut self, name: &str, mat: usize, by: Following) -> Result<(), Error> {
        let refuse_mass = |message: &str| self.refused(name, message);
        if self.mats.kind.get(mat) != Some(&MatKind::Mas) {
            return Err(refuse_mass("only the mass of a MAS follows a MAT"));
        }
        if self.following_masses.iter().any(|following| following.mat == mat) || by.mat == mat {
            return Err(refuse_mass("its mass follows one other MAT"));
        }
        self.check_following(name, &by)?;
        let least = by.from.min(by.to);
        if least <= 0.0 {
            return Err(refuse_mass("a mass is above 0 wherever it follows"));
        }
        self.mats.m[mat] = least;
        self.following_masses.push(FollowingMass { mat, by, least });
        Ok(())
    }

    /// The network with each following mass fixed at its value when MATs are at `x` [m].
    pub(crate) fn with_masses_at(mut self, x: &[f64]) -> Self {
        for following in std::mem::take(&mut self.following_masses) {
            self.mats.m[following.mat] = following.by.value(x[following.by.mat]);
        }
        self
    }

    fn check_following(&self, name: &str, by: &Following) -> Result<(), Error> {
        if by.mat >= self.n_mat() {
            return Err(self.refused(name, "what it follows is not there"));
        }
        if by.span == 0.0 {
            return Err(self.refused(name, "span is 0: the MAT would change nothing"));
        }
        let numbers = [
            ("offset", by.offset, Rule::Finite),
            ("span", by.span, Rule::Finite),
            ("from", by.from, Rule::Finite),
            ("to", by.to, Rule::Finite),
        ];
        self.check(name, &numbers)
    }
}

impl Run {
    /// The law of links that follow MATs; `None` for other links.
    pub(crate) fn followed(&self) -> Option<&Followed> {
        match &self.kind {
            LinkKind::Followed(followed) => Some(followed),
            _ => None,
        }
    }
}
