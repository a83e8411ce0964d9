"""Transformations of rhythms on phrases and MIDI files: the same strokes, in round after round."""

from pathlib import Path

import mido
import pytest
from checked import check
from damped_bar import SCORE as DAMPED_BAR

from ergon.notation.text.edit import EditError
from ergon.scores.edits.texts import Texts
from ergon.scores.edits.transformed import transform
from ergon.scores.reading.load import load
from ergon.scores.reading.phrase_do import split_transforms
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import stage

SCORE = """\
ergon: 1
seed: 7
tempo: {bpm: 60}
instruments:
  bar:
    CEL: {M: 1g, f: A4, t60: 1s}
    notes: C4..C6
    play: {strike: {impulse: 1mNs..4mNs}}
    out: {SOV: bar}
phrases:
  call: {to: bar, length: 4, entries: "0 C4 p\\n1/2 E4 G4 2mNs\\n3 D4 f"}
  thirds: {to: bar, length: 2, impulse: mf, entries: "1/3 C4\\n2/3 D4\\n4/3 bar.E4"}
  long: {to: bar, length: 8, impulse: mf, entries: "0 C4\\n6 D4"}
  drawn: {to: bar, entries: "0 C4 p..f"}
  mixed: {to: bar, length: 4, impulse: mf, entries: "0 C4\\n0.5s D4"}
  odd: {to: bar, length: 4, impulse: mf, entries: "0 C4\\n1.23456789 D4"}
"""


def piece(fields: str) -> Piece:
    loaded = check(f"{SCORE}strikes: {{s: {{{fields}}}}}\n")
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def falls(fields: str) -> list[str]:
    score = piece(f"{fields}, at: 0")
    return [f"{beat:.9g} {hit.struck_text}" for beat, _, hit in score.strikes[0].played_hits(score)]


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ("play: call, do: rev", "0 D4, 1 E4, 1 G4, 3.5 C4"),
        ("play: call, do: fast 2",
         "0 C4, 0.25 E4, 0.25 G4, 1.5 D4, 2 C4, 2.25 E4, 2.25 G4, 3.5 D4"),
        ("play: call, times: 2, do: [every 2 degrade 1]", "4 C4, 4.5 E4, 4.5 G4, 7 D4"),
        ("play: call, do: 'off 1/8 transpose 12st, degrade 0'",
         "0 C4, 0.5 E4, 0.5 G4, 0.5 C4+12, 1 E4+12, 1 G4+12, 3 D4, 3.5 D4+12"),
        # Transformations of its entries come first; `stretch` makes the round longer.
        ("play: call, times: 2, do: [stretch 2, every 2 rev]",
         "0 D4, 2 E4, 2 G4, 7 C4, 8 C4, 9 E4, 9 G4, 14 D4"),
        ("play: call, transpose: 2st, do: 'reverse, late 1/8'", "0.5 E4, 3 F#4, 3 A4, 3.5 D4"),
        ("play: thirds, do: ply 2",
         "0.333333333 C4, 0.5 C4, 0.666666667 D4, 1 D4, 1.33333333 bar.E4, 1.66666667 bar.E4"),
        ("play: call, every: 6, times: 2, do: fast 1",
         "0 C4, 0.5 E4, 0.5 G4, 3 D4, 6 C4, 6.5 E4, 6.5 G4, 9 D4"),
        ("play: call, do: arp up", "0 C4, 0.5 E4, 1.75 G4, 3 D4"),
    ],
)  # fmt: skip
def test_strokes_of_a_phrase(fields, expected):
    assert falls(fields) == expected.split(", ")


@pytest.mark.parametrize(
    "fields",
    [
        "play: call, at: 1|2, times: 3",
        "play: call, at: 1|1, until: 4|1, impulse: f p v77, transpose: 3st",
        "play: thirds, at: 2.5, every: 3, times: 2, transpose: 12st, do: [scale 0.7, mirror]",
    ],
)
def test_phrase_with_neutral_transformation(fields):
    ergons = []
    for do in ("", "fast 1"):
        written = fields.replace("]", f", {do}]") if do and "do:" in fields else fields
        written = written if "do:" in written or not do else f"{fields}, do: {do}"
        staged = stage(piece(written))
        each = (staged.timeline.strikes_on(mat) for mat in range(staged.network.n_mat))
        ergons.append([sorted((e.at, e.impulse) for e in strikes) for strikes in each])
    numbers = [[n for strikes in all_of for e in strikes for n in e] for all_of in ergons]
    assert len(numbers[0]) > 10
    assert numbers[1] == pytest.approx(numbers[0])


