//! Forces of a run of links that follow a law (LNL): the whole force, or the elastic part and the damping separately,
//! as methods of higher order need them.

use super::program::{LANES, Program, Register};
use super::{Elastic, Law};
use crate::maths::wide::wide;

/// Buffers for [`Law::eval_run`], made by [`Law::scratch`] of the same law.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    elastic: Vec<Register>,
    damping: Vec<Register>,
    constants: Vec<f64>,
    room: Vec<f64>,
}

/// The part of a law's force that is computed.
#[derive(Clone, Copy)]
enum Part {
    Elastic,
    Damping,
    Full,
}

impl Law {
    /// Buffers for [`Law::eval_run`].
    pub fn scratch(&self) -> Scratch {
        let program_registers = |program: Option<&Program>| program.map(Program::registers).unwrap_or_default();
        let elastic = match &self.elastic {
            Elastic::Expression { program, .. } => program.registers(),
            // A register for the elongations.
            Elastic::None | Elastic::Points(_) => vec![Register::filled(0.0)],
        };
        Scratch {
            elastic,
            damping: program_registers(self.damping.as_ref()),
            constants: self.constants(),
            room: vec![0.0; self.room_len()],
        }
    }

    /// Buffers for runs of one link by [`Law::eval_in`], kept small because a score can have very many.
    pub(crate) fn scratch_alone(&self) -> Scratch {
        Scratch {
            constants: self.constants(),
            ..Scratch::default()
        }
    }

    /// Forces of a run of links, each with the same bits as [`Law::force`]; nothing is allocated.
    ///
    /// `d`, `v`, `out`: (n_links,); `v` may be empty if the law has no damping. `scratch` must be this law's own,
    /// because its registers hold the constants.
    ///
    /// ```
    /// use ergon_engine::law::Law;
    ///
    /// let law = Law::hardening(2e3, 1e8, 0.0)?;
    /// let (d, mut forces) = ([0.0, 1e-3, 2e-3], [0.0; 3]);
    /// law.eval_run(&d, &[], &mut forces, &mut law.scratch());
    /// assert_eq!(forces[2], law.force(2e-3, 0.0));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn eval_run(&self, d: &[f64], v: &[f64], out: &mut [f64], scratch: &mut Scratch) {
        let mut scratch_room = std::mem::take(&mut scratch.room);
        self.eval_in(d, v, out, scratch, &mut scratch_room);
        scratch.room = scratch_room;
    }

    /// [`Law::eval_run`] with a shared `room`, at least as long as [`Law::room_len`] says.
    pub(crate) fn eval_in(&self, d: &[f64], v: &[f64], out: &mut [f64], scratch: &mut Scratch, room: &mut [f64]) {
        if self.is_shared() {
            self.shared_run(d, out);
        } else if let Some(native) = &self.native {
            native.run(d, v, out, &scratch.constants, room);
        } else if let [out] = out {
            // Most LNLs of a score are alone in their run.
            *out = self.force(d[0], v.first().copied().unwrap_or_default());
        } else {
            run(self, Part::Full, d, v, out, scratch);
        }
    }

    /// Elastic forces of a run of links, each as [`Law::spring`]; nothing is allocated.
    ///
    /// `d`, `out`: (n_links,); `scratch` is this law's own.
    pub(crate) fn spring_run(&self, d: &[f64], out: &mut [f64], scratch: &mut Scratch) {
        if self.is_shared() {
            self.shared_run(d, out);
        } else if let [out] = out {
            *out = self.spring(d[0]);
        } else {
            run(self, Part::Elastic, d, &[], out, scratch);
        }
    }

    /// Damping forces of a run of links; 0 if the law has no damping. Nothing is allocated.
    ///
    /// `d`, `v`, `out`: (n_links,); `scratch` is this law's own.
    pub(crate) fn drag_run(&self, d: &[f64], v: &[f64], out: &mut [f64], scratch: &mut Scratch) {
        if let [out] = out {
            *out = self.drag(d[0], v[0]);
        } else {
            run(self, Part::Damping, d, v, out, scratch);
        }
    }

    fn shared_run(&self, d: &[f64], out: &mut [f64]) {
        let tension = self.tension(d.iter().map(|d| d * d).sum());
        for (out, d) in out.iter_mut().zip(d) {
            *out = tension * d;
        }
    }

    pub(super) fn drag(&self, d: f64, v: f64) -> f64 {
        let damping = self.damping.as_ref();
        let damping_force = damping.map(|damping| damping.value(d / self.reach, v / self.reach));
        damping_force.unwrap_or_default() / self.reach
    }

    /// Whether the law has a damping.
    pub(crate) fn is_damped(&self) -> bool {
        self.damping.is_some()
    }

    /// Whether its force depends on the rate alone, or is constant.
    pub(crate) fn is_damping_alone(&self) -> bool {
        let depends_on_d = |damping: &Program| damping.reads_d();
        matches!(self.elastic, Elastic::None) && !self.damping.as_ref().is_some_and(depends_on_d)
    }

    /// Whether [`Law::potential`] is exact and allocates nothing: no law, a polynomial, or points.
    pub(crate) fn has_closed_energy(&self) -> bool {
        !matches!(self.elastic, Elastic::Expression { integral: None, .. })
    }

    /// Elastic forces of a chunk of links, before they are divided by the reach.
    #[inline(always)]
    fn elastic_chunk(&self, d: &[f64], out: &mut [f64], registers: &mut [Register]) {
        self.load(&mut registers[0][..], d);
        match &self.elastic {
            Elastic::None => out.fill(0.0),
            Elastic::Expression { program, .. } => {
                out.copy_from_slice(program.run(registers, out.len()));
            }
            Elastic::Points(points) => {
                for (out, d) in out.iter_mut().zip(&registers[0][..]) {
                    *out = points.value(*d);
                }
            }
        }
    }

    /// Add the damping of a chunk of links, before it is divided by the reach.
    #[inline(always)]
    fn damp_chunk(&self, d: &[f64], v: &[f64], out: &mut [f64], registers: &mut [Register]) {
        let Some(damping) = &self.damping else {
            return;
        };
        if damping.reads_d() {
            self.load(&mut registers[0][..], d);
        }
        self.load(&mut registers[1][..], v);
        for (out, force) in out.iter_mut().zip(damping.run(registers, d.len())) {
            *out += force;
        }
    }

    /// Load elongations or rates into the first lanes of a register: behind a lever they are smaller by the reach.
    #[inline(always)]
    pub(super) fn load(&self, register: &mut [f64], values: &[f64]) {
        register[..values.len()].copy_from_slice(values);
        if self.reach != 1.0 {
            for value in &mut register[..values.len()] {
                *value /= self.reach;
            }
        }
    }
}

