//! Flights: oscillations that a reader continues by itself, written when the engine differs from them.

use super::Recorder;
use crate::packed::BOUND;
use crate::payload::{Bytes, kind};

/// A displacement too small to be seen [m].
const FAINT: f64 = 1e-12;
/// If an oscillation has decayed since the strike by this exponent σt, it is not followed back to the strike.
const MAX_DECAY: f64 = 20.0;
/// Number of looks between two evaluations of modal parts, for their peaks.
const SHAPE_EVERY: u64 = 4;

/// The oscillation that a reader computes for one point or mode.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Flight {
    a: f64,
    b: f64,
    since: f64,
}

impl Recorder {
    /// Writes new flights for points and modes that differ from those that a reader has.
    pub(super) fn write_flights(&mut self, seen: &[f64], now: f64, is_first: bool) {
        let (track_count, frame_period) = (self.look.n_tracks(), 1.0 / self.rate);
        let mut flights: Vec<(f64, usize, Flight)> = Vec::new();
        for track in &self.tracks {
            let actual_phase =
                (track.oscillation).coefficients(seen[track.number], seen[track_count + track.number], frame_period);
            let flight = &self.flights[track.number];
            let predicted = track
                .oscillation
                .coefficients_after((flight.a, flight.b), now - flight.since);
            let velocity_scale = if track.oscillation.omega == 0.0 {
                1.0 / self.setup.fps
            } else {
                1.0
            };
            let amplitude_of = |(a, b): (f64, f64)| amplitude(a, b * velocity_scale);
            let difference = amplitude_of((actual_phase.0 - predicted.0, actual_phase.1 - predicted.1));
            let largest = amplitude_of(actual_phase).max(amplitude_of(predicted));
            let run_peak = &mut self.peaks[track.run];
            if track.number < self.look.points.len() {
                *run_peak = run_peak.max(if track.oscillation.omega == 0.0 {
                    actual_phase.0.abs()
                } else {
                    amplitude_of(actual_phase)
                });
            }
            if difference.is_nan() || difference <= BOUND.flight * largest + FAINT {
                continue;
            }
            // A strike at the instant of a look acts after it.
            let strike_times = &self.strike_times[track.struck];
            let last_strike = strike_times[..strike_times.partition_point(|time| *time < now)].last();
            let since = match last_strike {
                Some(&last_strike)
                    if last_strike >= self.last_look && track.oscillation.sigma * (now - last_strike) < MAX_DECAY =>
                {
                    last_strike
                }
                _ => now,
            };
            let (a, b) = track.oscillation.coefficients_after(actual_phase, since - now);
            let (a, b) = (f64::from(a as f32), f64::from(b as f32));
            flights.push((since, track.number, Flight { a, b, since }));
        }
        flights.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        for (since, number, flight) in flights {
            self.flights[number] = flight;
            // A flight that begins now is in the key state.
            if !(is_first && since == now) {
                write(self.event(since, kind::FLIGHTS), number, &flight);
            }
        }
        if self.frame.is_multiple_of(SHAPE_EVERY) {
            self.shape(seen);
        }
    }

    /// Updates the peaks of modal parts.
    fn shape(&mut self, seen: &[f64]) {
        let point_count = self.look.points.len();
        for (run, peak) in self.runs.iter().zip(&mut self.peaks) {
            let Some(body) = run.body.map(|body| &self.look.bodies[body]) else {
                continue;
            };
            let mode_positions = &seen[point_count + body.first_mode..][..body.modes.len()];
            for (row, &point) in body.shapes.chunks(mode_positions.len().max(1)).zip(&body.points) {
                self.modal_displacements[point] = row.iter().zip(mode_positions).map(|(share, q)| share * q).sum();
                *peak = peak.max(self.modal_displacements[point].abs());
            }
        }
    }

    /// Begins a segment with its key state: all flights that are not too small to be seen.
    pub(super) fn begin_segment(&mut self, now: f64) {
        self.segment.start = now;
        for track in &self.tracks {
            let track_flight = &mut self.flights[track.number];
            let (a, b) = track
                .oscillation
                .coefficients_after((track_flight.a, track_flight.b), now - track_flight.since);
            let is_faint = amplitude(a, b) <= FAINT;
            let value_or_zero = |x: f64| if is_faint { 0.0 } else { f64::from(x as f32) };
            *track_flight = Flight {
                a: value_or_zero(a),
                b: value_or_zero(b),
                since: now,
            };
            if !is_faint {
                write(&mut self.segment.state, track.number, track_flight);
            }
        }
    }
}

fn write(to: &mut Bytes, number: usize, flight: &Flight) {
    to.u32(number as u32);
    to.f32(flight.a);
    to.f32(flight.b);
}

fn amplitude(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}
