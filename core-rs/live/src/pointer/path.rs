//! An even path from positions that arrive unevenly: linear interpolation between their time stamps, read with a fixed
//! delay.
//!
//! A pointer that stands still sends nothing. Therefore a path that stood for longer than the delay begins to move only
//! one delay before the next position; a line from the earlier position would have begun to move long ago.

/// A position of a pointer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointerPosition {
    /// When it was there [s].
    pub time: f64,
    /// Where it was [m].
    pub x: f64,
    /// Factor of the finger's stiffness; `None`: the finger is lifted.
    pub firmness: Option<f64>,
}

/// Reads a path at rising instants.
#[derive(Clone, Debug)]
pub struct PathReader {
    delay: f64,
    previous_position: Option<PointerPosition>,
    /// The next position, and when the line to it begins [s].
    next_line: Option<(f64, PointerPosition)>,
    /// The instant that was read last [s].
    last_read_time: f64,
    n_late: u64,
}

impl PathReader {
    /// A path that stands still for longer than `delay` [s] is taken to stand until `delay` before the next position.
    pub fn new(delay: f64) -> Self {
        Self {
            delay,
            previous_position: None,
            next_line: None,
            last_read_time: f64::NEG_INFINITY,
            n_late: 0,
        }
    }

    /// The pointer already is somewhere: it led nothing so far.
    pub fn begin_at(&mut self, position: PointerPosition) {
        self.previous_position = Some(position);
    }

    /// Position and firmness at `time` [s]; `None` while no finger is on the key. `next_position` gives the following
    /// positions in the order of their time stamps.
    pub fn read(
        &mut self,
        time: f64,
        next_position: &mut impl FnMut() -> Option<PointerPosition>,
    ) -> Option<(f64, f64)> {
        loop {
            if self.next_line.is_none() {
                self.next_line = next_position().map(|position| self.line_to(position));
            }
            match self.next_line {
                Some((_, place_after)) if place_after.time <= time => {
                    (self.previous_position, self.next_line) = (Some(place_after), None);
                }
                _ => break,
            }
        }
        self.last_read_time = time;
        let position_before = self.previous_position?;
        let firmness = position_before.firmness?;
        let Some((line_start, position_after)) = self.next_line else {
            return Some((position_before.x, firmness));
        };
        let line_share = ((time - line_start) / (position_after.time - line_start)).max(0.0);
        let next_firmness = position_after.firmness.unwrap_or(firmness);
        Some((
            position_before.x + line_share * (position_after.x - position_before.x),
            firmness + line_share * (next_firmness - firmness),
        ))
    }

    /// The line to a position: when it begins, and where it ends. It begins where the path stands now, so that a
    /// position that comes late makes no jump unless its own instant has passed.
    fn line_to(&mut self, mut end_position: PointerPosition) -> (f64, PointerPosition) {
        let Some(position_before) = self.previous_position else {
            return (end_position.time, end_position);
        };
        if end_position.firmness.is_none() {
            end_position.x = position_before.x; // a finger is lifted where it was
        }
        let was_pause = end_position.time - position_before.time > self.delay;
        let line_start = position_before.time.max(end_position.time - self.delay);
        let was_awaited = self.last_read_time > line_start && !was_pause && position_before.firmness.is_some();
        self.n_late += u64::from(was_awaited || self.last_read_time >= end_position.time);
        (line_start.max(self.last_read_time), end_position)
    }

    /// Number of positions that came later than the path needed them.
    pub fn n_late(&self) -> u64 {
        self.n_late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(path: &[(f64, f64)], delay: f64, times: &[f64]) -> Vec<f64> {
        let mut placed_rows = path.iter().map(|&(time, x)| PointerPosition {
            time,
            x,
            firmness: Some(1.0),
        });
        let mut reader = PathReader::new(delay);
        let position = |&time: &f64| reader.read(time, &mut || placed_rows.next());
        times
            .iter()
            .map(position)
            .map(|placed| placed.map_or(f64::NAN, |(x, _)| x))
            .collect()
    }

    #[test]
    fn path_of_a_straight_line_sampled_unevenly() {
        let stamps = [0.0, 1e-3, 9e-3, 9.5e-3, 20e-3, 24e-3, 39e-3];
        let straight_path: Vec<_> = stamps.iter().map(|&t| (t, 0.5 * t)).collect();
        let read_times: Vec<_> = (0..38).map(|ms| 1e-3 * f64::from(ms)).collect();
        for (time, x) in read_times.iter().zip(read(&straight_path, 0.02, &read_times)) {
            assert!((x - 0.5 * time).abs() < 1e-15, "{time}: {x}");
        }
    }

    #[test]
    fn path_of_a_pointer_after_rest() {
        let pointer_path = [(0.0, 0.0), (2.0, 0.01)];
        let positions = read(&pointer_path, 0.02, &[1.0, 1.97, 1.98, 1.99, 2.0, 3.0]);
        for (read, expected) in positions.iter().zip([0.0, 0.0, 0.0, 0.005, 0.01, 0.01]) {
            assert!((read - expected).abs() < 1e-12, "{positions:?}");
        }
    }

    #[test]
    fn finger_lifts_and_lands() {
        let pointer_rows = [(0.0, Some(1.0)), (0.1, None), (0.2, Some(2.0))];
        let mut pointer_rows = pointer_rows.into_iter().map(|(time, firmness)| PointerPosition {
            time,
            x: time,
            firmness,
        });
        let mut reader = PathReader::new(0.02);
        let mut read_at = |time| reader.read(time, &mut || pointer_rows.next());
        assert_eq!(read_at(-0.1), None);
        assert!(read_at(0.09).is_some());
        assert_eq!((read_at(0.1), read_at(0.19)), (None, None));
        assert_eq!(read_at(0.2), Some((0.2, 2.0)));
    }

    #[test]
    fn path_continues_after_a_wait() {
        let pointer_path = [(0.0, 0.0), (0.015, 0.0), (0.03, 0.01), (0.045, 0.01)];
        let mut came_count = 2;
        let mut reader = PathReader::new(0.02);
        let mut next_index = 0;
        let mut last_position = 0.0;
        for tick in 0..60 {
            let time = 1e-3 * f64::from(tick);
            came_count = if time > 0.025 { 4 } else { came_count }; // the third comes 10 ms after the path needs it
            let mut next_place = || {
                let &(time, x) = pointer_path[..came_count].get(next_index)?;
                next_index += 1;
                let firmness = Some(1.0);
                Some(PointerPosition { time, x, firmness })
            };
            let (x, _) = reader.read(time, &mut next_place).expect("a finger");
            assert!((x - last_position).abs() < 0.003, "{tick}: {last_position} to {x}");
            last_position = x;
        }
        assert_eq!((last_position, reader.n_late()), (0.01, 1));
    }

    #[test]
    fn path_counts_late_positions() {
        let mut waiting = vec![(0.0, 0.0)];
        let mut reader = PathReader::new(0.02);
        let next_place = |waiting: &mut Vec<(f64, f64)>| {
            waiting.pop().map(|(time, x)| PointerPosition {
                time,
                x,
                firmness: Some(1.0),
            })
        };
        reader.read(0.0, &mut || next_place(&mut waiting));
        reader.read(0.5, &mut || next_place(&mut waiting));
        assert_eq!(reader.n_late(), 0);
        waiting.push((0.4, 1.0));
        assert_eq!(reader.read(0.5, &mut || next_place(&mut waiting)), Some((1.0, 1.0)));
        assert_eq!(reader.n_late(), 1);
    }
}
