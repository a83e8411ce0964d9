"""Keys with random subsets of parts: how many are measured right, and how honest their ± are.

The devices are emulated in this process, in lockstep: no figure depends on the clock.
"""

from __future__ import annotations

import json
import sys

import numpy as np
from random_keys import Outcome, accepted_parts, outcome, random_key

from benches.measure import Row

_WITHIN = 1.3  # times the sensor's noise: a replay that is right


def random_keys(runs: int) -> list[Row]:
    """`runs` keys, each measured and replayed; a line for each goes to stderr."""
    outcomes = [_measured(seed) for seed in range(runs)]
    replays = [each.replay for each in outcomes]
    errors = np.abs(np.concatenate([list(each.errors.values()) for each in outcomes]))
    right = float(np.mean(np.array(replays) <= _WITHIN))
    inside, near = float(np.mean(errors < 1.96)), float(np.mean(errors < 3.0))
    return [
        Row(
            f"{runs} random keys, measured in lockstep and replayed",
            f"{right:.1%} within {_WITHIN} × the sensor's noise, worst {max(replays):.3g} ×",
            "95 %",
            right / 0.95,
            "of that share",
            {"replays": json.dumps(replays)},
        ),
        Row(
            f"{errors.size} figures of these keys",
            f"{inside:.1%} of the truths within 1.96 deviations, {near:.1%} within 3",
            "90 to 98 %",
            None,
            "",
            {"inside": inside, "near": near},
        ),
    ]


def _measured(seed: int) -> Outcome:
    key = random_key(seed)
    each = outcome(key, seed)
    farthest = max(map(abs, each.errors.values()), default=0.0)
    parts = ", ".join(accepted_parts(each.measured.stages))
    print(
        f"key {seed} ({', '.join(sorted(key.parts)) or 'nothing'}): replay {each.replay:.3f}, "
        f"figures within {farthest:.1f} deviations, {parts}",
        file=sys.stderr,
        flush=True,
    )
    return each
