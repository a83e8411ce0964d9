"""The prompt in a real pseudo-terminal, over a session that only acts."""

import json
import random
import re
import signal
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from patience import until
from sweep import few
from terminals import CTRL_C, CTRL_D, CTRL_Q, CTRL_S, CTRL_Z, ENTER, F12, TAB, UP, Terminal

SESSION = str(Path(__file__).parents[1] / "support/acted_session.py")
EMPTY = re.compile(r"\d+\|\d+ >$")


class Prompt(Terminal):
    """A prompt, and what its session was asked to do."""

    def __init__(self, folder: Path, *options: str, **how: str):
        self.log = folder / "log.jsonl"
        super().__init__([sys.executable, SESSION, str(self.log), *options], **how)

    @property
    def done(self) -> list[dict[str, str]]:
        """What was called until now."""
        return [json.loads(line) for line in self.log.read_text().splitlines()]

    @property
    def submitted(self) -> list[str]:
        return [call["text"] for call in self.done if call["what"] == "submit"]

    def count(self, what: str) -> int:
        return sum(call["what"] == what for call in self.done)

    def typing(self, text: str) -> None:
        """Look until the line of the cursor ends in a text."""
        self.until(lambda: self.cursor_line.endswith(text), f"{text!r} in the prompt")

    def is_empty(self) -> None:
        self.until(lambda: EMPTY.fullmatch(self.cursor_line), "an empty prompt")

    def enter(self, line: str, answer: str) -> None:
        self.type(line + ENTER)
        self.sees(answer)


@contextmanager
def prompt(folder: Path, *options: str, **how: str) -> Iterator[Prompt]:
    with Prompt(folder, *options, **how) as terminal:
        terminal.sees("quant bar")
        yield terminal


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Prompt]:
    with prompt(tmp_path) as terminal:
        yield terminal


def test_a_line_its_echo_and_its_reply(at: Prompt):
    at.type("ada plays lean")
    at.typing("> ada plays lean")
    at.type(ENTER)
    at.sees("ok 2|1 ada: plays lean")
    at.is_empty()
    at.until(lambda: "quant bar" in at.lines[-1], "the status line")
    shown = [line for line in at.lines if line]
    assert re.fullmatch(r"\d+\|\d+ > ada plays lean", shown[0])
    assert shown[1] == "      ok 2|1 ada: plays lean"
    assert len(shown) == 4
    assert at.submitted == ["ada plays lean"]


def test_prompt_and_status_line_follow_the_clock_and_stand_still_under_a_line(at: Prompt):
    def bar() -> int:
        return int(re.match(r"(\d+)\|", at.cursor_line)[1])

    first = bar()
    at.until(lambda: bar() > first, "the next bar in the prompt")
    at.type("half")
    at.typing("half")
    stands = at.cursor_line
    status = at.lines[-1]
    assert "240 bpm  ada lean  load 12%  late 3  -18.2 dB  quant bar" in status
    at.until(lambda: int(at.lines[-1].partition("|")[0]) > int(status.partition("|")[0]) + 1)
    assert at.cursor_line == stands


def test_tab_takes_what_a_refusal_suggests(at: Prompt):
    at.enter("adda plays leen", "not taken: unknown verb 'adda plays leen'")
    assert "      try: ada plays lean   [Tab]" in at.text
    at.is_empty()
    at.type(TAB)
    at.typing("> ada plays lean")
    at.type(CTRL_C)
    at.is_empty()
    at.type(UP)  # the refused line itself
    at.typing("adda plays leen")
    at.type(TAB)
    at.typing("> ada plays lean")
    at.enter("", "ok 2|1 ada: plays lean")
    at.type(TAB)  # a line that was taken has nothing to suggest: these are the verbs
    at.sees("no more ergons")


def test_tab_completes_and_says_what_each_does(at: Prompt):
    at.type("pl" + TAB)
    at.sees("plays  a player begins")
    at.typing("> play")
    at.type(TAB + TAB)
    at.typing("> plays")
    at.type(CTRL_C)
    at.type("hu" + TAB)
    at.typing("> hush")


def test_ctrl_c_clears_the_line_and_nothing_else(at: Prompt):
    at.type("half a line")
    at.typing("half a line")
    at.type(CTRL_C)
    at.is_empty()
    at.child.kill(signal.SIGINT)  # the same, from elsewhere
    at.enter("ada goes on", "ok 2|1 ada: goes on")
    assert at.submitted == ["ada goes on"]
    assert at.count("close") == 0