def test_midi_file_keeps_its_chords_and_lengths(tmp_path: Path):
    file = mido.MidiFile(type=0, ticks_per_beat=480)
    track = mido.MidiTrack()
    # C4 for three beats, over it E4 and G4 for half a beat each, at 1 and 2.
    for time, word, note, velocity in [
        (0, "note_on", 60, 100),
        (480, "note_on", 64, 64),
        (240, "note_off", 64, 0),
        (240, "note_on", 67, 77),
        (240, "note_off", 67, 0),
        (240, "note_off", 60, 0),
    ]:
        track.append(mido.Message(word, note=note, velocity=velocity, time=time))
    track.append(mido.MetaMessage("end_of_track", time=480))
    file.tracks.append(track)
    file.save(tmp_path / "tune.mid")
    text = f"{DAMPED_BAR}takes: {{tune: {{file: tune.mid}}}}\n"  # where notes end
    text += "strikes: {s: {play: tune, to: bar, at: 0, DO}}\n"
    lines = []
    for do in ("times: 1", "do: fast 1", "do: rev"):
        loaded = load(tmp_path / "s.yaml", text=text.replace("DO", do))
        assert loaded.piece is not None, loaded.diagnostics
        falling = loaded.piece.strikes[0].played_hits(loaded.piece)
        lines.append([(beat, hit.struck_text, hit.level.low) for beat, _, hit in falling])
    notes = [(0.0, "C4", 100 / 127), (1.0, "E4", 64 / 127), (2.0, "G4", 77 / 127)]
    assert lines[0] == lines[1] == notes
    assert lines[2] == [(1.0, "C4", 100 / 127), (1.5, "G4", 77 / 127), (2.5, "E4", 64 / 127)]


@pytest.mark.parametrize(
    ("text", "words", "rest"),
    [
        ("scale 0.5, mirror", ["scale", "mirror"], ""),
        ("stretch 2, every 4 (rev, fast 2), scale 0.5",
         ["stretch"], "every 4 (rev, fast 2), scale 0.5"),
        ("rev", [], "rev"),
    ],
)  # fmt: skip
def test_split_do(text, words, rest):
    chain, rhythm = split_transforms(text)
    assert [transform.word for transform in chain] == words
    assert rhythm == rest


@pytest.mark.parametrize(
    ("fields", "code", "part"),
    [
        ("play: call, do: 'rev, mirror'", "E204", "unknown transformation 'mirror'"),
        ("play: call, do: [rev, mirror]", "E204", "unknown transformation 'mirror'"),
        ("play: call, do: revv", "E204", "unknown transformation 'revv'"),
        ("play: long, every: 4, times: 2, do: rev", "E306", "'D4' lies outside the round"),
        ("play: call, do: 'jitter 5ms 0mm, rev'", "E306", "no jitter"),
        ("play: drawn, do: rev", "E306", "is no word of a rhythm"),
        ("play: mixed, do: rev", "E306", "in one unit"),
        ("play: odd, do: rev", "E306", "use quantise"),
        ("play: call, do: off 1/8 transpose 40st", "E301", "has no note"),
        ("entries: '1|1 bar.C4 mf', do: rev", "E111", "together with `entries`"),
    ],
)
def test_phrase_rhythm_mistakes(fields, code, part):
    position = "" if "entries" in fields else ", at: 0"
    loaded = check(f"{SCORE}strikes: {{s: {{{fields}{position}}}}}\n")
    (error,) = [each for each in loaded.diagnostics if each.severity == "error"]
    assert part in error.message
    assert error.code == code


# --- at the prompt --------------------------------------------------------------------------------


def transformed(fields: str, beat: float, do: str) -> tuple[str, Piece]:
    text = f"{SCORE}strikes:\n  s: {{{fields}}}\n"
    before = load("s.yaml", text=text).piece
    assert before is not None
    after = transform(Texts("s.yaml", text), before, "s", beat, do)
    score = after.load().piece
    assert score is not None, after.load().diagnostics
    return after.text, score


def test_do_from_next_round():
    fields = "play: call, at: 1|1, times: 4, transpose: 12st, do: [scale 0.5]"
    text, score = transformed(fields, 6.0, "rev")
    beats = sorted(
        (beat, hit.struck_text)
        for strikes in score.strikes
        for beat, _, hit in strikes.played_hits(score)
    )
    expected = [(start + beat, what) for start in (0, 4) for beat, what in
                [(0, "C5"), (0.5, "E5 G5"), (3, "D5")]]  # fmt: skip
    expected += [(start + beat, what) for start in (8, 12) for beat, what in
                 [(0, "D5"), (1, "E5"), (1, "G5"), (3.5, "C5")]]  # fmt: skip
    assert beats == expected
    assert "to: bar" in text
    again = transform(Texts("s.yaml", text), score, "s", 12.0, "none").load().piece
    assert again is not None
    assert len(again.strikes) == 3


def test_do_of_a_phrase_with_words_of_rhythms():
    text, score = transformed("play: call, at: 1|1, times: 4, do: [every 2 rev]", 6.0, "fast 2")
    assert "every 2 rev, fast 2" in text
    (last,) = [strikes for strikes in score.strikes if strikes.name != "s"]
    falling = [(beat, hit.struck_text) for beat, _, hit in last.played_hits(score)]
    assert falling[:4] == [(8, "D4"), (8.5, "E4"), (8.5, "G4"), (9.75, "C4")]


def test_do_refuses_a_melody():
    with pytest.raises(EditError, match="no cycle to transform"):
        transformed("entries: '1|1 bar.C4 mf'", 0.0, "rev")
