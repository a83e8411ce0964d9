"""Instruments, keys, links, players and routes that are typed while the piece plays."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from edited import DUET, opened
from sessions import Stepped

from ergon.scores.edits import structure

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo:
  - {at: 1|1, bpm: 240}                    # a bar is a second
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}
  k2: {like: k1}
instruments:
  bell:                                    # rings
    modules:
      m: {CEL: {M: 20g, f: 220Hz, t60: 0.6s}}
      low: {CEL: {M: 20g, K: 5000N/m, Z: 0.1Ns/m}}
      slow: {CEL: {M: 8g, f: 2Hz, t60: 1s}}
      b: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
    out: {SOX: [m, low]}
gestures:
  knock: 0mm@0 smooth 6mm@60ms 0mm@160ms   # once
  lean: {like: knock, do: [scale 0.5]}
players:
  ada: {key: k1}
  leo: {key: k2}
parts:
  ada: [{at: 1|1, play: knock, every: 1, until: 99|1}]
  leo: |                                   # a table
    # at   what
    1|1    knock every 2 times 4
    5|1    lean
mix: {channels: 4, route: [{from: bell, to: [1]}]}
"""


@pytest.fixture
def at(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    stepped.ok("play")
    yield stepped
    stepped.close()


def same_again(at: Stepped) -> None:
    """Undone to the beginning, saved and resumed; the journal is the sound."""
    text = at.session.schedule.head.texts.text
    at.ok("save typed")
    at.run(0.3)
    assert opened(str(at.journal.with_name("typed.yaml")))
    at.session.close()
    assert np.array_equal(at.again(), at.sound)
    again = Stepped.resumed(at.journal)
    assert again.session.schedule.head.texts.text == text
    again.ok("play from 2|1")
    again.run(1.5)
    count = len(again.session.history.numbers) - 1
    again.ok(f"back {count}")
    again.run(1.0)
    assert again.session.schedule.head.texts.text == SCORE
    again.close()
    assert np.array_equal(again.again(), again.sound)


def level(at: Stepped, channel: int, seconds: float) -> float:
    return float(np.abs(at.sound[-int(seconds * at.rate) :, channel - 1]).max())


def test_a_new_instrument_is_built_linked_routed_and_played(at: Stepped):
    at.run(1.2)
    at.ok("bell2 = bell/bell transpose 7st")
    at.ok("mia takes k3 like k1\nlink k3 bell2.hammer BUT K=4kN/m Z=2Ns/m")
    at.ok("route bell2 3 4 gain 60dB")
    at.ok("mia plays knock every 1/2")
    at.run(4.0)
    version = at.session.schedule.running.version
    bell2 = {module.name: module.fields for module in version.piece.instruments["bell2"].modules}
    ratio = 2.0 ** (7.0 / 12.0)
    assert bell2["prime"]["f"] == 440.0 * ratio  # E5, to the last bit
    assert bell2["prime"]["t60"] == pytest.approx(6.0 / ratio, rel=1e-15)
    assert bell2["hammer"]["f"] == 1.0  # mechanics stay
    assert [module.name for module in version.piece.instruments["links"].modules] == ["but-1"]
    assert version.piece.players["mia"].key == "k3"
    for comment in ("# a bar is a second", "# rings", "# once", "# a table"):
        assert comment in version.texts.text
    assert level(at, 1, 1.0) > 0
    assert level(at, 3, 1.0) > 0
    assert level(at, 2, 4.0) == 0
    same_again(at)


@pytest.mark.parametrize(("base", "struck"), [("bell", "b2.m"), ("skins/kick", "b2.hammer")])
def test_build_routes_to_all_channels(at: Stepped, base: str, struck: str):
    at.ok(f"b2 = {base}")
    at.ok(f"d1 strikes {struck} every 1/2 impulse 50mNs")
    at.run(4.0)
    assert min(level(at, channel, 1.0) for channel in (2, 3, 4)) > 0
    same_again(at)


def test_an_instrument_like_another_is_transposed_where_it_sounds(at: Stepped):
    at.ok("deep = bell transpose -12st")
    piece = at.session.schedule.head.piece
    own = {module.name: module.fields for module in piece.instruments["deep"].modules}
    assert own["m"]["f"] == pytest.approx(110.0)
    assert own["low"]["K"] == pytest.approx(1250.0)
    assert own["slow"]["f"] == 2.0
    assert piece.instruments["bell"].modules[0].fields["f"] == 220.0


def test_cents_and_ratios_transpose_too(at: Stepped):
    at.ok("low = bell transpose -14cents")
    at.ok("fifth = bell transpose x1.5")
    piece = at.session.schedule.head.piece
    assert piece.instruments["low"].modules[0].fields["f"] == pytest.approx(
        220.0 * 2.0 ** (-14.0 / 1200.0), rel=1e-15
    )
    assert piece.instruments["fifth"].modules[0].fields["f"] == 330.0
    assert "transpose: x1.5" in at.session.schedule.head.texts.text


def test_a_generator_takes_fields_of_its_own(at: Stepped):
    at.ok("gong2 = gong/plate f=C2 t60=3s transpose 12st")
    (module,) = at.session.schedule.head.piece.instruments["gong2"].modules
    assert module.fields["f"] == pytest.approx(2 * 65.406, rel=1e-3)
    assert module.fields["t60"] == 3.0


def test_a_link_comes_in_without_a_jump(at: Stepped):
    at.ok("ada plays knock every 1")
    at.run(2.0)
    at.ok("link bell.m bell.low REF K=2kN/m now")
    at.run(0.3)
    (glide,) = at.session.schedule.running.glides
    assert (glide.part, glide.module, glide.before) == ("links", "ref-1", (0.0,))
    at.run(1.0)
    bends = np.abs(np.diff(at.sound[:, 0], 3))
    n = int(at.rate)
    before, within = bends[: 2 * n].max(), bends[2 * n : int(2.4 * n)].max()
    assert within < 1.5 * before
    same_again(at)


def test_what_was_built_is_removed_with_what_belongs_to_it(at: Stepped):
    at.ok("couple k1 k2 K=20N/m\nb2 = bell\nroute b2 2\nlink k2 b2.m BUT K=500N/m gap=1mm")
    at.run(2.0)
    assert "links" in at.session.schedule.head.piece.instruments
    at.ok("remove links.but-1")
    assert "links" not in at.session.schedule.head.piece.instruments
    at.ok("remove b2")
    assert [route.part for route in at.session.schedule.head.piece.mix.routes] == ["bell"]
    at.ok("remove leo\nremove k2")
    piece = at.session.schedule.head.piece
    assert [*piece.players] == ["ada"]
    assert [*piece.keys] == ["k1"]
    assert piece.duet == ()
    at.run(2.0)
    assert level(at, 1, 1.0) > 0
    same_again(at)


def test_what_is_renamed_is_renamed_wherever_it_is_named(at: Stepped):
    at.run(1.1)
    at.ok("rename knock tap2")
    piece = at.session.schedule.head.piece
    assert [*piece.gestures] == ["tap2", "lean"]
    assert {play.what for play in piece.parts} == {"tap2", "lean"}
    at.ok("rename leo eva")
    piece = at.session.schedule.head.piece
    assert [*piece.players] == ["ada", "eva"]
    assert [play.what for play in piece.parts if play.player == "eva"] == ["tap2", "lean"]
    text = at.session.schedule.head.texts.text
    assert text.replace("tap2", "knock").replace("eva:", "leo:") == SCORE
    at.run(2.0)
    same_again(at)


def test_what_is_renamed_is_renamed_in_patterns(at: Stepped):
    at.ok("ada plays knock (lean knock) ~ every 1")
    at.ok("leo plays choose knock lean every 1 chance 0.5")
    at.run(1.0)
    at.ok("rename knock tap2")
    text = at.session.schedule.head.texts.text
    assert "tap2 (lean tap2) ~" in text
    assert "choose tap2 lean" in text
    assert "knock" not in text.partition("gestures:")[2]
    at.run(1.0)


def test_a_player_takes_another_key(at: Stepped):
    at.ok("leo takes k1")
    assert at.session.schedule.head.piece.players["leo"].key == "k1"
    at.run(1.5)
    at.ok("leo takes k9")
    assert at.session.schedule.head.piece.keys["k9"].travel == (-0.015, 0.015)


def test_without_routes_what_sounds_stays_where_it_is():
    text = SCORE[: SCORE.index("mix:")] + "mix: {channels: 4}\n"
    texts, piece = opened("s.yaml", text)
    made = structure.build(texts, piece, "b2", "bell", {})
    made = structure.route(made, opened("s.yaml", made.text)[1], "b2", ["3"], None)
    _, after = opened("s.yaml", made.text)
    assert [(route.part, route.to) for route in after.mix.routes] == [("bell", (1,)), ("b2", (3,))]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("bell = bell/bell", "bell exists: `remove bell` first"),
        ("b2 = bel", "is not an instrument or a file"),
        ("b2 = nothing/bell", "names no file 'nothing'"),
        ("b2 = bell/nothing", "has no 'nothing'"),
        ("b2 = bell transpose 7", "is not an interval such as 7st, -14cents or 3/2"),
        ("b2 = bell f", "'f' is not a field"),
        ("b2 = gong/plate f=2kg", "'kg'"),
        ("link k1 bell.q BUT K=1kN/m", "nothing is called 'bell.q'"),
        ("link k1 k1 BUT K=1kN/m", "is named twice"),
        ("link k1 bell.m BUT K=1kg", "'kg'"),
        ("link k1 bell.m BUT k=1kN/m", "BUT has no field 'k'"),
        ("link k1 bell.m BAT K=1kN/m", "is not a kind of link"),
        ("link on", "--midi-clock-to PORT` shares the tempo"),
        ("mia takes k2 like k1", "k2 exists already"),
        ("route bell 9", "channel 9 does not exist; the mix has 4"),
        ("route bell three", "is not a channel"),
        ("route drum 1", "is not an instrument"),
        (
            "remove k1",
            "used by key 'k2', module 'bell.b', player 'ada'; ",
        ),
        ("remove bell", "is the last instrument that is heard"),
        ("remove nothing", "is not a name of this score"),
        ("rename bell k1", "the name 'k1' is in use"),
        ("rename k1 bell", "the name 'bell' is in use"),
        (
            "rename bell.m x",
            "is not a gesture, a phrase, a take, a player",
        ),
        ("rename knock lean", "the name 'lean' is in use"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(at: Stepped, line: str, message: str):
    reply = at.type(line)
    assert not reply.taken, reply.text
    assert message in reply.text
    assert at.session.schedule.head.texts.text == SCORE


def test_what_ships_keeps_its_own_text():
    texts, piece = opened(DUET)
    made = structure.build(texts, piece, "gong2", "gong", {})
    assert made.overlay == texts.overlay


STRUCK = """
strikes:
  tick: {to: bell.m, at: 1|1, every: 1, times: 9, impulse: 1e-4Ns}
  tab: |
    1|1 bell.m 1e-4Ns
"""


def test_what_is_referred_to_is_not_removed_and_all_that_does_is_named(tmp_path: Path) -> None:
    with closing(Stepped(SCORE + STRUCK, tmp_path)) as own:
        own.ok("play")
        reply = own.type("remove bell.m now")
        assert not reply.taken
        assert reply.text.startswith("cannot remove bell.m, because it is used by ")
        for name in ("strikes 'tick'", "strikes 'tab'"):
            assert name in reply.text
        assert reply.try_ == "remove tick"
        own.ok("remove tick\nremove tab")
        own.run(3.0)
        assert own.session.schedule.head.piece.strikes == ()
    assert np.array_equal(own.again(), own.sound)


def test_unheard_part_is_refused_by_its_line(at: Stepped) -> None:
    """It was taken, and the next line was refused for it."""
    vibraphone = "vib = bars/vibraphone notes=C8"  # all its modes: none can be left out
    for line in (vibraphone, f"{vibraphone}\nroute vib 1 2"):
        reply = at.type(line)
        assert not reply.taken
        assert reply.text.startswith("vib.C8.one: its frequency is 4186 Hz, above half the rate")
    at.ok("route bell 1 2")
    at.ok("cup = bell transpose 3st")
    assert "above half the rate" in at.type("set cup.m.f 9kHz").text
    at.ok("set cup.m.f 200Hz")
    at.ok("route cup 2")


FOUND = "ergon: 1\nuse: instruments/found.yaml\nmix: {channels: 2}\n"


def test_build_with_name_of_used_file(tmp_path: Path):
    at = Stepped(FOUND, tmp_path)
    reply = at.type("bottle = found/bottle")
    assert reply.text.startswith("bottle exists: a file that the score uses has it")
    at.close()


@pytest.mark.parametrize(
    "line",
    [
        "d1 strikes bottle.hammer every 1/2 impulse 5mNs",
        "route bottle 1 2\nd1 strikes bottle.hammer every 1/2 impulse 5mNs",
    ],
)
def test_strikes_on_instrument_of_used_file(tmp_path: Path, line: str):
    at = Stepped(FOUND, tmp_path)
    at.ok("play")
    at.ok(line)
    at.run(6.0)
    assert min(level(at, channel, 1.0) for channel in (1, 2)) > 0
    at.close()
    assert np.array_equal(at.again(), at.sound)


def test_build_beside_notes_without_routes():
    text = (
        "ergon: 1\ninstruments:\n"
        "  vib: {CEL: {M: 50g, f: A3, t60: 1s}, notes: [A3, C4], out: {SOX: vib}}\n"
    )
    texts, piece = opened("s.yaml", text)
    _, after = opened("s.yaml", structure.build(texts, piece, "v2", "bell/bell", {}).text)
    assert {(route.part, route.to) for route in after.mix.routes} == {
        *(("vib.A3", (1,)), ("vib.C4", (1,)), ("v2", (1,)))
    }
