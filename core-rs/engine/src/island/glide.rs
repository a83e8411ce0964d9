//! MATs whose numbers glide while they are stepped.

use crate::network::{Error, Network};
use crate::scheme::Scheme;
use crate::timeline::{Ties, Timeline};

/// 1/M, κ, ζ and the stiffness of the ground of a MAT, as a frame takes them.
type Numbers = [f64; 4];

/// A MAT on its way from some numbers to others.
#[derive(Clone, Debug)]
pub(super) struct Glide {
    mat: usize,
    /// Frames, rising, and which of the numbers the MAT has there.
    points: Vec<(u64, usize)>,
    numbers: Vec<Numbers>,
}

impl Glide {
    /// The numbers of frame `n`.
    fn at(&self, n: u64) -> Numbers {
        let next = self.points.partition_point(|&(frame, _)| frame <= n);
        let of = |point: usize| self.numbers[self.points[point].1];
        if next == 0 {
            return of(0);
        }
        let (start, before) = self.points[next - 1];
        let Some(&(stop, after)) = self.points.get(next) else {
            return of(next - 1);
        };
        if before == after {
            return of(next);
        }
        let share = (n - start) as f64 / (stop - start) as f64;
        let (from, to) = (of(next - 1), of(next));
        std::array::from_fn(|i| from[i] + (to[i] - from[i]) * share)
    }
}

/// The glides of an island.
pub(super) fn glides(
    network: &Network,
    timeline: &Timeline,
    scheme: &Scheme,
) -> Result<Vec<Glide>, Error> {
    let (mut found, mut ties): (Vec<Glide>, Vec<Vec<Option<Ties>>>) = (Vec::new(), Vec::new());
    for glide in &timeline.glides {
        let mut own: Vec<Option<Ties>> = Vec::new();
        let mut points = Vec::with_capacity(glide.points.len());
        for &(frame, ties) in glide.points.iter() {
            let known = own.iter().position(|other| *other == ties);
            let index = known.unwrap_or_else(|| {
                own.push(ties);
                own.len() - 1
            });
            points.push((frame, index));
        }
        found.push(Glide {
            mat: glide.mat,
            points,
            numbers: Vec::with_capacity(own.len()),
        });
        ties.push(own);
    }
    // One scheme tells one number of every MAT.
    for round in 0..ties.iter().map(Vec::len).max().unwrap_or(0) {
        let here = || found_at(&ties, round);
        let mut other = network.clone();
        for (at, own) in here() {
            if let Some(own) = own {
                other.retie(found[at].mat, own);
            }
        }
        let other = Scheme::new(&other, timeline.rate)?;
        for (at, own) in here() {
            let scheme = if own.is_some() { &other } else { scheme };
            let glide = &mut found[at];
            let mat = glide.mat;
            glide.numbers.push([
                scheme.w[mat],
                scheme.kappa[mat],
                scheme.zeta[mat],
                scheme.ground[mat],
            ]);
        }
    }
    Ok(found)
}

/// The parameters of one round, by the number of the glide.
fn found_at(
    ties: &[Vec<Option<Ties>>],
    round: usize,
) -> impl Iterator<Item = (usize, Option<Ties>)> + '_ {
    let some = ties.iter().enumerate();
    some.filter_map(move |(at, own)| own.get(round).map(|own| (at, *own)))
}

/// The numbers of frame `n` into `now`; what is mute stays so.
pub(super) fn turn(glides: &[Glide], own: &Scheme, now: &mut Scheme, n: u64) {
    for glide in glides.iter().filter(|glide| own.w[glide.mat] != 0.0) {
        let mat = glide.mat;
        let numbers = glide.at(n);
        [now.w[mat], now.kappa[mat], now.zeta[mat], now.ground[mat]] = numbers;
    }
}
