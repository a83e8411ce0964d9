"""Automation that follows controllers, the wheel and pressures of MIDI files."""

from __future__ import annotations

import math
import random
from pathlib import Path

import mido
import pytest
from midi_files import TICKS, note, save

from ergon.notation.text.errors import Collector
from ergon.scores.edits.excerpt import excerpt_between
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.load import load
from ergon.scores.staging.automating import automation_points, numbers_at

SCORE = """\
ergon: 1
tempo: [{{at: 1|1, bpm: {bpm}, meter: {meter}}}]
instruments:
  bars:
    f: C4
    modules:
      a: {{CEL: {{M: 2g, f: C4, t60: 9s}}}}
      b: {{CEL: {{M: 1g, f: G5, t60: 9s}}}}
      ab: {{REF: {{between: [a, b], K: 100N/m}}}}
    out: {{SOV: a}}
    play: {{strike: {{at: a, impulse: 1mNs..9mNs}}}}
    notes: [C4]
takes: {{tune: {{file: tune.mid}}}}
strikes:
  line: {{play: tune, to: bars, at: 1|1}}
  hit: {{to: bars.C4, impulse: 2mNs, at: 9|1}}
automation:
  - {{set: bars.C4.ab.K, from: tune.mid, at: 1|1, {fields}}}
mix: {{channels: 1, route: [{{from: bars, to: 1}}]}}
render: {{bits: float, tail: 8s}}
"""
RANGE = "range: 50N/m..250N/m"


def written(folder: Path, fields: str, meter: str = "4/4", bpm: float = 60.0) -> Path:
    path = folder / "s.yaml"
    path.write_text(SCORE.format(bpm=bpm, meter=meter, fields=fields), encoding="utf-8")
    return path


def stiffness(loaded, instant: float) -> float:
    """K of the link at an instant [s]."""
    points = automation_points(loaded.piece, -math.inf, 400.0, Collector()).points
    return 100.0 * numbers_at(points["bars.C4", "ab"], instant)[0]


def control(tick: int, number: int, value: int, channel: int = 0):
    return tick, mido.Message("control_change", control=number, value=value, channel=channel)


def moving(draw: random.Random) -> list[tuple[int, mido.Message]]:
    """Controllers, pressures and a wheel that move for twenty quarters, on two channels."""
    events: list[tuple[int, mido.Message]] = []
    for tick in sorted(draw.sample(range(30, 20 * TICKS, 7), 90)):
        channel, value = draw.randrange(2), draw.randrange(128)
        wheel = draw.choice((-8192, 8191, draw.randrange(-8192, 8192)))
        events += draw.choice(
            (
                [control(tick, 1, value, channel), control(tick, 33, draw.randrange(128), channel)],
                [control(tick, 33, value, channel)],
                [(tick, mido.Message("aftertouch", value=value, channel=channel))],
                [(tick, mido.Message("polytouch", note=60, value=value, channel=channel))],
                [(tick, mido.Message("polytouch", note=64, value=value, channel=channel))],
                [(tick, mido.Message("pitchwheel", pitch=wheel, channel=channel))],
            )
        )
    return events


class Reader:
    """Where each source stands by the messages of mido, from 0 to 1; None before the first."""

    def __init__(self) -> None:
        self.upper = self.lower = 0
        self.shares: dict[str, float] = {}

    def read(self, message) -> None:
        kind = message.type
        if kind == "control_change" and message.control == 1:
            self.upper, self.lower = message.value, 0
            self.shares["cc 1"] = message.value / 127
        elif kind == "control_change":
            self.lower = message.value
        elif kind == "aftertouch":
            self.shares["pressure"] = message.value / 127
        elif kind == "polytouch":
            self.shares[f"pressure {'C4' if message.note == 60 else 'E4'}"] = message.value / 127
        elif kind == "pitchwheel":
            method = message.pitch / (8191 if message.pitch > 0 else 8192)
            self.shares["bend"] = 0.5 + 0.5 * method
        if kind == "control_change":
            self.shares["cc 1/33"] = (128 * self.upper + self.lower) / 16383


@pytest.mark.parametrize("meter", ["4/4", "6/8", "3/2"])
@pytest.mark.parametrize(
    ("source", "channel"),
    [
        ("cc 1", 1),
        ("cc 1/33", 2),
        ("bend", 1),
        ("pressure", 2),
        ("pressure C4", None),
        ("pressure E4", 1),
    ],
)
def test_follow_values_equal_mido_in_every_meter(tmp_path: Path, meter, source, channel):
    """At the instants at which mido plays the file, at 75 quarters a minute."""
    save(tmp_path / "tune.mid", note(0, 60, 21 * TICKS), moving(random.Random(source)))
    bpm = 75.0 * int(meter.partition("/")[2]) / 4
    part = "" if channel is None else f"channel: {channel}, "
    loaded = load(written(tmp_path, f"{part}by: {source}, {RANGE}", meter, bpm))
    assert loaded.piece is not None, loaded.diagnostics
    points = automation_points(loaded.piece, -math.inf, 400.0, Collector()).points
    curve, reader = points["bars.C4", "ab"], Reader()
    now, compared = 0.0, set()
    for message in mido.merge_tracks(mido.MidiFile(tmp_path / "tune.mid").tracks):
        later = now + message.time * 0.8 / TICKS
        if later - now > 0.03:  # it stands, but for the time in which the next is reached
            expected = 50.0 + 200.0 * reader.shares[source] if source in reader.shares else 100.0
            assert 100.0 * numbers_at(curve, later - 0.015)[0] == pytest.approx(expected, rel=1e-9)
            compared.add(expected)
        now = later
        if channel in (None, getattr(message, "channel", -1) + 1):
            reader.read(message)
    assert len(compared) > 3


