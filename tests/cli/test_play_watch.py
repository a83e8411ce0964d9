"""`ergon play --watch`: what is saved plays on, in a session that leaves nothing behind."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from sessions import Stepped

from ergon.api import local_session
from ergon.cli import app
from ergon.cli.outcome import Refused
from ergon.cli.play_watch import follow

SCORE = """\
ergon: 1
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 440Hz, t60: 0.5s}}}, out: {SOX: m}}}
strikes: {a: {to: [bell.m], at: 1|1, every: 1, times: 40, impulse: 1mNs}}
"""


@pytest.fixture
def stepped(tmp_path: Path) -> Stepped:
    return Stepped(SCORE, tmp_path)


def test_watch_reloads_saved_and_skips_broken_score(stepped: Stepped) -> None:
    path, text, bars = stepped.journal.parent / "score.yaml", [], []

    def looks() -> Iterator[None]:
        """What an editor and the thread of the session do between two looks."""
        stepped.run(4.5)
        for text in (SCORE.replace("440Hz", "450Hz"), SCORE.replace("440Hz", "45x0Hz")):
            path.write_text(text)
            reply = stepped.session.submit("reload")
            stepped.session.say(reply.text)
            stepped.run(4.0)
            bars.append(stepped.session.state().bar)
            yield
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        follow(stepped.session, text.append, "2|1", looks())
    assert bars == [4, 5]  # from 2|1 on, and on
    assert "450Hz" in stepped.session.schedule.head.texts.text
    assert text[0] == "a saved version plays on from the next bar; Ctrl-C ends"
    assert any("45x0Hz" in message or "unit" in message for message in text[1:])
    assert stepped.session._is_closed.is_set()


def test_watch_with_a_wrong_position_closes_the_session(stepped: Stepped) -> None:
    with pytest.raises(Refused, match="--from"):
        follow(stepped.session, lambda text: None, "nowhere", iter(()))
    assert stepped.session._is_closed.is_set()


@pytest.mark.parametrize(
    "option",
    [
        ["--loop"],
        ["--until", "2|1"],
        ["--draft"],
        ["--seed", "2"],
        ["--strict"],
        ["--error", "-40dB"],
    ],
)
def test_watch_refuses_options_of_renders(
    option: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_text(SCORE)
    monkeypatch.setattr(
        local_session, "begin_session", lambda *_: pytest.fail("a session was opened")
    )
    assert app.run(["play", "a.yaml", "--watch", *option]) == 2
    assert f"--watch excludes {option[0]}" in capsys.readouterr().err


def test_watch_with_frozen_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_text(SCORE)
    assert app.run(["render", "a.yaml", "--freeze", "bell", "-q"]) == 0
    opened = []

    def begin(path, options, console):
        opened.append(options)
        raise Refused("that is all")

    monkeypatch.setattr(local_session, "begin_session", begin)
    assert app.run(["play", "a.yaml", "--watch", "--frozen", "a.frozen"]) == 2
    assert [Path(options.frozen) for options in opened] == [Path("a.frozen")]
