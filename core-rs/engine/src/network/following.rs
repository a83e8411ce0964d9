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
    pub value_before: f64,
    /// The value when the MAT is at span - offset, and beyond.
    pub value_beyond: f64,
}

impl Following {
    /// The value when the MAT is at `x` [m]; `value_before` if `x` is NaN.
    #[inline]
    pub(crate) fn value(&self, x: f64) -> f64 {
        let span_share = ((x + self.offset) / self.span).clamp(0.0, 1.0).max(0.0);
        self.value_before + (self.value_beyond - self.value_before) * span_share
    }

    fn renumbered(self, local: impl Fn(usize) -> Option<usize>) -> Option<Self> {
        Some(Self {
            mat: local(self.mat)?,
            ..self
        })
    }
}

/// The law of a link in which some constants follow MATs.
#[derive(Clone, Debug, PartialEq)]
pub struct Followed {
    /// The law; these constants are its open ones, in the order of `followings`.
    law: Arc<Law>,
    followings: Arc<[Following]>,
}

impl Followed {
    /// The law with arbitrary values of its open constants; a copy of it is updated by [set](Self::set).
    pub(crate) fn law(&self) -> &Law {
        &self.law
    }

    /// Give the open constants of `law`, a copy, the values that belong to MATs at `x` [m].
    #[inline]
    pub(crate) fn update_law(&self, law: &mut Law, x: impl Fn(usize) -> f64) {
        for (slot, following) in self.followings.iter().enumerate() {
            law.set(slot, following.value(x(following.mat)));
        }
    }

    /// The law when MATs are at `x` [m].
    pub(crate) fn law_for(&self, x: impl Fn(usize) -> f64) -> Law {
        let mut followed_law = (*self.law).clone();
        self.update_law(&mut followed_law, x);
        followed_law
    }

    /// The law with every combination of the end values of its open constants.
    pub(crate) fn end_value_laws(&self) -> impl Iterator<Item = Law> + '_ {
        (0..1_usize << self.followings.len()).map(|ends| {
            let mut corner_law = (*self.law).clone();
            for (slot, following) in self.followings.iter().enumerate() {
                corner_law.set(
                    slot,
                    if ends >> slot & 1 == 1 {
                        following.value_beyond
                    } else {
                        following.value_before
                    },
                );
            }
            corner_law
        })
    }

    /// The MATs that the law follows.
    pub(crate) fn guide_mats(&self) -> impl Iterator<Item = usize> + '_ {
        self.followings.iter().map(|following| following.mat)
    }

    /// The same law in a network that numbers MATs differently; `None` if a MAT is missing there.
    pub(super) fn renumbered(&self, local: impl Fn(usize) -> Option<usize>) -> Option<Self> {
        let followings = self.followings.iter().map(|following| following.renumbered(&local));
        Some(Self {
            law: self.law.clone(),
            followings: followings.collect::<Option<_>>()?,
        })
    }
}

/// A MAT whose mass follows another MAT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowingMass {
    pub(crate) mat: usize,
    pub(crate) following: Following,
    /// The smallest value of the mass [kg]; the network stores this one.
    mass_min: f64,
}

impl FollowingMass {
    /// Ratio of the mass in the network to the mass when MATs are at `x` [m]: at most 1.
    #[inline]
    pub(crate) fn mass_ratio(&self, x: impl Fn(usize) -> f64) -> f64 {
        self.mass_min / self.following.value(x(self.following.mat))
    }

