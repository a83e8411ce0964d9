//! Glides of M, K and Z of a MAT to the values of the network.

use super::Timeline;
use super::gate::Ramp;
use crate::network::{Error, Network};

/// A glide of the parameters of a MAT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Glide {
    pub(crate) mat: usize,
    /// Initial K [N/m], Z [N·s/m] and M [kg], or algorithmic values.
    pub(crate) from: [f64; 3],
    /// Share of the network's values.
    pub(crate) ramp: Ramp,
}

impl Glide {
    /// The same event at `oversampling` times the rate.
    pub(super) fn faster(self, oversampling: u64) -> Self {
        Self {
            ramp: self.ramp.faster(oversampling),
            ..self
        }
    }
}

impl Timeline {
    /// Let a MAT have other K, Z and M up to `start`, and the network's own from `stop` on [s], evenly between (of what a
    /// frame takes of them), on the grid.
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
    /// Unless the MAT moves and does not glide yet, the numbers are numbers, and `stop` comes after `start`.
    pub fn glide(
        &mut self,
        network: &Network,
        mat: usize,
        [k, z, m]: [f64; 3],
        (start, stop): (f64, f64),
    ) -> Result<(), Error> {
        let refuse = |message: &str| {
            Err(Error::Refused {
                module: network.mat_name(mat),
                message: message.to_owned(),
            })
        };
        if !network.mats().kind[mat].moves() {
            return refuse("a fixed point has no parameter that can glide");
        }
        if self.glides.iter().any(|glide| glide.mat == mat) {
            return refuse("it glides already");
        }
        let is_good = |x: f64| x.is_finite() && x >= 0.0;
        if !([k, z, m].into_iter().all(is_good) && m > 0.0) {
            return refuse("a glide needs K and Z of 0 or more, and M above 0");
        }
        if !(start.is_finite() && stop.is_finite() && start >= 0.0) {
            return refuse("a glide begins and ends at finite instants, at 0 s or later");
        }
        let (start, stop) = (self.on_grid(start), self.on_grid(stop));
        if stop <= start {
            return refuse("a glide takes 64 samples at least");
        }
        self.glides.push(Glide {
            mat,
            from: [k, z, m],
            ramp: Ramp {
                from: 0.0,
                to: 1.0,
                start,
                stop,
            },
        });
        Ok(())
    }
}
