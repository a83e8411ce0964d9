"""Scenes: kept bars that come back on a bar, from their beginning, again and again."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from edited import SCORES, SPANS, begun, opened, piece_of
from sessions import Stepped
from sweep import few

from ergon.notation.text.edit import EditError
from ergon.scores.edits import automation, excerpt, matter, scenes
from ergon.scores.edits.scenes import Scene

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo:
  - {at: 1|1, bpm: 240}                    # a bar is a second
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}
  k2: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}
instruments:
  bell:
    modules:
      m: {CEL: {M: 20g, f: 220Hz, t60: 0.3s}}
      b: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
  drum:
    modules:
      m: {CEL: {M: 20g, f: 90Hz, t60: 0.2s}}
      b: {BUT: {between: [k2, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
gestures:
  knock: 0mm@0 smooth 6mm@60ms 0mm@160ms   # once
  lean: 0mm@0 smooth 3mm@1 smooth 0mm@2
players:
  ada: {key: k1}
  leo: {key: k2}
parts:
  ada: []
  leo: []
mix: {channels: 2, route: [{from: bell, to: [1]}, {from: drum, to: [2]}]}
"""


@pytest.fixture
def stepped_session(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    yield stepped
    stepped.close()


def to_bar(stepped_session: Stepped, bar: int) -> None:
    """Run until some moments after the beginning of a bar of one second."""
    stepped_session.run(bar - 1 + 0.25 - stepped_session.engine.frame / stepped_session.rate)
    assert stepped_session.session.state().bar == bar


def a_verse(stepped_session: Stepped) -> None:
    """Bars 3 and 4: ada knocks on each beat but the last, leo leans; kept in bar 5 as `verse`."""
    stepped_session.ok("play")
    to_bar(stepped_session, 2)
    stepped_session.ok("ada plays knock every 1 times 7\nleo plays lean every 2 until 5|1")
    to_bar(stepped_session, 5)
    assert "verse.yaml" in stepped_session.ok("keep 2bar as verse").text


def bar_sound(stepped_session: Stepped, bar: int, count: int = 1) -> np.ndarray:
    n = int(stepped_session.rate)
    return stepped_session.sound[(bar - 1) * n : (bar - 1 + count) * n]


def test_scene_restarts_at_bar_and_repeats(stepped_session: Stepped):
    a_verse(stepped_session)
    stepped_session.ok("leo plays knock every 1/2")
    to_bar(stepped_session, 8)
    reply = stepped_session.ok("scene verse")
    assert reply.text == "ok 9|1 verse, from its beginning, again and again"
    to_bar(stepped_session, 20)
    piece = stepped_session.session.schedule.running.version.piece
    for player, first, times in (("ada", range(7), None), ("leo", range(0, 8, 2), None)):
        result = [beat - 32.0 for beat, *_ in begun(piece, player) if 32.0 <= beat < 56.0]
        wanted = [float(beat + 8 * turn) for turn in range(3) for beat in first]
        assert result == pytest.approx(wanted), (player, times)
    # Each round sounds as the one before, but for what still rings from before the scene.
    rounds = [bar_sound(stepped_session, bar, 2) for bar in (13, 15, 17)]
    scale = np.abs(rounds[0]).max()
    assert scale > 0
    assert np.abs(rounds[1] - rounds[0]).max() < 0.05 * scale
    assert np.abs(rounds[2] - rounds[1]).max() < 0.01 * scale


def test_scene_restores_gestures_tempo_and_parameters(stepped_session: Stepped):
    stepped_session.ok("set bell.m.f 330Hz\ncouple k1 k2 K=20N/m")
    a_verse(stepped_session)
    stepped_session.ok("knock = 0@0 smooth 2@60ms smooth 0@160ms")
    stepped_session.ok("tempo 180")
    stepped_session.ok("set bell.m.K 2kN/m")
    stepped_session.ok("set drum.m.t60 0.5s")
    stepped_session.ok("uncouple k1 k2")
    stepped_session.run(2.0)
    stepped_session.ok("scene verse")
    stepped_session.run(2.0)
    version = stepped_session.session.schedule.running.version
    saved = opened(str(Path(version.texts.path).with_name("verse.yaml")))[1]
    assert version.piece.gestures["knock"].points == saved.gestures["knock"].points
    assert version.piece.tempo_map.bpm(1000.0) == 240.0
    for part in ("bell", "drum"):
        item = [[*matter.number_fields(one)] for one in version.piece.instruments[part].modules]
        assert item == [[*matter.number_fields(one)] for one in saved.instruments[part].modules]
    assert len([one for one in version.piece.duet if one.until is None]) == 1
    assert "# a bar is a second" in version.texts.text  # comments stay


def test_scene_change_glides_parameters(stepped_session: Stepped):
    a_verse(stepped_session)
    stepped_session.ok(
        "set bell.m.f 440Hz\nada plays lean every 4\nleo plays knock every 2\ntempo 120"
    )
    stepped_session.run(8.0)
    stepped_session.ok("keep 2bar as refrain")
    stepped_session.ok("scene verse now")
    stepped_session.run(4.0)
    bar = stepped_session.session.state().bar + 1
    reply = stepped_session.ok("scene verse -> refrain over 2bar")
    assert reply.text == f"ok {bar}|1 verse, then refrain, from its beginning, again and again"
    start = stepped_session.session.schedule.head.piece.tempo_map.bars.start(bar)
    stepped_session.run(0.5)
    piece = stepped_session.session.schedule.head.piece
    whats = {b - start: what for b, what, *_ in begun(piece, "ada") if start <= b < start + 24}
    assert whats == {
        **{float(beat): "knock" for beat in range(7)},
        **{float(beat): "lean" for beat in range(8, 24, 4)},
    }
    assert piece.tempo_map.bpm(start + 4) == pytest.approx(180.0, abs=20.0)
    assert piece.tempo_map.bpm(start + 9) == pytest.approx(120.0)
    stepped_session.run(1.5)
    (glide,) = stepped_session.session.schedule.running.glides
    assert (glide.part, glide.module) == ("bell", "m")
    ramp = piece.tempo_map.seconds(start + 8) - piece.tempo_map.seconds(start)
    assert glide.stop - glide.start == pytest.approx(ramp)


def test_journal_of_scenes_after_undo_and_resume(stepped_session: Stepped, tmp_path: Path):
    a_verse(stepped_session)
    stepped_session.ok("set bell.m.f 440Hz\nada plays lean every 4")
    stepped_session.run(3.0)
    stepped_session.ok("keep 2bar as refrain")
    stepped_session.ok("scene verse -> refrain over 2bar")
    stepped_session.run(5.0)
    stepped_session.ok("scene verse over 1bar")
    stepped_session.run(2.6)
    stepped_session.ok("undo")
    stepped_session.run(2.2)
    texts = stepped_session.session.schedule.head.texts
    (tmp_path / "verse.yaml").write_text("not a score")  # the journal needs no file
    stepped_session.session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)
    again = Stepped.resumed(stepped_session.journal)
    assert again.session.schedule.head.texts.text == texts.text
    again.ok("play")
    again.run(3.0)
    again.ok("redo")
    again.run(2.0)
    again.ok("save later")
    assert opened(str(tmp_path / "later.yaml"))
    again.ok("play from 3|1")
    again.run(2.0)
    again.close()
    assert np.array_equal(again.again(), again.sound)


