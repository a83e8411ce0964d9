"""The command `ergon`: a table of commands, each imported when it is called, and the exit codes."""

from __future__ import annotations

import contextlib
import gc
import io
import os
import sys
from typing import Any

import click

from ergon.common.errors import ErgonError
from ergon.common.private import set_umask
from ergon.common.terminal import clean

from . import habits
from .console import Console
from .examples import EXAMPLES
from .lazy import ROOT, LazyGroup, Table
from .outcome import (
    EXIT_CODES,
    INTERNAL,
    INTERRUPTED,
    DeviceMissing,
    Diverged,
    Findings,
    Outcome,
    Refused,
)
from .streams import flush_and_close, make_whole

# numpy's BLAS starts a thread for each core, which spins for 25 ms and then does nothing: no
# command multiplies matrices large enough to need these threads. The variable is read when numpy is
# first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

COMMANDS: Table = {
    "new": "Make a folder with a score that plays.",
    "check": "Report every mistake in scores, with its place.",
    "compile": ("compile", "compile_score", "Print the stream of ergons as CSV or JSON lines."),
    "render": "Compute the sound of a score, or of a session's journal, into a WAV file.",
    "sweep": "Render variants of a score, with a table and a picture of what they are like.",
    "play": "Play a score through the loudspeakers.",
    "duet": ("play", "duet", "Play a score with real hands beside written ones."),
    "repl": "Live-code a score: every line is one musical decision.",
    "plan": "Say how each part is computed, at what cost and error, and what is left out.",
    "modes": "Say at which pitches instruments and keys vibrate, how long, and how much where.",
    "tune": "Find values of an instrument or a key that bring its modes to given frequencies.",
    "admittance": "Say how fast points move for a force, by its frequency, in dB re 1 (m/s)/N.",
    "stats": "Say what instruments and keys are made of, or what hands did in a take, in figures.",
    "bell": "Find the modes of a struck object, and write it as an instrument.",
    "plot": "Draw a gesture as written and as played, in the terminal or as SVG.",
    "chart": "Draw the error of every method against its cost, for a score.",
    "stability": "Draw where a method fails, as predicted and as measured.",
    "devices": "List loudspeakers and keys, the URL of each, and what it could be.",
    "doctor": "Measure whether this machine is fit to play.",
    "emulate": "Emulate a force-feedback device, for trying scores and drivers.",
    "metrology": "Measure what a real key is made of.",
    "import": ("import_", "import_command", "Make a score of a model of another program."),
    "export": "Write a piece, or its parts, for other programs.",
    "take": "List, cut and exchange recordings of live hands.",
    "motion": "Exchange files of what moved.",
    "fold": "Fold a sound file of many channels for other ears.",
    "view": "Show in a browser what moves in a piece, with its sound.",
    "share": "Write a piece as one HTML file that plays in any browser, without a network.",
    "layout": "Check and exchange layouts of loudspeakers.",
    "info": "Say what a render, a take, a MIDI file, a mesh, a layout, a pack or a score contains.",
    "schema": "Print the JSON Schema of scores, for editors.",
    "pack": "Write a score, and all files that it reads, as one file.",
    "unpack": "Write the files of a pack into a new folder.",
    "lsp": "Serve an editor: mistakes as one types, completion, explanations.",
    "fmt": "Put the layout of scores in order; comments stay.",
    "demo": "Render a score that ships with ergon, and play it.",
    "completion": "Print a completion script for bash, zsh or fish.",
    "help": ("help_", "help_command", "Show the help of a command, or a page of the manual."),
    "explain": "Explain a mistake by the code that its message shows, such as E204.",
}
# The headings of `ergon --help`; each command stands under one of them.
SECTIONS = {
    "Write": ("new", "check", "fmt", "plot", "compile", "tune", "bell"),
    "Hear": ("demo", "render", "play", "duet", "repl", "view", "share", "sweep"),
    "Study": ("plan", "modes", "admittance", "stats", "chart", "stability", "info"),
    "Hands and machine": ("devices", "doctor", "take", "emulate", "metrology"),
    "Exchange": ("import", "export", "fold", "layout", "motion", "pack", "unpack"),
    "Help and editors": ("help", "explain", "completion", "schema", "lsp"),
}
_EXIT_CODES_TEXT = "; ".join(f"{code} {meaning}" for code, meaning in EXIT_CODES)


def _print_version(ctx: click.Context, parameter: click.Parameter, is_asked: bool) -> None:
    if is_asked and not ctx.resilient_parsing:
        from ergon.api.version import __version__, build

        click.echo(f"ergon {__version__} ({build()})")
        ctx.exit()


@click.group(
    ROOT,
    cls=LazyGroup,
    table=COMMANDS,
    sections=SECTIONS,
    epilog=f"Exit codes: {_EXIT_CODES_TEXT}.",
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Print the version, its commit and what it was built for, and exit.",
)
@click.option(
    "--debug", is_flag=True, expose_value=False, help="Show where internal errors happen."
)
def group() -> None:
    """Write the gesture, hear the matter: scores of ergons for CORDIS-ANIMA instruments."""


def main(argument_words: list[str] | None = None) -> None:
    """Run a command line and exit with the code of its outcome."""
    set_umask()
    code = run(sys.argv[1:] if argument_words is None else argument_words)
    gc.freeze()  # the process ends soon: the collector need not search these objects
    sys.exit(code)


