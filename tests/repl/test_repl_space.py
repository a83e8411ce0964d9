"""Where instruments sound, typed: places between channels, rooms, fades."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from edited import opened
from sessions import Stepped
from sweep import few

from ergon.scores.edits import space

SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 240}]               # a bar is a second
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}
instruments:
  bell:
    modules:
      m: {CEL: {M: 20g, f: 220Hz, t60: 0.6s}}
      b: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
  drone:
    modules:
      m: {CEL: {M: 20g, K: 85kN/m, X0: 1mm}}
    out: {SOX: m}
gestures:
  knock: 0mm@0 smooth 6mm@60ms 0mm@160ms
players:
  ada: {key: k1}
parts:
  ada: [{at: 1|1, play: knock, every: 1, until: 99|1}]
mix: {channels: 2, route: [{from: bell, to: [1, 2]}, {from: drone, to: [1, 2]}]}
"""


@pytest.fixture
def stepped_session(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    stepped.ok("play")
    yield stepped
    stepped.close()


def level(stepped_session: Stepped, seconds: float) -> list[float]:
    """The level of each channel over the last seconds."""
    return [
        float(x)
        for x in np.sqrt(
            np.mean(stepped_session.sound[-int(seconds * stepped_session.rate) :] ** 2, axis=0)
        )
    ]


def same_again(stepped_session: Stepped) -> None:
    """Saved, undone and computed anew, it is what was heard."""
    text = stepped_session.session.schedule.head.texts.text
    stepped_session.ok("save typed")
    stepped_session.run(0.3)
    assert opened(str(stepped_session.journal.with_name("typed.yaml")))
    stepped_session.ok(f"back {len(stepped_session.session.history.numbers) - 1}")
    stepped_session.run(1.1)
    assert stepped_session.session.schedule.head.texts.text == SCORE
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)
    assert text != SCORE


def test_route_pan_and_gain_of_instrument(stepped_session: Stepped):
    stepped_session.ok("mute bell now")
    stepped_session.ok("route drone pan -0.6 now")
    stepped_session.run(1.0)
    left, right = level(stepped_session, 0.5)
    assert right / left == pytest.approx(0.5, rel=1e-3)  # (1 - 0.6) / (1 + 0.6), by the power
    stepped_session.ok("route drone gain -6dB now")
    stepped_session.run(1.0)
    assert level(stepped_session, 0.5)[0] / left == pytest.approx(10 ** (-6 / 20), rel=0.01)
    (route,) = (
        r for r in stepped_session.session.schedule.head.piece.mix.routes if r.part == "drone"
    )
    assert route.to == (1, 2)
    assert route.pan == pytest.approx((0.8**0.5, 0.2**0.5))
    same_again(stepped_session)


def test_pan_over_length_from_current_position(stepped_session: Stepped):
    stepped_session.ok("mute bell now")
    stepped_session.ok("pan drone -1 now")
    stepped_session.run(0.5)
    stepped_session.ok("pan drone 1 over 2bar")
    stepped_session.run(1.0)
    stepped_session.run(2.0)
    piece = stepped_session.session.schedule.head.piece
    path = piece.mix.routes[1].pan_path
    begin, end = (
        stepped_session.rate * piece.tempo_map.seconds(piece.tempo_map.resolve(p.at)) for p in path
    )
    assert [point.pan for point in path] == [-1.0, 1.0]
    assert end - begin == pytest.approx(2.0 * stepped_session.rate)
    frames = np.arange(int(begin) + 4096, int(end))
    listened = np.abs(stepped_session.sound[frames])
    power = np.hypot(*listened.T)
    loud = power > 1e-2 * power.max()
    angles = np.arctan2(listened[loud, 1], listened[loud, 0])
    slope, first = np.polyfit(frames[loud] - begin, angles, 1)
    assert slope == pytest.approx(np.pi / 2 / (end - begin), rel=1e-6)
    assert np.abs(slope * (frames[loud] - begin) + first - angles).max() < 1e-6
    assert abs(first / slope) < 0.03 * stepped_session.rate, (
        "the clock of the sound began that much later"
    )
    stepped_session.ok("pan drone 0 over 1bar now")
    stepped_session.run(0.2)
    same_again(stepped_session)


