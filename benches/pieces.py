"""What whole renders of bundled pieces cost beside what their plans say, and beside plain CA."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benches.fresh_process import ergon
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
# Threads of libraries.
_SINGLE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_CA = ("--method", "ca")
_HEAD = (
    "piece", "length", "cores", "the plan says", "ratio", "of that planning",
    "cores by ca", "its plan says", "ratio", "over ca",
)  # fmt: skip
_HEAD_LINES = (f"| {' | '.join(_HEAD)} |", f"|{'---|' * len(_HEAD)}")


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


def cost(score: Path, length: float, options: Sequence[str] = ()) -> Cost | None:
    """The cost of a piece by a plan with these options; None if it is refused."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        variables = {**_SINGLE_THREAD, "ERGON_CACHE": "off", "XDG_CACHE_HOME": name}
        planning, plan = ergon(["plan", "--json", *options, str(score)], folder, variables)
        if plan.returncode:
            return None
        sound = ["-q", "--threads", "1", "-o", str(folder / "piece.wav")]
        measured, rendered = ergon(["render", *sound, *options, str(score)], folder, variables)
    if rendered.returncode:
        return None
    stated = json.loads(plan.stdout.splitlines()[-1])["cost"]
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
    lines = [*_HEAD_LINES, *map(table_row, costs)]
    dearer = [piece.piece for piece in costs if (piece.over_ca or 0.0) > 1.0]
    lines.append(f"cost more than by --method ca: {', '.join(dearer) or 'none'}")
    return "\n".join(lines)


def table_row(piece: PieceCost) -> str:
    """The row of a piece."""
    by_ca, over_ca = piece.by_ca, piece.over_ca
    cells = [piece.piece, f"{piece.length:.0f} s", *_cells(piece.planned)]
    cells.append(f"{piece.planned.planning:.3f}")
    cells += ["refused", "–", "–"] if by_ca is None else _cells(by_ca)
    cells.append("–" if over_ca is None else f"{over_ca:.2f}")
    return f"| {' | '.join(cells)} |"


def _cells(cost: Cost) -> list[str]:
    return [f"{cost.measured:.3f}", f"{cost.stated:.3f}", f"{cost.ratio:.2f}"]


def pieces(names: Sequence[str] = PIECES) -> list[Row]:
    """Whole renders of bundled pieces; prints the row of each at once, and their table."""
    costs = []
    for name in names:
        costs.append(piece_cost(name))
        print(table_row(costs[-1]), flush=True)
    print(table(costs), flush=True)
    return [_row(piece) for piece in costs]


def _row(piece: PieceCost) -> Row:
    planned, by_ca = piece.planned, piece.by_ca
    summary = (
        f"{planned.measured:.3f} cores, of that {planned.planning:.3f} for planning; "
        f"the plan says {planned.stated:.3f}"
    )
    values: dict[str, float | int | str] = {
        "length_s": piece.length,
        "cores": planned.measured,
        "planning_cores": planned.planning,
        "stated_cores": planned.stated,
    }
    reference = "`--method ca` is refused"
    if by_ca is not None:
        reference = f"`--method ca`: {by_ca.measured:.3f} cores; its plan says {by_ca.stated:.3f}"
        values |= {"ca_cores": by_ca.measured, "ca_stated_cores": by_ca.stated}
    what = f"{piece.piece}, the whole render of {piece.length:.0f} s"
    return Row(what, summary, reference, piece.over_ca, "processor time over that by ca", values)
