//! Proxies: massless points between masses. A proxy moves as its masses do, and passes forces on it to these masses.

use std::sync::Arc;

use super::checks::Rule;
use super::error::Error;
use super::{MatKind, Network};

/// A point between masses: x = Σ share·x. A force on it is divided among the masses by the same shares.
#[derive(Clone, Debug, PartialEq)]
pub struct Proxy {
    /// Its index among the MATs.
    pub(crate) mat: usize,
    shares: Shares,
}

/// The masses of a proxy, and its share in each.
#[derive(Clone, Debug, PartialEq)]
pub enum Shares {
    /// MATs, each with a constant share.
    Fixed(Arc<[(usize, f64)]>),
    /// Shares that depend on the position on a row or a mesh of MATs, linear along each side.
    Moving {
        /// MATs, row by row.
        mats: Arc<[usize]>,
        /// Number of MATs in a row.
        columns: usize,
        /// Position across the rows, and within a row.
        sides: [SidePosition; 2],
    },
}

/// Position of a proxy along one side of a mesh, which has n MATs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SidePosition {
    /// At a fixed place, counted in MATs from the first.
    Fixed(f64),
    /// At (x + offset)/span of the way from the first MAT to the last, where x is the position of a MAT.
    Following {
        /// The MAT.
        mat: usize,
        /// Offset that is added to x [m].
        offset: f64,
        /// Distance that the MAT moves from one end to the other [m].
        span: f64,
    },
}

impl SidePosition {
    /// The MAT before the proxy among `n`, and the share of the next MAT.
    fn locate(self, n: usize, x: &impl Fn(usize) -> f64) -> (usize, f64) {
        let last_place = (n - 1) as f64;
        let proxy_place = match self {
            Self::Fixed(proxy_place) => proxy_place,
            Self::Following { mat, offset, span } => ((x(mat) + offset) / span).clamp(0.0, 1.0) * last_place,
        };
        // If the position of a MAT is NaN, the proxy is at the first MAT.
        let proxy_place = proxy_place.clamp(0.0, last_place).max(0.0);
        let mat_before = proxy_place as usize;
        (mat_before, proxy_place - mat_before as f64)
    }

    fn renumbered(self, new_index: &impl Fn(usize) -> Option<usize>) -> Option<Self> {
        Some(match self {
            Self::Fixed(place) => Self::Fixed(place),
            Self::Following { mat, offset, span } => Self::Following {
                mat: new_index(mat)?,
                offset,
                span,
            },
        })
    }
}

impl Proxy {
    /// Call `visit` with each mass and its share, when MATs are at `x` [m].
    #[inline]
    pub(crate) fn for_each_share(&self, x: impl Fn(usize) -> f64, mut visit: impl FnMut(usize, f64)) {
        match &self.shares {
            Shares::Fixed(shares) => shares.iter().for_each(|&(mat, mass_share)| visit(mat, mass_share)),
            Shares::Moving {
                mats,
                columns,
                sides: [across_rows, within_row],
            } => {
                let (row_index, row_share) = across_rows.locate(mats.len() / columns, &x);
                let (column_index, column_share) = within_row.locate(*columns, &x);
                for (row_index, row_weight) in [(row_index, 1.0 - row_share), (row_index + 1, row_share)] {
                    for (column_index, column_weight) in
                        [(column_index, 1.0 - column_share), (column_index + 1, column_share)]
                    {
                        let mass_share = row_weight * column_weight;
                        if mass_share != 0.0 {
                            visit(mats[row_index * columns + column_index], mass_share);
                        }
                    }
                }
            }
        }
    }

    /// Σ share·value over its masses, when MATs are at `x` [m].
    pub(crate) fn weighted_sum(&self, x: impl Fn(usize) -> f64, value: impl Fn(usize) -> f64) -> f64 {
        let mut weighted_sum = 0.0;
        self.for_each_share(x, |mat, share| weighted_sum += share * value(mat));
        weighted_sum
    }

    /// Whether it may move along its masses.
    pub(crate) fn is_moving(&self) -> bool {
        matches!(self.shares, Shares::Moving { .. })
    }