def test_undo_of_scene_restores_text(stepped_session: Stepped):
    a_verse(stepped_session)
    before = stepped_session.session.schedule.head.texts.text
    stepped_session.ok("scene verse")
    assert stepped_session.session.schedule.head.texts.text != before
    stepped_session.run(2.0)
    stepped_session.ok("undo")
    stepped_session.run(2.0)
    assert stepped_session.session.schedule.head.texts.text == before


@pytest.mark.parametrize(
    ("line", "message", "try_"),
    [
        ("scene vers", "there is no scene vers beside the score", "scene verse"),
        ("scene nothing-like-it", "`keep 8bar as nothing-like-it` makes one", None),
        ("scene verse -> verse", "needs a length: scene A -> B over 4bar", None),
        ("scene ../verse", "is not the name of a scene", None),
        ("scene a -> b -> c over 1bar", "a scene goes to one other", None),
        ("scene broken", "broken.yaml: ", None),
    ],
)
def test_scene_refuses_missing_and_broken_files(
    stepped_session: Stepped, tmp_path: Path, line, message, try_
):
    a_verse(stepped_session)
    (tmp_path / "broken.yaml").write_text("ergon: 1\nkeys: nothing\n")
    text = stepped_session.session.schedule.head.texts.text
    reply = stepped_session.type(line)
    assert not reply.taken
    assert message in reply.text
    assert reply.try_ == try_
    assert stepped_session.session.schedule.head.texts.text == text