wide! {
    fn run(law: &Law, part: Part, d: &[f64], v: &[f64], out: &mut [f64], scratch: &mut Scratch) {
        for (chunk_index, out) in out.chunks_mut(LANES).enumerate() {
            let span = chunk_index * LANES..chunk_index * LANES + out.len();
            let d = &d[span.clone()];
            match part {
                // −0, not 0: −0 + x keeps the sign of a zero x.
                Part::Damping => out.fill(if law.is_damped() { -0.0 } else { 0.0 }),
                Part::Elastic | Part::Full => law.elastic_chunk(d, out, &mut scratch.elastic),
            }
            if let (Part::Damping | Part::Full, true) = (part, law.is_damped()) {
                law.damp_chunk(d, &v[span], out, &mut scratch.damping);
            }
            if law.reach != 1.0 {
                out.iter_mut().for_each(|out| *out /= law.reach);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::law::LawText;

    /// Both parts have the same bits as the law of a single link, also through a lever.
    #[test]
    fn law_runs_of_parts_equal_single_links() {
        let damping = Some("0.3*v*abs(v) + d");
        let law_texts = [Some("2*d + d**3"), Some("tanh(3*d)"), None];
        for (text, reach) in law_texts.iter().flat_map(|text| [(*text, 1.0), (*text, 0.7)]) {
            let law = Law::new(&LawText {
                law: text,
                damping,
                ..LawText::default()
            });
            let law = law.and_then(|law| law.behind_lever(reach)).expect("a law");
            let damping_law = Law::new(&LawText {
                damping,
                ..LawText::default()
            });
            let damping_law = damping_law.and_then(|law| law.behind_lever(reach)).expect("a law");
            let d: Vec<f64> = (0..550).map(|i| 0.01 * f64::from(i - 70)).collect();
            let v: Vec<f64> = d.iter().map(|d| 0.5 - d * d).collect();
            let (mut run_force, mut scratch) = (vec![0.0; d.len()], law.scratch());
            law.spring_run(&d, &mut run_force, &mut scratch);
            for (d, run_force) in d.iter().zip(&run_force) {
                assert_eq!(run_force.to_bits(), law.spring(*d).to_bits());
            }
            law.drag_run(&d, &v, &mut run_force, &mut scratch);
            let mut single_force = [0.0];
            law.drag_run(&d[3..4], &v[3..4], &mut single_force, &mut Scratch::default());
            assert_eq!(single_force[0].to_bits(), run_force[3].to_bits());
            for ((d, v), run_force) in d.iter().zip(&v).zip(&run_force) {
                assert_eq!(*run_force, damping_law.force(*d, *v));
            }
            assert!(law.is_damped());
            assert_eq!(law.has_closed_energy(), text != Some("tanh(3*d)"));
        }
    }
}
