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

Made by `make accuracy`; do not edit. A plan states an error. This page compares it with the real
error: every scene is planned at four budgets, rendered, and compared with its exact motion.

The exact motion is computed from the differential equations of the score alone
(`tests/support/accuracy`), without any code of the engine. Where they are linear it is a matrix
exponential. Else it is Runge-Kutta of order 8 (DOP853: Hairer, Nørsett and Wanner, 1993) at a
relative tolerance of 10⁻¹², with no step across a frame or an event.

Under `units: ca` (the family `units-ca`) the numbers of a score are those of the discrete network:
they are what was chosen, and no differential equation stands behind them. The reference is this
network, stepped by its numbers at its own rate in plain loops (`tests/support/oracle`), again
without any code of the engine; a key in SI units that touches it is stepped with it, with exactly
its pitch and decay. How sure it is follows from a second run, in which all that sets the network
going is larger by 10⁻¹³.

## How errors are measured

The error is that of the plan's own metric, ‖y − x‖/‖x − mean‖, of the worst output. It is taken
over the time that the plan's pilot played, and over that time less 0.1 s and 0.2 s; the largest
counts. A shorter time that ends less than 50 ms after the first sound does not count, because no
pilot is so short.

By ear no error of the waveform is promised. The audible error is measured instead (pitches, T60,
third octaves, strokes: [the budget by ear](numerics.md#the-budget-by-ear)), by a program of its own
(`tests/support/accuracy/hearing.py`). A plan by ear leaves out modes above 20 kHz. So where all is
computed by modes, the exact motion is taken without them.

## What the columns mean

* **judged**: rendered, not announced as chaotic, and with a reference that is sure. A reference is
  sure if it differs from one at a tolerance 100 times wider by at least 10 dB less than the plan
  does.
* **met**: the real error is within the budget. By ear: the audible error is at most 1.2 times what
  is allowed, since two programs measure it.
* **says it cannot**: the plan warns (W403) that an error stays above the budget.
* **silent miss**: there is no warning, and the real error is above the budget and more than 1.5 dB
  above the stated one. By ear: no warning, and not met. For a motion that is announced as chaotic:
  no warning, and third octaves are off by more than 3 dB on average over the render, beyond the
  difference of two tolerances of the reference.
* **false cannot**: the plan says that it cannot, but one of the plain settings below is within the
  budget.
* **inversions**: scenes whose plan at this budget misses it by an error more than 1 dB above that
  of a looser budget, or costs over 1.02 times as much as a stricter one. Plans by ear do not count.
  A –: audited before inversions were counted. The rows of `all` are of the other families.
* **real − stated, worst**: the largest excess of a real error over the stated one.
* **overspending**: the cost of the plan over that of the cheapest plain setting within the budget,
  both by the table of costs, with the work of contacts and laws in the render. Plain settings are
  `--method ca` at 1, 2, 4 and 8 times the rate, `ca2p` and `bm4` at 1 and 2 times, and `modal`.
  Below 1 the plan is cheaper than all of them. Settings are compared with the reference over the
  same time as the plan, up to 0.3 s beyond the end of a render where the pilot played so long.
"""
_NAMED = """
## Named scenes

The scenes are in `tests/data/accuracy`; each file says what it shows. A cell holds the stated and
the real error [dB] at a budget. The last columns are the real error at -80 dB over the whole render
[dB], the worst overspending, and the most exact plain setting with its real error [dB].
"""
_LIMITS = """
## Where -80 dB is not reached

* **DRY in steps of CA.** Some friction is not located between frames
  ([dry friction](numerics.md#dry-friction)): that beside contacts or laws, in circles, on keys, and
  on MATs that glide or have an imposed position. It turns and holds inside a step of CA, and is
  tried at 8 times the rate at most.
  * A mass that friction stops then rests where its last frame began, up to a·T²/8 beside its place.
    Each stop shifts the next slip. The scenes of the family `dry` had errors of -36 to -70 dB in
    this way at 8 times the rate (`dry-6`, `dry-1`).
  * A strike on a mass that such friction holds acts as a force over a frame: -55 and -73 dB at
    44.1 kHz.
* **bridge-30** overspends at -40 dB (2.0). Planning pays for a pilot of 0.1 s, in which the first
  milliseconds of the contacts count more. There `ca2p` has -39.6 dB.
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
    page, *named = module_arguments("PAGE", rest_metavar="FAMILIES")
    main(Path(page), [name for names in named for name in names.split(",")] or ALL)
