"""`python -m accuracy docs/accuracy.md [FAMILIES]`: audit scenes, keep the results, write the page.

The named families (`named,dry`; all by default) are audited anew; the page is written from the
kept results of all families.
"""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from accuracy import tables
from accuracy.audit import Audit, look, look_drawn
from accuracy.kept import FamilyResults, keep, results, stored_results
from accuracy.random_scenes import FAMILIES
from docs.generators.wrap import wrapped
from ergon.common.module_arguments import module_arguments

NAMED = Path(__file__).parents[2] / "data" / "accuracy"
ALL = ("named", *FAMILIES)
SEEDS = 8  # of each family
_HEAD = """\
# Accuracy of plans

Made by `make accuracy`; do not edit. What a plan says of its error, and what its error is: every
scene is planned at four budgets, rendered, and compared with its exact motion. That comes from the
differential equations of the score alone (`tests/support/accuracy`): a matrix exponential where
they are linear, else Runge-Kutta of order 8 (DOP853) at a relative tolerance of 10⁻¹², with no step
across a frame or an event. Nothing of the engine takes part in it.

Errors are by the plan's own metric: ‖y − x‖/‖x − mean‖ of the worst output, over the time that the
plan's pilot played, and over that less 0.1 s and 0.2 s, whichever is worst. Of the two shorter
spans, one that ends less than 50 ms after the first sound does not count: no pilot plays less.

By ear, where all goes by modes, those above 20 kHz are taken from the exact motion: a plan leaves
them out.

* **met**: the real error is within the budget. By ear no error of the waveform is promised: what is
  heard of it is at most 1.2 times what is allowed (pitches, T60, third octaves, strokes;
  docs/numerics.md), measured over the pilot by other means than the planner's
  (`tests/support/accuracy/hearing.py`).
* **says it cannot**: the plan warns (W403) that an error stays above the budget.
* **silent miss**: no warning, and the real error is above the budget and more than 1.5 dB above the
  stated one; by ear, no warning and not met. Of a motion that is announced as chaotic: no warning,
  and its third octaves are off by more than 3 dB on average over the render, beyond what two
  tolerances of the reference are.
* **false cannot**: the plan says that it cannot, but one of the plain settings below keeps the
  budget.
* **inversions**: scenes with a plan at this budget that misses it by an error more than 1 dB above
  that of a looser one, or that costs over 1.02 times as much as a stricter one. Plans by ear do not
  count. –: audited before this was counted; the rows of `all` are of the other families.
* **overspending**: the plan's cost over that of the cheapest plain setting that is within the
  budget too (`--method ca` at 1, 2, 4 and 8 times the rate, `ca2p` and `bm4` at 1 and 2 times,
  `modal`), both by the table of costs, with what contacts and laws took in the render. Below 1 the
  plan is cheaper than all of them. Settings are held against the reference over the same time as
  the plan, up to 0.3 s beyond a render's end where the plan's pilot played so long.
* **judged**: rendered, not announced as chaotic, and with a reference that is sure: at a tolerance
  100 times wider it stays at least 10 dB closer than the plan.
"""
_NAMED = """
## Named scenes

In `tests/data/accuracy`; each says what it shows. Cells hold the stated and the real error [dB] at
a budget; the last columns are the real error at -80 dB over the whole render [dB], the worst
overspending, and the most exact plain setting with its real error [dB].
"""
_LIMITS = """
## Where -80 dB is not reached

The cost of what would help is counted in that of CA at the score's rate.

* **DRY in steps of CA.** Friction beside contacts or laws, in circles, on keys and on MATs that
  glide or whose position is imposed is not located between frames (docs/numerics.md). It turns
  and holds inside a step of CA, and is tried at 8 times the rate at most. There a mass that
  friction stops rests where its last frame began, up to a·T²/8 beside its place, and each stop
  shifts the next slip. The scenes of the family `dry` had errors of -36 to -70 dB so at 8 times
  the rate (`dry-6`, `dry-1`). A strike on a mass that such friction holds acts as a force for a
  frame: -55 and -73 dB at 44.1 kHz.
* **bridge-30** overspends at -40 dB (2.0): planning pays for a pilot of 0.1 s, which weighs the
  first milliseconds of the contacts more. There `ca2p` is at -39.6 dB.
"""


def main(page: Path, families: Sequence[str]) -> None:
    """Audit families anew, and write the page from all kept results."""
    unknown = [family for family in families if family not in ALL]
    if unknown:
        sys.exit(f"no family {', '.join(unknown)}: there are {', '.join(ALL)}")
    day, commit = datetime.now(UTC).strftime("%Y-%m-%d"), _commit()
    # Numba's threads do not survive a fork.
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), mp_context=get_context("spawn")) as pool:
        for family in families:
            if family == "named":
                named = sorted(NAMED.glob("*.yaml"))
                texts = [path.read_text(encoding="utf-8") for path in named]
                audits = pool.map(look, [path.stem for path in named], texts)
            else:
                audits = pool.map(partial(look_drawn, family), range(SEEDS))
            keep(family, results(day, commit, [_printed(audit) for audit in audits]))
    everything = {family: stored_results(family) for family in ALL}
    known = {family: own for family, own in everything.items() if own is not None}
    page.write_text(wrapped(written(known)), encoding="utf-8")


def written(known: Mapping[str, FamilyResults]) -> str:
    """The page, from the kept audits of each family."""
    drawn = [own for family, own in known.items() if family != "named"]
    parts = [
        _HEAD,
        "## By family\n",
        f"`named` and {SEEDS} random scenes of each family (`random_scenes`), seeds from 0.\n",
        tables.summary({family: own.tallies for family, own in known.items()}),
        "\nNo median of all is kept. When each was audited, and the commit that was:\n",
        *_audited(known),
        _NAMED,
        tables.scenes(known["named"].rows),
        "\n## Random scenes\n",
        tables.scenes(row for own in drawn for row in own.rows),
        _LIMITS.rstrip(),
    ]
    return "\n".join(parts) + "\n"


def _audited(known: Mapping[str, FamilyResults]) -> list[str]:
    """A line for each day and commit, with its families."""
    runs: dict[tuple[str, str], list[str]] = {}
    for family, item in known.items():
        runs.setdefault((item.day, item.commit), []).append(family)
    return [
        f"* {day}, `{commit}`: {', '.join(families)}"
        for (day, commit), families in sorted(runs.items())
    ]


def _commit() -> str:
    """The commit that is checked out, and whether the working tree differs from it."""
    command = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def _printed(audit: Audit) -> Audit:
    print(audit.name, *(f"{plan.stated:.0f}/{plan.real:.0f}" for plan in audit.plans), flush=True)
    return audit


if __name__ == "__main__":
    page, *named = module_arguments("PAGE", more="FAMILIES")
    main(Path(page), [name for names in named for name in names.split(",")] or ALL)
