//! Pushes on the ports of a body within a window of frames that are computed ahead: each moves all ports and outputs in
//! the rest of the window by their responses, and the modes at its end.

use super::script::ModalScript;
use super::{FRAMES_AHEAD, RunningModal, WINDOW_FRAMES};
use crate::kernel::bank::{GroupMotion, LaneSum, Lanes, advance_and_observe, lane_total};
use crate::kernel::ports;

/// Most pairs of a port and a port or output whose responses are kept: 2 MB of them.
const PAIRS_MAX: usize = 4096;
/// Pushed ports of a frame from which on windows of one frame may cost less: a push moves every row in all frames of a
/// window. 24 ports of 24 modes take 6 times as long in long windows.
const PUSHED_PORTS_MIN: usize = 8;
/// Modes for each of these ports up to which they do: more modes are quicker in registers (450 by 24 ports break even).
const MODES_PER_PORT: usize = 12;

/// Displacement of each row in the frames after 1 N at each port during one frame   (n_ports, n_rows, FRAMES_AHEAD);
/// empty if they would be too many.
pub(super) fn window_responses(script: &ModalScript) -> Vec<f64> {
    let n_ports = script.plan.ports.len();
    let n_rows = n_ports + script.plan.outputs.len();
    if n_ports * n_rows > PAIRS_MAX {
        return Vec::new();
    }
    let mut responses = vec![0.0; n_ports * n_rows * FRAMES_AHEAD];
    let mut sums = vec![LaneSum::ZERO; n_rows * FRAMES_AHEAD];
    for (port, responses) in responses.chunks_mut((n_rows * FRAMES_AHEAD).max(1)).enumerate() {
        sums.fill(LaneSum::ZERO);
        for (group, coefficients) in script.coefficients.iter().enumerate() {
            let mut group_motion = GroupMotion {
                positions: Lanes::ZERO,
                previous_positions: Lanes::ZERO,
            };
            script.push_group(group, &mut group_motion, port, 1.0);
            let rows = &script.row_shapes[group];
            advance_and_observe(
                coefficients,
                &mut group_motion,
                rows,
                FRAMES_AHEAD - 1,
                &mut sums,
                FRAMES_AHEAD,
            );
        }
        let rows = responses.chunks_mut(FRAMES_AHEAD).zip(sums.chunks(FRAMES_AHEAD));
        for ((response, sums), row_displacement) in rows.zip(&script.row_displacements[port]) {
            response[0] = *row_displacement;
            for (response, sum) in response[1..].iter_mut().zip(sums) {
                *response = lane_total(sum);
            }
        }
    }
    responses
}

impl ModalScript {
    /// Move a group that is one frame ahead by a force at a port [N].
    fn push_group(&self, group: usize, motion: &mut GroupMotion, port: usize, force: f64) {
        ports::add_scaled(&mut motion.positions, &self.port_gains[group][port], force);
        if let Some(group_gains) = self.present_port_gains.get(group) {
            ports::add_scaled(&mut motion.previous_positions, &group_gains[port], force);
        }
    }
}

impl RunningModal {
    /// Add the effect of the forces on the ports in this frame.
    pub(super) fn apply_port_forces(&mut self) {
        let n_pushed = self.port_forces.iter().filter(|force| **force != 0.0).count();
        let n_modes = self.script.plan.modes.len();
        let has_many_pushes = n_pushed >= PUSHED_PORTS_MIN && n_pushed * MODES_PER_PORT > n_modes;
        if self.script.window_responses.is_empty() || has_many_pushes {
            self.restart_window();
            self.contact_free_frames = 0;
        }
        // A clone of the script would be counted up and down by atomics in every frame.
        let Self {
            script,
            row_history,
            window_end_motions,
            port_forces,
            row_positions,
            window_forces,
            has_window_forces,
            present_index,
            window_end_index,
            ..
        } = self;
        let (window_frame, window_end) = (*present_index, *window_end_index);
        if window_end - window_frame == 1 && !*has_window_forces {
            // The motions are those of the next frame.
            let next_entries = row_history.iter_mut().skip(window_frame + 1).step_by(WINDOW_FRAMES);
            for (position, history_entry) in row_positions.iter_mut().zip(next_entries) {
                *position = *history_entry;
            }
            for (displacements, &force) in script.row_displacements.iter().zip(&*port_forces) {
                if force != 0.0 {
                    ports::add_response(row_positions, displacements, force);
                }
            }
            let next_entries = row_history.iter_mut().skip(window_frame + 1).step_by(WINDOW_FRAMES);
            for (position, history_entry) in row_positions.iter().zip(next_entries) {
                *history_entry = *position;
            }
            for (group, motion) in window_end_motions.iter_mut().enumerate() {
                for (port, &force) in port_forces.iter().enumerate() {
                    if force != 0.0 {
                        script.push_group(group, motion, port, force);
                    }
                }
            }
            return;
        }
        let n_ports = port_forces.len();
        window_forces[window_frame * n_ports..][..n_ports].copy_from_slice(port_forces);
        *has_window_forces = true;
        let port_responses = script.window_responses.chunks(row_positions.len() * FRAMES_AHEAD);
        for (responses, &force) in port_responses.zip(&*port_forces) {
            if force == 0.0 {
                continue;
            }
            let window_rows = row_history
                .chunks_mut(WINDOW_FRAMES)
                .zip(responses.chunks(FRAMES_AHEAD));
            for (window_row, response) in window_rows {
                ports::add_response(&mut window_row[window_frame + 1..=window_end], response, force);
            }
        }
    }

