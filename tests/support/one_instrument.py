"""A score of one instrument, and its outputs: scenes of modules that are stepped."""

import numpy as np
from checked import check

from ergon.scores.staging.stage import stage


def score(modules: str, out: str, accuracy: str = "method: ca", rate: int = 44_100) -> str:
    lines = "\n".join(f"      {line}" for line in modules.strip().split("\n"))
    return f"""ergon: 1
rates: {{audio: {rate}Hz}}
accuracy: {{{accuracy}}}
instruments:
  i:
    modules:
{lines}
    out: {{{out}}}
render: {{bits: float, tail: 40ms}}
"""


def rendered(text: str) -> np.ndarray:
    """Outputs of a score (n_frames, n_out)."""
    built = stage(check(text).piece, planned=True)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound
