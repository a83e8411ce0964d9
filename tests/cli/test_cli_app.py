"""The command line as a whole: what it loads, says and answers."""

import io
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from commands import ERGON
from patience import PATIENCE

from ergon.api import remote_session
from ergon.api.options import SessionOptions
from ergon.cli import app, manual, take
from ergon.cli.colour import linked_code, may_colour
from ergon.cli.console import Console, json_line
from ergon.cli.lazy import LazyGroup, command_entry
from ergon.cli.outcome import Diverged, Findings, Refused
from ergon.cli.units import loudness_of
from ergon.exchange.safe import FileRefusedError

HEAVY = ("numpy", "numba", "soundfile", "rich", "yaml", "ergon._core")


def python(code: str, **more: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=False, **more)


def test_help_imports_nothing_heavy() -> None:
    done = python(
        "import sys\n"
        "from ergon.cli.app import run\n"
        "assert run(['--help']) == 0\n"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"


def test_help_of_each_command_without_engine_imports() -> None:
    done = python(
        "import sys\n"
        "from ergon.cli import take\n"
        "from ergon.cli.app import COMMANDS, run\n"
        "for name in COMMANDS:\n"
        "    assert run([name, '--help']) == 0, name\n"
        "for name in take.COMMANDS:\n"
        "    assert run(['take', name, '--help']) == 0, name\n"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("group", [app.group, take.take], ids=["ergon", "take"])
def test_command_table_agrees_with_commands(group: LazyGroup) -> None:
    context = click.Context(group)
    for name in group.table:
        text = command_entry(group.table, name).help_line
        command = group.get_command(context, name)
        assert command is not None
        assert command.name == name
        assert command.get_short_help_str(limit=200).rstrip(".") == text.rstrip(".")


@pytest.mark.parametrize(
    ("typed", "output"),
    [
        (["rendr", "x.yaml"], "Did you mean 'render'?"),
        (["chek"], "Did you mean 'check'?"),
        (["xyzzy"], "No such command 'xyzzy'."),
        (["piece.yaml"], "ergon render piece.yaml"),
        (["render", "--bits", "20", "x.yaml"], "bits"),
        (["render"], "SCORE"),
    ],
)
def test_wrong_usage_exits_2(
    capsys: pytest.CaptureFixture[str], typed: list[str], output: str
) -> None:
    assert app.run(typed) == 2
    out, err = capsys.readouterr()
    assert output in err
    assert out == ""


def test_wrong_usage_with_json_record(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["render", "--json", "--bits", "20", "x.yaml"]) == 2
    out, err = capsys.readouterr()
    record = json.loads(out)
    assert (record["v"], record["event"]) == (1, "error")
    assert "bits" in record["message"]
    assert err == ""


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (Findings("a mistake"), 1, "error: a mistake\n"),
        (Refused("no"), 2, "error: no\n"),
        (Diverged("bell.m went away"), 4, "error: bell.m went away\n"),
        (FileRefusedError("x.wav exists"), 2, "error: x.wav exists\n"),
        (FileNotFoundError(2, "No such file", "x.yaml"), 2, "error: x.yaml: No such file\n"),
        (KeyboardInterrupt(), 130, ""),
        (ZeroDivisionError("division"), 2, "error: internal error: ZeroDivisionError: division"),
    ],
)
def test_exit_codes_of_command_outcomes(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: BaseException,
    code: int,
    text: str,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(app, "invoke", fail)
    monkeypatch.delenv("ERGON_DEBUG", raising=False)
    assert app.run([]) == code
    out, err = capsys.readouterr()
    assert err.startswith(text)
    assert "Traceback" not in err
    assert out == ""


def test_debug_option_raises_exceptions(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(app, "invoke", fail)
    with pytest.raises(ZeroDivisionError):
        app.run(["--debug"])
    monkeypatch.setenv("ERGON_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        app.run([])


def test_engine_error_outcome_with_module_and_frame() -> None:
    class EngineError(ValueError):
        module = "bell.m"

    class DivergedError(EngineError):
        frame = 4410

    class Core:
        pass

    core = Core()
    core.EngineError, core.DivergedError = EngineError, DivergedError
    result = app._engine_outcome(EngineError("bell.m: M must be positive"), core)
    assert (result.exit_code, result.message) == (1, "bell.m: M must be positive")
    result = app._engine_outcome(DivergedError("'bell.m' is not finite"), core)
    assert (result.exit_code, result.message) == (4, "'bell.m' is not finite")
    assert result.place["frame"] == 4410


def test_broken_pipe_exits_silently() -> None:
    code = (
        "import sys\n"
        "from ergon.cli import app\n"
        "def flood(*_, **__):\n"
        "    while True: print('x' * 1000)\n"
        "app.invoke = flood\n"
        "app.main([])"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.read(10)
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(timeout=PATIENCE) == 0


@pytest.mark.parametrize("words", [["--help"], ["render", "--help"], ["completion", "bash"]])
def test_command_with_closed_stdout_ends_quietly(words: list[str]) -> None:
    command = [*ERGON, *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(timeout=PATIENCE) == 0


def test_run_without_command_prints_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run([]) == 2
    assert "Hear:" in capsys.readouterr().err


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("environment", "stream", "colour"),
    [
        ({}, Terminal(), True),
        ({}, io.StringIO(), False),
        ({"NO_COLOR": ""}, Terminal(), True),
        ({"NO_COLOR": "1"}, Terminal(), False),
        ({"TERM": "dumb"}, Terminal(), False),
        ({"FORCE_COLOR": "1"}, io.StringIO(), True),
        ({"FORCE_COLOR": "1", "NO_COLOR": "1"}, Terminal(), False),
        ({"FORCE_COLOR": "1", "TERM": "dumb"}, Terminal(), True),
        ({"FORCE_COLOR": "0"}, Terminal(), False),
    ],
)
def test_may_colour_by_stream_and_environment(
    environment: dict[str, str], stream: io.StringIO, colour: bool
) -> None:
    assert may_colour(stream, environment) is colour


def test_linked_code_in_terminal_and_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    monkeypatch.setattr("sys.stderr", Terminal())
    page = Path(manual.pages()["E204"].path).resolve().as_uri()
    assert linked_code("error[E204]", "E204") == f"\x1b]8;;{page}\x1b\\error[E204]\x1b]8;;\x1b\\"
    assert linked_code("error[E999]", "E999") == "error[E999]"  # no page
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr("sys.stderr", io.StringIO())
    assert linked_code("error[E204]", "E204") == "error[E204]"


def test_json_line_of_infinite_and_nan_values() -> None:
    record = json.loads(json_line("meter", peak=float("-inf"), other=float("nan"), fine=1.5))
    assert record == {"v": 1, "event": "meter", "peak": None, "other": None, "fine": 1.5}


def test_progress_json_records(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter([0.0, 0.5, 1.5, 2.0, 3.0])
    monkeypatch.setattr("ergon.cli.progress.time.monotonic", lambda: next(clock))
    with Console(json=True).progress("rendering", 400, 100.0) as progress:
        for done in (50, 150, 200, 300):
            progress.update(done)
    out, err = capsys.readouterr()
    records = [json.loads(text) for text in out.splitlines()]
    assert [record["frames"] for record in records] == [150, 300]
    assert records[1]["x_real_time"] == 1.0
    assert records[1]["left_s"] == 1.0
    assert err == ""


def test_progress_without_terminal_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with Console().progress("rendering", 4, 1.0) as progress:
        progress.update(4)
    assert capsys.readouterr() == ("", "")


def test_progress_bar_on_terminal() -> None:
    pexpect = pytest.importorskip("pexpect")
    code = (
        "from ergon.cli.console import Console\n"
        "with Console().progress('rendering', 100, 1.0) as bar:\n"
        "    for n in range(101): bar.update(n)\n"
    )
    environment = {**os.environ, "TERM": "xterm", "NO_COLOR": "1", "COLUMNS": "100"}
    child = pexpect.spawn(sys.executable, ["-c", code], env=environment, encoding="utf-8")
    child.expect("× real time")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0


def test_waiting_on_terminal_prints_seconds() -> None:
    pexpect = pytest.importorskip("pexpect")
    code = "from ergon.cli.console import Console\nwith Console().waiting('planning'): input()\n"
    child = pexpect.spawn(
        sys.executable, ["-c", code], env={**os.environ, "TERM": "xterm"}, encoding="utf-8"
    )
    child.expect("planning: 2 s")
    child.sendline("")
    child.expect(re.escape("\r\x1b[K"))  # the line is cleared
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0


def test_waiting_without_terminal_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with Console().waiting("planning"):
        pass
    assert capsys.readouterr() == ("", "")


def test_version_option_outside_checkout() -> None:
    done = python("from ergon.cli.app import main; main(['--version'])", cwd=Path("/"))
    assert done.returncode == 0
    assert done.stdout.startswith("ergon 0.")


@pytest.mark.parametrize(
    "command",
    [
        ("render", "s.yaml"),
        ("plan", "s.yaml"),
        ("tune", "s.yaml", "bell", "440Hz"),
        ("fold", "s.wav", "--to", "stereo"),
        ("layout", "export", "dome24", "--form", "iem"),
        ("layout", "import", "s.json"),
    ],
)
def test_json_and_stdout_output_refused_together(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run([*command, "--json", "-o", "-"]) == 2
    output = json.loads(capsys.readouterr().out)
    assert output["message"] == "--json and -o - both write to stdout; give one"


@pytest.mark.parametrize("option", [["--force-max", "nan"], ["--cents", "nan"], ["--rate", "nan"]])
def test_number_options_refuse_nan(option: list[str], capsys: pytest.CaptureFixture[str]):
    command = {"--force-max": "duet", "--cents": "plan", "--rate": "render"}[option[0]]
    assert app.run([command, "nowhere.yaml", *option]) == 2
    assert f"'{option[0]}': nan is not a number" in capsys.readouterr().err


def test_loudness_text_of_silent_short_and_quiet_sounds():
    assert loudness_of(-18.24, 0.5, 3.0) == "-18.2 LUFS"
    assert loudness_of(-math.inf, 0.0, 3.0) == "silent"
    assert loudness_of(-math.inf, 0.5, 0.3) == "not measured (shorter than 0.4 s)"
    assert loudness_of(-math.inf, 1e-5, 3.0) == "below -70 LUFS"


@pytest.mark.parametrize("force", [0.0, 5.0])
def test_force_max_passed_to_remote_session(force: float):
    options = SessionOptions(live=("a=emul:",), force_max=force, journal="other.jsonl")
    assert list(remote_session._command_line_options(options)) == [
        "--live=a=emul:",
        f"--force-max={force}",
    ]
