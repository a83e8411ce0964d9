//! MATs: single ones, points in space and proxies.

use ergon_engine::network::{Following, Shares, SidePosition, SpacePoints, Tie};
use pyo3::prelude::*;

use super::Network;
use crate::error::{from_engine, module_error};

/// How a value follows a MAT: the MAT, an offset and a span [m], and the values at both ends of the span.
pub(super) type FollowingValue = (usize, f64, f64, f64, f64);

pub(super) fn to_following((mat, offset, span, from, to): FollowingValue) -> Following {
    Following {
        mat,
        offset,
        span,
        value_before: from,
        value_beyond: to,
    }
}

#[pymethods]
impl Network {
    #[pyo3(signature = (name, *, M, X0=0.0, V0=0.0))]
    #[allow(non_snake_case)] // the field's names
    fn mas(&mut self, name: &str, M: f64, X0: f64, V0: f64) -> PyResult<usize> {
        self.0.mas(name, M, X0, V0).map_err(from_engine)
    }

    #[pyo3(signature = (name, *, X0=0.0))]
    #[allow(non_snake_case)]
    fn sol(&mut self, name: &str, X0: f64) -> PyResult<usize> {
        self.0.sol(name, X0).map_err(from_engine)
    }

    /// A mass tied to the ground, by K and Z, or by the damped frequency f and the decay t60.
    #[pyo3(signature = (name, *, M, K=None, Z=None, f=None, t60=None, X0=0.0, V0=0.0, rest=0.0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn cel(
        &mut self,
        name: &str,
        M: f64,
        K: Option<f64>,
        Z: Option<f64>,
        f: Option<f64>,
        t60: Option<f64>,
        X0: f64,
        V0: f64,
        rest: f64,
    ) -> PyResult<usize> {
        let ground_tie = match (K, Z, f, t60) {
            (k, z, None, None) => Tie::Physical {
                k: k.unwrap_or(0.0),
                z: z.unwrap_or(0.0),
            },
            (None, None, Some(f), t60) => Tie::Tuned { f, t60 },
            _ => {
                return Err(module_error(name, "a CEL takes either K and Z or f and t60"));
            }
        };
        self.0.cel(name, M, ground_tie, rest, X0, V0).map_err(from_engine)
    }

    /// Points in space, each with a mass; X0 and V0 have one value for each axis and point, axis by axis.
    #[pyo3(signature = (name, *, axes, M, X0, V0, Z=0.0, numbered=true))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn points(
        &mut self,
        name: &str,
        axes: usize,
        M: Vec<f64>,
        X0: Vec<f64>,
        V0: Vec<f64>,
        Z: f64,
        numbered: bool,
    ) -> PyResult<usize> {
        let space_points = SpacePoints {
            n_axes: axes,
            masses: &M,
            x0: &X0,
            v0: &V0,
            z: Z,
        };
        self.0.points(name, numbered, space_points).map_err(from_engine)
    }

    /// Let gravity g [m/s²] act along the axis of `count` MATs from `first` on.
    fn weigh(&mut self, first: usize, count: usize, g: f64) -> PyResult<()> {
        if count == 0 {
            return Ok(());
        }
        self.check_mat(first)?;
        self.check_mat(first + count - 1)?;
        self.0.set_gravity(first..first + count, g).map_err(from_engine)
    }

    /// Let the mass of a MAS follow another MAT.
    fn follow_mass(&mut self, name: &str, index: usize, by: FollowingValue) -> PyResult<()> {
        self.0.follow_mass(name, index, to_following(by)).map_err(from_engine)
    }

    /// A massless point between masses, each (index, share): its position is their sum by shares.
    fn proxy(&mut self, name: &str, shares: Vec<(usize, f64)>) -> PyResult<usize> {
        let shares = Shares::Fixed(shares.into());
        self.0.proxy(name, shares).map_err(from_engine)
    }

    /// The masses of a proxy, each (index, share), with all MATs at their initial positions; empty for another MAT.
    fn shares(&self, index: usize) -> PyResult<Vec<(usize, f64)>> {
        self.check_mat(index)?;
        Ok(self.0.shares(index))
    }

    /// A massless point on rows of MATs, at a fixed place or following other MATs.
    fn moving_proxy(
        &mut self,
        name: &str,
        mats: Vec<usize>,
        columns: usize,
        along: [(Option<usize>, f64, f64); 2],
    ) -> PyResult<usize> {
        let sides = along.map(|(mat, position, span)| match mat {
            None => SidePosition::Fixed(position),
            Some(mat) => SidePosition::Following {
                mat,
                offset: position,
                span,
            },
        });
        let moving_shares = Shares::Moving {
            mats: mats.into(),
            columns,
            sides,
        };
        self.0.proxy(name, moving_shares).map_err(from_engine)
    }

    /// Set the initial position and velocity of one MAT.
    #[allow(non_snake_case)]
    fn start(&mut self, index: usize, X0: f64, V0: f64) -> PyResult<()> {
        self.check_mat(index)?;
        self.0.set_initial_motion(index, X0, V0).map_err(from_engine)
    }

    /// Impose the MAT's position (ENX).
    fn impose(&mut self, index: usize) -> PyResult<()> {
        self.check_mat(index)?;
        self.0.set_imposed(index);
        Ok(())
    }
}
