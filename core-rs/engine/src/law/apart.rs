//! A law's elastic part and its damping, each on its own: methods of higher order treat them apart.

use super::program::LANES;
use super::{Elastic, Law, Scratch};

impl Law {
    /// Elastic forces of a run of links, each as [`Law::spring`]; nothing is allocated.
    ///
    /// `d`, `out`: (n_links,); `scratch` is this law's own.
    pub(crate) fn spring_run(&self, d: &[f64], out: &mut [f64], scratch: &mut Scratch) {
        for (chunk, out) in out.chunks_mut(LANES).enumerate() {
            let first = chunk * LANES;
            self.elastic_chunk(&d[first..first + out.len()], out, scratch);
            if self.reach != 1.0 {
                out.iter_mut().for_each(|out| *out /= self.reach);
            }
        }
    }

    /// Whether it has a damping.
    pub(crate) fn is_damped(&self) -> bool {
        self.damping.is_some()
    }

    /// The damping's forces on a run of links; 0 where it has none. Nothing is allocated.
    ///
    /// `d`, `v`, `out`: (n_links,); `scratch` is this law's own.
    pub(crate) fn drag_run(&self, d: &[f64], v: &[f64], out: &mut [f64], scratch: &mut Scratch) {
        let Some(damping) = &self.damping else {
            return out.fill(0.0);
        };
        for (chunk, out) in out.chunks_mut(LANES).enumerate() {
            let (first, n) = (chunk * LANES, out.len());
            let registers = &mut scratch.damping;
            self.load(&mut registers[0], &d[first..first + n]);
            self.load(&mut registers[1], &v[first..first + n]);
            out.copy_from_slice(damping.run(registers, n));
            if self.reach != 1.0 {
                out.iter_mut().for_each(|out| *out /= self.reach);
            }
        }
    }

    /// Whether [`Law::potential`] is exact and allocates nothing: no law, a polynomial, or points.
    pub(crate) fn has_closed_energy(&self) -> bool {
        !matches!(self.elastic, Elastic::Expression { integral: None, .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::law::LawText;

    /// Both parts have the bits of the law asked for one link, also seen through a lever.
    #[test]
    fn the_parts_are_those_of_the_whole() {
        let damping = Some("0.3*v*abs(v) + d");
        let texts = [Some("2*d + d**3"), Some("tanh(3*d)"), None];
        for (text, reach) in texts.iter().flat_map(|text| [(*text, 1.0), (*text, 0.7)]) {
            let law = Law::new(&LawText {
                law: text,
                damping,
                ..LawText::default()
            });
            let law = law.and_then(|law| law.through(reach)).expect("a law");
            let still = Law::new(&LawText {
                damping,
                ..LawText::default()
            });
            let still = still.and_then(|law| law.through(reach)).expect("a law");
            let d: Vec<f64> = (0..150).map(|i| 0.01 * f64::from(i - 70)).collect();
            let v: Vec<f64> = d.iter().map(|d| 0.5 - d * d).collect();
            let (mut out, mut scratch) = (vec![0.0; d.len()], law.scratch());
            law.spring_run(&d, &mut out, &mut scratch);
            for (d, out) in d.iter().zip(&out) {
                assert_eq!(out.to_bits(), law.spring(*d).to_bits());
            }
            law.drag_run(&d, &v, &mut out, &mut scratch);
            for ((d, v), out) in d.iter().zip(&v).zip(&out) {
                assert_eq!(*out, still.force(*d, *v));
            }
            assert!(law.is_damped());
            assert_eq!(law.has_closed_energy(), text != Some("tanh(3*d)"));
        }
    }
}