    /// Advance a group from frame `start_frame` of the window, one frame ahead of it, to frame `end_frame`, with the
    /// pushes in between.
    pub(super) fn replay(&self, group: usize, motion: &mut GroupMotion, start_frame: usize, end_frame: usize) {
        let group_coefficients = if self.is_damped {
            &self.damped_coefficients
        } else {
            &self.script.coefficients
        };
        let group_coefficients = &group_coefficients[group];
        let mut frames_done = start_frame;
        if self.has_window_forces {
            let n_ports = self.port_forces.len();
            for frame in start_frame..end_frame {
                let port_forces = &self.window_forces[frame * n_ports..][..n_ports];
                if port_forces.iter().all(|force| *force == 0.0) {
                    continue;
                }
                advance_and_observe(group_coefficients, motion, &[], frame + 1 - frames_done, &mut [], 0);
                frames_done = frame + 1;
                for (port, &force) in port_forces.iter().enumerate() {
                    if force != 0.0 {
                        self.script.push_group(group, motion, port, force);
                    }
                }
            }
        }
        advance_and_observe(group_coefficients, motion, &[], end_frame - frames_done, &mut [], 0);
    }

    /// The motion of a group at the end of the window, with all pushes so far.
    pub(super) fn motion_at_window_end(&self, group: usize) -> GroupMotion {
        if !self.has_window_forces {
            return self.window_end_motions[group].clone();
        }
        let mut group_motion = self.window_start_motions[group].clone();
        self.replay(group, &mut group_motion, 0, self.window_end_index);
        group_motion
    }

    /// Let the modes at the end of the window contain all pushes.
    pub(super) fn absorb_window_forces(&mut self) {
        if self.has_window_forces {
            for group in 0..self.window_end_motions.len() {
                self.window_end_motions[group] = self.motion_at_window_end(group);
            }
            self.clear_window_forces();
        }
    }

    pub(super) fn clear_window_forces(&mut self) {
        if self.has_window_forces {
            self.window_forces.fill(0.0);
            self.has_window_forces = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use crate::island::modal::{Modal, Mode, Port, RunningModal};
    use crate::maths::{cos, sin};
    use crate::network::Network;
    use crate::units::Rate;

    const N_MODES: usize = 45;

    /// A body with two ports, MATs 0 and 1, and one output that hears all modes.
    fn body() -> Modal {
        let new_mode = |i: usize| {
            let (r, pole_angle) = (1.0 - 1e-3 * (1 + i % 7) as f64, 0.01 + 0.06 * i as f64);
            Mode {
                a: 2.0 * r * cos(pole_angle),
                b: r * r,
                displacement_per_newton: 1.0 / (1 + i) as f64,
                start_amplitude: 0.0,
                previous_amplitude: 0.0,
                cell: None,
            }
        };
        let new_port = |mat: usize| Port {
            mat,
            rest_position: 0.0,
            shape: (0..N_MODES).map(|i| sin((mat + 1) as f64 * (0.3 + i as f64))).collect(),
        };
        Modal {
            network: Arc::new(Network::new()),
            mode_numbers: (0..N_MODES as u32).collect(),
            alignment_mats: None,
            modes: (0..N_MODES).map(new_mode).collect(),
            ports: vec![new_port(0), new_port(1)],
            outputs: vec![(0, vec![1.0; N_MODES])],
            rest_outputs: vec![0.0],
            struck_points: Vec::new(),
            rate: Rate::new(44_100.0).unwrap(),
            complex_responses: None,
        }
    }

    /// Forces on both ports: rattling, single pushes, both at once, and silence for longer than a window.
    fn forces(n: usize) -> [f64; 2] {
        let force_noise = sin((n * n) as f64 * 0.37);
        match n {
            0..40 | 300..700 => [force_noise, 0.0],
            100 | 163 | 164 | 291 => [0.0, 1.0],
            800..900 if n.is_multiple_of(5) => [force_noise, -force_noise],
            _ => [0.0, 0.0],
        }
    }

    #[test]
    fn modal_pushes_equal_the_recurrence() {
        let plan = body();
        let mut running = RunningModal::new(&plan);
        let (mut modes_now, mut modes_before) = ([0.0; N_MODES], [0.0; N_MODES]);
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |peak, x| peak.max(x.abs()));
        let mut loudest = 0.0_f64;
        for n in 0..1_200 {
            let mut output_now = [0.0];
            running.add_outputs(&mut output_now);
            let mode_sum: f64 = modes_now.iter().sum();
            loudest = loudest.max(mode_sum.abs());
            assert!(
                (output_now[0] - mode_sum).abs() <= 1e-11 * loudest,
                "{n}: {} {mode_sum}",
                output_now[0]
            );
            if n % 37 == 0 {
                let mut worst_error = 0.0_f64;
                running.for_each_amplitude(|mode, x, _| worst_error = worst_error.max((x - modes_now[mode]).abs()));
                assert!(worst_error <= 1e-11 * largest(&modes_now), "{n}: {worst_error}");
            }
            if n % 211 == 0 {
                let (mut x, mut y) = ([0.0; N_MODES], [0.0; N_MODES]);
                running.write_amplitudes(&mut x, &mut y);
                let worst_error = (0..N_MODES).map(|i| (x[i] - modes_now[i]).abs()).fold(0.0, f64::max);
                assert!(worst_error <= 1e-11 * largest(&modes_now), "{n}: {worst_error}");
            }
            let forces = forces(n);
            running.step(n as u64, &forces);
            for (i, mode) in plan.modes.iter().enumerate() {
                let mode_push: f64 = (plan.ports.iter().zip(forces))
                    .map(|(port, force)| port.shape[i] * force)
                    .sum();
                let mode_next =
                    mode.a * modes_now[i] - mode.b * modes_before[i] + mode.displacement_per_newton * mode_push;
                (modes_before[i], modes_now[i]) = (modes_now[i], mode_next);
            }
        }
    }
}
