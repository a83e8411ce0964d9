"""`python -m accuracy docs/accuracy.md [SEEDS] [FAMILIES]`: audit scenes, write the page."""

import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from accuracy import tables
from accuracy.audit import Audit, look, look_drawn
from accuracy.random_scenes import FAMILIES

NAMED = Path(__file__).parents[2] / "data" / "accuracy"
SEEDS = 8  # of each family
WORKERS = 4
_HEAD = """\
# Accuracy of plans

Made by `make accuracy`; do not edit. What a plan says of its error, and what its error is: every
scene is planned at four budgets, rendered, and compared with its exact motion. That comes from the
differential equations of the score alone (`tests/support/accuracy`): a matrix exponential where
they are linear, else Runge-Kutta of order 8 (DOP853) at a relative tolerance of 10⁻¹², with no step
across a frame or an event. Nothing of the engine takes part in it.

Errors are by the plan's own metric: ‖y − x‖/‖x − mean‖ of the worst output, over the time that the
plan's pilot played, and over that less 0.1 s and 0.2 s, whichever is worst.

By ear, where all goes by modes, what lies above 20 kHz is taken from both: a plan may leave it out.

* **met**: the real error is within the budget. By ear no error of the waveform is promised.
* **says it cannot**: the plan warns (W403) that an error stays above the budget.
* **silent miss**: no warning, and the real error is above the budget (by ear: above -60 dB) and
  more than 1.5 dB above the stated one.
* **overspending**: the plan's cost over that of the cheapest plain setting that is within the
  budget too (`--method ca` at 1, 2, 4 and 8 times the rate, `ca2p` and `bm4` at 1 and 2 times,
  `modal`), both by the table of costs. Below 1 the plan is cheaper than all of them.
* **judged**: rendered, not announced as chaotic, and with a reference that is sure: at a tolerance
  100 times wider it stays at least 10 dB closer than the plan.
"""
_NAMED = """
## Named scenes

In `tests/data/accuracy`; each says what it shows. Cells hold the stated and the real error [dB] at
a budget; the last columns are the real error at -80 dB over the whole render [dB], the worst
overspending, and the most exact plain setting with its real error [dB].
"""


def main(page: Path, n_seeds: int, families: Sequence[str]) -> None:
    """Write the page."""
    named = {path.stem: path.read_text(encoding="utf-8") for path in sorted(NAMED.glob("*.yaml"))}
    drawn = {family: [f"{family}-{seed}" for seed in range(n_seeds)] for family in families}
    # Numba's threads do not survive a fork.
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        found_named = [_told(audit) for audit in pool.map(look, named, named.values())]
        found = {
            family: [_told(a) for a in pool.map(partial(look_drawn, family), range(len(names)))]
            for family, names in drawn.items()
        }
    page.write_text(written(found_named, found), encoding="utf-8")


def written(named: Sequence[Audit], drawn: Mapping[str, Sequence[Audit]]) -> str:
    """The page, of audits of the named scenes and of those of each family."""
    n_seeds = max(map(len, drawn.values()))
    parts = [
        _HEAD,
        "## By family\n",
        f"`named` and {n_seeds} random scenes of each family (`random_scenes`), seeds from 0.\n",
        tables.summary({"named": named, **drawn}),
        _NAMED,
        tables.scenes(named),
        "\n## Random scenes\n",
        tables.scenes(audit for audits in drawn.values() for audit in audits),
    ]
    return "\n".join(parts) + "\n"


def _told(audit: Audit) -> Audit:
    print(audit.name, *(f"{plan.stated:.0f}/{plan.real:.0f}" for plan in audit.plans), flush=True)
    return audit


if __name__ == "__main__":
    main(
        Path(sys.argv[1]),
        int(sys.argv[2]) if len(sys.argv) > 2 else SEEDS,
        sys.argv[3].split(",") if len(sys.argv) > 3 else list(FAMILIES),
    )
