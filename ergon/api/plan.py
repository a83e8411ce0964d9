"""The plan of a score: by which method each part is computed, at what cost and error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report

from . import score as scores
from .options import AccuracyOptions
from .pictures import table_html

if TYPE_CHECKING:
    from ergon._core import IslandChoice, PlanRow
    from ergon.exchange.plan_file import Budget
    from ergon.scores.reading.outputs import Accuracy

    from .work_shares import Shares, WorkPiece


@dataclass(frozen=True, slots=True)
class Plan:
    """How a score is computed.

    `rows` has a row for each part; `choices` are the decisions behind the rows, and `hash` their
    sha256 (64 hex digits). `is_kept` says whether all results of trials were in the cache,
    `seconds` how long reading, planning and staging took. `inputs` are the files that the plan
    was made from. `budget` is the accuracy that the plan was made for: `method`, `error` [dB],
    `cents` and `upto` [Hz], as far as they were given. If the score has a rate of motion, `seen`
    has rows for parts that nobody hears, as they are computed for pages and motion files.
    `highest_modes` are those of strings and plates by name [Hz]. `pieces` are what other
    processes can compute, each as a whole.
    """

    rows: tuple[PlanRow, ...]
    hash: str
    is_kept: bool
    seconds: float
    choices: Sequence[IslandChoice]
    inputs: tuple[Path, ...]
    budget: Budget
    highest_modes: Mapping[str, float]
    pieces: tuple[WorkPiece, ...] = ()
    seen: tuple[PlanRow, ...] = ()

    def shares(self, count: int) -> Shares:
        """How the work would be divided among `count` processes."""
        from .work_shares import share_out

        return share_out(self.pieces, self.cost, count)

    @property
    def is_cut_short(self) -> bool:
        """Whether planning ended because its trials had used up the work that they may do."""
        return any(row.cut_short for row in self.rows)

    @property
    def cost(self) -> float:
        """Seconds of work on one core for a second of sound, by the table of costs."""
        return sum(row.cost for row in self.rows)

    def _repr_html_(self) -> str:
        return table_html(
            ("parts", "modules", "computed", "error", "cost"),
            (
                (
                    ", ".join(row.parts),
                    f"{row.n_mat:,} + {row.n_lia:,}",
                    row.what,
                    "" if row.error_db is None else f"{row.error_db:.1f} dB",
                    f"{row.cost:.2g}",
                )
                for row in self.rows
            ),
        )

    def write(self, path: str | Path, *, force: bool = False) -> None:
        """Write the plan into a file for the option `plan` of a later call; "-" is stdout.

        With `force`, a file that ergon did not write is overwritten. Raises FileRefusedError.
        """
        from ergon.exchange.plan_file import write

        write(str(path), self.choices, self.hash, self.budget, force=force, inputs=self.inputs)


def budget_of(accuracy: Accuracy) -> Budget:
    """The accuracy that a plan was made for, as far as it was given."""
    names = ("method", "error", "cents", "upto")
    return {name: getattr(accuracy, name) for name in names if getattr(accuracy, name) is not None}


def plan(
    score: str | Path, options: AccuracyOptions | None = None, *, report: Report | None = None
) -> Plan:
    """Plan a score within its accuracy. Raises ScoreError and OptionError."""
    from ergon.scores.staging.highest_modes import highest_modes

    from .work_shares import work_pieces

    options = options or AccuracyOptions()
    loaded = scores.read(score, options, report)
    has_motion = scores.piece_of(loaded).motion is not None
    staged = scores.stage_piece(loaded, options, report, is_seen=has_motion)
    staged_plan, planned_accuracy = staged.stage.plan, staged.stage.planned_accuracy
    assert staged_plan is not None
    assert planned_accuracy is not None
    budget = budget_of(planned_accuracy)
    plan_rows = tuple(staged_plan.rows())
    return Plan(
        plan_rows,
        staged_plan.hash,
        staged.stage.is_plan_kept,
        staged.plan_s,
        staged_plan.choices(),
        (*loaded.inputs, *options.files),
        budget,
        {
            highest_mode.name: highest_mode.frequency
            for highest_mode in highest_modes(staged.piece, staged.stage.built_network)
        },
        work_pieces(staged.stage.simulation, plan_rows, staged.stage.rate),
        tuple(staged_plan.seen()),
    )
