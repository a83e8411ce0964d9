//! MATs whose numbers glide while they are stepped.

use crate::network::{Error, Network};
use crate::scheme::Scheme;
use crate::timeline::{Ramp, Timeline};

/// A MAT on its way from some numbers to those of its network.
#[derive(Clone, Debug)]
pub(super) struct Glide {
    mat: usize,
    /// 1/M, κ, ζ and the stiffness of the ground, as a frame takes them.
    from: [f64; 4],
    to: [f64; 4],
    ramp: Ramp,
}

/// The glides of an island.
pub(super) fn glides(
    network: &Network,
    timeline: &Timeline,
    scheme: &Scheme,
) -> Result<Vec<Glide>, Error> {
    if timeline.glides.is_empty() {
        return Ok(Vec::new());
    }
    let mut before = network.clone();
    for glide in &timeline.glides {
        before.retie(glide.mat, glide.from);
    }
    let before = Scheme::new(&before, timeline.rate)?;
    let numbers = |scheme: &Scheme, mat: usize| {
        [
            scheme.w[mat],
            scheme.kappa[mat],
            scheme.zeta[mat],
            scheme.ground[mat],
        ]
    };
    let glide = |glide: &crate::timeline::Glide| Glide {
        mat: glide.mat,
        from: numbers(&before, glide.mat),
        to: numbers(scheme, glide.mat),
        ramp: glide.ramp,
    };
    Ok(timeline.glides.iter().map(glide).collect())
}

/// The numbers of frame `n` into `now`; what is mute stays so.
pub(super) fn turn(glides: &[Glide], own: &Scheme, now: &mut Scheme, n: u64) {
    for glide in glides.iter().filter(|glide| own.w[glide.mat] != 0.0) {
        let (mat, share) = (glide.mat, glide.ramp.at(n));
        let number = |at: usize| {
            if share == 1.0 {
                glide.to[at]
            } else {
                glide.from[at] + (glide.to[at] - glide.from[at]) * share
            }
        };
        now.w[mat] = number(0);
        now.kappa[mat] = number(1);
        now.zeta[mat] = number(2);
        now.ground[mat] = number(3);
    }
}
