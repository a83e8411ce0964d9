"""A stop is done while a line is at work: zero force reaches the board before the line ends.

The line at work never ends, so that nothing here depends on how fast the machine is.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from acted_session import Acted
from commands import PATIENT
from patience import until
from sessions import Stepped
from simulated_board import Simulated, simulated
from sweep import few
from terminals import CTRL_C, ENTER, F12, Terminal

from ergon.repl.language.parse import parse
from ergon.repl.language.scope import scope_of
from ergon.repl.line_queue import LineQueue
from ergon.repl.prompt.error_boundary import ErrorBoundary
from ergon.repl.session_protocol import SessionProtocol, stop_of
from ergon.repl.wire.remote import RemoteSession
from tests.repl.test_repl_plain import calls, script
from tests.repl.test_repl_session import SCORE

SHARED = """\
ergon: 1
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 20g, f: 110Hz, t60: 1s}}
      b: {BUT: {between: [k, m], K: 300N/m, Z: 0.1Ns/m, gap: 0mm}}
    out: {SOX: m}
players: {remi: {hand: live, key: k}}
"""
# Locks a mutex of C twice. By PyDLL the interpreter waits too, by CDLL it goes on.
STUCK = (
    'py (lambda c, m: (print("stuck", flush=True), c.pthread_mutex_lock(m), '
    "c.pthread_mutex_lock(m)))"
    '(__import__("ctypes").{}(None), __import__("ctypes").create_string_buffer(64))\n'
)
INTERPRETER, LINE = STUCK.format("PyDLL"), STUCK.format("CDLL")


def command(folder: Path, board: Simulated, *options: str) -> list[str]:
    (folder / "score.yaml").write_text(SHARED, encoding="utf-8")
    live = ["--live", f"remi={board.url}?lockstep", "--unchecked"]
    return [*PATIENT, "repl", "score.yaml", *live, "--audio", "null", *options]


@contextmanager
def played(folder: Path) -> Iterator[Simulated]:
    with simulated(folder / "log.npy", lockstep=True, hand=0.004) as board:
        yield board


def pushes(board: Simulated) -> bool:
    return abs(board.look()[1]) > 0.1


def has_let_go(board: Simulated) -> bool:
    """Zero, and so it stays: in lockstep the last zeros may be the last packets of all."""
    for _ in range(50):
        if board.look()[1] != 0.0:
            return False
        time.sleep(0.01)
    return True


@contextmanager
def piped(folder: Path, board: Simulated, line: str) -> Iterator[subprocess.Popen[str]]:
    """A session on a pipe whose line is at work."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command(folder, board), cwd=folder, text=True, **pipes) as process:
        try:
            until(lambda: pushes(board), "a force")
            process.stdin.write(line)
            process.stdin.flush()
            while process.stdout.readline().rstrip() != "stuck":
                pass
            yield process
        finally:
            process.kill()


def say(text: str) -> Callable[[subprocess.Popen[str]], None]:
    def stop(process: subprocess.Popen[str]) -> None:
        process.stdin.write(text)
        process.stdin.flush()

    return stop


def send(number: signal.Signals) -> Callable[[subprocess.Popen[str]], None]:
    return lambda process: process.send_signal(number)


STOPS = {
    "TERM": (INTERPRETER, send(signal.SIGTERM)),
    "INT": (INTERPRETER, send(signal.SIGINT)),
    "HUP": (INTERPRETER, send(signal.SIGHUP)),
    "panic": (LINE, say("panic\n")),
    "quit": (LINE, say("quit\n")),
    "F12": (LINE, say(F12)),
    "end": (LINE, lambda process: process.stdin.close()),
}


@pytest.mark.parametrize("method", few(STOPS, ["panic"]))
def test_stop_releases_force_during_endless_line(tmp_path: Path, method: str):
    line, stop = STOPS[method]
    with played(tmp_path) as board, piped(tmp_path, board, line) as process:
        until(lambda: pushes(board), "a force")
        stop(process)
        until(lambda: has_let_go(board), "zero force")
        if line is LINE:  # a signal may have come just before it was stuck
            assert process.poll() is None