def test_follow_range_of_factors_multiplies_value(tmp_path: Path):
    save(tmp_path / "tune.mid", note(0), [control(TICKS, 1, 127), control(3 * TICKS, 1, 0)])
    loaded = load(written(tmp_path, "by: cc 1, range: 0.5..3"))
    assert [stiffness(loaded, t) for t in (0.5, 2.0, 4.0)] == pytest.approx([100.0, 300.0, 50.0])


def test_follow_ends_at_until_position(tmp_path: Path):
    save(tmp_path / "tune.mid", note(0), [control(TICKS, 1, 127), control(3 * TICKS, 1, 0)])
    loaded = load(written(tmp_path, f"by: cc 1, {RANGE}, until: 1|3"))
    assert [stiffness(loaded, t) for t in (1.9, 2.1, 5.0)] == pytest.approx([250.0, 100.0, 100.0])


def test_follow_ended_by_later_set_line(tmp_path: Path):
    save(tmp_path / "tune.mid", note(0), [control(TICKS, 1, 127), control(4 * TICKS, 1, 0)])
    path = written(tmp_path, f"by: cc 1, {RANGE}")
    text = path.read_text(encoding="utf-8")
    more = "automation:\n  - {set: bars.C4.ab.K, to: 70N/m, over: 0.5s, at: 1|3}"
    path.write_text(text.replace("automation:", more), encoding="utf-8")
    assert [stiffness(load(path), t) for t in (1.9, 2.6, 9.0)] == pytest.approx([250.0, 70.0, 70.0])


def test_follow_with_start_skips_beginning(tmp_path: Path):
    save(tmp_path / "tune.mid", note(0), [control(k * TICKS, 1, 20 * k) for k in range(1, 7)])
    loaded = load(written(tmp_path, f"by: cc 1, {RANGE}, start: 2.5"))
    values = [stiffness(loaded, t) for t in (0.25, 0.75, 1.75)]
    assert values == pytest.approx([50.0 + 200.0 * v / 127 for v in (40, 60, 80)])


@pytest.mark.parametrize("meter", ["4/4", "6/8", "3/2"])
def test_keep_of_bars_of_followed_file(tmp_path: Path, meter: str):
    events = [control(k * TICKS // 3, 1, k) for k in range(1, 127)]
    save(tmp_path / "tune.mid", note(0), note(20 * TICKS), events)
    path = written(tmp_path, f"by: cc 1, {RANGE}, start: 1.5", meter)
    loaded = load(path)
    start = loaded.piece.tempo_map.bars.start(2.5)
    texts = Texts.read(path)
    piece = texts.load().piece
    saved = excerpt_between(texts, piece, "cut", start, start + 60.0)
    cut = saved.load()
    assert cut.piece is not None, cut.diagnostics
    shift = loaded.piece.tempo_map.seconds(start)
    for instant in (0.4, 1.3, 5.0):
        expected = stiffness(loaded, instant + shift)
        assert stiffness(cut, instant) == pytest.approx(expected, rel=1e-9)


# --- what is passed over, and what is refused ----------------------------------------------------


def test_follow_note_of_unused_events(tmp_path: Path):
    events = [control(1, 1, 9), control(2, 7, 9), control(3, 1, 9, 4)]
    events += [(4, mido.Message("aftertouch", value=3)), (5, mido.Message("pitchwheel", pitch=3))]
    save(tmp_path / "tune.mid", note(0), events)
    expected = {
        "channel: 1, by: cc 1": "1 pitch bend, 1 channel pressure and 2 controller values (1, 7)",
        "by: cc 1/7": "1 pitch bend and 1 channel pressure",
        "by: pressure": "1 pitch bend and 3 controller values (1, 7)",
        "by: bend": "1 channel pressure and 3 controller values (1, 7)",
    }
    for fields, words in expected.items():
        loaded = load(written(tmp_path, f"{fields}, {RANGE}"))
        (message,) = [d.message for d in loaded.diagnostics if d.code == "N404"]
        assert message == f"tune.mid: the score does not use {words} of this file"


@pytest.mark.parametrize(
    ("fields", "code", "words"),
    [
        (f"by: cc 2, {RANGE}", "E310", "no values of `cc 2`"),
        (f"channel: 3, by: cc 1, {RANGE}", "E310", "they are on channel 1"),
        (f"channel: 17, by: cc 1, {RANGE}", "E202", "1 to 16"),
        (f"by: cc 1/1, {RANGE}", "E2", "names one controller twice"),
        (f"by: knob, {RANGE}", "E201", "write cc 21"),
        ("by: cc 1, range: x1..90N/m", "E202", "two values or two factors"),
        (RANGE, "E103", "`by` is missing"),
        (f"by: cc 1, {RANGE}, over: 1bar", "E111", "`over`"),
    ],
)
def test_follow_mistakes_are_refused(tmp_path: Path, fields, code, words):
    save(tmp_path / "tune.mid", note(0), [control(1, 1, 9)])
    loaded = load(written(tmp_path, fields))
    errors = [d for d in loaded.diagnostics if d.severity == "error"]
    assert errors[0].code.startswith(code)
    assert words in errors[0].message
