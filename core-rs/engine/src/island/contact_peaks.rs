//! The strongest push of each contact since it was last taken.

use crate::network::Network;

/// One contact that pushed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ContactPeak {
    /// Step of the island in which it pushed most.
    pub(crate) frame: u64,
    /// Force in that step: the largest in magnitude [N].
    pub(crate) force: f64,
}

const NO_PEAK: ContactPeak = ContactPeak { frame: 0, force: 0.0 };

/// The contacts of an island, while they are watched.
#[derive(Clone, Debug, Default)]
pub(super) struct ContactPeaks {
    /// Link of each contact; empty: contacts are not watched.
    links: Vec<u32>,
    /// (n_links)
    peaks: Vec<ContactPeak>,
}

impl ContactPeaks {
    pub(super) fn new(network: &Network) -> Self {
        let network_runs = network.runs().iter();
        let contacts = network_runs.filter(|run| run.kind.is_contact());
        let links: Vec<u32> = contacts
            .flat_map(|run| (run.first..run.first + run.len).map(|link| link as u32))
            .collect();
        Self {
            peaks: vec![NO_PEAK; links.len()],
            links,
        }
    }

    /// Note the forces of a step (n_lia).
    pub(super) fn record_forces(&mut self, frame: u64, forces: &[f64]) {
        for (&link, peak) in self.links.iter().zip(&mut self.peaks) {
            let force = forces[link as usize];
            if force.abs() > peak.force.abs() {
                *peak = ContactPeak { frame, force };
            }
        }
    }

    /// Whether any watched contact pushes, by the forces of all links (n_lia).
    pub(super) fn is_any_pushing(&self, forces: &[f64]) -> bool {
        self.links.iter().any(|&link| forces[link as usize] != 0.0)
    }

    /// Report each contact that pushed (link, peak), and reset its peak.
    pub(super) fn take_peaks(&mut self, mut report_peak: impl FnMut(usize, ContactPeak)) {
        for (&link, peak) in self.links.iter().zip(&mut self.peaks) {
            if peak.force != 0.0 {
                report_peak(link as usize, std::mem::replace(peak, NO_PEAK));
            }
        }
    }
}
