"""`ergon render session.jsonl`: the samples that a session played, computed again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from . import score
from .console import Console
from .outcome import Diverged, Refused
from .summary import finer, rendered

if TYPE_CHECKING:
    from .render import Wishes

SUFFIX = ".jsonl"
# What a journal says for itself.
_NOT_HERE = {
    "--from": "from_",
    "--to": "to",
    "--stems": "stems",
    "--channels": "channels",
    "--seed": "seed",
    "--rate": "rate",
    "--hands": "hands",
    "--method": "method",
    "--error": "error",
    "--cents": "cents",
    "--plan": "pinned",
}


def render_journal(console: Console, path: Path, wishes: Wishes) -> None:
    """Write what a session's virtual players played, at the level that was heard."""
    from ergon._core import DivergedError
    from ergon.exchange.wave_header import Stamp, WaveFormat
    from ergon.rendering.level import Level
    from ergon.rendering.render import Order, render
    from ergon.repl.session.journal import JournalError
    from ergon.repl.session.recorded import opened
    from ergon.repl.session.replay import Again
    from ergon.repl.session.version import NotTakenError

    for option, name in _NOT_HERE.items():
        if getattr(wishes, name) is not None:
            raise Refused(f"a journal is rendered as it was played; {option} does nothing to it")
    try:
        replay = opened(path, trust=wishes.trust)
        with score.staging(console, replay.opening.texts.load):
            again = Again(replay)
    except JournalError as error:
        raise Refused(str(error)) from None
    except NotTakenError as error:
        raise Refused(f"{path}: {error}") from None
    if not again.n_frames:
        raise Refused(f"{path}: nothing was played")
    opening = replay.opening
    piece = again.running.version.piece
    plan = again.running.stage.plan
    order = Order(
        target=wishes.output or path.with_suffix(".wav").name,
        format=WaveFormat(score.whole_rate(again.rate), again.n_channels, wishes.bits or 24),
        start=0,
        stop=again.n_frames,
        level=Level(None, opening.limit, opening.highpass, opening.gain),
        stamp=Stamp(piece.title, piece.digest(), plan.hash if plan else ""),
        block=wishes.block,
        threads=wishes.threads,
        force=wishes.force,
        inputs=(path, *(one for texts in replay.all_texts() for one in texts.load().inputs)),
    )
    try:
        with console.progress(f"rendering {path.name}", again.n_frames, again.rate) as progress:
            done = render(again, order, progress.at)
    except DivergedError as error:
        raise Diverged(str(error)) from None
    except JournalError as error:
        raise Refused(str(error)) from None
    except NotTakenError as error:
        raise Refused(f"{path}: {error}") from None
    rendered(console, done, order, 0.0, again.running.stage.network)
    finer(console, again.running.stage.simulation)
