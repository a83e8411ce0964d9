"""`ergon repl`: a score that is played while lines change it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ergon.api.options import SessionOptions

from . import options
from .bundled import ScorePath, is_pack
from .console import Console
from .outcome import Findings

if TYPE_CHECKING:
    from ergon.repl.session_protocol import SessionProtocol, SignalWatch


@click.command()
@click.argument("score_path", metavar="[SCORE]", required=False, type=ScorePath(opens=False))
@options.hands
@options.sound
@options.from_dataclass(SessionOptions, "journal resume frozen midi midi_clock_from midi_clock_to")
@options.from_dataclass(SessionOptions, "osc osc_to view view_at see watch socket")
@click.option("--engine", is_flag=True, hidden=True, help="Be that process.")
@click.option(
    "--plain",
    is_flag=True,
    help="Print one line after the other, redraw none: for screen readers and pipes.",
)
@options.strict("when a line was not taken")
@options.trust
@options.with_console
def repl(
    console: Console,
    score_path: str | None,
    engine: bool,
    plain: bool,
    strict: bool,
    **arguments: Any,
) -> None:
    """Live-code a score: every line is one musical decision.

    Without a score, an empty piece begins. The line `play` begins; `help` lists the lines that
    exist. A line takes effect at the next bar, and one with a mistake changes nothing: the music
    goes on. F12 silences the sound and all forces. A pack is unpacked into a folder of its name.
    """
    from ergon.api import local_session, remote_session
    from ergon.api.errors import EngineExitError

    session_options = SessionOptions(**arguments)
    if score_path is not None and is_pack(score_path):
        from ergon.api.packs import unpack

        score_path = str(unpack(score_path))
        console.say(f"unpacked; the score is {score_path}")
    if session_options.socket is None:
        from ergon._core import stop_on_signals

        session = local_session.begin_session(score_path, session_options, console)
        _prompt(session, stop_on_signals, plain=plain, strict=strict)
    elif engine:
        remote_session.serve(score_path, session_options, console)
    else:
        try:
            from ergon.repl.prompt.signals import watch_nothing

            remote = remote_session.join(score_path, session_options, console)
        except EngineExitError as ended:  # the terminal shows the reason
            raise click.exceptions.Exit(ended.exit_code) from None
        _prompt(remote, watch_nothing, plain=plain, strict=strict)


def _prompt(session: SessionProtocol, watch: SignalWatch, *, plain: bool, strict: bool) -> None:
    """Read lines until the user leaves."""
    from ergon.repl.prompt.run import run, user_history

    if run(session, plain=plain, strict=strict, history=user_history(), watch=watch):
        raise Findings
