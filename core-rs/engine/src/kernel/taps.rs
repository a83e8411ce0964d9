//! Listening: sums over ranges by a fixed tree of eight lanes, whatever the vector width.

use crate::network::Term;
use crate::plan::Plan;
use crate::state::Body;

/// Write one frame of outputs, (n_out).
pub(crate) fn tap(plan: &Plan, body: &Body, frame: &mut [f64]) {
    for (output, sample) in plan.outputs.iter().zip(frame) {
        *sample = output
            .terms
            .iter()
            .map(|term| value(plan, body, term))
            .sum();
    }
}

fn value(plan: &Plan, body: &Body, term: &Term) -> f64 {
    match *term {
        Term::Position { first, len, weight } => {
            weight * sum(&body.x[first..first + len], |i| body.x[first + i])
        }
        // A link's force on its second point is −f.
        Term::Force { first, len, weight } => {
            -weight * sum(&body.link[first..first + len], |i| body.link[first + i])
        }
        Term::Ground { first, len, weight } => {
            weight
                * sum(&body.x[first..first + len], |i| {
                    let mat = first + i;
                    plan.ground[mat] * (body.x[mat] - plan.rest[mat])
                })
        }
    }
}

fn sum(range: &[f64], at: impl Fn(usize) -> f64) -> f64 {
    if range.len() == 1 {
        return at(0);
    }
    let mut lanes = [0.0; 8];
    for i in 0..range.len() {
        lanes[i % 8] += at(i);
    }
    ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6]))
        + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]))
}
