//! A law given as straight lines through points.

use super::error::{LawError, LawField};

/// Most points of a law: more than a measured law needs, and few enough for the L2 cache.
const MAX_POINTS: usize = 10_000;

/// Straight lines through points, extended beyond the first and the last.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Points {
    d: Vec<f64>,
    f: Vec<f64>,
    /// Slope of the line from point i to point i + 1.
    slope: Vec<f64>,
    /// Energy from point 0 to point i.
    energy: Vec<f64>,
}

impl Points {
    pub(super) fn new(points: &[(f64, f64)]) -> Result<Self, LawError> {
        let error = |index, message: String| Err(LawError::new(LawField::Points, index, 1, message));
        if points.len() < 2 {
            return error(0, "A law by points needs at least two of them.".into());
        }
        if points.len() > MAX_POINTS {
            let message = format!("A law has at most {MAX_POINTS} points; here are {}.", points.len());
            return error(MAX_POINTS, message);
        }
        if let Some(index_at_fault) = points.iter().position(|(d, f)| !(d.is_finite() && f.is_finite())) {
            return error(
                index_at_fault,
                format!("Point {} is not a pair of finite numbers.", index_at_fault + 1),
            );
        }
        if let Some(index_at_fault) = points.windows(2).position(|pair| pair[1].0 <= pair[0].0) {
            let message = format!(
                "Elongations must rise: point {} is at {} m, after {} m.",
                index_at_fault + 2,
                points[index_at_fault + 1].0,
                points[index_at_fault].0
            );
            return error(index_at_fault + 1, message);
        }
        let (d, f): (Vec<f64>, Vec<f64>) = points.iter().copied().unzip();
        let slope = points
            .windows(2)
            .map(|p| (p[1].1 - p[0].1) / (p[1].0 - p[0].0))
            .collect();
        let mut energy = vec![0.0];
        for pair in points.windows(2) {
            energy.push(energy[energy.len() - 1] + line(pair[0], pair[1]));
        }
        Ok(Self { d, f, slope, energy })
    }

    /// Index of the line that holds `d`.
    fn line_at(&self, d: f64) -> usize {
        let next_point = self.d.partition_point(|point| *point <= d);
        next_point.clamp(1, self.slope.len()) - 1
    }

    /// Slope of the line that holds `d`.
    pub(super) fn slope(&self, d: f64) -> f64 {
        self.slope[self.line_at(d)]
    }

    /// Distance from 0 to the nearest line that is steeper than `slope`.
    pub(super) fn distance_to_steeper(&self, slope: f64) -> f64 {
        let last_line = self.slope.len() - 1;
        let nearest = |i: usize| {
            let line_start = if i == 0 { f64::NEG_INFINITY } else { self.d[i] };
            let line_end = if i == last_line { f64::INFINITY } else { self.d[i + 1] };
            if line_start > 0.0 {
                line_start
            } else {
                (-line_end).max(0.0)
            }
        };
        let steeper = (0..=last_line).filter(|&i| self.slope[i] > slope);
        steeper.map(nearest).fold(f64::INFINITY, f64::min)
    }

    /// Force at elongation `d`.
    pub(super) fn value(&self, d: f64) -> f64 {
        let line_index = self.line_at(d);
        self.f[line_index] + self.slope[line_index] * (d - self.d[line_index])
    }

    /// Energy from 0 to `d`, exact for straight lines.
    pub(super) fn potential(&self, d: f64) -> f64 {
        let (low, high) = if d < 0.0 { (d, 0.0) } else { (0.0, d) };
        let (lower_point, upper_point) = ((low, self.value(low)), (high, self.value(high)));
        let (first, last) = (self.line_at(low), self.line_at(high));
        let between = if first == last {
            line(lower_point, upper_point)
        } else {
            // Point first + 1 ends the line that holds `low`; point `last` begins that of `high`.
            let (after_lower, before_upper) = (first + 1, last);
            line(lower_point, (self.d[after_lower], self.f[after_lower]))
                + (self.energy[before_upper] - self.energy[after_lower])
                + line((self.d[before_upper], self.f[before_upper]), upper_point)
        };
        if d < 0.0 { -between } else { between }
    }
}

/// Energy along a straight line.
fn line(start_point: (f64, f64), end_point: (f64, f64)) -> f64 {
    (end_point.0 - start_point.0) * (0.5 * (start_point.1 + end_point.1))
}