def run(argument_words: list[str]) -> int:
    """Run a command line and return its exit code; when this returns, every message is printed."""
    make_whole()
    try:
        code = _exit_code(argument_words)
    except BrokenPipeError:  # the reader has seen enough
        code = 0
    except OSError:  # not even the message about an error can be written
        code = Refused.exit_code
    failure = flush_and_close()
    if code == 0 and failure is not None and not isinstance(failure, BrokenPipeError):
        code = Refused.exit_code
        with contextlib.suppress(OSError):  # both streams may lead to one full disk
            Console().outcome(explain(failure))
        flush_and_close()
    return code


def _exit_code(argument_words: list[str]) -> int:
    debug = "--debug" in argument_words or bool(os.environ.get("ERGON_DEBUG"))
    argument_words = [
        word for word in argument_words if word != "--debug"
    ]  # taken before or after a command
    from ergon.cli.signals import Terminated, signals_as_exceptions

    console = Console(json="--json" in argument_words)
    try:
        with signals_as_exceptions(is_unexpected):
            invoke(argument_words)
        return 0
    except click.exceptions.Exit as exit_error:
        return exit_error.exit_code
    except (KeyboardInterrupt, click.exceptions.Abort):
        return INTERRUPTED
    except Terminated as termination:
        return 128 + termination.number
    except click.ClickException as error:
        error = _with_example(error, argument_words)
        if console.json:
            console.outcome(Refused(error.format_message()))
        else:
            message = io.StringIO()
            error.show(message)
            sys.stderr.write(clean(message.getvalue()))
        return error.exit_code
    except BrokenPipeError:
        raise
    except BaseException as error:  # PyO3's panic exception is no Exception
        if debug and not isinstance(error, Outcome):
            raise
        # Where a stream is full, the error that is seen first names no file.
        failure = flush_and_close() if isinstance(error, OSError) and not error.filename else None
        outcome = explain(error if failure is None else failure)
        (console if failure is None else Console()).outcome(outcome)
        return outcome.exit_code


def _with_example(error: click.ClickException, argument_words: list[str]) -> click.ClickException:
    """The error, with what to write: an example of the command where an argument or an option is
    missing, the form of an option without its value, what an option of other programs is here.
    """
    if isinstance(error, click.MissingParameter) and error.ctx is not None:
        example_rows = EXAMPLES.get(error.ctx.command_path.removeprefix(f"{ROOT} "))
        if example_rows:
            error_sentence = error.format_message().rstrip(".")
            return click.UsageError(
                f"{error_sentence}; for example: {example_rows[0][0]}", error.ctx
            )
    if isinstance(error, click.BadOptionUsage):
        params = _command_of(argument_words).params
        option = next((param for param in params if error.option_name in param.opts), None)
        if option is not None:
            form = f"{error.option_name} {option.metavar or str(option.name).upper()}"
            error_sentence = error.format_message().rstrip(".")
            return click.UsageError(f"{error_sentence}; write {form}", error.ctx)
    if isinstance(error, click.NoSuchOption) and error.ctx is not None:
        names = (name for param in error.ctx.command.params for name in param.opts)
        if advice := habits.option_instead(error.option_name, names):
            return click.UsageError(f"No such option '{error.option_name}': {advice}.", error.ctx)
    return error


def _command_of(argument_words: list[str]) -> click.Command:
    """The command that a line begins with; the group where it names none."""
    command: click.Command = group
    for word in argument_words:
        subcommand = (
            command.get_command(click.Context(command), word)
            if isinstance(command, click.Group)
            else None
        )
        if subcommand is None:
            break
        command = subcommand
    return command


def invoke(arguments: list[str]) -> None:
    """Parse and run without click's own handling of endings, which makes a closed pipe an error."""
    with group.make_context("ergon", arguments) as context:
        group.invoke(context)


def explain(error: BaseException) -> Outcome:
    """The outcome that is shown for an exception."""
    if isinstance(error, Outcome):
        return error
    if isinstance(error, OSError):
        file_prefix = f"{error.filename}: " if error.filename else ""
        return Refused(f"{file_prefix}{error.strerror or error}")
    if isinstance(error, ErgonError):
        return _library_outcome(error)
    if isinstance(error, MemoryError):
        return Refused("there is not enough memory for this piece")
    core: Any = sys.modules.get("ergon._core")  # its exceptions exist only once it is loaded
    if core is not None and isinstance(error, getattr(core, "EngineError", ())):
        return _engine_outcome(error, core)
    return Outcome(
        f"internal error: {type(error).__name__}: {error} "
        "(please report it; --debug shows where it happened)"
    )


def is_unexpected(error: BaseException) -> bool:
    """Whether an exception is shown as an internal error."""
    is_from_click = isinstance(error, (click.exceptions.Exit, click.Abort, click.ClickException))
    return not is_from_click and type(explain(error)) is Outcome


def _library_outcome(error: ErgonError) -> Outcome:
    """The outcome for an error of the library; diagnostics are printed already."""
    from ergon.api.errors import DeviceError, DivergedError, OptionError, ScoreError

    match error:
        case DivergedError():
            return Diverged(error.reason)
        case ScoreError():
            return Findings(error.reason)
        case OptionError():
            return Refused(error.on_command_line)
        case DeviceError():
            return DeviceMissing(str(error))
    return Refused(str(error))


def _engine_outcome(error: BaseException, core: Any) -> Outcome:
    """The outcome for an error of the engine, whose message names the module as in the score."""
    module_name = getattr(error, "module", None)
    error_sentence = str(error)
    if isinstance(error, core.DivergedError):
        return Diverged(error_sentence, code="E401", module=module_name, frame=error.frame)
    return Findings(error_sentence, code="E309", module=module_name)


assert Outcome.exit_code == INTERNAL

if __name__ == "__main__":
    main()