def test_scene_with_missing_player_is_refused(stepped_session: Stepped, tmp_path: Path):
    other = SCORE.replace("leo", "mia").replace("  mia: []", "  mia: [{at: 1|1, play: knock}]")
    (tmp_path / "other.yaml").write_text(other)
    assert "no player mia" in stepped_session.type("scene other").text


def test_names_of_scenes_and_files_are_completed(stepped_session: Stepped):
    a_verse(stepped_session)
    offered = {one.text for one in stepped_session.session.complete("scene ve", 8)}
    assert "verse" in offered
    assert "verse.yaml" in {one.text for one in stepped_session.session.complete("load ve", 7)}


@pytest.mark.parametrize(("path", "span"), SPANS)
def test_keep_as_scene_repeats_bars_of_any_score(path, span):
    start, stop = span
    texts, piece = opened(path)
    try:
        message = excerpt.excerpt_between(texts, piece, "verse-2", start, stop)
    except EditError:
        return
    saved = piece_of(message)
    scene = Scene.from_texts(message, saved)
    assert scene.beats == pytest.approx(stop - start)
    back = piece_of(scenes.play_scene(texts, piece, scene, 100.0, 100.0 + 2 * scene.beats))
    for player in piece.players:
        once = [(b, *rest) for b, *rest in begun(saved, player)]
        wanted = sorted((b + turn * scene.beats, *rest) for turn in (0, 1) for b, *rest in once)
        result = [(b - 100.0, *rest) for b, *rest in begun(back, player) if b >= 100.0 - 1e-9]
        result = [one for one in result if one[0] < 2 * scene.beats]
        assert [rest for _, *rest in result] == [rest for _, *rest in wanted]
        assert [b for b, *_ in result] == pytest.approx([b for b, *_ in wanted])


STRUCK = SCORE.replace(
    "gestures:",
    """strikes:
  rain: {to: [bell.m, drum.m], at: 1|1, until: 3|1, rate: 9Hz, impulse: 1uNs..4uNs}
  tick: {to: drum.m, at: 1|2, every: 2, times: 5, impulse: 2uNs}
  late: {to: drum.m, at: 2|2, until: 4|1, rate: 5Hz, impulse: 2uNs}
gestures:""",
)


@pytest.mark.parametrize("until", [None, 101.5, 102.5, 120.0])
def test_scene_repeats_strikes(until: float | None):
    texts, piece = opened("s.yaml", STRUCK + "marks: {end: 3|1}\n")
    scene = Scene.from_texts(texts, piece)
    assert scene.beats == 8.0
    back = piece_of(scenes.play_scene(texts, piece, scene, 100.0, until))
    tempo = back.tempo_map
    new = [
        (item.name, tempo.resolve(item.at), tempo.resolve(item.until), item.every is None)
        for item in back.strikes
        if tempo.resolve(item.at) >= 100.0 and item.until is not None
    ]
    end = until or 3992.0  # 999|1
    wanted = [
        ("rain-2", 100.0, end, True),
        *((f"tick-{2 + n}", 101.0 + 2 * n, end, False) for n in range(4)),
        ("late-2", 105.0, min(108.0, end), True),
    ]
    assert new == [item for item in wanted if item[1] < end]


# --- a score that is loaded ----------------------------------------------------------------------

SHORT = SCORE.replace("  ada: []", "  ada: [{at: 1|1, play: knock, every: 1, times: 16}]")


def test_load_of_shorter_score_restarts_at_bar_one(stepped_session: Stepped, tmp_path: Path):
    (tmp_path / "short.yaml").write_text(SHORT.replace("bpm: 240", "bpm: 120"))
    stepped_session.ok("play")
    to_bar(stepped_session, 9)
    reply = stepped_session.ok(f"load {tmp_path / 'short.yaml'}")
    assert reply.text == (
        "ok 10|1 short.yaml begins at 1|1, because the present bar is behind its end"
    )
    stepped_session.run(1.0)
    assert stepped_session.session.state().bar == 1
    stepped_session.run(2.0)
    assert np.abs(stepped_session.sound[-int(stepped_session.rate) :]).max() > 0
    stepped_session.session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)
    again = Stepped.resumed(stepped_session.journal)
    assert again.session.schedule.running.clock.stopped_beat == 4.0
    again.close()


