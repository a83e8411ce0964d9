//! A law's elastic part and its damping, each on its own: methods of higher order treat them apart.

use super::program::LANES;
use super::{Elastic, Law, Scratch};

impl Law {
    /// Elastic forces of a run of links, each as [`Law::spring`]; nothing is allocated.
    ///
    /// `d`, `out`: (n_links,); `scratch` is this law's own.
    pub(crate) fn spring_run(&self, d: &[f64], out: &mut [f64], scratch: &mut Scratch) {
        for (chunk, out) in out.chunks_mut(LANES).enumerate() {
            let (first, n) = (chunk * LANES, out.len());
            let elastic = &mut scratch.elastic;
            self.load(&mut elastic[0], &d[first..first + n]);
            match &self.elastic {
                Elastic::None => out.fill(0.0),
                Elastic::Expression { program, .. } => out.copy_from_slice(program.run(elastic, n)),
                Elastic::Points(points) => {
                    for (out, d) in out.iter_mut().zip(&elastic[0]) {
                        *out = points.value(*d);
                    }
                }
            }
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