    pub(super) fn renumbered(&self, local: impl Fn(usize) -> Option<usize>) -> Option<Self> {
        Some(Self {
            mat: local(self.mat)?,
            following: self.following.renumbered(local)?,
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
    pub fn has_following(&self) -> bool {
        !self.following_masses.is_empty() || self.runs.iter().any(|run| run.followed_law().is_some())
    }

    /// Pairs of a MAT whose link or mass follows another MAT, and that other MAT.
    pub(crate) fn follower_pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let link_guides = self.runs.iter().flat_map(|run| {
            let law_guides = run.followed_law().into_iter().flat_map(Followed::guide_mats);
            law_guides.flat_map(|guide| [(run.a, guide), (run.b, guide)])
        });
        let mass_followers = self.following_masses.iter();
        link_guides.chain(mass_followers.map(|mass| (mass.mat, mass.following.mat)))
    }

    /// Add a link (LNL) between MATs `a` and `b`, `rest` [m] long at rest, in whose law the constants named in
    /// `followings` follow MATs; returns its index.
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
    /// // From 100 N/m to 400 N/m while the finger moves by a centimetre.
    /// let by = Following { mat: finger, offset: 0.0, span: 0.01, value_before: 100.0, value_beyond: 400.0 };
    /// network.following_lnl("tie", (a, b), &text, 0.0, &[("k".to_owned(), by)])?;
    /// assert!(network.has_following());
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
        followings: &[(String, Following)],
    ) -> Result<usize, Error> {
        self.check(name, &[("rest", rest, Rule::Finite)])?;
        if followings.len() > FOLLOWING_MAX {
            let message = format!("at most {FOLLOWING_MAX} constants of a law follow MATs");
            return Err(self.refused(name, &message));
        }
        let open_constants: Vec<String> = followings.iter().map(|(constant, _)| constant.clone()).collect();
        let mut constants = text.constants.clone();
        for (constant, following) in followings {
            self.check_following(name, following)?;
            constants.insert(constant.clone(), following.value_before);
        }
        let open_law = Law::new(&LawText {
            constants,
            open: &open_constants,
            ..text.clone()
        });
        let open_law = open_law.map_err(|error| self.refused(name, &error.to_string()))?;
        let followed = Followed {
            law: Arc::new(open_law),
            followings: followings.iter().map(|(_, following)| *following).collect(),
        };
        self.add_link(name, LinkKind::Followed(followed), a, b, [0.0, 0.0, rest])
    }

    /// Let the mass of a MAS follow a MAT.
    ///
    /// # Errors
    /// [`Error::Refused`] with its name if it is not a MAS, follows a MAT already, a mass is not above 0, a number is
    /// not finite, or the MAT is missing.
    pub fn follow_mass(&mut self, name: &str, mat: usize, following: Following) -> Result<(), Error> {
        let refuse_mass = |message: &str| self.refused(name, message);
        if self.mats.kind.get(mat) != Some(&MatKind::Mas) {
            return Err(refuse_mass("only the mass of a MAS follows a MAT"));
        }
        if self.following_masses.iter().any(|other| other.mat == mat) || following.mat == mat {
            return Err(refuse_mass("its mass follows one other MAT"));
        }
        self.check_following(name, &following)?;
        let mass_min = following.value_before.min(following.value_beyond);
        if mass_min <= 0.0 {
            return Err(refuse_mass("a mass is above 0 wherever it follows"));
        }
        self.mats.m[mat] = mass_min;
        self.following_masses.push(FollowingMass {
            mat,
            following,
            mass_min,
        });
        Ok(())
    }

    /// The network with each following mass fixed at its value when MATs are at `x` [m].
    pub(crate) fn with_masses_at(mut self, x: &[f64]) -> Self {
        for mass in std::mem::take(&mut self.following_masses) {
            self.mats.m[mass.mat] = mass.following.value(x[mass.following.mat]);
        }
        self
    }

    fn check_following(&self, name: &str, following: &Following) -> Result<(), Error> {
        if following.mat >= self.n_mat() {
            return Err(self.refused(name, "what it follows is not there"));
        }
        if following.span == 0.0 {
            return Err(self.refused(name, "span is 0: the MAT would change nothing"));
        }
        let numbers = [
            ("offset", following.offset, Rule::Finite),
            ("span", following.span, Rule::Finite),
            ("from", following.value_before, Rule::Finite),
            ("to", following.value_beyond, Rule::Finite),
        ];
        self.check(name, &numbers)
    }
}

impl Run {
    /// The law of links that follow MATs; `None` for other links.
    pub(crate) fn followed_law(&self) -> Option<&Followed> {
        match &self.kind {
            LinkKind::Followed(followed) => Some(followed),
            _ => None,
        }
    }
}