def test_filter_and_delay_typed_changed_and_removed(stepped_session: Stepped):
    stepped_session.ok("mute bell now")
    stepped_session.run(0.5)
    plain = level(stepped_session, 0.3)[0]
    smooth = np.abs(np.diff(stepped_session.sound[int(0.2 * stepped_session.rate) :, 0], 3)).max()
    stepped_session.ok("filter drone lowpass 100Hz now")
    stepped_session.run(0.7)
    route = stepped_session.session.schedule.head.piece.mix.routes[1]
    assert [(tone.kind, tone.frequency) for tone in route.tones] == [("lowpass", 100.0)]
    f = np.sqrt(85e3 / 0.02) / 2 / np.pi
    w = [np.tan(np.pi * x / stepped_session.rate) for x in (f, 100.0)]
    assert level(stepped_session, 0.3)[0] / plain == pytest.approx(
        1 / np.hypot(1, (w[0] / w[1]) ** 2), rel=0.01
    )
    stepped_session.ok("filter drone lowpass off now")
    stepped_session.ok("filter drone highshelf 50Hz -12dB now")
    stepped_session.run(0.7)
    assert level(stepped_session, 0.3)[0] / plain == pytest.approx(10 ** (-12 / 20), rel=0.02)
    stepped_session.ok("filter drone highshelf off now")
    stepped_session.ok("filter drone delay 250ms -6dB now")
    stepped_session.run(1.0)
    route = stepped_session.session.schedule.head.piece.mix.routes[1]
    assert not route.tones
    assert (route.echo.time, route.echo.feedback) == (0.25, pytest.approx(10 ** (-6 / 20)))
    stepped_session.ok("filter drone delay off now")
    stepped_session.run(0.5)
    steps = np.abs(np.diff(stepped_session.sound[int(0.6 * stepped_session.rate) :, 0], 3))
    assert steps.max() < 5.0 * smooth, "nothing clicks"
    reply = stepped_session.type("filter drone lowpass off")
    assert not reply.taken
    assert "no route of drone has a lowpass" in reply.text
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_room_added_sent_to_and_changed(stepped_session: Stepped):
    stepped_session.ok("room hall t60=1s size=8m gain=-3dB")
    stepped_session.ok("route bell send hall -6dB")
    stepped_session.run(3.0)
    piece = stepped_session.session.schedule.head.piece
    assert [(room.name, room.size, room.t60[0][1]) for room in piece.mix.rooms] == [
        ("hall", 8.0, 1.0)
    ]
    assert [route.sends for route in piece.mix.routes] == [
        (("hall", pytest.approx(10 ** (-6 / 20))),),
        (),
    ]
    stepped_session.ok("room hall t60=2s")
    stepped_session.run(1.5)
    assert stepped_session.session.schedule.running.version.piece.mix.rooms[0].t60[0][1] == 2.0
    same_again(stepped_session)


def test_fade_out_and_in_of_instrument(stepped_session: Stepped):
    stepped_session.ok("mute bell now")
    stepped_session.run(0.5)
    before = level(stepped_session, 0.3)[0]
    stepped_session.ok("fade drone out over 2bar")
    stepped_session.run(1.6)
    half = level(stepped_session, 0.1)[0]
    assert 0.4 * before < half < 0.65 * before
    stepped_session.run(1.2)
    assert level(stepped_session, 0.1)[0] == 0.0
    stepped_session.ok("fade drone in over 1bar")
    stepped_session.run(2.3)
    assert level(stepped_session, 0.2)[0] == pytest.approx(before, rel=0.02)
    bends = np.abs(np.diff(stepped_session.sound[int(0.2 * stepped_session.rate) :, 0], 3))
    assert bends.max() < 1.2 * bends[: int(0.2 * stepped_session.rate)].max()  # nothing clicks
    same_again(stepped_session)


def test_fade_in_during_fade_out(stepped_session: Stepped):
    stepped_session.ok("mute bell now")
    stepped_session.ok("fade drone out over 2bar now")
    stepped_session.run(1.0)
    stepped_session.ok("fade drone in over 1bar now")
    stepped_session.run(0.1)
    piece = stepped_session.session.schedule.running.version.piece
    (route,) = (r for r in piece.mix.routes if r.part == "drone")
    assert 0.3 < route.fade[0].gain < 0.7
    bends = np.abs(np.diff(stepped_session.sound[int(0.2 * stepped_session.rate) :, 0], 3))
    assert bends.max() < 1.2 * bends[: int(0.1 * stepped_session.rate)].max()
    stepped_session.run(1.5)
    same_again(stepped_session)


