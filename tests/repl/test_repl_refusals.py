"""A line that is not taken: its place, why, and a better line."""

import dataclasses

import pytest
from spoken import SCOPE, refused

from ergon.notation.clock.positions import Position
from ergon.repl.language.lines import MAX_LINE, MAX_PASTE
from ergon.repl.language.matter import Set
from ergon.repl.language.parse import parse
from ergon.repl.language.playing import Define, Plays
from ergon.repl.language.transport import Tap


@pytest.mark.parametrize(
    ("line", "faulty_text", "better"),
    [
        ("ada plyas leen", "plyas", "ada plays lean"),
        ("aad plyas leen", "aad", "ada plays lean"),
        ("ada plays knok every 1", "knok", "ada plays knock every 1"),
        ("ada plays knock evry 1", "evry", "ada plays knock every 1"),
        ("ada do scael 0.5", "scael", "ada do scale 0.5"),
        ("knock every 1", "knock", "ada plays knock every 1"),
        ("knock = 0@0 smoth 6@1", "smoth", "knock = 0@0 smooth 6@1"),
        ("set bel.m.K x2", "bel.m.K", "set bell.m.K x2"),
        ("set bell.m.k x2", "bell.m.k", "set bell.m.K x2"),
        ("set bell.m.K 900N/mm/s", "N/mm/s", "set bell.m.K 900N/mm"),
        ("gain bell -6", "-6", "gain bell -6dB"),
        (
            "d1 strikes bell.m every 1 impulse 100",
            "100",
            "d1 strikes bell.m every 1 impulse 100mNs",
        ),
        (
            "d1 strikes bell.m impulse 2.5 every 1",
            "2.5",
            "d1 strikes bell.m impulse 2.5mNs every 1",
        ),
        ("temop 72", "temop", "tempo 72"),
        ("tempo 72 nwo", "72 nwo", None),
        ("hush nwo", "nwo", "hush now"),
        ("record remi as solo", "solo", "record remi as solo-2"),
        ("record remi os lala", "os", None),
        ("quant bra", "bra", "quant bar"),
        ("uncuple k1 k2", "uncuple", "uncouple k1 k2"),
        ("save my piece.yaml", "piece.yaml", None),
        ("ada\xa0plays knock", "\xa0", "ada plays knock"),
        ("ada plays \x1bknock\x00", "\x1bknock\x00", "ada plays knock"),
    ],
)
def test_refusal_offset_and_suggestion(line: str, faulty_text: str, better: str | None):
    refusal = refused(line)
    assert line[refusal.offset : refusal.offset + refusal.length] == faulty_text
    assert refusal.try_ == better
    if better is not None:
        assert parse(better, SCOPE)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("set bell.m.K 900N", "unit 'N' does not measure stiffness"),
        ("set k1.M 2s", "unit 's' does not measure mass"),
        ("set bell.m.K x-1", "negative"),
        ("damp 3", "'3' has no unit"),
        ("link on", "Ableton Link is not part of ergon"),
        ("u", "'u' may be use or uncouple or unmap or unmute or undo"),
        ("help re", "'re' may be"),
        ("ada plays knock until Q", "'Q' is not a mark"),
        ("stop at Q+2", "'Q' is not a mark"),
        ("ada plays knock at B now", "says twice"),
        ("ada plays knock every", "'every' needs a value"),
        ("ada plays knock every 0", "is zero"),
        ("ada plays knock rate 4kHz", "belongs to the score"),
        ("ada plays solo from B", "is not a time"),
        ("ada plays", "a gesture or a take is missing"),
        ("ada", "what does ada play?"),
        ("stop at", "'at' needs a position"),
        ("panic at C", "acts at once"),
        ("rest", "is missing"),
        ("couple k1 k2", "K, Z or both"),
        ("couple k1 k1 K=1N/m", "'k1' is named twice"),
        ("guide remi remi", "'remi' is named twice"),
        ("gain bell", "a level is missing"),
        ("couple k1 k2 K=", "'K=' needs a stiffness"),
        ("tempo 60 over 4bar", "a ramp needs"),
        ("tempo 60 -> 90", "a ramp needs"),
        ("quant 1s", "not on seconds"),
        ("back 0", "from 1 to"),
        ("every = 0@0 6@1", "'every' is a word of the language"),
        ("solo = 0@0 6@1", "'solo' is a take"),
        ("9th = 0@0 6@1", "is not a name"),
        ("knock = ", "is missing"),
        ("knock = 0@0 throw", "has no point after it"),
        ("knock = 0@0 (1@1 0@2)*90000", "more than 2,000 points"),
        ('load "duet.yaml', "not closed"),
        ("xyz", "unknown verb 'xyz'"),
        ("gain 25dB", "25dB is above the highest level, 24dB"),
        ("gain bell x16", "x16 is above the highest level, 24dB"),
        ("= 0@0", "unknown verb '='"),
        ("x" * (MAX_LINE + 1), "10,000 are the most"),
        ("play\n" * MAX_PASTE, "100,000 are the most"),
        ("play\n" * 201, "more than 200 lines"),
    ],
)
def test_refusals_give_reason_and_valid_suggestion(line: str, reason: str):
    refusal = refused(line)
    assert reason in refusal.message
    assert "\n" not in refusal.message
    assert refusal.try_ is None or parse(refusal.try_, SCOPE)


def test_verb_names_as_gestures_and_players():
    """`tempo.yaml` has a gesture `tap`; players are called what they are called."""
    scope = dataclasses.replace(
        SCOPE, gestures={"tap": "", "help": ""}, players={"set": "", "ada": ""}
    )
    assert isinstance(parse("ada plays tap", scope)[0], Plays)
    assert isinstance(parse("tap", scope)[0], Tap)
    assert isinstance(parse("help = 0@0 1@1", scope)[0], Define)
    assert isinstance(parse("set plays help", scope)[0], Plays)
    assert isinstance(parse("set bell.m.K x2", scope)[0], Set)


def test_mark_with_hyphen_parses_as_mark():
    scope = dataclasses.replace(SCOPE, marks={"verse-2": ""})
    (stop,) = parse("stop at verse-2", scope)
    assert isinstance(stop.when, Position)
    assert stop.when.text == "verse-2"


@pytest.mark.parametrize(
    ("line", "suggested"),
    [
        ("reverb bell", None),  # not `remove bell`
        ("remvoe bell", "remove bell"),
        ("quiit", "quit"),
        ("quiet", "hush"),  # not `quit`
        ("stpo", "stop"),
        ("undu", "undo"),
        ("relaod", "reload"),
        ("bakc 2", "back 2"),
        ("sleep 1", None),  # not `seed 1`
        ("push", "hush"),
        ("damped 2s", None),
        ("fast 2", None),  # not `at 2`
    ],
)
def test_unknown_verb_near_removing_verb(line: str, suggested: str | None):
    assert refused(line).try_ == suggested


def test_transformation_as_verb_is_refused():
    assert "'fast' is a transformation" in refused("fast 2").message
    assert "rain do fast 2" in refused("fast 2").message


@pytest.mark.parametrize("line", ["d9 do rev", "d9 do mirror"])
def test_do_of_unknown_name_lists_players_and_strikes(line: str):
    message = refused(line).message
    assert "'d9' is not a player or the name of strikes" in message
    assert all(name in message for name in ("ada", "remi", "rain"))


def test_strikes_with_ordinal_are_refused():
    refusal = refused("d1 strikes bell.m every 4th do rev")
    assert refusal.message.startswith("'every 4th' changes every so many plays of a gesture")
