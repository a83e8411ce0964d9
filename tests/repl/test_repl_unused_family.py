"""Names of shipped instruments, typed before their family is in use or before they have notes."""

from contextlib import closing

import pytest
from sessions import Stepped

SCORE = "ergon: 1\ninstruments:\n  bell: {modules: {m: {CEL: {M: 2g, f: A3, t60: 50ms}}}}\n"
UNUSED = "'piano' is an instrument of strings, which is not in use: type `use strings`"


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    with closing(Stepped(SCORE, tmp_path_factory.mktemp("session"))) as session:
        yield session


@pytest.mark.parametrize(
    "line",
    [
        "piano C4 mf",
        "piano f",
        "piano notes C4 E4 every 1",
        "piano every 1",
        "gain piano -6dB",
        "fade piano out over 4bar",
        "pan piano 0.5",
        "rain strikes piano every 1",
        "rain strikes piano.hammer every 1 impulse 1mNs",
        'd1 = "piano*2"',
        "phrase tune 0 C4 to piano",
    ],
)
def test_instrument_of_unused_family_by_line(session, line):
    reply = session.type(line)
    assert not reply.taken
    assert reply.text.startswith(UNUSED), reply.text


@pytest.mark.parametrize("word", ["piano", "strings/piano"])
def test_use_of_instrument_names_its_family(session, word):
    reply = session.type(f"use {word}")
    assert not reply.taken
    expected = f"{word!r} is an instrument: type `use strings` for its family, or "
    assert f"{expected}`piano = strings/piano` for it alone" in reply.text


@pytest.mark.parametrize("line", ["piano strikes bell.m every 1 impulse 1mNs", "piano = bell"])
def test_new_name_of_unused_instrument_is_taken(tmp_path, line):
    with closing(Stepped(SCORE, tmp_path)) as session:
        session.ok(line)


def test_notes_of_instrument_without_members_by_advice(tmp_path):
    with closing(Stepped("ergon: 1\n", tmp_path)) as session:
        session.ok("use plucked")
        for line in ("guitar C4 mf", "guitar notes C4 every 1"):
            reply = session.type(line)
            assert not reply.taken
            assert "guitar-notes = guitar notes=C" in reply.text, reply.text
        session.ok("guitar-notes = guitar notes=C4..D4")
        session.ok("guitar-notes C4 mf")
