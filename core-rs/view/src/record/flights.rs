//! Flights: oscillations that a reader continues by itself, written when the engine differs from them.

use super::Recorder;
use crate::packed::ERROR_BOUNDS;
use crate::payload::{ByteWriter, kind};

/// A displacement too small to be seen [m].
const INVISIBLE_METRES: f64 = 1e-12;
/// If an oscillation has decayed since the strike by this exponent σt, it is not followed back to the strike.
const DECAY_EXPONENT_MAX: f64 = 20.0;
/// Number of looks between two evaluations of modal parts, for their peaks.
const SHAPE_INTERVAL_LOOKS: u64 = 4;

/// The oscillation that a reader computes for one point or mode.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Flight {
    cosine_amplitude: f64,
    sine_amplitude: f64,
    start_time: f64,
}

impl Recorder {
    /// Writes new flights for points and modes that differ from those that a reader has.
    pub(super) fn write_flights(&mut self, tracks: &[f64], now: f64, is_first: bool) {
        let (track_count, frame_period) = (self.look.n_tracks(), 1.0 / self.rate);
        let mut flights: Vec<(f64, usize, Flight)> = Vec::new();
        for track in &self.tracks {
            let actual = (track.oscillation).coefficients(
                tracks[track.track_number],
                tracks[track_count + track.track_number],
                frame_period,
            );
            let flight = &self.flights[track.track_number];
            let predicted = track.oscillation.coefficients_after(
                (flight.cosine_amplitude, flight.sine_amplitude),
                now - flight.start_time,
            );
            let velocity_scale = if track.oscillation.omega == 0.0 {
                1.0 / self.setup.looks_per_second
            } else {
                1.0
            };
            let amplitude_of = |(a, b): (f64, f64)| amplitude(a, b * velocity_scale);
            let difference = amplitude_of((actual.0 - predicted.0, actual.1 - predicted.1));
            let largest = amplitude_of(actual).max(amplitude_of(predicted));
            let run_peak = &mut self.output_peaks[track.run_index];
            if track.track_number < self.look.points.len() {
                *run_peak = run_peak.max(if track.oscillation.omega == 0.0 {
                    actual.0.abs()
                } else {
                    amplitude_of(actual)
                });
            }
            if difference.is_nan() || difference <= ERROR_BOUNDS.flight_share * largest + INVISIBLE_METRES {
                continue;
            }
            // A strike at the instant of a look acts after it.
            let strike_times = &self.strike_times[track.strike_list_index];
            let last_strike = strike_times[..strike_times.partition_point(|time| *time < now)].last();
            let start_time = match last_strike {
                Some(&last_strike)
                    if last_strike >= self.last_look
                        && track.oscillation.sigma * (now - last_strike) < DECAY_EXPONENT_MAX =>
                {
                    last_strike
                }
                _ => now,
            };
            let (a, b) = track.oscillation.coefficients_after(actual, start_time - now);
            let (a, b) = (f64::from(a as f32), f64::from(b as f32));
            flights.push((
                start_time,
                track.track_number,
                Flight {
                    cosine_amplitude: a,
                    sine_amplitude: b,
                    start_time,
                },
            ));
        }
        flights.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        for (since, number, flight) in flights {
            self.flights[number] = flight;
            // A flight that begins now is in the key state.
            if !(is_first && since == now) {
                write_flight(self.event_bytes(since, kind::FLIGHTS), number, &flight);
            }
        }
        if self.look_number.is_multiple_of(SHAPE_INTERVAL_LOOKS) {
            self.update_modal_peaks(tracks);
        }
    }

    /// Updates the peaks of modal parts.
    fn update_modal_peaks(&mut self, tracks: &[f64]) {
        let point_count = self.look.points.len();
        for (run, peak) in self.runs.iter().zip(&mut self.output_peaks) {
            let Some(body) = run.body.map(|body| &self.look.bodies[body]) else {
                continue;
            };
            let mode_positions = &tracks[point_count + body.first_mode..][..body.modes.len()];
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
            let track_flight = &mut self.flights[track.track_number];
            let (a, b) = track.oscillation.coefficients_after(
                (track_flight.cosine_amplitude, track_flight.sine_amplitude),
                now - track_flight.start_time,
            );
            let is_faint = amplitude(a, b) <= INVISIBLE_METRES;
            let rounded = |x: f64| if is_faint { 0.0 } else { f64::from(x as f32) };
            *track_flight = Flight {
                cosine_amplitude: rounded(a),
                sine_amplitude: rounded(b),
                start_time: now,
            };
            if !is_faint {
                write_flight(&mut self.segment.state_bytes, track.track_number, track_flight);
            }
        }
    }
}

fn write_flight(out: &mut ByteWriter, track_number: usize, flight: &Flight) {
    out.u32(track_number as u32);
    out.f32(flight.cosine_amplitude);
    out.f32(flight.sine_amplitude);
}

fn amplitude(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}
