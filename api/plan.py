"""The plan of a score: by which method each part is computed, at what cost and error."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report

from . import score as scores
from .options import AccuracyOptions

if TYPE_CHECKING:
    from ergon._core import PlanRow
    from ergon.exchange.plan_file import Choices


@dataclass(frozen=True, slots=True)
class Plan:
    """How a score is computed: a row for each part of it, and the decisions behind them.

    `hash` is of the decisions (64 hex digits); `is_kept`: whether it was found in the cache of
    plans; `seconds`: how long it took to read, plan and stage the score. `inputs` are the files
    that it was made from.
    """

    rows: tuple[PlanRow, ...]
    hash: str
    is_kept: bool
    seconds: float
    choices: Choices
    inputs: tuple[Path, ...]

    @property
    def is_cut_short(self) -> bool:
        """Whether planning ended because its trials had done all the work that they may."""
        return any(row.cut_short for row in self.rows)

    @property
    def cost(self) -> float:
        """Seconds of work on one core for a second of sound, by the table of costs."""
        return sum(row.cost for row in self.rows)

    def write(self, path: str | Path, *, force: bool = False) -> None:
        """Write the plan as a file that `plan=` of a render follows; "-" is stdout.

        With `force` a file is overwritten that ergon did not write. Raises FileRefusedError.
        """
        from ergon.exchange.plan_file import write

        write(str(path), self.choices, self.hash, force=force, inputs=self.inputs)


def plan(
    score: str | Path, options: AccuracyOptions | None = None, *, report: Report | None = None
) -> Plan:
    """Plan a score within its accuracy. Raises ScoreError and OptionError."""
    options = options or AccuracyOptions()
    loaded = scores.read(score, options, report)
    staged = scores.stage_piece(loaded, options, report)
    made = staged.stage.plan
    assert made is not None
    return Plan(
        tuple(made.rows()),
        made.hash,
        staged.stage.is_plan_kept,
        staged.plan_s,
        made.choices(),
        (*loaded.inputs, *options.files),
    )
