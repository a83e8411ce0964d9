"""What is found once a piece is on its stage: cuts, travel, what the engine will not run."""

from pathlib import Path

import numpy as np
import pytest

from ergon import _core
from ergon.notation.text.errors import Diagnostic
from ergon.scores.gesture.takes import read
from ergon.scores.reading.load import load
from ergon.scores.staging.hands import ALL_TIME
from ergon.scores.staging.preparing import Span
from ergon.scores.staging.recording_stages import solo
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import Stage, StageTakeover, stage

TAKES = Path(__file__).parents[2] / "scores/library/takes"
PLAYED = """\
ergon: 1
tempo: [{{at: 1|1, bpm: 120}}]
marks: {{A: 1|1}}
keys: {{k: {{M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}}}
players: {{p: {{key: k}}, q: {{hand: live, key: k, standin: t}}}}
gestures: {{g: 0@0 1@2, wide: 0@0 throw 12@1/4 throw 0@3/4}}
takes: {{t: {{file: {takes}/hand-point-1.csv}}}}
parts: {{p: [{plays}]}}
"""


def staged(plays: str) -> Stage:
    loaded = load("s.yaml", text=PLAYED.format(plays=plays, takes=TAKES))
    assert loaded.piece is not None, loaded.diagnostics
    return stage(loaded.piece)


def warned(plays: str) -> list[Diagnostic]:
    # The live hand's stand-in sounds from the beginning for 5 s: begin after it.
    return staged(plays).diagnostics


@pytest.mark.parametrize(
    ("plays", "codes"),
    [
        ("{at: 6|1, play: g}, {at: 6|3, play: g}", []),
        ("{at: 6|1, play: g}, {at: 6|2, play: g}", ["W310"]),
        ("{at: 6|1, play: g}, {at: 6|2, play: g, layer: true}", []),
        ("{at: 6|1, play: g, every: 1, times: 3}", ["W310"]),
        ("{at: 6|1, play: g, every: 2, times: 9, do: [jitter 4ms 0.1mm]}", []),
        ("{at: 6|1, play: t}, {at: 7|1, play: t}", ["W310"]),
        ("{at: 6|1, play: t}, {at: 7|1, play: t, layer: true}", []),
        ("{at: 6|1, play: t, touch: tracked}, {at: 7|1, play: g, layer: true}", ["W313"]),
        ("{at: 6|1, play: g, touch: tracked}, {at: 7|1, play: g, layer: true}", []),
        ("{at: 1|2, play: g}", ["W310"]),  # cuts the stand-in
    ],
)
def test_stage_warnings_of_overlapping_gestures(plays: str, codes: list[str]):
    assert [found.code for found in warned(plays)] == codes


def test_overlap_warning_position_in_bars_and_beats():
    (found,) = warned("{at: 6|1, play: g}, {at: 6|2.5, play: g}")
    assert found.message == "'g' at 6|2.5 cuts 'g', which lasts until 6|3"


def test_throw_outside_travel_has_one_message():
    with pytest.raises(StageError) as raised:
        staged("{at: 6|1, play: wide, every: 2, times: 8}, {at: 20|1, play: wide}")
    assert [found.code for found in raised.value.diagnostics] == ["E307", "W312"]
    # 12 mm thrown back within a quarter of a second, as the paper's ballistic gesture would.
    assert "swings to 98.6 mm" in raised.value.diagnostics[0].message


def test_standin_take_of_live_hand():
    played = staged("{at: 6|1, play: g}")
    assert [(g.player, g.name, g.start) for g in played.gestures] == [
        ("p", "g", 10.0),
        ("q", "t", 0.0),
    ]


