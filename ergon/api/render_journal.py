"""The samples that a session played, computed again from its journal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ergon.common.errors import ErgonError
from ergon.common.report import Report
from ergon.scores.reading.digest import digest_of

from . import score as scores
from .errors import DivergedError, OptionError
from .layouts import chunks_of_layout
from .options import FileOptions
from .render import Completed

# Options whose values the journal itself decides.
_OPTIONS_SET_BY_JOURNAL = (
    "from_",
    "until",
    "stems",
    "wet",
    "only",
    "except_",
    "channels",
    "seed",
    "rate",
    "hands",
    "input",
    "method",
    "error",
    "cents",
    "plan",
)


def render_journal(
    path: Path, out: str | Path | None, options: FileOptions, report: Report
) -> Completed:
    """Write what a session played, its real hands too, at the level that was heard.

    Raises OptionError, ScoreError, DivergedError, FileRefusedError, and ErgonError for a journal
    that cannot be read or played.
    """
    from ergon.exchange.wave_header import Stamp, WaveFormat
    from ergon.rendering.job import RenderJob
    from ergon.rendering.level import Level
    from ergon.rendering.render import render_files
    from ergon.repl.session.journal_content import read_journal
    from ergon.repl.session.replay import ReplayedSession

    for name in _OPTIONS_SET_BY_JOURNAL:
        if getattr(options, name) not in (None, False):
            raise OptionError(name, "a journal is rendered as it was played, without this option")
    if options.motion:
        raise OptionError("motion", "a journal has no motion file; render its score")
    with _journal_errors(path):
        journal_content = read_journal(path, trust=options.trust)
        with scores.staging(journal_content.session_start.texts.load, report):
            replayed_session = ReplayedSession(journal_content)
    for warning in replayed_session.warnings:
        report.warn(warning)
    if not replayed_session.n_frames:
        raise ErgonError(f"{path}: the session played nothing")
    session_start, running = journal_content.session_start, replayed_session.running
    piece, plan = running.version.piece, running.stage.plan
    job = RenderJob(
        target=str(out) if out is not None else path.with_suffix(".wav").name,
        format=WaveFormat(
            scores.integer_rate(replayed_session.rate),
            replayed_session.n_channels,
            options.bits or 24,
        ),
        start=0,
        stop=replayed_session.n_frames,
        level=Level(
            None,
            session_start.limit,
            session_start.highpass,
            session_start.gain,
            session_start.reference,
        ),
        stamp=Stamp(
            piece.title,
            digest_of(piece),
            plan.hash if plan else "",
            chunks_of_layout(piece.mix.layout, replayed_session.n_channels, piece.title),
        ),
        block_frames=options.block,
        threads=options.threads,
        force=options.force,
        inputs=(
            path,
            *(() if session_start.take is None else (session_start.take.path,)),
            *(() if session_start.frozen is None else session_start.frozen.files),
            *(
                input_path
                for texts in journal_content.all_texts()
                for input_path in texts.load().inputs
            ),
        ),
        silences=journal_content.silences,
    )
    with (
        _journal_errors(path),
        report.progress(
            f"rendering {path.name}", replayed_session.n_frames, replayed_session.rate
        ) as progress,
    ):
        rendered = render_files(replayed_session, job, progress.update)
    stage = replayed_session.running.stage
    return Completed(rendered, job, 0.0, stage.network, stage.simulation)


@contextmanager
def _journal_errors(path: Path) -> Iterator[None]:
    """Turn errors of reading or replaying a journal into ErgonErrors."""
    from ergon import _core
    from ergon.repl.session.journal import JournalError
    from ergon.repl.session.version import NotTakenError

    try:
        yield
    except _core.DivergedError as error:
        raise DivergedError((), reason=str(error)) from None
    except JournalError as error:
        raise ErgonError(str(error)) from None
    except NotTakenError as error:
        raise ErgonError(f"{path}: {error}") from None
