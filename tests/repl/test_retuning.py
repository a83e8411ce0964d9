"""`set vib.tuning`: what sounds after it, what a session's journal renders, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from sessions import Stepped

from ergon.repl.language.complete import complete
from ergon.repl.language.scope import scope_of

SCORE = """\
ergon: 1
instruments:
  vib:
    CEL: {M: 1g, f: A4, t60: 30s}
    notes: [E4, A4]
    out: {SOX: vib}
    play: {strike: {impulse: 1mNs..3mNs}}
strikes: {tune: {to: vib, at: 1|1, notes: E4, every: 1, times: 40}}
mix: {channels: 1, route: [{from: vib, to: 1}]}
"""
SCALE = "! just.scl\njust\n3\n5/4\n3/2\n2/1\n"
A4_MAP = "! just.kbm\n3\n0\n127\n69\n69\n440.0\n3\n0\n1\n2\n"


@pytest.fixture
def session(tmp_path):
    opened = Stepped(SCORE, tmp_path)
    opened.ok("play")
    opened.run(0.5)
    return opened


def frequency(sound: np.ndarray, rate: float) -> float:
    """Frequency [Hz] of one decaying partial, by the pole of order two that predicts it best."""
    middle = sound[1:-1]
    # x[n+1] + ρ²·x[n-1] = 2·ρ·cos(ω)·x[n], with ρ of T60 = 30 s.
    decay = 10.0 ** (-3.0 / (30.0 * rate))
    both = sound[2:] + decay**2 * sound[:-2]
    cosine = (middle @ both) / (middle @ middle) / (2.0 * decay)
    return float(np.arccos(cosine) * rate / (2.0 * np.pi))


def cents(sound: float, expected: float) -> float:
    return abs(1200.0 * np.log2(sound / expected))


def sounding(session: Stepped) -> float:
    """Frequency [Hz] of E4 between two strokes, once it has gone where it goes."""
    session.run(5.0)
    n = int(0.3 * session.rate)
    return frequency(session.sound[-n:, 0], session.rate)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("set vib.tuning edo 19", 440.0 * 2.0 ** (-8 / 19)),
        ("set vib.tuning 415Hz", 415.0 * 2.0 ** (-5 / 12)),
        ("set tuning A4 415Hz", 415.0 * 2.0 ** (-5 / 12)),
        ("set vib.tuning edo 31 over 1s", 440.0 * 2.0 ** (-13 / 31)),
        ("set vib.tuning off", 440.0 * 2.0 ** (-5 / 12)),
    ],
)
def test_partial_after_set_tuning_by_closed_form(session, line, expected):
    session.ok(line)
    assert cents(sounding(session), expected) < 0.05


def test_set_tuning_live_equals_journal(session):
    session.ok("set vib.tuning edo 19 over 500ms")
    session.run(1.5)
    session.ok("set tuning 442Hz")
    session.run(1.0)
    session.ok("set vib.tuning off")
    session.run(1.0)
    sound = session.sound
    session.close()
    assert np.abs(sound).max() > 0
    assert (session.again() == sound).all()


def test_set_tuning_scale_file_in_journal(session, tmp_path):
    (tmp_path / "just.scl").write_text(SCALE, encoding="utf-8")
    (tmp_path / "just.kbm").write_text(A4_MAP, encoding="utf-8")
    session.ok("set vib.tuning scale just.scl keys just.kbm")
    session.run(1.5)
    sound = session.sound
    session.close()
    (tmp_path / "just.scl").unlink()
    assert (session.again() == sound).all()


def test_undo_restores_previous_tuning(session):
    session.ok("set vib.tuning edo 19")
    session.run(2.0)
    session.ok("undo")
    assert cents(sounding(session), 440.0 * 2.0 ** (-5 / 12)) < 0.05


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("set vib.tuning edo", "a value is missing after 'edo', such as edo 19"),
        ("set vib.tuning edoo 19", "says nothing of a tuning"),
        ("set vib.tuning edo 19 edo 31", "each once"),
        ("set vib.tuning edo x", "'x' is not a number"),
        ("set vib.tuning scale no.scl", "there is no file no.scl"),
        ("set vib.tuning keys no.kbm", "write `scale` beside it"),
        ("set vib.E4.tuning edo 19", "did you mean"),
        ("set vbi.tuning edo 19", "'vbi.tuning' is not a tuning"),
    ],
)
def test_invalid_tuning_is_refused(session, line, words):
    reply = session.type(line)
    assert not reply.taken
    assert words in reply.text


def test_set_tuning_scale_outside_folder_is_refused(tmp_path):
    (tmp_path / "just.scl").write_text(SCALE, encoding="utf-8")
    (tmp_path / "piece").mkdir()
    session = Stepped(SCORE, tmp_path / "piece")
    reply = session.type("set vib.tuning scale ../just.scl")
    assert not reply.taken
    assert "outside" in reply.text


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("set vib.t", {"vib.tuning"}),
        ("set vib.tuning ", {"edo", "A4", "scale", "root", "off"}),
        ("set vib.tuning edo ", {"19"}),
    ],
)
def test_completion_of_tuning_words(session, line, words):
    scope = scope_of(session.session.schedule.head.piece)
    assert words <= {each.text for each in complete(line, len(line), scope)}