@pytest.mark.parametrize(
    ("fields", "on_fault"),
    [
        ("channel: nope", "nope"),
        ("trim: 0s..900s", "0s..900s"),
        ("smooth: 90kHz", "90kHz"),
        ("rate: 50Hz", "50Hz"),
    ],
)
def test_take_errors_at_their_field(fields: str, on_fault: str):
    text = PLAYED.replace("hand-point-1.csv", "hand-point-1.csv, " + fields)
    text = text.format(plays="{at: 6|1, play: t}", takes=TAKES)
    loaded = load("s.yaml", text=text)
    assert loaded.piece is not None
    with pytest.raises(StageError) as raised:
        stage(loaded.piece)
    (result,) = raised.value.diagnostics
    assert result.code == "E310"
    line = text.splitlines()[result.place.line - 1]
    assert line[result.place.column - 1 :].startswith(on_fault)


def test_solo_of_gesture_starts_at_zero():
    piece = staged("{at: 6|1, play: g}").piece
    alone = solo(piece, "g", "k")
    assert [(g.name, g.start, g.stop) for g in alone.gestures] == [("g", 0.0, 1.0)]
    alone.simulation.process(np.zeros((int(alone.rate), alone.simulation.n_out)))
    assert alone.simulation.positions()[0] == pytest.approx(1e-3, abs=1e-9)


def test_stage_without_tail_and_join():
    text = PLAYED.format(plays="{at: 6|1, play: g, join: 0s}", takes=TAKES)
    loaded = load("s.yaml", text=text + "render: {tail: 0s}\n")
    assert loaded.piece is not None, loaded.diagnostics
    assert stage(loaded.piece).n_frames == 11 * 44100  # 2 beats at 120 from 10 s on


def test_restage_rereads_changed_take(tmp_path: Path):
    def after(before: Stage | None) -> Stage:
        text = PLAYED.format(plays="{at: 6|1, play: t}", takes=tmp_path)
        piece = load(tmp_path / "s.yaml", text=text).piece
        assert piece is not None
        return stage(piece, planned=True, takeover=StageTakeover((Span(piece, ALL_TIME),), before))

    copied = tmp_path / "hand-point-1.csv"
    copied.write_bytes((TAKES / copied.name).read_bytes())
    first = after(None)
    second = after(first)
    assert [*second.takes.values()] == [*first.takes.values()] != []
    copied.write_text("t [s],x [mm]\n0,0\n0.25,3\n1,0\n")
    third = after(second)
    assert third.takes.keys().isdisjoint(second.takes)
    played = [(g.name, g.stop - g.start) for g in third.gestures if g.player == "p"]
    assert played == [("t", pytest.approx(1.0))]


def test_take_with_from_stretch_and_mirror():
    """At 120 bpm two beats are a second; twice as slow and mirrored it passes where it passed."""
    played = staged("{at: 6|1, play: t, do: [from 2, stretch 2, mirror]}")
    (mine,) = (g for g in played.gestures if g.player == "p")
    (complete,) = (g for g in staged("{at: 6|1, play: t}").gestures if g.player == "p")
    assert mine.start == 10.0
    assert mine.stop - mine.start == pytest.approx(2 * (complete.stop - complete.start - 1.0))
    samples = read(TAKES / "hand-point-1.csv")
    take = _core.Take(samples.t, samples.x)
    simulation = played.simulation
    simulation.process(np.zeros((round(12.5 * simulation.rate), simulation.n_out)))
    wanted = -take.evaluate(float(samples.t[0]) + 1.0 + 0.5 * (12.5 - mine.start))[0]
    assert abs(wanted) > 1e-3
    assert simulation.positions()[mine.struck_mat] == pytest.approx(wanted, abs=1e-9)


def test_take_with_from_after_its_end_is_refused():
    with pytest.raises(StageError) as raised:
        staged("{at: 6|1, play: t, do: [from 90s]}")
    (result,) = raised.value.diagnostics
    assert (result.code, result.place.line) == ("E308", 8)
    assert "does not lie inside a take that lasts" in result.message


def test_module_error_of_used_file_at_instrument(tmp_path: Path):
    score = tmp_path / "score.yaml"
    score.write_text("ergon: 1\ninstruments:\n  small: {from: bell/bell, transpose: 96st}\n")
    piece = load(score).piece
    assert piece is not None
    with pytest.raises(StageError) as refused:
        stage(piece)
    result = [one for one in refused.value.diagnostics if one.severity == "error"]
    assert {(one.code, one.place.file, one.place.line) for one in result} == {
        ("E309", str(score), 3)
    }
    names = {one.message.split(":")[0] for one in result}
    assert {"small.hum", "small.octave"} < names  # all are too high, so that none is left out


