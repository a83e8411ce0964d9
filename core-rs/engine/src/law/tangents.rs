//! Force and slopes of a law at a few places at once. The slopes are differences to places nearby, which fill the lanes
//! of a wide vector that the places leave empty.

use super::native::Native;
use super::program::{Program, SHORT_LANES, ShortVector};
use super::{Elastic, Law};

/// Places at once.
pub(crate) const PLACES: usize = SHORT_LANES / 2;
pub(crate) type Places = [f64; PLACES];

/// Distance of the places nearby: relative to the argument, and at least [m, m/s].
const SLOPE_DISTANCES: (f64, f64) = (1e-6, 1e-9);

/// Forces at some places [N], and slopes there in elongation [N/m] and in its rate [N·s/m].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tangents {
    pub(crate) force: Places,
    pub(crate) by_d: Places,
    pub(crate) by_v: Places,
}

/// Forces at some places [N], and those at places nearby in elongation and in rate.
struct Around {
    force: Places,
    near_d: Places,
    near_v: Places,
}

/// Buffers for [`Law::tangents`] of one law.
#[derive(Clone, Debug, Default)]
pub(crate) struct TangentScratch {
    elastic: Vec<ShortVector>,
    damping: Vec<ShortVector>,
    constants: Vec<f64>,
    room: Vec<f64>,
}

impl Law {
    pub(crate) fn tangent_scratch(&self) -> TangentScratch {
        let registers = |program: Option<&Program>| program.map(Program::short_registers);
        let elastic = match &self.elastic {
            Elastic::Expression { program, .. } => Some(program),
            Elastic::None | Elastic::Points(_) => None,
        };
        TangentScratch {
            elastic: registers(elastic).unwrap_or_default(),
            damping: registers(self.damping.as_ref()).unwrap_or_default(),
            constants: self.constants(),
            room: vec![0.0; self.room_len()],
        }
    }

    /// Force, with the bits of [`Law::force`], and slopes at elongations `d` [m] and rates `v` [m/s]; nothing is
    /// allocated.
    pub(crate) fn tangents(&self, d: &Places, v: &Places, scratch: &mut TangentScratch) -> Tangents {
        let [elongation_step, rate_step] =
            [d, v].map(|at| at.map(|at| SLOPE_DISTANCES.0 * at.abs() + SLOPE_DISTANCES.1));
        let shifted_places = |at: &Places, step: &Places| std::array::from_fn(|place| at[place] + step[place]);
        let (d, v) = (
            [*d, shifted_places(d, &elongation_step)],
            [*v, shifted_places(v, &rate_step)],
        );
        let nearby_forces = match self.native {
            Some(native) => self.native_forces(native, &d, &v, scratch),
            None => self.program_forces(&d, &v, scratch),
        };
        let place_slopes = |near: Places, step: Places| {
            std::array::from_fn(|place| (near[place] - nearby_forces.force[place]) / step[place])
        };
        Tangents {
            force: nearby_forces.force,
            by_d: place_slopes(nearby_forces.near_d, elongation_step),
            by_v: place_slopes(nearby_forces.near_v, rate_step),
        }
    }

    fn native_forces(
        &self,
        native: Native,
        [d, near_d]: &[Places; 2],
        [v, near_v]: &[Places; 2],
        scratch: &mut TangentScratch,
    ) -> Around {
        let mut forces = [[0.0; PLACES]; 3];
        let (d, v) = ([*d, *d, *near_d], [*v, *near_v, *v]);
        // The force of a damper is the same nearby in elongation.
        let place_sets = if self.is_damping_alone() { 2 } else { 3 };
        native.run(
            d[..place_sets].as_flattened(),
            v[..place_sets].as_flattened(),
            forces[..place_sets].as_flattened_mut(),
            &scratch.constants,
            &mut scratch.room,
        );
        let [force, near_v, last_forces] = forces;
        let near_d = if place_sets == 3 { last_forces } else { force };
        Around { force, near_d, near_v }
    }

    fn program_forces(&self, d: &[Places; 2], v: &[Places; 2], scratch: &mut TangentScratch) -> Around {
        let registers = &mut scratch.elastic;
        let [force, near_d] = match &self.elastic {
            Elastic::None => [[0.0; PLACES]; 2],
            Elastic::Expression { program, .. } => {
                self.load(&mut registers[0].0, d.as_flattened());
                halves(program.run_short(registers))
            }
            Elastic::Points(points) => d.map(|d| d.map(|d| points.value(d / self.reach))),
        };
        let mut nearby_forces = Around {
            force,
            near_d,
            near_v: force,
        };
        if let Some(damping) = &self.damping {
            let registers = &mut scratch.damping;
            let [drag_forces, near_v] = self.drags(damping, [&[d[0]; 2], v], registers);
            let near_d = if damping.reads_d() {
                self.drags(damping, [d, &[v[0]; 2]], registers)[1]
            } else {
                drag_forces
            };
            for place in 0..PLACES {
                nearby_forces.force[place] += drag_forces[place];
                nearby_forces.near_d[place] += near_d[place];
                nearby_forces.near_v[place] += near_v[place];
            }
        }
        if self.reach != 1.0 {
            for forces in [
                &mut nearby_forces.force,
                &mut nearby_forces.near_d,
                &mut nearby_forces.near_v,
            ] {
                forces.iter_mut().for_each(|force| *force /= self.reach);
            }
        }
        nearby_forces
    }

    #[inline(always)]
    fn drags(&self, damping: &Program, points: [&[Places; 2]; 2], registers: &mut [ShortVector]) -> [Places; 2] {
        for (register, points) in registers.iter_mut().zip(points) {
            self.load(&mut register.0, points.as_flattened());
        }
        halves(damping.run_short(registers))
    }
}

fn halves(ShortVector(values): &ShortVector) -> [Places; 2] {
    let (place_chunks, _) = values.as_chunks::<PLACES>();
    [place_chunks[0], place_chunks[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::law::LawText;

    /// The slopes of a cubic spring and of a damping that depends on the elongation, also behind a lever.
    #[test]
    fn tangents_equal_closed_form_slopes() {
        let law_text = LawText {
            law: Some("2*d + 5*d**3"),
            damping: Some("0.3*v + 4*d*v**2"),
            ..LawText::default()
        };
        for reach in [1.0, 0.7] {
            let law = Law::new(&law_text)
                .and_then(|law| law.behind_lever(reach))
                .expect("a law");
            let (d, v) = ([0.0, 0.1, -0.3, 2.0], [0.5, -0.2, 0.0, 3.0]);
            let tangents = law.tangents(&d, &v, &mut law.tangent_scratch());
            for place in 0..PLACES {
                let (x, u) = (d[place] / reach, v[place] / reach);
                let slope_by_d = (2.0 + 15.0 * x * x + 4.0 * u * u) / (reach * reach);
                let slope_by_v = (0.3 + 8.0 * x * u) / (reach * reach);
                assert!(
                    (tangents.by_d[place] / slope_by_d - 1.0).abs() < 1e-5,
                    "{tangents:?} {slope_by_d}"
                );
                assert!(
                    (tangents.by_v[place] / slope_by_v - 1.0).abs() < 1e-5,
                    "{tangents:?} {slope_by_v}"
                );
            }
        }
    }
}
