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
def stepped_session(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    stepped.ok("play")
    yield stepped
    stepped.close()


def same_again(stepped_session: Stepped) -> None:
    """Undone to the beginning, saved and resumed; the journal is the sound."""
    text = stepped_session.session.schedule.head.texts.text
    stepped_session.ok("save typed")
    stepped_session.run(0.3)
    assert opened(str(stepped_session.journal.with_name("typed.yaml")))
    stepped_session.session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)
    again = Stepped.resumed(stepped_session.journal)
    assert again.session.schedule.head.texts.text == text
    again.ok("play from 2|1")
    again.run(1.5)
    count = len(again.session.history.numbers) - 1
    again.ok(f"back {count}")
    again.run(1.0)
    assert again.session.schedule.head.texts.text == SCORE
    again.close()
    assert np.array_equal(again.again(), again.sound)


def level(stepped_session: Stepped, channel: int, seconds: float) -> float:
    return float(
        np.abs(stepped_session.sound[-int(seconds * stepped_session.rate) :, channel - 1]).max()
    )


def test_build_link_route_and_play_new_instrument(stepped_session: Stepped):
    stepped_session.run(1.2)
    stepped_session.ok("bell2 = bell/bell transpose 7st")
    stepped_session.ok("mia takes k3 like k1\nlink k3 bell2.hammer BUT K=4kN/m Z=2Ns/m")
    stepped_session.ok("route bell2 3 4 gain 60dB")
    stepped_session.ok("mia plays knock every 1/2")
    stepped_session.run(4.0)
    version = stepped_session.session.schedule.running.version
    bell2 = {module.name: module.fields for module in version.piece.instruments["bell2"].modules}
    ratio = 2.0 ** (7.0 / 12.0)
    assert bell2["prime"]["f"] == 440.0 * ratio  # E5, to the last bit
    assert bell2["prime"]["t60"] == pytest.approx(6.0 / ratio, rel=1e-15)
    assert bell2["hammer"]["f"] == 1.0  # mechanics stay
    assert [module.name for module in version.piece.instruments["links"].modules] == ["but-1"]
    assert version.piece.players["mia"].key == "k3"
    for comment in ("# a bar is a second", "# rings", "# once", "# a table"):
        assert comment in version.texts.text
    assert level(stepped_session, 1, 1.0) > 0
    assert level(stepped_session, 3, 1.0) > 0
    assert level(stepped_session, 2, 4.0) == 0
    same_again(stepped_session)


@pytest.mark.parametrize(("base", "struck"), [("bell", "b2.m"), ("skins/timpani", "b2.hammer")])
def test_build_routes_to_all_channels(stepped_session: Stepped, base: str, struck: str):
    stepped_session.ok(f"b2 = {base}")
    stepped_session.ok(f"d1 strikes {struck} every 1/2 impulse 50mNs")
    stepped_session.run(2.0)
    assert min(level(stepped_session, channel, 1.0) for channel in (2, 3, 4)) > 0
    same_again(stepped_session)


def test_build_with_transpose_scales_sounding_modules(stepped_session: Stepped):
    stepped_session.ok("deep = bell transpose -12st")
    piece = stepped_session.session.schedule.head.piece
    item = {module.name: module.fields for module in piece.instruments["deep"].modules}
    assert item["m"]["f"] == pytest.approx(110.0)
    assert item["low"]["K"] == pytest.approx(1250.0)
    assert item["slow"]["f"] == 2.0
    assert piece.instruments["bell"].modules[0].fields["f"] == 220.0


def test_build_with_transpose_by_cents_and_ratios(stepped_session: Stepped):
    stepped_session.ok("low = bell transpose -14cents")
    stepped_session.ok("fifth = bell transpose x1.5")
    piece = stepped_session.session.schedule.head.piece
    assert piece.instruments["low"].modules[0].fields["f"] == pytest.approx(
        220.0 * 2.0 ** (-14.0 / 1200.0), rel=1e-15
    )
    assert piece.instruments["fifth"].modules[0].fields["f"] == 330.0
    assert "transpose: x1.5" in stepped_session.session.schedule.head.texts.text


