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
def typed_prompt(tmp_path: Path) -> Iterator[Prompt]:
    with prompt(tmp_path) as terminal:
        yield terminal


def test_prompt_shows_line_and_reply(typed_prompt: Prompt):
    typed_prompt.type("ada plays lean")
    typed_prompt.typing("> ada plays lean")
    typed_prompt.type(ENTER)
    typed_prompt.sees("ok 2|1 ada: plays lean")
    typed_prompt.is_empty()
    typed_prompt.until(lambda: "quant bar" in typed_prompt.lines[-1], "the status line")
    shown = [line for line in typed_prompt.lines if line]
    assert re.fullmatch(r"\d+\|\d+ > ada plays lean", shown[0])
    assert shown[1] == "      ok 2|1 ada: plays lean"
    assert len(shown) == 4
    assert typed_prompt.submitted == ["ada plays lean"]


def test_prompt_and_status_line_follow_clock(typed_prompt: Prompt):
    def bar() -> int:
        return int(re.match(r"(\d+)\|", typed_prompt.cursor_line)[1])

    first = bar()
    typed_prompt.until(lambda: bar() > first, "the next bar in the prompt")
    typed_prompt.type("half")
    typed_prompt.typing("half")
    stands = typed_prompt.cursor_line
    status = typed_prompt.lines[-1]
    assert "240 bpm  ada lean  load 12%  late 3  -18.2 dB  quant bar" in status
    typed_prompt.until(
        lambda: int(typed_prompt.lines[-1].partition("|")[0]) > int(status.partition("|")[0]) + 1
    )
    assert typed_prompt.cursor_line == stands


def test_tab_inserts_suggestion_of_refusal(typed_prompt: Prompt):
    typed_prompt.enter("adda plays leen", "not taken: unknown verb 'adda plays leen'")
    assert "      try: ada plays lean   [Tab]" in typed_prompt.text
    typed_prompt.is_empty()
    typed_prompt.type(TAB)
    typed_prompt.typing("> ada plays lean")
    typed_prompt.type(CTRL_C)
    typed_prompt.is_empty()
    typed_prompt.type(UP)  # the refused line itself
    typed_prompt.typing("adda plays leen")
    typed_prompt.type(TAB)
    typed_prompt.typing("> ada plays lean")
    typed_prompt.enter("", "ok 2|1 ada: plays lean")
    typed_prompt.type(TAB)  # a line that was taken has nothing to suggest: these are the verbs
    typed_prompt.sees("no more ergons")


def test_tab_completes_verbs_with_hints(typed_prompt: Prompt):
    typed_prompt.type("pl" + TAB)
    typed_prompt.sees("plays  a player begins")
    typed_prompt.typing("> play")
    typed_prompt.type(TAB + TAB)
    typed_prompt.typing("> plays")
    typed_prompt.type(CTRL_C)
    typed_prompt.type("hu" + TAB)
    typed_prompt.typing("> hush")


def test_ctrl_c_clears_the_line_and_nothing_else(typed_prompt: Prompt):
    typed_prompt.type("half a line")
    typed_prompt.typing("half a line")
    typed_prompt.type(CTRL_C)
    typed_prompt.is_empty()
    typed_prompt.child.kill(signal.SIGINT)  # the same, from elsewhere
    typed_prompt.enter("ada goes on", "ok 2|1 ada: goes on")
    assert typed_prompt.submitted == ["ada goes on"]
    assert typed_prompt.count("close") == 0


def test_ctrl_z_ctrl_s_and_ctrl_q_do_nothing(typed_prompt: Prompt):
    typed_prompt.type("ada" + CTRL_Z + CTRL_S + CTRL_Q + " plays")
    typed_prompt.typing("> ada plays")
    typed_prompt.child.kill(signal.SIGTSTP)
    typed_prompt.enter("", "ok 2|1 ada: plays")


def test_ctrl_d_on_empty_line_after_pending_lines(typed_prompt: Prompt):
    typed_prompt.type("ada" + CTRL_D + " stays")
    typed_prompt.typing("> ada stays")
    typed_prompt.type(CTRL_C)
    typed_prompt.is_empty()
    typed_prompt.type("slow 0.3" + ENTER + "ada last" + ENTER + CTRL_D)
    assert typed_prompt.ends() == 0
    assert typed_prompt.submitted == ["slow 0.3", "ada last"]
    assert typed_prompt.count("close") == 1
    assert "ok 2|1 ada: last" in typed_prompt.text
    assert typed_prompt.text.rstrip().endswith("closed")