@contextmanager
def terminal(folder: Path, board: Simulated, *options: str) -> Iterator[Terminal]:
    """A session in a terminal that pushes; a line may be stuck in it in the end."""
    with Terminal(command(folder, board, *options), cwd=folder) as window:
        try:
            until(lambda: window.look(0) and pushes(board), "a force")
            window.until(lambda: window.cursor_line.endswith(" >"), "a prompt")
            yield window
        finally:
            window.child.kill(signal.SIGKILL)
            window.child.wait()


@pytest.mark.slow
@pytest.mark.parametrize("key", [F12, CTRL_C, "panic" + ENTER, "quit" + ENTER, "SIGINT"])
@pytest.mark.parametrize("options", [(), ("--plain",)])
def test_terminal_stop_keys_during_endless_line(tmp_path: Path, options: tuple[str, ...], key: str):
    with played(tmp_path) as board, terminal(tmp_path, board, *options) as position:
        position.type(LINE.rstrip() + ENTER)
        position.sees("\nstuck\n")
        if key == "SIGINT":
            position.child.kill(signal.SIGINT)
        else:  # a terminal that draws nothing gives F12 with the line
            position.type(key + (ENTER if options and key == F12 else ""))
        until(lambda: position.look(0) and has_let_go(board), "zero force")


def test_ctrl_c_at_idle_terminal_clears_line_only(tmp_path: Path):
    with played(tmp_path) as board, terminal(tmp_path, board) as position:
        position.type("half a line")
        position.sees("half a line")
        position.type(CTRL_C)
        position.until(lambda: position.cursor_line.endswith(" >"), "an empty prompt")
        position.type("half a line")
        position.until(lambda: position.cursor_line.endswith("half a line"), "half a line again")
        position.child.kill(signal.SIGINT)
        position.until(lambda: position.cursor_line.endswith(" >"), "an empty prompt")
        position.type("help" + ENTER)
        position.sees("all hands lift, and the session ends")
        until(lambda: position.look(0) and pushes(board), "a force")


# --- lines, stops, and their turns ---------------------------------------------------------------


def test_panic_in_pipe_stops_preceding_line(tmp_path: Path):
    """`slow` ends by a panic alone."""
    done = script(tmp_path, "slow 1000\nada a\npanic\nada b\n")
    assert "stopped by the panic" in done.stdout
    message = [call for call in calls(tmp_path) if call["what"] in ("submit", "panic")]
    texts = [call.get("text", "panic at once") for call in message]
    assert sorted(texts) == sorted(["slow 1000", "panic at once", "ada a", "panic", "ada b"])
    assert [text for text in texts if text != "panic at once"] == [
        *["slow 1000", "ada a", "panic", "ada b"]
    ]
    assert [call["releases"] for call in message if call.get("text") == "ada a"] == [False]


def test_script_file_is_read_one_line_ahead(tmp_path: Path):
    lines = tmp_path / "lines.txt"
    lines.write_text("ada a\nada b\nslow 1000\npanic\nada c\nada d\n")
    session = [sys.executable, str(Path(__file__).parents[1] / "support/acted_session.py")]
    with lines.open() as source:
        done = subprocess.run(
            [*session, str(tmp_path / "log")], stdin=source, capture_output=True, text=True
        )
    assert "stopped by the panic" in done.stdout
    events = [call.get("text", call["what"]) for call in calls(tmp_path)]
    assert events.index("ada b") < events.index("panic")  # the one that is done at once
    assert events.index("ada c") < events.index("input ends") < events.index("close")
    bound = [call["text"] for call in calls(tmp_path) if call.get("releases") is False]
    assert "ada a" not in bound