def test_build_generator_with_fields_and_transpose(stepped_session: Stepped):
    stepped_session.ok("gong2 = gong/plate f=C2 t60=3s transpose 12st")
    (module,) = stepped_session.session.schedule.head.piece.instruments["gong2"].modules
    assert module.fields["f"] == pytest.approx(2 * 65.406, rel=1e-3)
    assert module.fields["t60"] == 3.0


def test_link_during_play_starts_without_jump(stepped_session: Stepped):
    stepped_session.ok("ada plays knock every 1")
    stepped_session.run(2.0)
    stepped_session.ok("link bell.m bell.low REF K=2kN/m now")
    stepped_session.run(0.3)
    (glide,) = stepped_session.session.schedule.running.glides
    assert (glide.part, glide.module, glide.initial_values) == ("links", "ref-1", (0.0,))
    stepped_session.run(1.0)
    bends = np.abs(np.diff(stepped_session.sound[:, 0], 3))
    n = int(stepped_session.rate)
    before, within = bends[: 2 * n].max(), bends[2 * n : int(2.4 * n)].max()
    assert within < 1.5 * before
    same_again(stepped_session)


def test_remove_built_instruments_links_and_keys(stepped_session: Stepped):
    stepped_session.ok(
        "couple k1 k2 K=20N/m\nb2 = bell\nroute b2 2\nlink k2 b2.m BUT K=500N/m gap=1mm"
    )
    stepped_session.run(2.0)
    assert "links" in stepped_session.session.schedule.head.piece.instruments
    stepped_session.ok("remove links.but-1")
    assert "links" not in stepped_session.session.schedule.head.piece.instruments
    stepped_session.ok("remove b2")
    assert [route.part for route in stepped_session.session.schedule.head.piece.mix.routes] == [
        "bell"
    ]
    stepped_session.ok("remove leo\nremove k2")
    piece = stepped_session.session.schedule.head.piece
    assert [*piece.players] == ["ada"]
    assert [*piece.keys] == ["k1"]
    assert piece.duet == ()
    stepped_session.run(2.0)
    assert level(stepped_session, 1, 1.0) > 0
    same_again(stepped_session)


def test_rename_gesture_and_player_in_parts(stepped_session: Stepped):
    stepped_session.run(1.1)
    stepped_session.ok("rename knock tap2")
    piece = stepped_session.session.schedule.head.piece
    assert [*piece.gestures] == ["tap2", "lean"]
    assert {play.played_text for play in piece.parts} == {"tap2", "lean"}
    stepped_session.ok("rename leo eva")
    piece = stepped_session.session.schedule.head.piece
    assert [*piece.players] == ["ada", "eva"]
    assert [play.played_text for play in piece.parts if play.player == "eva"] == ["tap2", "lean"]
    text = stepped_session.session.schedule.head.texts.text
    assert text.replace("tap2", "knock").replace("eva:", "leo:") == SCORE
    stepped_session.run(2.0)
    same_again(stepped_session)


def test_rename_gesture_in_patterns(stepped_session: Stepped):
    stepped_session.ok("ada plays knock (lean knock) ~ every 1")
    stepped_session.ok("leo plays choose knock lean every 1 chance 0.5")
    stepped_session.run(1.0)
    stepped_session.ok("rename knock tap2")
    text = stepped_session.session.schedule.head.texts.text
    assert "tap2 (lean tap2) ~" in text
    assert "choose tap2 lean" in text
    assert "knock" not in text.partition("gestures:")[2]
    stepped_session.run(1.0)


def test_takes_with_existing_and_new_key(stepped_session: Stepped):
    stepped_session.ok("leo takes k1")
    assert stepped_session.session.schedule.head.piece.players["leo"].key == "k1"
    stepped_session.run(1.5)
    stepped_session.ok("leo takes k9")
    assert stepped_session.session.schedule.head.piece.keys["k9"].travel == (-0.015, 0.015)


