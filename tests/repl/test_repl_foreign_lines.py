"""Lines of other programs, and near misses: each is answered with the line that does it here."""

from contextlib import closing

import pytest
from sessions import Stepped

SCORE = """\
ergon: 1
instruments:
  kick: {CEL: {M: 1g, f: 60Hz, t60: 50ms}, play: {strike: {impulse: 1mNs..4mNs}}, out: {SOX: kick}}
  bell: {modules: {m: {CEL: {M: 2g, f: A3, t60: 50ms}}}, out: {SOX: m}}
mix: {channels: 2, route: [{from: kick, to: 1}, {from: bell, to: [1, 2]}]}
"""


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    with closing(Stepped(SCORE, tmp_path_factory.mktemp("session"))) as session:
        yield session


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("fade kick out over 2 bars", "a number and its unit are one word: 2bar"),
        ("tempo 60 -> 84 over 4 bars", "a number and its unit are one word: 4bar"),
        ("fade kick out over 2 seconds", "a number and its unit are one word: 2s"),
        ("undo 2", "write back 2"),
        ("undo kick", "write undo"),
        ("stop kick", "write mute kick, or remove kick"),
        ("faster", "did you mean 'tempo'?"),
        ("reverb", "did you mean 'room'?"),
        ("kick every 1/2", "write d1 strikes kick every 1/2"),
        ("pan bell left", "a place from -1 (first channel) to 1 (second)"),
        ('d1 = "x...x..."', "a hit is the name of an instrument, and a rest is ~"),
    ],
)
def test_foreign_line_is_answered_with_ours(session, line, words):
    reply = session.type(line)
    assert not reply.taken
    assert words in reply.text, reply.text


def test_verb_of_other_programs_by_its_line(session):
    reply = session.type("volume kick -3dB")
    assert not reply.taken
    assert reply.try_ == "gain kick -3dB"


def test_advised_lines_are_taken(session):
    for line in ("d1 strikes kick every 1/2", "tempo 90", "back 1", "mute kick"):
        session.ok(line)


def test_remove_of_strikes_named_as_instrument(tmp_path):
    with closing(Stepped(SCORE, tmp_path)) as session:
        session.ok('kick = "kick*2"')
        session.run(0.1)
        session.ok("remove kick")  # what plays goes first
        session.ok("kick f")
        session.ok("remove kick")
        assert "not in use" in session.type("hear kick f").text
