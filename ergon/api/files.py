"""A score, or the journal of a session, into WAV files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report

from . import score as scores
from .options import FileOptions
from .render import prepare, target, write
from .render_journal import render_journal

if TYPE_CHECKING:
    from ergon.rendering.job import RenderedFiles


def render_to_file(
    score: str | Path,
    out: str | Path | None = None,
    options: FileOptions | None = None,
    *,
    report: Report | None = None,
) -> RenderedFiles:
    """Render a score, or the journal of a session (`.jsonl`), into a WAV file and its stems.

    `out` is the file to write; "-" is stdout; without it the file is the one that the score names,
    or SCORE.wav in the current folder. All files are written, or none. Raises ScoreError,
    DivergedError, OptionError, and FileRefusedError where a file may not be written.
    """
    options, report = options or FileOptions(), report or Report()
    if Path(score).suffix == scores.JOURNAL_SUFFIX:
        return render_journal(Path(score), out, options, report).files
    loaded = scores.read(score, options, report)
    return write(prepare(loaded, target(score, loaded, out), options, report), report).files