def test_first_route_keeps_implicit_routes():
    text = SCORE[: SCORE.index("mix:")] + "mix: {channels: 4}\n"
    texts, piece = opened("s.yaml", text)
    built = structure.add_instrument(texts, piece, "b2", "bell", {})
    built = structure.route_instrument(built, opened("s.yaml", built.text)[1], "b2", ["3"], None)
    _, after = opened("s.yaml", built.text)
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
def test_wrong_structure_lines_change_no_version(stepped_session: Stepped, line: str, message: str):
    reply = stepped_session.type(line)
    assert not reply.taken, reply.text
    assert message in reply.text
    assert stepped_session.session.schedule.head.texts.text == SCORE


def test_build_from_a_bundled_instrument_edits_no_bundled_text():
    texts, piece = opened(DUET)
    built = structure.add_instrument(texts, piece, "gong2", "gong", {})
    assert built.overlay == texts.overlay


STRUCK = """
strikes:
  tick: {to: bell.m, at: 1|1, every: 1, times: 9, impulse: 1e-4Ns}
  tab: |
    1|1 bell.m 1e-4Ns
"""


def test_remove_of_referenced_module_names_references(tmp_path: Path) -> None:
    with closing(Stepped(SCORE + STRUCK, tmp_path)) as player_session:
        player_session.ok("play")
        reply = player_session.type("remove bell.m now")
        assert not reply.taken
        assert reply.text.startswith("cannot remove bell.m, because it is used by ")
        for name in ("strikes 'tick'", "strikes 'tab'"):
            assert name in reply.text
        assert reply.try_ == "remove tick"
        player_session.ok("remove tick\nremove tab")
        player_session.run(3.0)
        assert player_session.session.schedule.head.piece.strikes == ()
    assert np.array_equal(player_session.again(), player_session.sound)


def test_build_with_pitch_above_half_rate_is_refused(stepped_session: Stepped) -> None:
    """It was taken, and the next line was refused for it."""
    bell = "hand = bells/handbell notes=C9"  # all its modes: none can be left out
    for line in (bell, f"{bell}\nroute hand 1 2"):
        reply = stepped_session.type(line)
        assert not reply.taken
        assert reply.text.startswith("hand.C9.low: its frequency is 8372 Hz, above half the rate")
    stepped_session.ok("route bell 1 2")
    stepped_session.ok("cup = bell transpose 3st")
    assert "above half the rate" in stepped_session.type("set cup.m.f 9kHz").text
    stepped_session.ok("set cup.m.f 200Hz")
    stepped_session.ok("route cup 2")


USING_SCORE = "ergon: 1\nuse: instruments/found.yaml\nmix: {channels: 2}\n"


def test_build_with_name_of_used_file(tmp_path: Path):
    stepped_session = Stepped(USING_SCORE, tmp_path)
    reply = stepped_session.type("bottle = found/bottle")
    assert reply.text.startswith("bottle exists: a file that the score uses has it")
    stepped_session.close()


@pytest.mark.parametrize(
    "line",
    [
        "d1 strikes bottle.hammer every 1/2 impulse 5mNs",
        "route bottle 1 2\nd1 strikes bottle.hammer every 1/2 impulse 5mNs",
    ],
)
def test_strikes_on_instrument_of_used_file(tmp_path: Path, line: str):
    stepped_session = Stepped(USING_SCORE, tmp_path)
    stepped_session.ok("play")
    stepped_session.ok(line)
    stepped_session.run(6.0)
    assert min(level(stepped_session, channel, 1.0) for channel in (1, 2)) > 0
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_build_beside_notes_without_routes():
    text = (
        "ergon: 1\ninstruments:\n"
        "  vib: {CEL: {M: 50g, f: A3, t60: 1s}, notes: [A3, C4], out: {SOX: vib}}\n"
    )
    texts, piece = opened("s.yaml", text)
    _, after = opened("s.yaml", structure.add_instrument(texts, piece, "v2", "bell/bell", {}).text)
    assert {(route.part, route.to) for route in after.mix.routes} == {
        *(("vib.A3", (1,)), ("vib.C4", (1,)), ("v2", (1,)))
    }
