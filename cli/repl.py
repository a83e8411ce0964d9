"""`ergon repl`: a score that is played while lines change it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

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
@click.option(
    "--journal",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("session.jsonl"),
    show_default=True,
    metavar="FILE",
    help="File that keeps every line typed; where it exists, the next free name is taken.",
)
@click.option(
    "--resume",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Continue the session of this journal, where it ends.",
)
@options.frozen
@click.option(
    "--midi",
    multiple=True,
    metavar="PORT",
    help="Hear MIDI from the input whose name contains this, or `virtual`; repeatable.",
)
@click.option(
    "--midi-clock-from",
    metavar="PORT",
    help="Follow the MIDI clock of this input: its start and stop, its tempo and its beat.",
)
@click.option("--midi-clock-to", metavar="PORT", help="Send MIDI clock to this output.")
@options.osc
@options.view
@options.see
@click.option("--watch", is_flag=True, help="Reload the score whenever it is saved.")
@click.option(
    "--socket",
    is_flag=False,
    flag_value="",
    metavar="[PATH]",
    help="Run the engine as a process of its own at this socket, or join the one that runs there.",
)
@click.option("--engine", is_flag=True, hidden=True, help="Be that process.")
@click.option(
    "--plain",
    is_flag=True,
    help="Print one line after the other, redraw none: for screen readers and pipes.",
)
@click.option("--strict", is_flag=True, help="Exit with code 1 when a line was not taken.")
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

    Without a score, an empty piece begins. The line `play` begins; `help` lists the lines that
    exist. A line takes effect at the next bar, and one with a mistake changes nothing: the music
    goes on. F12 silences the sound and all forces. A pack is unpacked into a folder of its name.
    """
    from ergon.api import local_session, remote_session
    from ergon.api.errors import EngineExitError
    from ergon.api.options import SessionOptions

    asked = SessionOptions(**given)
    if score_path is not None and is_pack(score_path):
        from ergon.api.packs import unpack

        score_path = str(unpack(score_path))
        console.say(f"unpacked; the score is {score_path}")
    if asked.socket is None:
        from ergon._core import stop_on_signals

        session = local_session.begin(score_path, asked, console)
        _prompt(session, stop_on_signals, plain=plain, strict=strict)
    elif engine:
        remote_session.serve(score_path, asked, console)
    else:
        try:
            from ergon.repl.prompt.signals import watch_nothing

            remote = remote_session.join(score_path, asked, console)
        except EngineExitError as ended:  # the terminal shows the reason
            raise click.exceptions.Exit(ended.exit_code) from None
        _prompt(remote, watch_nothing, plain=plain, strict=strict)


def _prompt(session: SessionProtocol, watch: SignalWatch, *, plain: bool, strict: bool) -> None:
    """Read lines until the user leaves."""
    from ergon.repl.prompt.run import history_of_user, run

    if run(session, plain=plain, strict=strict, history=history_of_user(), watch=watch):
        raise Findings
