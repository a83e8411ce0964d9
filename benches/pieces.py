"""What whole renders of bundled pieces cost beside what their plans say, and beside plain CA."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benches.measure import Row
from ergon.scores.reading.load import load
from ergon.scores.staging.preparing import prepare

LIBRARY = Path(__file__).parent.parent / "scores" / "library"
PIECES = (
    "drum-machine",
    "workshop",
    "night-piece",
    "procession",
    "evening-raga",
    "interlocking",
    "change-ringing",
    "bloom",
    "torn-cloth",
    "poured-chain",
    "ocean-drum",
    "feathers-small",
)
_ERGON = (sys.executable, "-m", "ergon.cli")
_CA = ("--method", "ca")
_HEAD = (
    "piece", "length", "cores", "the plan says", "ratio", "of that planning",
    "cores by ca", "its plan says", "ratio", "over ca",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Cost:
    """A render of a piece, in cores: processor time over the piece's length.

    `measured`: of a fresh process that plans, starts and renders; `planning`: of one that only
    plans; `stated`: the plan's own total by the table of costs.
    """

    measured: float
    planning: float
    stated: float

    @property
    def ratio(self) -> float:
        """What was measured over what the plan says."""
        return self.measured / self.stated


@dataclass(frozen=True, slots=True)
class PieceCost:
    """A piece, its length [s], and its costs; `by_ca` is None where plain CA is refused."""

    piece: str
    length: float
    planned: Cost
    by_ca: Cost | None

    @property
    def over_ca(self) -> float | None:
        """The planned render's processor time over that by `--method ca`."""
        return None if self.by_ca is None else self.planned.measured / self.by_ca.measured


def _run(line: Sequence[str], folder: Path) -> tuple[int, float, str]:
    """Exit code, processor time [s] and standard output of a command in a fresh process.

    Nothing that an earlier process stored is used; libraries get one thread, too.
    """
    environment = {
        **os.environ,
        "ERGON_CACHE": "off",
        "XDG_CACHE_HOME": str(folder),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    with tempfile.TemporaryFile(dir=folder) as output:
        child = subprocess.Popen(
            line, stdout=output, stderr=subprocess.DEVNULL, env=environment, cwd=folder
        )
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        text = output.read().decode()
    return child.returncode, used.ru_utime + used.ru_stime, text


def cost(score: Path, length: float, options: Sequence[str] = ()) -> Cost | None:
    """The cost of a piece by a plan with these options; None if it is refused."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plan = [*_ERGON, "plan", "--json", *options, str(score)]
        code, planning, text = _run(plan, folder)
        if code:
            return None
        stated = json.loads(text.splitlines()[-1])["cost"]
        sound = ["-q", "--threads", "1", "-o", str(folder / "piece.wav")]
        code, measured, _ = _run([*_ERGON, "render", *sound, *options, str(score)], folder)
    if code:
        return None
    return Cost(measured / length, planning / length, stated)


def piece_cost(piece: str) -> PieceCost:
    """The costs of a bundled piece."""
    score = LIBRARY / f"{piece}.yaml"
    read = load(score).piece
    assert read is not None, f"{piece} is refused"
    length = prepare(read).n_frames / read.rate
    planned = cost(score, length)
    assert planned is not None, f"{piece} is not rendered"
    return PieceCost(piece, length, planned, cost(score, length, _CA))


def table(costs: Sequence[PieceCost]) -> str:
    """A row for each piece, and a line that names those that cost more than by `--method ca`."""
    lines = [f"| {' | '.join(_HEAD)} |", f"|{'---|' * len(_HEAD)}"]
    for found in costs:
        cells = [found.piece, f"{found.length:.0f} s", *_cells(found.planned)]
        cells.append(f"{found.planned.planning:.3f}")
        over = found.over_ca
        cells += ["refused", "–", "–"] if found.by_ca is None else _cells(found.by_ca)
        cells.append("–" if over is None else f"{over:.2f}")
        lines.append(f"| {' | '.join(cells)} |")
    dearer = [found.piece for found in costs if (found.over_ca or 0.0) > 1.0]
    lines.append(f"cost more than by --method ca: {', '.join(dearer) or 'none'}")
    return "\n".join(lines)


def _cells(found: Cost) -> list[str]:
    return [f"{found.measured:.3f}", f"{found.stated:.3f}", f"{found.ratio:.2f}"]


def pieces(names: Sequence[str] = PIECES) -> list[Row]:
    """Whole renders of bundled pieces; prints their table too."""
    costs = []
    for name in names:
        costs.append(piece_cost(name))
        print(table(costs[-1:]).splitlines()[2], flush=True)
    print(table(costs), flush=True)
    return [_row(found) for found in costs]


def _row(found: PieceCost) -> Row:
    planned, by_ca = found.planned, found.by_ca
    summary = (
        f"{planned.measured:.3f} cores, of that {planned.planning:.3f} for planning; "
        f"the plan says {planned.stated:.3f}"
    )
    values: dict[str, float | int | str] = {
        "length_s": found.length,
        "cores": planned.measured,
        "planning_cores": planned.planning,
        "stated_cores": planned.stated,
    }
    reference = "`--method ca` is refused"
    if by_ca is not None:
        reference = f"`--method ca`: {by_ca.measured:.3f} cores; its plan says {by_ca.stated:.3f}"
        values |= {"ca_cores": by_ca.measured, "ca_stated_cores": by_ca.stated}
    what = f"{found.piece}, the whole render of {found.length:.0f} s"
    return Row(what, summary, reference, found.over_ca, "processor time over that by ca", values)