def test_ctrl_z_ctrl_s_and_ctrl_q_do_nothing(at: Prompt):
    at.type("ada" + CTRL_Z + CTRL_S + CTRL_Q + " plays")
    at.typing("> ada plays")
    at.child.kill(signal.SIGTSTP)
    at.enter("", "ok 2|1 ada: plays")


def test_ctrl_d_leaves_an_empty_line_alone_and_after_all_lines_are_done(at: Prompt):
    at.type("ada" + CTRL_D + " stays")
    at.typing("> ada stays")
    at.type(CTRL_C)
    at.is_empty()
    at.type("slow 0.3" + ENTER + "ada last" + ENTER + CTRL_D)
    assert at.ends() == 0
    assert at.submitted == ["slow 0.3", "ada last"]
    assert at.count("close") == 1
    assert "ok 2|1 ada: last" in at.text
    assert at.text.rstrip().endswith("closed")


def test_a_second_ctrl_d_leaves_a_line_that_does_not_end(at: Prompt):
    at.type("slow 1000" + ENTER)
    at.until(lambda: at.submitted, "the line at work")
    at.type(CTRL_D + CTRL_D)
    assert at.ends() == 0
    assert at.count("close") == 1


def test_quit_leaves(at: Prompt):
    at.type("quit" + ENTER)
    assert at.ends() == 0
    assert "      left" in at.text
    assert at.count("close") == 1


def test_f12_is_heard_while_a_line_is_at_work(at: Prompt):
    at.type("slow 1000" + ENTER)
    at.until(lambda: at.submitted, "the line at work")
    at.type("typing goes on")
    at.typing("typing goes on")
    at.type(F12)
    at.sees("stopped by the panic")
    at.sees("PANIC")
    at.typing("typing goes on")
    assert at.count("panic") == 1


@pytest.mark.parametrize("reads", [("\x1b[200~all this", F12), ("\x1b[200~all this" + F12,)])
def test_f12_is_heard_within_a_paste_that_never_ends(at: Prompt, reads: tuple[str, ...]):
    for typed in reads:
        at.look()
        at.type(typed)
    at.sees("PANIC")
    at.typing("> all this")
    assert at.count("panic") == 1


def test_a_pasted_block_is_one_submission(at: Prompt):
    at.paste("knock = 0@0\r\nada plays knock\nremi rests\n")
    at.typing(". remi rests")
    assert at.submitted == []
    at.enter("", "not taken")
    assert at.submitted == ["knock = 0@0\nada plays knock\nremi rests"]


def test_a_line_that_ends_in_a_backslash_goes_on(at: Prompt):
    at.type("ada plays \\" + ENTER)
    at.until(lambda: at.cursor_line.endswith(" ."), "a second line")
    assert at.submitted == []
    at.enter("knock", "ok 2|1 ada")
    assert at.submitted == ["ada plays \\\nknock"]


def test_messages_stand_above_a_line_that_is_being_typed(at: Prompt):
    at.enter("say 1 0.2 the key of remi is gone", "ok, later")
    at.type("half a li")
    at.typing("half a li")
    at.sees("\nthe key of remi is gone\n")
    at.typing("half a li")
    at.type("ne")
    at.typing("half a line")
    above = [line for line in at.lines if line]
    assert above[-3] == "the key of remi is gone"
    assert above[-2] == at.cursor_line


def test_a_flood_of_messages_comes_folded(at: Prompt):
    at.enter("say 15 0 the same", "the same … 14 more like it")
    at.enter("say 25 0 different #", "ok, later")
    at.type("half")
    at.sees("different 24")
    at.typing("half")
    assert len(re.findall("different [0-9]+", at.text)) == 25
    assert at.text.count("the same") == 2


def test_what_code_prints_stands_above_too(at: Prompt):
    at.type("print something")
    at.type(ENTER + "half")
    at.sees("\nprinted something\n")
    at.typing("half")


def test_a_drawing_is_shown_as_it_is_and_steers_nothing(at: Prompt):
    at.enter("draw", "\n⣀⡠⠤ a drawing\n?[31m of two lines\n")


@pytest.mark.parametrize("kind", ["exit", "panic", "value"])
def test_no_error_of_the_session_ends_the_prompt(at: Prompt, kind: str):
    at.enter(f"fail {kind}", "not taken: internal error")
    at.type("an unlucky line")
    at.sees("internal error: ValueError: no colours")
    at.typing("an unlucky line")
    at.type(CTRL_C)
    at.enter("ada goes on", "ok 2|1 ada: goes on")