def test_fade_end_after_tempo_change(stepped_session: Stepped):
    stepped_session.ok("mute bell now")
    stepped_session.ok("fade drone out over 4bar now")
    stepped_session.run(0.5)
    stepped_session.ok("tempo 480 now")
    stepped_session.run(1.9)
    assert level(stepped_session, 0.05)[0] == 0.0
    same_again(stepped_session)


def test_fade_master_out_and_keep(stepped_session: Stepped):
    stepped_session.ok("fade master out over 4bar")
    stepped_session.run(3.3)
    stepped_session.ok("keep 2bar as verse")
    text, piece = opened(str(stepped_session.journal.with_name("verse.yaml")))
    assert "master" in text.text
    assert piece.mix.master is not None
    player_session = stepped_session.session.schedule.head.piece
    assert player_session.mix.master is not None
    start = player_session.tempo_map.bars.start(2)
    for beat in (0.0, 3.0, 7.0):
        there = space.fade_level(
            player_session.mix.master.fade, player_session.tempo_map, start + beat
        )
        assert space.fade_level(piece.mix.master.fade, piece.tempo_map, beat) == pytest.approx(
            there
        )
    stepped_session.run(2.0)
    assert level(stepped_session, 0.1) == [0.0, 0.0]
    same_again(stepped_session)


@pytest.mark.parametrize("name", ["master", "drone"])
def test_play_from_after_and_within_fade(stepped_session: Stepped, name: str):
    stepped_session.ok("mute bell now")
    stepped_session.ok(f"fade {name} out over 2bar")
    stepped_session.run(0.5)
    stepped_session.ok("play from 9|1")  # the fade began before the frames of the session
    stepped_session.run(0.5)
    assert level(stepped_session, 0.1)[0] == 0.0
    stepped_session.ok("play from 2|3")
    stepped_session.run(0.3)
    assert level(stepped_session, 0.1)[0] > 0.0
    same_again(stepped_session)


@pytest.mark.parametrize("name", few(["master", "drone"], 1))
@pytest.mark.parametrize("method", ["out", "in"])
def test_undo_and_redo_of_fade_without_jump(stepped_session: Stepped, name: str, method: str):
    stepped_session.ok("mute bell now")
    stepped_session.run(0.3)
    plain = np.abs(np.diff(stepped_session.sound[int(0.2 * stepped_session.rate) :, 0], 3)).max()
    if method == "in":
        stepped_session.ok(f"fade {name} out over 1bar now")
        stepped_session.run(1.3)
    stepped_session.ok(f"fade {name} {method} over 1bar now")
    stepped_session.run(1.3)
    stepped_session.ok("undo now")
    stepped_session.run(0.3)
    assert (level(stepped_session, 0.2)[0] > 0.0) == (method == "out")
    stepped_session.ok("redo now")  # to a fade that begins again
    stepped_session.run(0.5)
    bends = np.abs(np.diff(stepped_session.sound[int(0.2 * stepped_session.rate) :, 0], 3))
    assert bends.max() < 1.2 * plain
    same_again(stepped_session)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("route bell", "channels, such as 3 or 3 4 is missing"),
        ("route bell pan 2", "2"),
        ("route bell 1 pan 0.3", "`pan` lies between two channels"),
        ("route bell send hall -6dB", "is not a room"),
        ("room hall size=12kg", "'kg'"),
        ("room hall t61=2s", "a room has no field 't61'"),
        ("fade bell over 2bar", "neither in nor out"),
        ("fade bell out", "over"),
        ("fade nobody out over 2bar", "is not an instrument or master"),
    ],
)
def test_wrong_route_lines_are_refused(stepped_session: Stepped, line: str, message: str):
    reply = stepped_session.type(line)
    assert not reply.taken, reply.text
    assert message in reply.text
    assert stepped_session.session.schedule.head.texts.text == SCORE