def test_load_of_score_continues_at_same_beat(stepped_session: Stepped, tmp_path: Path):
    (tmp_path / "short.yaml").write_text(SHORT.replace("bpm: 240", "bpm: 120"))
    stepped_session.ok("play")
    to_bar(stepped_session, 2)
    assert stepped_session.ok(f"load {tmp_path / 'short.yaml'}").text == "ok 3|1"
    stepped_session.run(0.75 + 1.0)  # in the new tempo a bar takes two seconds
    state = stepped_session.session.state()
    assert (state.bar, state.beat) == (3, pytest.approx(3.0, abs=0.1))
    assert np.abs(stepped_session.sound[-int(0.5 * stepped_session.rate) :]).max() > 0
    stepped_session.session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


PATTERNS = [
    "ada plays knock ~ (knock lean) every 1/2",
    "ada plays choose knock lean every 1 chance 0.7",
    "ada plays walk knock lean ~ every 1/3\nleo plays shuffle lean knock euclid 3 8 rotate 1",
    "ada plays knock euclid 5 8",
    "ada plays knock lean every 1/2 swing 0.6 every 3rd do mirror, scale 0.5",
]


@pytest.mark.parametrize("line", few(PATTERNS, PATTERNS[::2]))
def test_scene_repeats_pattern_bars(stepped_session: Stepped, line: str):
    stepped_session.ok("play")
    to_bar(stepped_session, 2)
    stepped_session.ok(line)
    to_bar(stepped_session, 5)
    stepped_session.ok("keep 2bar as verse")
    saved = started(stepped_session, 8.0, 16.0)
    assert len(saved) > 3
    stepped_session.ok("scene verse")
    to_bar(stepped_session, 11)
    for round_ in range(3):
        again = started(stepped_session, 20.0 + 8.0 * round_, 28.0 + 8.0 * round_)
        assert again == [(who, what, (beat - 8.0) % 8.0 + 8.0) for who, what, beat in saved]
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def started(stepped_session: Stepped, since: float, until: float) -> list[tuple[str, str, float]]:
    """Who begins what between two beats, as beats from 8 on."""
    running = stepped_session.session.schedule.running
    result = {
        (g.player, g.name, round(running.beat(round(g.start * stepped_session.rate)), 2))
        for g in running.stage.gestures
    }
    return sorted((p, n, round(b - since + 8.0, 2)) for p, n, b in result if since <= b < until)


@pytest.mark.parametrize(
    "line",
    few(
        [
            "rain strikes bell.m euclid 5 8 impulse 1mNs",
            "rain strikes bell.m euclid 3 7 impulse 1mNs",  # lasts no whole number of rounds
            "rain strikes bell.m every 1/2 impulse 1mNs swing 0.6",
            "bell notes A3 (C4 E4) ~ every 1",
            "bell notes walk A3.minor every 1/2",
        ],
        2,
    ),
)
def test_scene_with_strikes_by_patterns(stepped_session: Stepped, line: str):
    """`scene` was an internal error, or its strikes had the scene's length as their step."""
    stepped_session.ok("play")
    to_bar(stepped_session, 2)
    stepped_session.ok(line)
    to_bar(stepped_session, 6)
    stepped_session.ok("keep 2bar as verse")
    stepped_session.ok("scene verse")
    to_bar(stepped_session, 13)
    first, second = bar_sound(stepped_session, 9, 2), bar_sound(stepped_session, 11, 2)
    assert np.abs(first).max() > 1e-5
    assert np.max(np.abs(first[-4000:] - second[-4000:])) < 0.02 * np.abs(first).max()
    saved = bar_sound(stepped_session, 4, 2)
    assert np.max(np.abs(saved[-4000:] - second[-4000:])) < 0.02 * np.abs(first).max()
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_scene_repeats_strikes_by_pattern_in_rounds():
    """Those with notes too: they are written out on the grid of their steps."""
    path = next(path for path in SCORES if path.endswith("patterns.yaml"))
    texts, piece = opened(path)
    saved = excerpt.excerpt_between(texts, piece, "verse-2", 0.0, 16.0)
    scene = Scene.from_texts(saved, piece_of(saved))

    def struck(source, name, first, last):
        result = []
        for item in (own for own in source.strikes if own.name.startswith(name)):
            steps = dataclasses.replace(
                item, pattern=dataclasses.replace(item.pattern, chance=None)
            ).place_beats(source)
            for place, beat in enumerate(steps):
                note = steps.places.played_name(place)
                if note is not None and first - 1e-9 <= beat < last - 1e-9:
                    result.append((beat - first, item.notes[note].value))
        return sorted(result)

    back = piece_of(scenes.play_scene(texts, piece, scene, 100.0, 132.0))
    for name in ("tune", "walk"):
        once = struck(scene.piece, name, 0.0, 16.0)
        assert once
        for begin in (100.0, 116.0):
            again = struck(back, f"{name}-", begin, begin + 16.0)
            assert [note for _, note in again] == [note for _, note in once]
            assert [stepped_session for stepped_session, _ in again] == pytest.approx(
                [stepped_session for stepped_session, _ in once]
            )