    /// Every MAT in which it may ever have a share.
    pub(crate) fn masses(&self) -> impl Iterator<Item = usize> + '_ {
        let (fixed_masses, moving_masses): (&[(usize, f64)], &[usize]) = match &self.shares {
            Shares::Fixed(shares) => (shares, &[]),
            Shares::Moving { mats, .. } => (&[], mats),
        };
        let fixed_masses = fixed_masses.iter().map(|&(mat, _)| mat);
        fixed_masses.chain(moving_masses.iter().copied())
    }

    /// The MATs that determine its place.
    pub(crate) fn guide_mats(&self) -> impl Iterator<Item = usize> + '_ {
        let sides: &[SidePosition] = match &self.shares {
            Shares::Fixed(_) => &[],
            Shares::Moving { sides, .. } => sides,
        };
        sides.iter().filter_map(|side| match side {
            SidePosition::Fixed(_) => None,
            SidePosition::Following { mat, .. } => Some(*mat),
        })
    }

    /// Turn shares that follow no MAT into fixed shares.
    fn fix_shares(&mut self) {
        if self.guide_mats().next().is_none() {
            let mut fixed_shares = Vec::new();
            self.for_each_share(|_| 0.0, |mat, share| fixed_shares.push((mat, share)));
            self.shares = Shares::Fixed(fixed_shares.into());
        }
    }

    /// The largest possible Σ|share|.
    pub(crate) fn share_sum_max(&self) -> f64 {
        match &self.shares {
            Shares::Fixed(shares) => shares.iter().map(|(_, share)| share.abs()).sum(),
            Shares::Moving { .. } => 1.0,
        }
    }

    /// The proxy in a network that numbers MATs differently; `None` if a MAT is missing there.
    pub(super) fn renumbered(&self, new_index: impl Fn(usize) -> Option<usize>) -> Option<Self> {
        let shares = match &self.shares {
            Shares::Fixed(shares) => {
                let weights = shares.iter().map(|&(mat, share)| Some((new_index(mat)?, share)));
                Shares::Fixed(weights.collect::<Option<_>>()?)
            }
            Shares::Moving {
                mats,
                columns,
                sides: [across_rows, within_row],
            } => Shares::Moving {
                mats: mats.iter().map(|&mat| new_index(mat)).collect::<Option<_>>()?,
                columns: *columns,
                sides: [across_rows.renumbered(&new_index)?, within_row.renumbered(&new_index)?],
            },
        };
        Some(Self {
            mat: new_index(self.mat)?,
            shares,
        })
    }
}

impl Network {
    /// The proxies, in order of declaration.
    pub fn proxies(&self) -> &[Proxy] {
        &self.proxies
    }

    /// The masses of a proxy, each with its share at the initial positions; empty for any other MAT.
    pub fn shares(&self, mat: usize) -> Vec<(usize, f64)> {
        let mut initial_shares = Vec::new();
        if let Some(matching_proxy) = self.proxies.iter().find(|proxy| proxy.mat == mat) {
            matching_proxy.for_each_share(|mat| self.mats.x0[mat], |mat, share| initial_shares.push((mat, share)));
        }
        initial_shares
    }

    /// Whether a MAT is a proxy.
    pub(crate) fn is_proxy(&self, mat: usize) -> bool {
        self.mats.kind[mat] == MatKind::Proxy
    }

    /// Add a massless point between masses, with the initial position and velocity that its shares give; returns its
    /// index.
    ///
    /// ```
    /// use ergon_engine::Network;
    /// use ergon_engine::network::Shares;
    ///
    /// let mut network = Network::new();
    /// let (a, b) = (network.mas("a", 1e-3, 1.0, 0.0)?, network.mas("b", 1e-3, 2.0, 0.0)?);
    /// let between = network.proxy("between", Shares::Fixed([(a, 0.75), (b, 0.25)].into()))?;
    /// assert_eq!(network.mats().x0[between], 1.25);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Refused`] with the name of the module if it has no mass, a mass is missing or is itself a proxy, a row
    /// is not full, or a number is not finite.
    pub fn proxy(&mut self, name: &str, shares: Shares) -> Result<usize, Error> {
        let mut new_proxy = Proxy {
            mat: self.n_mat(),
            shares,
        };
        let is_known = |mat: usize| mat < self.n_mat() && !self.is_proxy(mat);
        if new_proxy.masses().next().is_none() || !new_proxy.masses().all(is_known) {
            return Err(self.refused(name, "a PROXY must lie between masses that exist"));
        }
        if !new_proxy.guide_mats().all(is_known) {
            return Err(self.refused(name, "a PROXY must follow a MAT that exists"));
        }
        self.check_shares(name, &new_proxy.shares)?;
        new_proxy.fix_shares();
        let mats = &self.mats;
        let initial_position = |mat: usize| mats.x0[mat];
        let (x0, v0) = (
            new_proxy.weighted_sum(initial_position, initial_position),
            new_proxy.weighted_sum(initial_position, |mat| mats.v0[mat]),
        );
        let proxy_place =
            [0, 1].map(|axis| new_proxy.weighted_sum(initial_position, |mat| mats.bench_position[mat][axis]));
        let numbers = [0.0, 0.0, 0.0, 0.0, x0, v0];
        let mat = self.add_mat(name, MatKind::Proxy, numbers)?;
        self.mats.bench_position[mat] = proxy_place;
        self.proxies.push(new_proxy);
        Ok(mat)
    }

    fn check_shares(&self, name: &str, shares: &Shares) -> Result<(), Error> {
        match shares {
            Shares::Fixed(shares) => shares
                .iter()
                .try_for_each(|&(_, share)| self.check(name, &[("a share", share, Rule::Finite)])),
            Shares::Moving { mats, columns, sides } => {
                if *columns == 0 || !mats.len().is_multiple_of(*columns) {
                    return Err(self.refused(name, "its masses do not fill the last row"));
                }
                sides.iter().try_for_each(|side| match *side {
                    SidePosition::Fixed(place) => self.check(name, &[("at", place, Rule::NotNegative)]),
                    SidePosition::Following { span: 0.0, .. } => {
                        Err(self.refused(name, "span is 0 m, so the MAT would not move it; write a length"))
                    }
                    SidePosition::Following { offset, span, .. } => {
                        self.check(name, &[("offset", offset, Rule::Finite), ("span", span, Rule::Finite)])
                    }
                })
            }
        }
    }
}
