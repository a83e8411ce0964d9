//! Links in space: they measure the distance of two points, and act along the line between them.
//!
//! A point in space is two or three MATs, its coordinates. Everything that acts on a MAT can therefore act on a
//! coordinate: hands, ergons, springs, outputs.

mod facets;
mod law;
mod links;
mod measure;
mod points;

pub use facets::Facets;
pub(super) use law::COLLAPSE_MESSAGE;
pub use law::SpaceLaw;
pub use links::SpaceLink;
pub use measure::Measure;
pub(crate) use measure::{distance, inverse, length_and_unit_vector};
pub use points::{SpacePoint, SpacePoints};

use super::{LinkKind, Network, Run};

/// Largest number of axes of a space.
pub(crate) const AXES_MAX: usize = 3;

impl LinkKind {
    /// Whether its force depends on earlier motion.
    pub(crate) fn has_memory(&self) -> bool {
        match self {
            Self::Bristle(_) => true,
            Self::Space(space) => space.law.yields(),
            _ => false,
        }
    }

    /// Whether a view draws it between its ends: false for contacts, attractions and gauges.
    pub fn is_drawn(&self) -> bool {
        match self {
            Self::Space(SpaceLink {
                law: SpaceLaw::Attraction { .. } | SpaceLaw::Gauge,
                ..
            }) => false,
            Self::Pairwise(_) => false,
            _ => !self.is_contact(),
        }
    }

    /// Whether it may break for good.
    pub fn may_break(&self) -> bool {
        let Self::Space(SpaceLink {
            law: SpaceLaw::Yielding { break_elongation, .. },
            ..
        }) = self
        else {
            return false;
        };
        break_elongation.is_finite()
    }

    /// Whether it acts only while its ends touch.
    pub fn is_contact(&self) -> bool {
        match self {
            Self::But(_) => true,
            Self::Space(space) => space.law.is_contact(),
            Self::Pairwise(pairs) => pairs.link.law.is_contact(),
            _ => false,
        }
    }
}

impl Run {
    /// How many axes its links act along.
    pub(crate) fn n_axes(&self) -> usize {
        match &self.kind {
            LinkKind::Space(space) => space.n_axes,
            LinkKind::Pairwise(pairs) => pairs.link.n_axes,
            _ => 1,
        }
    }

    /// The MATs that its i-th link joins along an axis.
    pub fn pair(&self, i: usize, axis: usize) -> (usize, usize) {
        let link_ends = (self.a + i, self.b + i);
        match &self.kind {
            LinkKind::Space(space) => space.pair(link_ends, axis),
            LinkKind::Pairwise(pairs) => pairs.pair((self.a, self.b), i, axis),
            _ => link_ends,
        }
    }

    /// The MATs that its i-th link joins, axis by axis.
    pub fn pairs(&self, i: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.n_axes()).map(move |axis| self.pair(i, axis))
    }
}