HIGH = """\
ergon: 1
rates: {audio: 16kHz}
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 2s}, notes: [A4, C9, D9], out: {SOX: cell}}
  sky: {BANK: {count: 40, M: 1g, f: 9kHz..15kHz, t60: 1s}, out: {SOX: sky.all}}
  bell:
    modules:
      prime: {CEL: {M: 1g, f: 25kHz, t60: 1s}}
      hum: {CEL: {M: 1g, f: 440Hz, t60: 1s}}
    out: {SOX: [prime, hum]}
strikes: {s: {to: bell.hum, at: 0, impulse: 1mNs}, t: {to: cell, at: 0, impulse: 1mNs}}
"""
UNSTABLE = """\
ergon: 1
instruments:
  first: {units: ca, at: 44100Hz, modules: {m: {CEL: {M: 1, K: 5, X0: 1mm}}}, out: {SOX: m}}
  good: {units: ca, at: 44100Hz, modules: {m: {CEL: {M: 1, K: 0.5, X0: 1mm}}}, out: {SOX: m}}
  second: {units: ca, at: 44100Hz, modules: {m: {CEL: {M: 1, K: 6, X0: 1mm}}}, out: {SOX: m}}
"""
DECAYS = """\
ergon: 1
instruments:
  one: {STRING: {masses: 40, M: 1g, f: 100Hz, t60: {100Hz: 1s, 400Hz: 100s}}, out: {SOX: one.4}}
  two: {STRING: {masses: 40, M: 1g, f: 100Hz, t60: 1s}, out: {SOX: two.4}}
  three:
    PLATE: {radius: 3, M: 1g, f: 100Hz, t60: {100Hz: 1s, 200Hz: 100s}}
    notes: [A2, B2]
    out: {SOX: three.1}
  tie: {modules: {r: {REF: {between: [one.3, two.3], K: 2N/m}}}}
strikes: {s: {to: [one.5, two.5], at: 0, impulse: 1mNs}}
"""
GLIDES = """\
ergon: 1
instruments:
  a: {CEL: {M: 1g, f: A4, t60: 2s}, out: {SOX: a}}
  b: {CEL: {M: 1g, f: A4, t60: 2s}, out: {SOX: b}}
automation:
  - {at: 0, set: a.f, to: 30kHz, over: 1}
  - {at: 0, set: b.f, to: 40kHz, over: 1}
strikes: {s: {to: [a, b], at: 0, impulse: 1mNs}}
"""


@pytest.mark.parametrize("planned", [False, True])
@pytest.mark.parametrize(
    ("text", "refused"),
    [
        (HIGH, [(4, "cell.C9"), (4, "cell.D9"), (5, "sky.0"), (8, "bell.prime")]),
        (DECAYS, [(3, "one"), (5, "three.A2"), (5, "three.B2")]),
        (GLIDES, [(3, "a"), (4, "b")]),
    ],
    ids=["pitches", "decays", "glides"],
)
def test_stage_reports_all_engine_errors(
    text: str, refused: list[tuple[int, str]], planned: bool
) -> None:
    assert stage_errors(text, planned=planned) == refused


def test_stage_reports_each_unstable_part() -> None:
    assert stage_errors(UNSTABLE, planned=True) == [(3, "first.m"), (5, "second.m")]


def stage_errors(text: str, *, planned: bool) -> list[tuple[int, str]]:
    """Lines and modules of the errors of a stage, all of them E309."""
    piece = load("s.yaml", text=text).piece
    assert piece is not None
    with pytest.raises(StageError) as raised:
        stage(piece, planned=planned)
    result = [one for one in raised.value.diagnostics if one.severity == "error"]
    assert {one.code for one in result} == {"E309"}
    return [(one.place.line, one.message.split(":")[0]) for one in result]