class StoringActions(Acted):
    """Keeps what it was asked."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def panic(self) -> None:
        self.asked.append("panic")

    def let_go(self) -> None:
        self.asked.append("let go")

    def end_input(self) -> None:
        self.asked.append("input ends")


def test_line_queue_withholds_lines_entered_before_stop():
    face = StoringActions()
    turns: LineQueue[int] = LineQueue(face)
    turns.enter("play", 1)
    turns.enter("pa  # at once", 2)
    turns.enter("release", 3)
    assert face.asked == ["panic"]
    turns.panic()  # by a key: it has no line, and lines wait
    turns.enter("play", 4)
    turns.end()
    assert face.asked == ["panic", "panic", "input ends"]
    result = [turns.next() for _ in range(5)]
    assert [turn and (turn.sender, turn.releases) for turn in result] == [
        *[(1, False), (2, False), (3, False), (4, False)],
        None,
    ]
    assert face.asked == ["panic", "panic", "input ends", "panic"]
    turns.enter("play", 5)
    last = turns.next()
    assert last is not None
    assert last.releases


def test_line_entered_before_panic_does_not_end_it(tmp_path: Path):
    played = Stepped(SCORE, tmp_path)
    session = played.session
    session.panic()
    for line, why in (("release", "a stop was entered"), ("play", "a panic was entered")):
        reply = session.submit(line, releases=False)
        assert not reply.taken
        assert reply.text.startswith(why)
    assert session.submit("panic").taken
    assert session.state().panicked
    played.ok("release")
    assert not session.state().panicked
    played.ok("play")
    assert session.submit("hush", releases=False).taken
    played.close()


def test_repeated_panic_is_one_version(tmp_path: Path):
    played = Stepped(SCORE, tmp_path)
    played.ok("play")
    played.run(0.5)
    played.session.panic()
    played.ok("panic")
    played.run(0.1)
    rows = played.ok("history").lines
    assert sum("panic" in row for row in rows) == 1, rows
    played.close()


@pytest.mark.parametrize(
    ("line", "stop"),
    [
        *(
            (line, "panic")
            for line in ("pa", "panic", "  panic now", "pani", "panic\t# no", "pa\r")
        ),
        *((line, "quit") for line in ("quit", "qui", "quit # bye")),
        ("tempo 90\npanic", "panic"),
        *((line, None) for line in ("play", "pan", "p", "panics", "panic = 0@0 smooth 1@1")),
    ],
)
def test_prompt_stop_words_equal_language_stop_words(tmp_path: Path, line: str, stop: str | None):
    """What the prompt takes for a stop, the language does."""
    played = Stepped(SCORE, tmp_path)
    scope = scope_of(played.session.schedule.head.piece)
    played.close()
    assert stop_of(line) == stop
    if stop:
        assert stop in {type(one).__name__.lower() for one in parse(line, scope)}


@pytest.mark.parametrize(
    "line", ["pan bell x", "pan 0.5", "pa x", "pan", "panic button", "panic# no", "quit it"]
)
def test_queue_with_refused_line(tmp_path: Path, line: str):
    played = Stepped(SCORE, tmp_path)
    played.ok("play")
    played.ok("gain bell -3dB at 4|1")
    queue = LineQueue[None](played.session)
    queue.enter(line, None)
    assert not played.session.submit(line).taken
    assert not played.session.state().panicked
    played.run(7.0)
    assert played.session.schedule.head.faders.gains["bell"] == pytest.approx(10 ** (-3 / 20))
    played.close()


def test_pan_line_with_instrument_named_pan(tmp_path: Path):
    text = SCORE.replace(
        "  bell:",
        "  pan:\n    modules: {m: {CEL: {M: 20g, f: 90Hz}}}\n    out: {SOX: m}\n  bell:",
        1,
    )
    played = Stepped(text, tmp_path)
    for line in ("route pan 1 2", "pan pan 0.2"):
        played.ok(line)
    played.ok("pan strikes pan.m every 1 impulse 1mNs")
    text = played.session.schedule.head.texts.text
    assert "pan: 0.2" in text
    assert not played.session.state().panicked
    played.close()


def test_session_classes_implement_stop_methods():
    for face in (ErrorBoundary, RemoteSession, Acted):
        for name in ("panic", "let_go", "end_input"):
            assert callable(getattr(face, name)), (face, name)
    assert SessionProtocol is not None
