"""Strikes by a rhythm text: what falls when, with strengths and transformations, in a score."""

import numpy as np
import pytest
from checked import check, check_reports

from ergon.scores.edits import strikes as edits
from ergon.scores.edits.excerpt import excerpt_between
from ergon.scores.edits.renaming import rename
from ergon.scores.edits.texts import Texts
from ergon.scores.edits.transformed import transform
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import stage

DRUMS = """\
ergon: 1
seed: 7
tempo: {bpm: 60}
instruments:
  kick: {CEL: {M: 5g, f: 90Hz, t60: 0.2s}, play: {strike: {impulse: 1mNs..16mNs}}, out: {SOV: kick}}
  hat: {CEL: {M: 1g, f: 3kHz, t60: 0.1s}, play: {strike: {impulse: 1mNs..4mNs}}, out: {SOV: hat}}
  bar:
    CEL: {M: 1g, f: A4, t60: 1s}
    notes: C4..C5
    play: {strike: {impulse: 1mNs..4mNs}}
    out: {SOV: bar}
  bare: {CEL: {M: 1g, f: A4, t60: 1s}, out: {SOV: bare}}
"""


def piece(text: str, head: str = DRUMS) -> Piece:
    loaded = check(head + text)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def falls(fields: str) -> list[str]:
    """Every stroke of a rhythm, as its beat and its word."""
    score_piece = piece(f"strikes: {{s: {{{fields}}}}}\n")
    return [
        f"{beat:.9g} {hit.struck_text}"
        for beat, _, hit in score_piece.strikes[0].played_hits(score_piece)
    ]


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ("rhythm: 'kick ~ hat ~', at: 0, times: 1", "0 kick, 2 hat"),
        ("rhythm: 'kick*2, ~ hat', at: 0, times: 1", "0 kick, 2 kick, 2 hat"),
        ("rhythm: '<kick hat>', at: 0, times: 3", "0 kick, 4 hat, 8 kick"),
        ("rhythm: '<kick hat>', at: 0, times: 3, cycle: 3/2", "0 kick, 1.5 hat, 3 kick"),
        ("rhythm: 'kick hat', at: 1|3, until: 2|3.5", "2 kick, 4 hat, 6 kick"),
        ("rhythm: 'kick hat', at: 0, for: 6", "0 kick, 2 hat, 4 kick"),
        ("rhythm: 'x(3,8)', to: kick, at: 0, times: 1", "0 x, 1.5 x, 3 x"),
        ("rhythm: 'kick hat', at: 0, times: 2, do: every 2 rev", "0 hat, 2 kick, 4 kick, 6 hat"),
        ("rhythm: 'kick ~', at: 0, times: 1, do: [ply 2, late 1/8]", "0.5 kick, 1.5 kick"),
        ("rhythm: 'c4 e4', to: bar, at: 0, times: 1", "0 c4, 2 e4"),
        ("rhythm: 'c4.min ~', to: bar, at: 0, times: 1", "0 c4.min"),
        (
            "rhythm: 'c4 ~', to: bar, at: 0, times: 1, do: off 1/4 transpose 12st",
            "0 c4, 1 c4+12",
        ),
    ],
)
def test_strokes_of_rhythm(fields, expected):
    assert falls(fields) == expected.split(", ")


def test_cycles_follow_meter():
    """A cycle is a bar, also where the meter changes."""
    tempo = "tempo: [{at: 1|1, bpm: 60, meter: 3/4}, {at: 2|1, meter: 4/4}]\n"
    head = DRUMS.replace("tempo: {bpm: 60}\n", tempo)
    score_piece = piece("strikes: {s: {rhythm: 'kick kick', at: 0, times: 2}}\n", head)
    assert [beat for beat, *_ in score_piece.strikes[0].played_hits(score_piece)] == [0, 1.5, 3, 5]


def test_levels_of_words_and_cycle():
    fields = "rhythm: 'kick hat:p kick:2mNs hat', at: 0, times: 1, impulse: f mf, do: scale 0.5"
    score_piece = piece(f"strikes: {{s: {{{fields}}}}}\n")
    hits = [hit for *_, hit in score_piece.strikes[0].played_hits(score_piece)]
    amounts = [hit.level.impulse(hit.impulse_range, max) for hit in hits]
    expected = [1e-3 * 16 ** (5 / 7), 1e-3 * 4 ** (2 / 7), 2e-3, 1e-3 * 4 ** (4 / 7)]
    assert amounts == pytest.approx([amount / 2 for amount in expected])


