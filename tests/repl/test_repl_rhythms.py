"""Rhythms at the prompt: texts in quotes, strengths, transformations, and what they become."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from sessions import Stepped

from ergon.repl.language.complete import complete
from ergon.repl.language.parse import first_error
from ergon.repl.language.scope import scope_of
from ergon.repl.session.version import piece_of
from ergon.scores.edits.texts import Texts

# Two drums that are silent after a tenth of a beat, and a bar of notes; a beat is half a second.
SCORE = """\
ergon: 1
seed: 4
rates: {audio: 8kHz}
tempo: [{at: 1|1, bpm: 120}]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  kick: {CEL: {M: 5g, f: 90Hz, t60: 50ms}, play: {strike: {impulse: 1mNs..16mNs}}, out: {SOX: kick}}
  hat: {CEL: {M: 1g, f: 900Hz, t60: 50ms}, play: {strike: {impulse: 1mNs..4mNs}}, out: {SOX: hat}}
  bare: {CEL: {M: 1g, f: 700Hz, t60: 50ms}, out: {SOX: bare}}
  bar:
    CEL: {M: 1g, f: A4, t60: 50ms}
    notes: C4..C5
    play: {strike: {impulse: 1mNs..4mNs}}
    out: {SOX: bar}
gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@160ms}
players: {ada: {key: k1}}
mix: {channels: 3, route: [{from: kick, to: [1]}, {from: hat, to: [2]}, {from: bar, to: [3]}]}
"""

SCOPE = scope_of(piece_of(Texts("s.yaml", SCORE)))


@pytest.fixture
def stepped(tmp_path: Path):
    with closing(Stepped(SCORE, tmp_path)) as session:
        yield session


def steps(session: Stepped, channel: int, first: float, last: float) -> list[int]:
    """The half beats of a channel in which something is struck, from one beat to another."""
    n_frames = int(session.rate / 4)
    part = session.sound[int(2 * first) * n_frames : int(2 * last) * n_frames, channel - 1]
    levels = np.abs(part).reshape(-1, n_frames).max(axis=1)
    return [number for number, level in enumerate(levels) if level > 1e-3 * np.abs(part).max()]


def same_again(session: Stepped) -> None:
    session.close()
    assert np.array_equal(session.again(), session.sound)


def test_rhythm_sounds_on_its_steps(stepped: Stepped):
    stepped.ok('d1 = "kick*2, ~ hat ~ hat"')
    stepped.ok("play")
    stepped.run(4.0)
    assert steps(stepped, 1, 0, 8) == [0, 4, 8, 12]
    assert steps(stepped, 2, 0, 8) == [2, 6, 10, 14]
    same_again(stepped)


def test_rhythm_is_defined_anew_at_the_bar(stepped: Stepped):
    stepped.ok('d1 = "kick*2"')
    stepped.ok("play")
    stepped.run(1.0)
    stepped.ok('d1="hat(3,8)"')
    stepped.run(3.0)
    assert steps(stepped, 1, 0, 8) == [0, 4]
    assert steps(stepped, 2, 4, 8) == [0, 3, 6]
    same_again(stepped)


def test_strength_after_rhythm_and_after_words(stepped: Stepped):
    stepped.ok('d1 = "kick kick:fff" p')
    stepped.ok("play")
    stepped.run(2.0)
    n_frames = int(stepped.rate)
    soft, hard = (np.abs(stepped.sound[i * n_frames : (i + 1) * n_frames, 0]).max() for i in (0, 1))
    assert hard / soft == pytest.approx(16 ** (5 / 7), rel=0.01)


def test_do_rev_continues_from_current_cycle(stepped: Stepped):
    """`rev` turns the cycles that follow; what is chosen by cycle is not begun anew."""
    stepped.ok('d1 = "<kick hat> ~ ~ ~"')
    stepped.ok("play")
    stepped.run(3.0)
    stepped.ok("d1 do rev")
    stepped.run(3.0)
    assert steps(stepped, 1, 0, 8) == [0]
    assert steps(stepped, 2, 0, 8) == [8]
    assert steps(stepped, 1, 8, 12) == [6] or steps(stepped, 2, 8, 12) == [6]
    stepped.ok("d1 do none")
    stepped.run(4.0)
    assert "do" not in next(line for line in stepped.ok("show d1").lines if "d1" in line)
    same_again(stepped)


def test_do_makes_strikes_by_the_clock_a_rhythm(stepped: Stepped):
    stepped.ok("d1 strikes kick every 1")
    stepped.ok("play")
    stepped.run(1.0)
    stepped.ok("d1 do ply 2")
    stepped.run(3.0)
    assert steps(stepped, 1, 0, 4) == [0, 2, 4, 6]
    assert steps(stepped, 1, 4, 8) == [0, 1, 2, 3, 4, 5, 6, 7]
    same_again(stepped)


def test_do_of_walk(stepped: Stepped):
    stepped.ok("bar notes walk C4 E4 G4 every 1")
    stepped.ok("play")
    stepped.run(1.0)
    stepped.ok("bar do ply 2")
    stepped.run(3.0)
    assert steps(stepped, 3, 0, 8) == [0, 2, 4, 6, *range(8, 16)]
    (line,) = [line for line in stepped.ok("voices").lines if line.startswith("bar")]
    assert '"<C4|E4|G4>" do ply 2' in line
    same_again(stepped)


def test_do_of_rhythm_words_on_phrase(stepped: Stepped):
    """Rounds of four beats, first backwards, then as written, then twice as fast."""
    stepped.ok("phrase tune 0 C4 1mNs, 1 E4, 3 G4 to bar length 4")
    stepped.ok("hook strikes tune every 4 do every 2 rev")
    stepped.ok("play")
    stepped.run(3.0)
    stepped.ok("hook do fast 2")
    stepped.run(5.0)
    # G4 lasts a beat, E4 two and C4 one: backwards they begin at 0, 1 and 3 beats.
    assert steps(stepped, 3, 0, 8) == [0, 2, 6, 8, 10, 14]
    # Twice as fast, a step of half a beat each; cycles go on to count.
    assert steps(stepped, 3, 8, 12) == [0, 1, 3, 4, 5, 7]
    stepped.ok("hook do none")
    stepped.run(2.0)
    assert not stepped.type("ada do ply 2").taken
    same_again(stepped)


@pytest.mark.parametrize(
    ("do", "expected"),
    [
        ("arp up", [0, 2, 4, 6]),
        ("arp up 1/8", [*range(8)]),
        ("tremolo 2Hz", [0, 2, 4, 6]),
        ("tremolo 8", [*range(8)]),
        ("strum 250ms, tremolo 1Hz", [0, 1, 4, 5]),
        ("grace 1/8 12st", [0, 7]),
        ("rolled 1", [0, 2, 4, 6]),
    ],
)
def test_phrasing_sounds_on_its_steps(stepped: Stepped, do: str, expected: list[int]):
    """In a bar of two seconds, after one that is played as it was."""
    chord = "c4" if "grace" in do else "[c4,e4,g4,c5]" if "1Hz" not in do else "[c4,e4]"
    stepped.ok(f'bar = "{chord}" mf')
    stepped.ok("play")
    stepped.run(0.7)
    stepped.ok(f"bar do {do}")
    stepped.run(5.3)
    assert steps(stepped, 3, 8, 12) == expected
    same_again(stepped)


def test_rhythm_of_notes_named_like_instrument(stepped: Stepped):
    stepped.ok('bar = "c4 <e4 g4>" mf')
    stepped.ok("play")
    stepped.run(2.0)
    assert steps(stepped, 3, 0, 4) == [0, 4]
    same_again(stepped)


def test_bow_is_added_with_first_stroke(stepped: Stepped):
    stepped.ok("saw = friction/saw")
    stepped.ok("play")
    stepped.run(1.0)
    stepped.ok('d1 = "saw saw"')
    stepped.run(3.0)
    stepped.ok("rest d1")
    stepped.run(1.0)
    assert np.abs(stepped.sound).max() > 1e-3
    same_again(stepped)


def test_undo_returns_the_rhythm(stepped: Stepped):
    stepped.ok('d1 = "kick*2"')
    stepped.ok('d1 = "kick*4" at 3|1')
    stepped.ok("undo")
    stepped.ok("play")
    stepped.run(4.0)
    assert steps(stepped, 1, 4, 8) == [0, 4]
    same_again(stepped)


@pytest.mark.parametrize(
    ("line", "place", "part"),
    [
        ('d1 = "kick [hat"', 11, "not closed"),
        ('d1 = "kick snar"', 11, "'snar' is not an instrument"),
        ('d1 = "kick bare"', 11, "does not say how it is played"),
        ('d1 = "c4 e4"', 6, "whose is 'c4'"),
        ('d1 = "kick" loud', 12, "does not belong here"),
        ('d1 = "kick" 100', 12, "write 100mNs or 100Ns"),
        ('d1 = "kick" do revv', 15, "unknown transformation"),
        ('d1 = "kick" to baar', 15, "'baar' is not an instrument"),
        ('d1 = "kick', 5, "quote at the end"),
        ('bar = "c4.moll"', 10, "name of a chord"),
        ('d1 = "kick:loud"', 11, "neither an impulse"),
        ('d1 = "kick" do', 13, "a transformation is missing"),
        ("d1 do rev", 0, "'d1' is not"),
    ],
)
def test_rhythm_line_mistake_offset(stepped: Stepped, line: str, place: int, part: str):
    reply = stepped.type(line)
    assert not reply.taken
    assert part in reply.text
    error = first_error(line, SCOPE)
    assert error is not None
    assert error.offset == place


def test_do_refused_without_cycles(stepped: Stepped):
    stepped.ok("d1 strikes kick rate 3Hz for 4bar impulse 1mNs")
    reply = stepped.type("d1 do rev")
    assert not reply.taken
    assert "no cycle" in reply.text
    stepped.ok("ada plays knock every 1")
    assert not stepped.type("ada do ply 2").taken
    stepped.ok("ada do mirror")


@pytest.mark.parametrize(
    ("line", "channel"),
    [
        ("bar notes C4 E4 ~ G4 every 1/2 f do rev", 3),
        ("d1 strikes kick every 1/2 p f do every 2 fast 2", 1),
        ("d1 strikes kick euclid 3 8 every 1/4 impulse mf do rev, fast 2", 1),
    ],
)
def test_strikes_with_transformations_in_their_line(
    stepped: Stepped, tmp_path: Path, line: str, channel: int
):
    before, _, do = line.partition(" do ")
    stepped.ok(line)
    stepped.ok("play")
    stepped.run(4.0)
    assert len(steps(stepped, channel, 0, 8)) > 4
    (tmp_path / "two").mkdir()
    with closing(Stepped(SCORE, tmp_path / "two")) as two_lines:
        two_lines.ok(f"{before}\n{line.split()[0]} do {do}")  # pasted: both begin in one frame
        two_lines.ok("play")
        two_lines.run(4.0)
        assert np.array_equal(stepped.sound, two_lines.sound)
    same_again(stepped)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("bar notes C4 every 1 do rve", "unknown transformation 'rve'"),
        ("bar notes C4 every 1 do", "a transformation is missing"),
        ("d1 strikes kick every 1 times 8 1", "unknown word '1'"),
        ("d1 strikes kick every 1 f impulse p", "'impulse' is written twice"),
    ],
)
def test_strikes_line_with_wrong_end(line: str, expected: str):
    error = first_error(line, SCOPE)
    assert error is not None
    assert error.message.startswith(expected)


def test_pasted_lines_with_names_of_first_line(stepped: Stepped):
    stepped.ok("use friction")
    stepped.ok('d1 = "saw*2"\ngain saw -3dB\nd1 do rev')


def test_voices_show_rhythms(stepped: Stepped):
    stepped.ok('d1 = "kick*2, ~ hat" p do every 2 rev')
    (line,) = [line for line in stepped.ok("voices").lines if line.startswith("d1")]
    assert line == 'd1 (strikes): "kick*2, ~ hat" do every 2 rev from 1|1'


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("d1 do ", {"legato", "arp", "strum", "none", "rev"}),
        ("d1 do rev, tr", {"tremolo", "transpose"}),
        ("d1 do arp ", {"up", "down", "updown", "thumbup"}),
        ("d1 do legato ", {"0.3"}),
        ('d1 = "kick" do gra', {"grace"}),
    ],
)
def test_tab_offers_transformations_and_their_values(line: str, expected: set[str]):
    scope = scope_of(piece_of(Texts("s.yaml", SCORE + "strikes: {d1: {to: kick, at: 0}}\n")))
    offered = {offer.text for offer in complete(line, len(line), scope)}
    assert expected <= offered
    assert len(offered) < 45


def test_misspelt_phrasing_is_corrected(stepped: Stepped):
    stepped.ok('d1 = "kick*2"')
    assert "legato" in stepped.type("d1 do legatto 0.3").text
    assert "'upp' is not an order of notes" in stepped.type("d1 do arp upp").text


def test_tab_offers_acts():
    offered = {offer.text for offer in complete("d1 strikes kick.", 16, SCOPE)}
    assert "kick.strike" in offered