def test_a_terminal_of_another_size(at: Prompt):
    at.type("ada plays")
    at.typing("ada plays")
    for rows, columns in ((40, 120), (10, 40), (3, 20), (24, 80)):
        at.resize(rows, columns)
        at.typing("> ada plays")
    at.until(lambda: "quant bar" in at.lines[-1], "the status line")
    at.enter("", "ok 2|1 ada: plays")


def test_lines_of_earlier_sessions(tmp_path: Path):
    history = tmp_path / "state" / "ergon" / "history"
    with prompt(tmp_path, "--history", str(history)) as at:
        at.enter("ada plays knock", "ok 2|1")
        at.paste("ada first\nada second")
        at.enter("", "ok 2|1 ada: first")
        at.type(CTRL_D)
        assert at.ends() == 0
    assert stat.S_IMODE(history.stat().st_mode) == 0o600
    assert stat.S_IMODE(history.parent.stat().st_mode) == 0o700
    with prompt(tmp_path, "--history", str(history)) as at:
        at.type(UP)
        at.typing("ada second")
        at.type(UP + UP)
        at.typing("> ada plays knock")


def test_a_history_that_cannot_be_kept_is_no_error(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with prompt(tmp_path, "--history", str(tmp_path / "file" / "history")) as at:
        at.enter("ada plays knock", "ok 2|1")
        at.is_empty()
        at.type(UP)
        at.typing("> ada plays knock")


def garbage(seed: int, count: int) -> list[bytes]:
    """Lines of bytes, keys and escape sequences; none leaves or panics."""
    draw = random.Random(seed)
    keys = [UP, TAB, "\x1b[B", "\x1b[D", "\x1b[3~", "\x12", "\x0f", "\x18\x05", "\x1bx", "\x1b[99~"]
    lines = []
    for _ in range(count):
        parts = [
            bytes(draw.randrange(256) for _ in range(draw.randrange(1, 30))),
            draw.choice(keys).encode(),
            draw.choice(["ada plyas", "é漢字🎻", "((((", "\u202e", "x" * 500]).encode(),
        ]
        draw.shuffle(parts)
        line = b"".join(parts).replace(b"\x04", b"").replace(b"\x1b[24~", b"")
        lines.append(line + b"\r")
    return lines


@pytest.mark.slow
@pytest.mark.parametrize("n_lines", few([20, 200], [20]))
def test_lines_of_garbage_and_a_paste_of_a_megabyte(at: Prompt, n_lines: int):
    for number, line in enumerate(garbage(1, n_lines)):
        at.type(line)
        if number == n_lines // 2:
            at.paste("x" * 1_000_000)
    at.type(b"y" * 1_000_000)  # as by a terminal that marks no paste
    at.sees("a paste of 1,000,000 characters")
    # Out of whatever the last line began, such as a search.
    at.type(CTRL_C)
    at.type(CTRL_C)
    at.is_empty()
    at.enter("ada goes on", "ok 2|1 ada: goes on")
    assert len(at.submitted) > n_lines // 2
    at.type(CTRL_D)
    assert at.ends() == 0


def test_a_terminal_that_is_closed_closes_the_session(at: Prompt):
    at.child.ptyproc.fileobj.close()
    until(lambda: at.count("close"), "the end")


def test_a_terminal_that_is_closed_while_something_is_printed(at: Prompt):
    at.enter("say 100 0 different #", "different 2")
    at.type("slow 1000" + ENTER)
    at.child.ptyproc.fileobj.close()
    until(lambda: at.count("close"), "the end")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_closes_the_session_and_acts(at: Prompt, number: signal.Signals):
    at.child.kill(number)
    assert at.ends() == -number
    assert at.count("close") == 1


def test_the_terminal_is_as_it_was(tmp_path: Path):
    code = f"stty -a > before; {sys.executable} {SESSION} log; stty -a > after"
    with Terminal(["/bin/sh", "-c", f"cd {tmp_path}; {code}"]) as terminal:
        terminal.sees("quant bar")
        terminal.type(CTRL_D)
        terminal.ends()
    assert (tmp_path / "before").read_text() == (tmp_path / "after").read_text()


def test_no_colour_where_none_is_wanted(tmp_path: Path):
    colour = re.compile(rb"\x1b\[(?:[0-9]+;)*(?:3[0-8]|9[0-7])[;m]")
    for environment, coloured in (({}, True), ({"NO_COLOR": "1"}, False)):
        with prompt(tmp_path, **environment) as at:
            at.type("play and more")
            at.typing("play and more")
            assert bool(colour.search(at.said)) is coloured
