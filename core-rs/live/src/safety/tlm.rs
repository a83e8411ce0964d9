//! A link that is passive whatever its stiffness, its rates and its delay of one tick: a wave line.
//!
//! Between two ends go waves instead of positions. Its price is an inertia of k·H² and that it knows no absolute
//! place; so it is for couplings that [`stiffness::limit`](super::stiffness::limit) forbids.

/// A wave line of a stiffness between a slow end, once every tick, and a fast end, several times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tlm {
    /// Impedance k·H [N·s/m].
    zc: f64,
    /// Of a tick, H [s].
    tick: f64,
    /// Waves on their way to the slow and to the fast end [N].
    waves: [f64; 2],
    /// The slow end's answer, and the fast end's so far.
    next_fast: f64,
    sum: f64,
    sum_squares: f64,
    n: u32,
    lost: f64,
}

impl Tlm {
    /// A line of stiffness `k` [N/m], its slow end met every `tick` [s].
    pub fn new(k: f64, tick: f64) -> Self {
        Self {
            zc: k * tick,
            tick,
            waves: [0.0; 2],
            next_fast: 0.0,
            sum: 0.0,
            sum_squares: 0.0,
            n: 0,
            lost: 0.0,
        }
    }

    /// Energy in the line [J].
    pub fn energy(&self) -> f64 {
        let [slow, fast] = self.waves;
        self.tick * (slow * slow + fast * fast) / (4.0 * self.zc)
    }

    /// What it has lost so far [J]; never less than before.
    pub fn lost(&self) -> f64 {
        self.lost
    }

    /// The slow end moves with `v` [m/s], centred: the force on it is minus what this returns [N].
    pub fn slow(&mut self, v: f64) -> f64 {
        let wave = self.waves[0];
        self.next_fast = wave + 2.0 * self.zc * v;
        self.zc * v + wave
    }

    /// The fast end moves with `v` [m/s], centred: the force on it is what this returns [N].
    pub fn fast(&mut self, v: f64) -> f64 {
        let wave = self.waves[1];
        let back = wave - 2.0 * self.zc * v;
        self.sum += back;
        self.sum_squares += back * back;
        self.n += 1;
        wave - self.zc * v
    }

    /// Where a slow mass `m` [kg] goes from `x` and `before` under `force` [N] and the line, solved together [m].
    pub fn move_slow(&mut self, m: f64, x: f64, before: f64, force: f64) -> f64 {
        let next = self.solve(m, self.tick, [x, before], force - self.waves[0]);
        self.slow((next - before) / (2.0 * self.tick));
        next
    }

    /// The same for a fast mass, by steps of `step` [s].
    pub fn move_fast(&mut self, m: f64, step: f64, x: f64, before: f64, force: f64) -> f64 {
        let next = self.solve(m, step, [x, before], force + self.waves[1]);
        self.fast((next - before) / (2.0 * step));
        next
    }

    fn solve(&self, m: f64, step: f64, [x, before]: [f64; 2], force: f64) -> f64 {
        let (mass, half) = (m / (step * step), self.zc / (2.0 * step));
        (mass * (2.0 * x - before) + force + half * before) / (mass + half)
    }

    /// The tick is over: waves arrive at the other end.
    pub fn tick(&mut self) {
        if self.n > 0 {
            let n = f64::from(self.n);
            let mean = self.sum / n;
            self.lost += self.tick * (self.sum_squares / n - mean * mean) / (4.0 * self.zc);
            self.waves[0] = mean;
        }
        self.waves[1] = self.next_fast;
        (self.sum, self.sum_squares, self.n) = (0.0, 0.0, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two masses, a line between them: what they and it hold, and what it lost, is what they began with.
    fn ledger(k: f64, ratio: u32) -> (f64, f64) {
        let tick = 1e-3;
        let step = tick / f64::from(ratio);
        // Tied to the ground, so that they stay where differences of positions are exact enough.
        let (slow_mass, fast_mass) = (0.05, 0.002);
        let (slow_tie, fast_tie) = (800.0, 90.0);
        let mut line = Tlm::new(k, tick);
        let (mut slow, mut fast) = ([0.0, -1e-3], [0.0, 0.0]);
        let energy = |m: f64, k: f64, [x, before]: [f64; 2], step: f64| {
            let v = (x - before) / step;
            0.5 * m * v * v + 0.5 * k * x * before
        };
        let start = energy(slow_mass, slow_tie, slow, tick);
        let (mut worst, mut moved): (f64, f64) = (0.0, 0.0);
        for _ in 0..20_000 {
            let next = line.move_slow(slow_mass, slow[0], slow[1], -slow_tie * slow[0]);
            slow = [next, slow[0]];
            for _ in 0..ratio {
                let pull = -fast_tie * fast[0];
                let next = line.move_fast(fast_mass, step, fast[0], fast[1], pull);
                fast = [next, fast[0]];
            }
            line.tick();
            let there = energy(fast_mass, fast_tie, fast, step);
            let held = energy(slow_mass, slow_tie, slow, tick) + there + line.energy();
            worst = worst.max((held + line.lost() - start).abs() / start);
            moved = moved.max(there / start);
        }
        (worst, moved)
    }

    #[test]
    fn what_goes_in_is_stored_lost_or_comes_out() {
        for k in [1.0, 1e3, 1e6] {
            for ratio in [1, 10, 44] {
                let (worst, moved) = ledger(k, ratio);
                assert!(worst < 1e-12, "k {k}, ratio {ratio}: {worst}");
                assert!(
                    moved > 1e-5,
                    "the other end moves: k {k}, ratio {ratio}, {moved}"
                );
            }
        }
    }

    #[test]
    fn it_pulls_like_its_spring() {
        // Fixed fast end, slow end pushed slowly by 1 mm over 2 s: the force is k·x, to the line's own steps.
        let (k, tick) = (200.0, 1e-3);
        let mut line = Tlm::new(k, tick);
        let mut force = 0.0;
        for _ in 0..2000 {
            force = line.slow(0.5e-3);
            line.fast(0.0);
            line.tick();
        }
        assert!((force / (k * 1e-3) - 1.0).abs() < 2e-3, "{force}");
    }
}
