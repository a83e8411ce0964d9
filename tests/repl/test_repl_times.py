"""Edits of tempo, names and couplings."""

from pathlib import Path

import pytest
from edited import DUET, PIECES, SCORES, TEMPO, TWO, lines, opened, piece_of
from sweep import crossed

from ergon.notation.text.edit import EditError
from ergon.scores.edits import keys, names, times
from ergon.scores.edits.texts import Texts


@pytest.mark.parametrize(
    ("path", "beat", "tempo"),
    crossed(SCORES, [0.0, 3.0, 12.0, 22.0, 60.0], [("72", None), ("60 -> 96", "8")]),
)
def test_tempo_change_from_its_beat(path, beat, tempo):
    bpm, over = tempo
    texts, piece = opened(path)
    after = piece_of(times.change_tempo(texts, piece, beat, bpm, over)).tempo_map
    for k in range(20):
        beats = beat * k / 20
        assert after.seconds(beats) == pytest.approx(piece.tempo_map.seconds(beats), abs=1e-9)
        assert after.bar_beat(beat + k) == piece.tempo_map.bar_beat(beat + k)
    assert after.bpm(beat) == float(bpm.split()[0])
    assert after.bpm(beat + 1000) == float(bpm.split()[-1])


def test_tempo_change_cuts_ramp_under_way():
    texts, piece = opened(DUET)
    after = times.change_tempo(texts, piece, 36.0, "72")
    assert lines(texts, after)[1] == [
        "- {at: 9|1, bpm: 60 -> 69, over: 4}   # accelerando",
        "- {at: 10|1, bpm: 72}",
    ]


@pytest.mark.parametrize(
    "tempo",
    [
        "tempo: {at: 1|1, bpm: 60}\n",
        "tempo: {at: 3|1, meter: 3/4}\n",
        "tempo:\n  at: 3|1\n  bpm: 60\n",
        "tempo: []\n",
        "",
    ],
)
def test_tempo_change_beside_single_entry(tempo):
    head, tail = Path(TWO).read_text().split("tempo:\n")
    texts, piece = opened(TWO, head + tempo + tail[tail.index("marks:") :])
    after = piece_of(times.change_tempo(texts, piece, 4.0, "90"))
    assert after.tempo_map.bpm(4.0) == 90.0
    assert after.tempo_map.bar_beat(20.0) == piece.tempo_map.bar_beat(20.0)


@pytest.mark.parametrize(
    "tempo",
    [
        "tempo: {at: 1|1, bpm: 60}\n",
        "tempo: {at: 3|1, bpm: 60, meter: 7/8}\n",
        "tempo: [{at: 2|1, bpm: 60}, {at: 9|1, meter: 5/4}, {at: 11|1, bpm: 90, meter: 4/4}]\n",
        "tempo: []\n",
        "",
    ],
)
def test_change_meter_on_bar_line(tempo):
    head, tail = Path(TWO).read_text().split("tempo:\n")
    texts, piece = opened(TWO, head + tempo + tail[tail.index("marks:") :])
    after = piece_of(times.change_meter(texts, piece, 4.0, "3/4")).tempo_map
    assert [after.bar_beat(float(beat)) for beat in (3, 4, 6, 7, 40)] == [
        *((1, 4.0), (2, 1.0), (2, 3.0), (3, 1.0), (14, 1.0))
    ]


def test_change_meter_within_bar():
    texts, piece = opened(DUET)
    with pytest.raises(EditError, match=r"a meter begins with a bar"):
        times.change_meter(texts, piece, 37.0, "3/4")


def test_mark_resolves_to_its_beat():
    texts, piece = opened(DUET)
    after = piece_of(times.set_mark(texts, piece, "verse-2", 13.25))
    assert {m.name: after.tempo_map.resolve(m.at) for m in after.marks}["verse-2"] == 13.25


@pytest.mark.parametrize("name", ["knock", "roll", "lean", "soft", "new"])
def test_defined_gesture_has_its_written_points(name):
    texts, piece = opened(DUET)
    after = names.define(texts, name, "0@0 smooth 7@1/8 0@1/4")
    result = piece_of(after).gestures[name]
    assert [point.x for point in result.points] == [0.0, 0.007, 0.0]
    if name in piece.gestures:
        assert result.do == piece.gestures[name].do
        assert result.options == piece.gestures[name].options


def test_define_edits_gesture_in_its_file():
    texts, _ = opened(TEMPO)
    after = names.define(texts, "tap", "0@0 smooth 7@1/8 0@1/4")
    file = str(PIECES / "gestures" / "common.yaml")
    assert after.text == texts.text
    assert lines(texts, after, file)[1] == [
        "tap: 0@0 smooth 7@1/8 0@1/4     # throws a hammer over a gap of 7 mm"
    ]
    assert piece_of(after).gestures["tap"].points[1].x == 0.007
    prefixed = texts.text.replace(", gestures/common.yaml]", "]").replace(
        "use: [instruments/string.yaml]",
        "use: {s: instruments/string.yaml, c: gestures/common.yaml}",
    )
    texts = Texts(TEMPO, prefixed.replace("tap,", "c.tap,").replace(" tap", " c.tap"))
    after = names.define(texts, "c.tap", "0@0 smooth 7@1/8 0@1/4")
    assert list(after.overlay) == [file]


def test_take_and_seed_edits():
    texts, _ = opened(DUET)
    after = piece_of(
        names.set_seed(names.define_take(texts, "solo", "takes/hand-draw-1.csv", "x"), 7)
    )
    assert (after.takes["solo"].channel, after.seed) == ("x", 7)


def acting(piece, beat):
    result = []
    for c in piece.duet:
        until = piece.tempo_map.resolve(c.until) if c.until else float("inf")
        if piece.tempo_map.resolve(c.at) <= beat < until:
            result.append(c.link.fields["K"])
    return result


@pytest.mark.parametrize("coupling_beat", [8.0, 32.0, 40.0])
def test_couple_replaces_earlier_coupling(coupling_beat):
    texts, piece = opened(DUET)
    after = keys.couple(texts, piece, coupling_beat, "k2", "k1", "90N/m", "1Ns/m")
    new = piece_of(after)
    for beat in (0.0, 7.0, 31.0, 39.0, 41.0, 100.0):
        assert acting(new, beat) == ([90.0] if beat >= coupling_beat else acting(piece, beat))
    assert "duet:                                      # the two keys" in after.text
    free = piece_of(keys.uncouple(after, new, coupling_beat + 8, "k1", "k2"))
    assert acting(free, coupling_beat + 9) == []
    assert acting(free, coupling_beat + 7) == [90.0]


def test_uncoupling_uncoupled_keys_is_refused():
    texts, piece = opened(DUET)
    texts = keys.uncouple(texts, piece, 8.0, "k1", "k2")
    with pytest.raises(EditError, match="not coupled"):
        keys.uncouple(texts, piece_of(texts), 8.0, "k1", "k2")