def test_ctrl_d_twice_during_endless_line(typed_prompt: Prompt):
    typed_prompt.type("slow 1000" + ENTER)
    typed_prompt.until(lambda: typed_prompt.submitted, "the line at work")
    typed_prompt.type(CTRL_D + CTRL_D)
    assert typed_prompt.ends() == 0
    assert typed_prompt.count("close") == 1


def test_quit_line_ends_prompt(typed_prompt: Prompt):
    typed_prompt.type("quit" + ENTER)
    assert typed_prompt.ends() == 0
    assert "      left" in typed_prompt.text
    assert typed_prompt.count("close") == 1


def test_f12_while_a_line_runs(typed_prompt: Prompt):
    typed_prompt.type("slow 1000" + ENTER)
    typed_prompt.until(lambda: typed_prompt.submitted, "the line at work")
    typed_prompt.type("typing goes on")
    typed_prompt.typing("typing goes on")
    typed_prompt.type(F12)
    typed_prompt.sees("stopped by the panic")
    typed_prompt.sees("PANIC")
    typed_prompt.typing("typing goes on")
    assert typed_prompt.count("panic") == 1


@pytest.mark.parametrize("reads", [("\x1b[200~all this", F12), ("\x1b[200~all this" + F12,)])
def test_f12_within_unfinished_paste(typed_prompt: Prompt, reads: tuple[str, ...]):
    for typed in reads:
        typed_prompt.look()
        typed_prompt.type(typed)
    typed_prompt.sees("PANIC")
    typed_prompt.typing("> all this")
    assert typed_prompt.count("panic") == 1


def test_pasted_block_is_one_submission(typed_prompt: Prompt):
    typed_prompt.paste("knock = 0@0\r\nada plays knock\nremi rests\n")
    typed_prompt.typing(". remi rests")
    assert typed_prompt.submitted == []
    typed_prompt.enter("", "not taken")
    assert typed_prompt.submitted == ["knock = 0@0\nada plays knock\nremi rests"]


def test_backslash_at_line_end_continues_line(typed_prompt: Prompt):
    typed_prompt.type("ada plays \\" + ENTER)
    typed_prompt.until(lambda: typed_prompt.cursor_line.endswith(" ."), "a second line")
    assert typed_prompt.submitted == []
    typed_prompt.enter("knock", "ok 2|1 ada")
    assert typed_prompt.submitted == ["ada plays \\\nknock"]


def test_messages_printed_above_typed_line(typed_prompt: Prompt):
    typed_prompt.enter("say 1 0.2 the key of remi is gone", "ok, later")
    typed_prompt.type("half a li")
    typed_prompt.typing("half a li")
    typed_prompt.sees("\nthe key of remi is gone\n")
    typed_prompt.typing("half a li")
    typed_prompt.type("ne")
    typed_prompt.typing("half a line")
    above = [line for line in typed_prompt.lines if line]
    assert above[-3] == "the key of remi is gone"
    assert above[-2] == typed_prompt.cursor_line


def test_flood_of_messages_is_folded(typed_prompt: Prompt):
    typed_prompt.enter("say 15 0 the same", "the same … 14 more like it")
    typed_prompt.enter("say 25 0 different #", "ok, later")
    typed_prompt.type("half")
    typed_prompt.sees("different 24")
    typed_prompt.typing("half")
    assert len(re.findall("different [0-9]+", typed_prompt.text)) == 25
    assert typed_prompt.text.count("the same") == 2


def test_prints_of_code_above_typed_line(typed_prompt: Prompt):
    typed_prompt.type("print something")
    typed_prompt.type(ENTER + "half")
    typed_prompt.sees("\nprinted something\n")
    typed_prompt.typing("half")


def test_drawing_with_escapes_is_cleaned(typed_prompt: Prompt):
    typed_prompt.enter("draw", "\n⣀⡠⠤ a drawing\n?[31m of two lines\n")


@pytest.mark.parametrize("kind", ["exit", "panic", "value"])
def test_session_errors_do_not_end_prompt(typed_prompt: Prompt, kind: str):
    typed_prompt.enter(f"fail {kind}", "not taken: internal error")
    typed_prompt.type("an unlucky line")
    typed_prompt.sees("internal error: ValueError: no colours")
    typed_prompt.typing("an unlucky line")
    typed_prompt.type(CTRL_C)
    typed_prompt.enter("ada goes on", "ok 2|1 ada: goes on")


