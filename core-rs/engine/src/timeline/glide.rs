//! Glides of M, K and Z of a MAT: to the values in the network, or through any number of points.

use std::sync::Arc;

use super::Timeline;
use super::lead::points_at_lower_rate;
use crate::network::{Error, MatKind, Network};

/// K [N/m], Z [N·s/m] and M [kg], or algorithmic values.
pub type MatParameters = [f64; 3];

/// The parameters of a MAT as a function of the frame; between points, the coefficients of its scheme are linear.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Glide {
    pub(crate) mat: usize,
    /// Frames on the grid, rising, and the parameters there; `None` means those of the network. Parameters are
    /// constant before the first point and after the last.
    pub(crate) points: Arc<[(u64, Option<MatParameters>)]>,
}

impl Glide {
    /// The same event at `oversampling` times the rate.
    pub(super) fn with_higher_rate(&self, oversampling: u64) -> Self {
        let slow_points = self.points.iter();
        Self {
            points: slow_points.map(|&(frame, ties)| (frame * oversampling, ties)).collect(),
            ..*self
        }
    }

    /// The same event at the rate divided by `rate_divisor`.
    pub(super) fn with_lower_rate(&self, rate_divisor: u64) -> Self {
        Self {
            points: points_at_lower_rate(&self.points, rate_divisor),
            ..*self
        }
    }
}

impl Timeline {
    /// Let a MAT have other K, Z and M until `start`, and those of the network from `stop` on [s], on the grid. Between
    /// these instants the coefficients of its scheme are linear.
    ///
    /// ```
    /// use ergon_engine::network::Tie;
    /// use ergon_engine::{Network, Rate, Timeline};
    ///
    /// let mut network = Network::new();
    /// let tie = Tie::Physical { k: 100.0, z: 0.1 };
    /// let bell = network.cel("bell", 0.002, tie, 0.0, 0.0, 0.0)?;
    /// let mut timeline = Timeline::new(Rate::new(44_100.0)?);
    /// // From 50 N/m at 1 s to the 100 N/m of the network at 2 s.
    /// timeline.glide(&network, bell, [50.0, 0.1, 0.002], (1.0, 2.0))?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If the MAT does not move or glides already, a number is out of range, or `stop` does not come after `start`.
    pub fn glide(
        &mut self,
        network: &Network,
        mat: usize,
        ties: MatParameters,
        (start, stop): (f64, f64),
    ) -> Result<(), Error> {
        let end_points = [(start, Some(ties)), (stop, None)];
        self.add_glide(network, mat, &end_points)?;
        Ok(())
    }

    /// Let K, Z and M of a MAT go through points (instants [s], rising), linearly between them, on the grid. Of points
    /// that fall on the same frame of the grid, the last counts.
    ///
    /// # Errors
    /// If the MAT does not move or glides already, there are no points, or their instants or numbers are out of range.
    pub fn glide_through(
        &mut self,
        network: &Network,
        mat: usize,
        points: &[(f64, MatParameters)],
    ) -> Result<(), Error> {
        let points: Vec<_> = points.iter().map(|&(instant, ties)| (instant, Some(ties))).collect();
        let glide_count = self.add_glide(network, mat, &points)?;
        debug_assert!(glide_count > 0);
        Ok(())
    }

    /// Let `n` CELs go through points (instants [s], rising; the square of a factor of their frequencies, and a factor
    /// of their decay rates), linearly between them, on the grid.
    ///
    /// # Errors
    /// As [`Timeline::glide_through`], and if a MAT is not a CEL with K and Z in SI units.
    pub fn retune(
        &mut self,
        network: &Network,
        (first, n): (usize, usize),
        points: &[(f64, [f64; 2])],
    ) -> Result<(), Error> {
        let network_mats = network.mats();
        for mat in first..first + n {
            let mat_part = network.parts().get(network_mats.part[mat] as usize);
            let is_ca_part = mat_part.is_some_and(|mat_part| mat_part.ca_rate.is_some());
            if network_mats.kind[mat] != MatKind::Cel || is_ca_part {
                return Err(Error::Refused {
                    module: network.mat_name(mat),
                    message: "only a CEL with K and Z in SI units has a pitch that can glide".to_owned(),
                });
            }
            let (m, k, z) = (network_mats.m[mat], network_mats.k[mat], network_mats.z[mat]);
            let sigma = 0.5 * z / m;
            let omega_square = (k / m - sigma * sigma).max(0.0);
            let numbers = points.iter().map(|&(instant, [square_ratio, sigma_ratio])| {
                let sigma = sigma_ratio * sigma;
                let k = m * (square_ratio * omega_square + sigma * sigma);
                (instant, [k, 2.0 * m * sigma, m])
            });
            self.glide_through(network, mat, &numbers.collect::<Vec<_>>())?;
        }
        Ok(())
    }

    fn add_glide(
        &mut self,
        network: &Network,
        mat: usize,
        points: &[(f64, Option<MatParameters>)],
    ) -> Result<usize, Error> {
        let refusal = |message: &str| {
            Err(Error::Refused {
                module: network.mat_name(mat),
                message: message.to_owned(),
            })
        };
        if !network.mats().kind[mat].moves() {
            return refusal("a fixed point has no parameter that can glide");
        }
        if self.glides.iter().any(|glide| glide.mat == mat) {
            return refusal("it glides already");
        }
        let is_nonnegative = |x: f64| x.is_finite() && x >= 0.0;
        let is_tie_valid = |&[k, z, m]: &MatParameters| [k, z, m].into_iter().all(is_nonnegative) && m > 0.0;
        if !points.iter().filter_map(|(_, ties)| ties.as_ref()).all(is_tie_valid) {
            return refusal("a glide needs K and Z of 0 or more, and M above 0");
        }
        if points.is_empty() || !points.iter().all(|&(instant, _)| instant.is_finite() && instant >= 0.0) {
            return refusal("a glide must begin and end at finite instants, at 0 s or later");
        }
        if points.windows(2).any(|pair| pair[1].0 < pair[0].0) {
            return refusal("the points of a glide must rise in time");
        }
        let is_plain_glide = points.len() == 2 && points[1].1.is_none();
        let mut grid_points: Vec<(u64, Option<MatParameters>)> = Vec::with_capacity(points.len());
        for &(instant, ties) in points {
            let grid_frame = self.on_grid(instant);
            if grid_points.last().is_some_and(|&(last, _)| last == grid_frame) {
                if is_plain_glide {
                    return refusal("a glide must last 64 samples at least");
                }
                grid_points.pop();
            }
            grid_points.push((grid_frame, ties));
        }
        self.glides.push(Glide {
            mat,
            points: grid_points.into(),
        });
        Ok(self.glides.len())
    }
}
