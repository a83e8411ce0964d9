"""`ergon sweep`: variants of a score as sounds, and what they are like."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ergon.api.sweep import SweepOptions
from ergon.api.sweep import sweep as make_sweep

from . import options
from .console import Console, plural
from .outcome import Diverged, Findings
from .tables import table

if TYPE_CHECKING:
    from ergon.api.sweep_table import SweepRow

_COLUMN_BY_FIGURE = {
    "loudness_lufs": "LUFS",
    "centroid_hz": "centroid [Hz]",
    "pitch_hz": "pitch [Hz]",
    "t60_s": "T60 [s]",
    "cpu_s": "work [CPU s]",
    "error_db": "error [dB]",
    "error_cents": "error [cents]",
}


@click.command()
@options.score
@options.from_dataclass(SweepOptions, "vary zip")
@click.option(
    "-o",
    "--output",
    "out",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="The folder of sounds, table and picture. Default: SCORE.sweep.",
)
@options.from_dataclass(SweepOptions, "sound jobs")
@options.on
@options.bits
@options.seed
@options.from_dataclass(SweepOptions, "rate")
@options.accuracy
@options.draft
@options.force
@options.trust
@options.with_console
def sweep(console: Console, score_path: str, **arguments: Any) -> None:
    """Render variants of a score, with a table and a picture of what they are like.

    TARGET is what `set` of a session names, or seed. Every variant is checked before any is
    rendered. What is stopped keeps what is whole; the same command computes only what is missing. A
    variant that is refused or diverges is a row of the table with its reason.
    """
    sweep_result = make_sweep(score_path, SweepOptions(**arguments), report=console)
    if not console.json:
        console.data(_table_text(sweep_result.targets, sweep_result.rows))
    if sweep_result.n_known:
        console.say(f"{plural(sweep_result.n_known, 'variant')} of an earlier run kept")
    console.say(f"wrote {sweep_result.table} and {sweep_result.picture}")
    failed_rows = [row for row in sweep_result.rows if row.status != "ok"]
    if failed_rows:
        message = (
            f"{plural(len(failed_rows), 'variant')} of {len(sweep_result.rows):,} failed; the "
            "first: "
        )
        outcome_class = (
            Diverged if all(row.status == "diverged" for row in failed_rows) else Findings
        )
        raise outcome_class(message + failed_rows[0].reason)


def _table_text(targets: tuple[str, ...], sweep_rows: tuple[SweepRow, ...]) -> str:
    shown_figures = [
        name
        for name in _COLUMN_BY_FIGURE
        if any(row.figures.get(name) is not None for row in sweep_rows)
    ]
    table_rows = [(*targets, *(_COLUMN_BY_FIGURE[name] for name in shown_figures), "")]
    for row in sweep_rows:
        value_texts = [_value_text(row.figures.get(name)) for name in shown_figures]
        table_rows.append((*row.values, *value_texts, "" if row.status == "ok" else row.status))
    return table(table_rows)


def _value_text(x: float | None) -> str:
    return "-" if x is None else f"{x:.4g}"