def test_note_and_transposed_note_strike_members():
    score_piece = piece("strikes: {s: {rhythm: c4, to: bar, at: 0, times: 1, do: transpose 7st}}\n")
    assert [target.part for target in score_piece.strikes[0].to] == ["bar.G4"]


def test_chord_strikes_its_notes_together():
    fields = "rhythm: c4.min7, to: bar, at: 0, times: 1, do: transpose 2st"
    (strikes,) = piece(f"strikes: {{s: {{{fields}}}}}\n").strikes
    assert [target.part for target in strikes.to] == ["bar.D4", "bar.F4", "bar.A4", "bar.C5"]


def test_same_strokes_from_middle():
    """Strokes between two beats are those of the entire rhythm, by chance too."""
    score_piece = piece(
        "strikes: {s: {rhythm: 'kick? [hat|kick] hat*3?', at: 1, times: 64, do: 'sometimes rev'}}\n"
    )
    every = [*score_piece.strikes[0].played_hits(score_piece)]
    assert 100 < len(every) < 300
    for since, before in [(0.0, 9.0), (17.3, 100.0), (250.0, 1e9), (33.0, 33.0)]:
        part = [fall for fall in every if since - 1e-9 <= fall[0] < before - 1e-9]
        assert [*score_piece.strikes[0].played_hits(score_piece, since, before)] == part


def test_ergons_of_rhythm():
    score_piece = piece("strikes: {s: {rhythm: 'kick hat', at: 0, times: 2, impulse: fff}}\n")
    staged = stage(score_piece)
    each = (staged.timeline.strikes_on(mat) for mat in range(staged.network.n_mat))
    ergons = sorted((e.at, e.impulse) for strikes in each for e in strikes)
    expected = [(0, 16e-3), (2, 4e-3), (4, 16e-3), (6, 4e-3)]
    assert np.array(ergons) == pytest.approx(np.array(expected))


def test_block_of_text_as_rhythm():
    """A rhythm may be written in several lines."""
    score_piece = piece(
        "strikes:\n  s:\n    at: 0\n    times: 1\n    rhythm: |\n      kick ~,\n      hat*2\n"
    )
    assert len([*score_piece.strikes[0].played_hits(score_piece)]) == 3


@pytest.mark.parametrize(
    ("fields", "code", "column", "part"),
    [
        ("rhythm: 'kick snar', at: 0, times: 1", "E301", 29, "nothing is called 'snar'"),
        ("rhythm: 'kick [hat', at: 0, times: 1", None, 29, "is not closed"),
        ("rhythm: 'kick bare', at: 0, times: 1", "E103", 29, "'bare' has no `play`"),
        ("rhythm: 'c4', at: 0, times: 1", "E103", 24, "'C4' is a note; write `to`"),
        ("rhythm: 'c3', to: bar, at: 0, times: 1", "E301", 24, "has no note 'C3'"),
        ("rhythm: 'c4.moll', to: bar, at: 0, times: 1", None, 27, "name of a chord"),
        ("rhythm: 'kick:loud', at: 0, times: 1", None, 29, "neither an impulse"),
        ("rhythm: 'kick', at: 0", "E103", None, "the rhythm has no end"),
        ("rhythm: 'kick', times: 1", "E103", None, "has no 'at'"),
        ("rhythm: 'kick', at: 0, every: 1", "E111", None, "cannot be used together with `rhythm`"),
        ("rhythm: 'kick', at: 0, times: 1, do: revv", "E204", None, "revv"),
        ("rhythm: 'kick', at: 0, times: 1, do: mirror", "E204", None, "mirror"),
        ("rhythm: 'kick', at: 0, times: 1, do: transpose 2st", "E306", 24, "no note that could"),
        ("rhythm: 'kick*1000', at: 0, times: 1, do: fast 1000", "E306", None, "steps"),
        ("rhythm: 'kick*1000', at: 0, times: 9999", "E105", None, "more than 2,000,000"),
        ("to: kick, at: 0, cycle: 3", "E111", None, "needs `rhythm` beside it"),
        ("rhythm: 'kick', at: 0, for: 1, until: 9", "E111", None, "keep one"),
    ],
)
def test_rhythm_mistake_code_and_column(fields, code, column, part):
    loaded = check(f"{DRUMS}strikes: {{s: {{{fields}}}}}\n")
    errors = [each for each in loaded.diagnostics if each.severity == "error"]
    assert len(errors) == 1, errors
    (error,) = errors
    assert part in error.message
    assert code is None or error.code == code
    assert column is None or error.place.column == column


