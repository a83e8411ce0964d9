"""`ergon repl`: a score that is played while lines change it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from . import options
from .console import Console
from .outcome import Findings

if TYPE_CHECKING:
    from ergon.repl.prompt.signals import Watch
    from ergon.repl.session_protocol import SessionProtocol


@click.command()
@click.argument("score_path", metavar="SCORE", required=False)
@click.option(
    "--live", multiple=True, metavar="PLAYER=DEVICE", help="A hand on a key, as for `ergon duet`."
)
@click.option("--unchecked", is_flag=True, help="Try no axis for its direction first.")
@click.option("--force-max", type=click.FloatRange(0, 200), help="Most force on a hand [N].")
@click.option(
    "--audio",
    default="auto",
    show_default=True,
    metavar="WHERE",
    help="jack[:PORTS], pulse[:SINK], file:PATH, null or auto.",
)
@click.option("--block", type=click.IntRange(16, 8192), help="Frames of the card at a time.")
@click.option("--ahead", type=click.IntRange(64, 1 << 20), help="Frames kept ready for the card.")
@click.option("--gain", metavar="LEVEL", help="Instead of what a preflight finds: -12dB.")
@click.option(
    "--journal",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("session.jsonl"),
    show_default=True,
    metavar="FILE",
    help="What is typed, as it happens; where it is there, the next free name.",
)
@click.option(
    "--resume",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Go on where a journal ends.",
)
@click.option("--watch", is_flag=True, help="Reload the score whenever it is saved.")
@click.option(
    "--socket",
    is_flag=False,
    flag_value="",
    metavar="[PATH]",
    help="The engine is a process of its own, which prompts join and leave.",
)
@click.option("--engine", is_flag=True, hidden=True, help="Be that process.")
@click.option("--plain", is_flag=True, help="Lines only, no redrawing: for screen readers, pipes.")
@click.option("--strict", is_flag=True, help="Exit 1 when a line was not taken.")
@options.trust
@options.speaking
def repl(
    console: Console,
    score_path: str | None,
    engine: bool,
    plain: bool,
    strict: bool,
    **given: Any,
) -> None:
    """Live-code a score: every line is one musical decision.

    `play` begins; `help` lists what may be typed. Lines act on the next bar, and whatever is wrong
    with one, the music goes on. F12 is silence.
    """
    from ergon.api import local_session, remote_session
    from ergon.api.errors import EngineExitError
    from ergon.api.options import SessionOptions

    asked = SessionOptions(**given)
    if asked.socket is None:
        from ergon._core import stop_on_signals

        session = local_session.begin(score_path, asked, console)
        _prompt(session, stop_on_signals, plain=plain, strict=strict)
    elif engine:
        remote_session.serve(score_path, asked, console)
    else:
        try:
            from ergon.repl.prompt.signals import unwatched

            remote = remote_session.join(score_path, asked, console)
        except EngineExitError as ended:  # why stands on the terminal
            raise click.exceptions.Exit(ended.exit_code) from None
        _prompt(remote, unwatched, plain=plain, strict=strict)


def _prompt(face: SessionProtocol, watch: Watch, *, plain: bool, strict: bool) -> None:
    """Read lines until somebody leaves."""
    from ergon.repl.prompt.run import history_of_user, run

    if run(face, plain=plain, strict=strict, history=history_of_user(), watch=watch):
        raise Findings