def test_prompt_after_terminal_resize(typed_prompt: Prompt):
    typed_prompt.type("ada plays")
    typed_prompt.typing("ada plays")
    for rows, columns in ((40, 120), (10, 40), (3, 20), (24, 80)):
        typed_prompt.resize(rows, columns)
        typed_prompt.typing("> ada plays")
    typed_prompt.until(lambda: "quant bar" in typed_prompt.lines[-1], "the status line")
    typed_prompt.enter("", "ok 2|1 ada: plays")


def test_prompt_history_of_earlier_sessions(tmp_path: Path):
    history = tmp_path / "state" / "ergon" / "history"
    with prompt(tmp_path, "--history", str(history)) as prompt_shown:
        prompt_shown.enter("ada plays knock", "ok 2|1")
        prompt_shown.paste("ada first\nada second")
        prompt_shown.enter("", "ok 2|1 ada: first")
        prompt_shown.type(CTRL_D)
        assert prompt_shown.ends() == 0
    assert stat.S_IMODE(history.stat().st_mode) == 0o600
    assert stat.S_IMODE(history.parent.stat().st_mode) == 0o700
    with prompt(tmp_path, "--history", str(history)) as prompt_shown:
        prompt_shown.type(UP)
        prompt_shown.typing("ada second")
        prompt_shown.type(UP + UP)
        prompt_shown.typing("> ada plays knock")


def test_prompt_with_unwritable_history(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with prompt(tmp_path, "--history", str(tmp_path / "file" / "history")) as prompt_shown:
        prompt_shown.enter("ada plays knock", "ok 2|1")
        prompt_shown.is_empty()
        prompt_shown.type(UP)
        prompt_shown.typing("> ada plays knock")


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
def test_prompt_with_garbage_lines_and_megabyte_paste(typed_prompt: Prompt, n_lines: int):
    for number, line in enumerate(garbage(1, n_lines)):
        typed_prompt.type(line)
        if number == n_lines // 2:
            typed_prompt.paste("x" * 1_000_000)
    typed_prompt.type(b"y" * 1_000_000)  # as by a terminal that marks no paste
    typed_prompt.sees("a paste of 1,000,000 characters")
    # Out of whatever the last line began, such as a search.
    typed_prompt.type(CTRL_C)
    typed_prompt.type(CTRL_C)
    typed_prompt.is_empty()
    typed_prompt.enter("ada goes on", "ok 2|1 ada: goes on")
    assert len(typed_prompt.submitted) > n_lines // 2
    typed_prompt.type(CTRL_D)
    assert typed_prompt.ends() == 0


def test_closed_terminal_closes_session(typed_prompt: Prompt):
    typed_prompt.child.ptyproc.fileobj.close()
    until(lambda: typed_prompt.count("close"), "the end")


def test_closed_terminal_during_output_closes_session(typed_prompt: Prompt):
    typed_prompt.enter("say 100 0 different #", "different 2")
    typed_prompt.type("slow 1000" + ENTER)
    typed_prompt.child.ptyproc.fileobj.close()
    until(lambda: typed_prompt.count("close"), "the end")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_signal_closes_session_with_its_exit_status(typed_prompt: Prompt, number: signal.Signals):
    typed_prompt.child.kill(number)
    assert typed_prompt.ends() == -number
    assert typed_prompt.count("close") == 1


def test_terminal_settings_restored_at_exit(tmp_path: Path):
    code = f"stty -a > before; {sys.executable} {SESSION} log; stty -a > after"
    with Terminal(["/bin/sh", "-c", f"cd {tmp_path}; {code}"]) as terminal:
        terminal.sees("quant bar")
        terminal.type(CTRL_D)
        terminal.ends()
    assert (tmp_path / "before").read_text() == (tmp_path / "after").read_text()


def test_colours_with_and_without_no_color(tmp_path: Path):
    colour = re.compile(rb"\x1b\[(?:[0-9]+;)*(?:3[0-8]|9[0-7])[;m]")
    for environment, coloured in (({}, True), ({"NO_COLOR": "1"}, False)):
        with prompt(tmp_path, **environment) as prompt_shown:
            prompt_shown.type("play and more")
            prompt_shown.typing("play and more")
            assert bool(colour.search(prompt_shown.output)) is coloured
