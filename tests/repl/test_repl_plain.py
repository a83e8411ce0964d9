"""The prompt by lines: pipes, scripts, screen readers; and what needs no terminal to be tested."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from patience import PATIENCE
from terminals import CTRL_C, CTRL_D, CTRL_S, CTRL_Z, ENTER, F12, Terminal

from ergon.repl.prompt import history
from ergon.repl.prompt.message_throttle import HELD_MAX, PER_SECOND, MessageThrottle
from ergon.repl.prompt.output import clean, echo, reply_lines, valid_unicode
from ergon.repl.prompt.run import user_history
from ergon.repl.prompt.status import status
from ergon.repl.session_protocol import Reply, State

SESSION = [sys.executable, str(Path(__file__).parents[1] / "support/acted_session.py")]


def script(folder: Path, lines: str | bytes, *options: str) -> subprocess.CompletedProcess[str]:
    data = lines if isinstance(lines, bytes) else lines.encode()
    done = subprocess.run(
        [*SESSION, str(folder / "log"), *options], input=data, capture_output=True, check=False
    )
    text = done.stdout.decode()
    return subprocess.CompletedProcess(done.args, done.returncode, text, done.stderr.decode())


def calls(folder: Path) -> list[dict[str, str]]:
    return [json.loads(line) for line in (folder / "log").read_text().splitlines()]


def submitted(folder: Path) -> list[str]:
    return [call["text"] for call in calls(folder) if call["what"] == "submit"]


# --- through a pipe ------------------------------------------------------------------------------


def test_script_output_and_submitted_lines(tmp_path: Path):
    done = script(tmp_path, "ada plays lean\nadda\n\nada \\\nplays\ndraw\nada last")
    lines = [line.partition(" > ")[2] or line for line in done.stdout.splitlines()]
    assert lines == [
        "ada plays lean",
        "ok 2|1 ada: plays lean",
        "adda",
        "not taken: unknown verb 'adda'",
        "try: ada plays lean",
        *[line for line in lines[5:6]],
        "ada \\",
        "plays",
        "ok 2|1 ada: \\",
        "plays",
        "draw",
        "⣀⡠⠤ a drawing",
        "?[31m of two lines",
        "ada last",
        "ok 2|1 ada: last",
        lines[-2],
        "closed",
    ]
    assert done.returncode == 0
    assert "\x1b" not in done.stdout + done.stderr
    assert submitted(tmp_path) == ["ada plays lean", "adda", "ada \\\nplays", "draw", "ada last"]
    assert calls(tmp_path)[-1]["what"] == "close"


def test_strict_option_exit_code_after_refused_line(tmp_path: Path):
    assert script(tmp_path, "ada plays\n", "--strict").returncode == 0
    assert script(tmp_path, "adda\nada plays\n", "--strict").returncode == 1
    assert script(tmp_path, "fail value\n", "--strict").returncode == 1


def test_quit_ends_piped_script(tmp_path: Path):
    script(tmp_path, "ada plays\nquit\nada more\n")
    assert submitted(tmp_path) == ["ada plays", "quit"]


def test_piped_session_prints_messages_while_idle(tmp_path: Path):
    with subprocess.Popen(
        [*SESSION, str(tmp_path / "log")], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(b"say 15 0 gone\n")
        process.stdin.flush()
        text = b""
        while b" more" not in text:
            text += process.stdout.readline()
        assert "gone … 14 more like it\n".encode() in text
        process.stdin.close()
        assert process.wait(PATIENCE) == 0


def test_script_with_invalid_utf8_and_huge_line(tmp_path: Path):
    done = script(
        tmp_path, b"ada \xff\xfe\x00\x1b[2J\xed\xa0\x80\n" + b"x" * 1_000_000 + b"\nada b\n"
    )
    assert done.returncode == 0
    assert "\x1b" not in done.stdout
    assert submitted(tmp_path)[0].startswith("ada \ufffd\ufffd\x00\x1b[2J")
    assert len(submitted(tmp_path)[1]) == 1_000_000
    assert "998,000 more characters" in done.stdout
    assert "ok 2|1 ada: b" in done.stdout


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_closes_piped_session(tmp_path: Path, number: signal.Signals):
    with subprocess.Popen(
        [*SESSION, str(tmp_path / "log")], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        process.stdout.read(1)  # it waits for a line
        process.send_signal(number)
        process.wait(PATIENCE)
    assert calls(tmp_path)[-1]["what"] == "close"


# --- in a terminal -------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["--plain", "dumb"])
def test_plain_terminal_output_without_escapes(tmp_path: Path, how: str):
    options = [how] if how.startswith("-") else []
    environment = {} if options else {"TERM": how}
    with Terminal([*SESSION, str(tmp_path / "log"), *options], **environment) as terminal:

        def waits(count: int) -> None:
            terminal.until(
                lambda: terminal.cursor_line.endswith(" >") and terminal.text.count(" >") == count
            )

        waits(1)
        terminal.type("ada plays" + ENTER)
        terminal.sees("\nok 2|1 ada: plays\n")
        terminal.type("say 1 0.2 remi is gone" + ENTER)
        terminal.sees("\nremi is gone\n")
        waits(4)  # it stands again below the message
        terminal.type("half")
        terminal.sees("> half")
        terminal.type(CTRL_C)
        waits(5)
        terminal.type(CTRL_Z + CTRL_S + CTRL_C)  # text, and no brake
        waits(6)
        terminal.type("slow 1000" + ENTER)
        terminal.until(lambda: "slow 1000" in submitted(tmp_path))
        terminal.type(CTRL_C)  # and not into the middle of what a line does
        terminal.child.kill(signal.SIGTSTP)
        time.sleep(0.1)
        assert terminal.child.isalive()
    assert submitted(tmp_path) == ["ada plays", "say 1 0.2 remi is gone", "slow 1000"]
    assert b"\x1b" not in terminal.output


def test_plain_terminal_with_f12_and_ctrl_d(tmp_path: Path):
    with Terminal([*SESSION, str(tmp_path / "log"), "--plain"]) as terminal:
        terminal.sees(" >")
        terminal.type(F12 + ENTER)
        terminal.until(lambda: {"what": "panic"} in calls(tmp_path))
        terminal.type(CTRL_D)
        assert terminal.ends() == 0
    assert submitted(tmp_path) == []
    assert calls(tmp_path)[-1]["what"] == "close"


# --- without one ---------------------------------------------------------------------------------


def test_message_throttle_rate_and_folding():
    folded = MessageThrottle()
    folded.add(["first"] * 3)
    assert folded.pop_due(0.0) == ["first … 2 more like it"]
    folded.add(["first"])
    assert folded.pop_due(0.9) == []  # within a second it stands there already
    assert folded.pop_due(1.0) == ["first"]
    folded.add(f"number {n}" for n in range(HELD_MAX + 7))
    shown: list[tuple[float, str]] = []
    for step in range(1, 200):
        now = 1.0 + step / 10
        shown += [(now, line) for line in folded.pop_due(now)]
    assert [line for _, line in shown] == [f"number {n}" for n in range(HELD_MAX)] + [
        "… 7 more messages"
    ]
    times = [1.0, *(now for now, _ in shown)]
    assert all(
        sum(start <= time < start + 0.999 for time in times) <= PER_SECOND for start in times
    )


def test_message_throttle_prints_counts_in_pipe():
    folded = MessageThrottle()
    folded.add(["one", "two", "two"])
    assert folded.pop_all() == ["one", "two … 1 more like it"]
    assert folded.pop_all() == []


def test_status_line_shortened_to_width():
    state = State(
        bar=12,
        beat=4.99,
        tempo=72.5,
        playing=(("ada", "knock"), ("remi", "a-very-long-name")),
        load=0.5,
        late=2,
        recording=3.25,
    )
    complete = status(state, 200)
    assert complete == (
        "12|4.9  72.5 bpm  ada knock · remi a-very-long-name  "
        "rec 3.2 s  load 50%  late 2  silent  quant bar"
    )
    for width in range(200):
        line = status(state, width)
        assert len(line) <= width
        assert line.startswith("12|4.9"[:width])
    assert "ada knock · …" in status(state, len(complete) - 20)
    assert "quant bar" in status(state, len(complete) - 20)
    assert "quant bar" not in status(state, 50)
    assert status(State(1, 1.0, 60.0, panicked=True), 80).startswith("PANIC")


def test_shown_text_without_control_characters():
    hostile = "".join(map(chr, range(0x20))) + "\x7f\x9b2J\u202e\ud800 é漢🎻"
    shown = clean(hostile)
    assert set(shown) == set("?\t\n 2Jé漢🎻")
    reported = reply_lines(Reply(False, hostile, try_=hostile, lines=(hostile,)), plain=True)
    assert not set("".join(reported)) & set("\x1b\x9b\x07\ud800\r")
    assert echo("1|1 > ", "a\nb\x1b") == "1|1 > a\n    . b?"


def test_valid_unicode_of_surrogates():
    assert valid_unicode(b"a\xff\xc3".decode("utf-8", "surrogateescape")) == "a\ufffd\ufffd"
    assert valid_unicode("é漢🎻") == "é漢🎻"
    valid_unicode("\ud800 \udcff").encode()


def test_history_path_of_user(tmp_path: Path):
    assert user_history({"XDG_STATE_HOME": str(tmp_path)}) == tmp_path / "ergon" / "history"
    ours = Path.home() / ".local" / "state" / "ergon" / "history"
    assert user_history({"XDG_STATE_HOME": "not/absolute"}) == user_history({}) == ours


def test_history_file_permissions_and_content(tmp_path: Path):
    path = tmp_path / "ergon" / "history"
    old = os.umask(0)
    try:
        saved = history.LineHistory(path)
        saved.append_string("ada plays\nremi rests")
        saved.append_string("x" * (history.LINE_MAX + 1))
        saved.append_string("é \udcff")
    finally:
        os.umask(old)
    assert path.stat().st_mode & 0o777 == 0o600
    saved = history.LineHistory(path).load_history_strings()
    assert list(saved) == ["é ?", "ada plays\nremi rests"]
    path.write_bytes(bytes(range(256)) * 100)
    assert isinstance(list(history.LineHistory(path).load_history_strings()), list)