# --- edits --------------------------------------------------------------------------------------


TEXT = DRUMS + "strikes:\n  s: {rhythm: 'kick*2 hat', at: 1|1, until: 999|1}\n"


def texts(text: str = TEXT) -> Texts:
    return Texts("s.yaml", text)


def test_rename_changes_words():
    before = load("s.yaml", text=TEXT).piece
    assert before is not None
    after = rename(texts(), before, "kick", "bd")
    assert "rhythm: 'bd*2 hat'" in after.text
    assert after.load().piece is not None


def test_end_edit_writes_until():
    before = load("s.yaml", text=TEXT).piece
    assert before is not None
    after = edits.end_strikes(texts(), before, before.strikes[0], 8.0)
    score_piece = after.load().piece
    assert score_piece is not None
    assert len([*score_piece.strikes[0].played_hits(score_piece)]) == 6


def test_keep_of_rhythm_writes_out_strikes():
    before = load("s.yaml", text=TEXT).piece
    assert before is not None
    excerpt = excerpt_between(texts(), before, "two", 6.0, 12.0)
    score_piece = excerpt.load().piece
    assert score_piece is not None, excerpt.load().diagnostics
    beats = [beat for beat, *_ in score_piece.strikes[0].played_hits(score_piece)]
    expected = [beat - 6.0 for beat, *_ in before.strikes[0].played_hits(before, 6.0, 12.0)]
    assert beats == pytest.approx(expected)


@pytest.mark.parametrize(
    ("fields", "rhythm"),
    [
        ("to: kick, every: 1/2", "rhythm: x, to: kick, cycle: 0.5"),
        ("to: kick, euclid: 3 8 rotate 2", 'rhythm: "x(3,8,2)", to: kick'),
        ("to: kick, euclid: 3 8, every: 1/4", 'rhythm: "x(3,8)", to: kick, cycle: 2.0'),
        ("to: kick, every: 1, chance: 0.7", 'rhythm: "[x]?0.3", to: kick, cycle: 1.0'),
        (
            "to: bar, notes: C4 ~ (E4 G4), every: 1, impulse: f p",
            'rhythm: "C4 ~ [E4 G4]", to: bar, cycle: 3.0, impulse: f p',
        ),
        ("to: bar, notes: choose C4 E4, every: 1", 'rhythm: "[C4|E4]", to: bar, cycle: 1.0'),
        (
            "to: bar, notes: walk C4 (E4 G4) F4, every: 1",
            'rhythm: "<C4|[E4 G4]|F4>", to: bar, cycle: 1.0',
        ),
        (
            "to: bar, notes: C4 (walk E4 G4)*2, every: 1",
            "rhythm: C4 <E4|G4> <E4|G4>, to: bar, cycle: 3.0",
        ),
    ],
)
def test_do_writes_strikes_as_rhythm(fields, rhythm):
    """The same strokes as before, until something is transformed."""
    text = f"{DRUMS}strikes:\n  s: {{{fields}, at: 1|1, until: 999|1}}\n"
    before = load("s.yaml", text=text).piece
    assert before is not None
    after = transform(texts(text), before, "s", 0.0, "fast 1")
    line = after.text.splitlines()[-1]
    for part in rhythm.split(", "):
        assert part in line
    score_piece = after.load().piece
    assert score_piece is not None, after.load().diagnostics
    if {"chance:", "choose", "walk", "(walk"} & set(fields.split()):  # other draws
        return
    ergons = [ergons_of(each, 12.0) for each in (before, score_piece)]
    assert ergons[0] == pytest.approx(ergons[1])
    assert len(ergons[0]) > 4


def ergons_of(score_piece: Piece, before: float) -> list[float]:
    """The instants of all strikes before an instant [s]."""
    staged = stage(score_piece)
    each = (staged.timeline.strikes_on(mat) for mat in range(staged.network.n_mat))
    return sorted(e.at for strikes in each for e in strikes if e.at < before)


def test_do_keeps_the_end_of_a_rhythm():
    text = f"{DRUMS}strikes:\n  s: {{rhythm: kick*2, at: 1|1, for: 16}}\n"
    before = load("s.yaml", text=text).piece
    assert before is not None
    after = transform(texts(text), before, "s", 6.0, "fast 1").load().piece
    assert after is not None
    beats = [beat for strikes in after.strikes for beat, *_ in strikes.played_hits(after)]
    assert beats == [0, 2, 4, 6, 8, 10, 12, 14]


def test_plain_rhythm_without_diagnostics():
    assert check_reports(TEXT) == []