@pytest.mark.slow
def test_scene_ends_automation_typed_after_keep(stepped_session: Stepped):
    """An lfo, a pattern and a glide that began after the bars were kept went on for ever."""
    stepped_session.ok("lfo drum.m.K 0.5..2 period 2bar")
    a_verse(stepped_session)
    stepped_session.ok("lfo bell.m.K 0.8..1.2 period 1bar\nset drum.m.M 10g 20g every 1")
    stepped_session.ok("set bell.b.K 2kN/m over 8bar")
    to_bar(stepped_session, 8)
    reply = stepped_session.ok("scene verse")
    assert reply.text == (
        "ok 9|1 verse, from its beginning, again and again; "
        "bell.m.K, drum.m.M, bell.b.K have their own values again"
    )
    stepped_session.run(4.0)
    piece = stepped_session.session.schedule.running.version.piece
    running = [one for one in piece.automation if automation.is_automated_from(piece, one, 40.0)]
    assert [one.name for one in running] == ["drum.m.K"]
    assert running[0].swing is not None
    assert running[0].swing.phase == 0.0  # bar 3: a whole period has passed
    assert piece.tempo_map.resolve(running[0].at) == 32.0
    saved = opened(
        str(Path(stepped_session.session.schedule.head.texts.path).with_name("verse.yaml"))
    )[1]
    item = [[*matter.number_fields(one)] for one in piece.instruments["bell"].modules]
    assert item == [[*matter.number_fields(one)] for one in saved.instruments["bell"].modules]
    stepped_session.ok("undo")
    stepped_session.run(1.3)
    back = stepped_session.session.schedule.running.version.piece
    ended = {one.name for one in back.automation if automation.is_automated_from(back, one, 60.0)}
    assert ended == {"drum.m.K", "bell.m.K", "drum.m.M", "bell.b.K"}
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_scene_automation_begins_and_ends_with_scene(
    stepped_session: Stepped,
):
    stepped_session.ok("play")
    to_bar(stepped_session, 2)
    stepped_session.ok("ada plays knock every 1")
    stepped_session.ok("set bell.m.f 220Hz 330Hz 440Hz every 1")
    to_bar(stepped_session, 5)
    stepped_session.ok("keep 2bar as verse")
    stepped_session.ok("leo plays knock every 1\nset bell.m.f 200Hz")
    stepped_session.run(2.0)
    stepped_session.ok("keep 1bar as refrain")
    reply = stepped_session.ok("scene verse -> refrain over 2bar")
    assert reply.text.endswith("verse, then refrain, from its beginning, again and again")
    piece = stepped_session.session.schedule.head.piece
    result = [one for one in piece.automation if one.pattern is not None]
    begin, stop = (piece.tempo_map.resolve(when) for when in (result[-1].at, result[-1].until))
    assert stop - begin == 8.0
    stepped_session.run(5.0)
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_scene_without_automation_after_next_scene(stepped_session: Stepped):
    """It was refused: "`until` must be later than `at`"."""
    stepped_session.ok("play")
    to_bar(stepped_session, 2)
    stepped_session.ok("ada plays knock every 1")
    to_bar(stepped_session, 5)
    stepped_session.ok("lfo bell.m.K 0.8..1.2 period 1bar")  # from bar 6 on: bar 3 of what is kept
    to_bar(stepped_session, 8)
    stepped_session.ok("keep 4bar as verse")
    stepped_session.ok("lfo bell.m.K off")
    stepped_session.ok("leo plays knock every 1")
    stepped_session.run(2.0)
    stepped_session.ok("keep 1bar as refrain")
    stepped_session.ok("scene verse -> refrain over 2bar")
    stepped_session.run(5.0)
    piece = stepped_session.session.schedule.head.piece
    begun = [piece.tempo_map.resolve(one.at) for one in piece.automation]
    assert max(begun) < 36.0  # the lfo that was typed, and none of the scene
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)
