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
        let (n, step) = (self.look.n_tracks(), 1.0 / self.rate);
        let mut flights: Vec<(f64, usize, Flight)> = Vec::new();
        for track in &self.tracks {
            let actual =
                (track.oscillation).phase(seen[track.number], seen[n + track.number], step);
            let flight = &self.flights[track.number];
            let predicted = track
                .oscillation
                .later((flight.a, flight.b), now - flight.since);
            let scale = if track.oscillation.omega == 0.0 {
                1.0 / self.setup.fps
            } else {
                1.0
            };
            let size = |(a, b): (f64, f64)| amplitude(a, b * scale);
            let difference = size((actual.0 - predicted.0, actual.1 - predicted.1));
            let largest = size(actual).max(size(predicted));
            let peak = &mut self.peaks[track.run];
            if track.number < self.look.points.len() {
                *peak = peak.max(if track.oscillation.omega == 0.0 {
                    actual.0.abs()
                } else {
                    size(actual)
                });
            }
            if difference.is_nan() || difference <= BOUND.flight * largest + FAINT {
                continue;
            }
            // A strike at the instant of a look acts after it.
            let strike_times = &self.strike_times[track.struck];
            let strike = strike_times[..strike_times.partition_point(|time| *time < now)].last();
            let since = match strike {
                Some(&strike)
                    if strike >= self.last
                        && track.oscillation.sigma * (now - strike) < MAX_DECAY =>
                {
                    strike
                }
                _ => now,
            };
            let (a, b) = track.oscillation.later(actual, since - now);
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
        let n = self.look.points.len();
        for (run, peak) in self.runs.iter().zip(&mut self.peaks) {
            let Some(body) = run.body.map(|body| &self.look.bodies[body]) else {
                continue;
            };
            let modes = &seen[n + body.first..][..body.modes.len()];
            for (row, &point) in body.shapes.chunks(modes.len().max(1)).zip(&body.points) {
                self.shaped[point] = row.iter().zip(modes).map(|(share, q)| share * q).sum();
                *peak = peak.max(self.shaped[point].abs());
            }
        }
    }

    /// Begins a segment with its key state: all flights that are not too small to be seen.
    pub(super) fn begin_segment(&mut self, now: f64) {
        self.segment.start = now;
        for track in &self.tracks {
            let flight = &mut self.flights[track.number];
            let (a, b) = track
                .oscillation
                .later((flight.a, flight.b), now - flight.since);
            let is_faint = amplitude(a, b) <= FAINT;
            let value_or_zero = |x: f64| if is_faint { 0.0 } else { f64::from(x as f32) };
            *flight = Flight {
                a: value_or_zero(a),
                b: value_or_zero(b),
                since: now,
            };
            if !is_faint {
                write(&mut self.segment.state, track.number, flight);
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
