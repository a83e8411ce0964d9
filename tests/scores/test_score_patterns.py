"""Patterns of words as a score writes them: gestures on keys, and strikes."""

from __future__ import annotations

from itertools import islice, pairwise

import pytest

from ergon.notation.text.errors import Collector
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.hands import Window
from ergon.scores.staging.preparing import Span, prepare
from ergon.scores.staging.striking import Striking

SCORE = """\
ergon: 1
seed: 5
tempo: [{{at: 1|1, bpm: 120, meter: 4/4}}]
keys: {{k: {{M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}}}
players: {{p: {{key: k}}}}
gestures:
  knock: 0mm@0 smooth 6mm@60ms 0mm@160ms
  lean: 0mm@0 smooth 3mm@1/8 smooth 0mm@1/4
  tap: 0mm@0 smooth 4mm@60ms 0mm@160ms
parts:
  p: {part}
"""
TABLE = """|
    # at  what
    1|1   knock lean ~ (tap tap) every 1 times 2
    4|1   choose knock tap every 1/2 times 8 chance 0.6 every 4th do mirror
    7|1   knock euclid 3 8 rotate 2 times 2
    10|1  shuffle knock lean tap every 1/2 until 14|1 swing 2/3 do jitter 4ms 0.2mm
"""
LIST = """
  - {at: 1|1, play: knock lean ~ (tap tap), every: 1, times: 2}
  - {at: 4|1, play: choose knock tap, every: 1/2, times: 8, chance: 0.6, nth: 4th do mirror}
  - {at: 7|1, play: knock, euclid: 3 8 rotate 2, times: 2}
  - {at: 10|1, play: shuffle knock lean tap, every: 1/2, until: 14|1, swing: 2/3,
     do: [jitter 4ms 0.2mm]}
"""


def piece(part: str, seed: int = 5) -> Piece:
    loaded = load("s.yaml", text=SCORE.format(part=part).replace("seed: 5", f"seed: {seed}"))
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def staged(source: Piece, spans=None) -> list[tuple[str, float, tuple[float, ...]]]:
    gestures = prepare(source, spans=spans).hands.gestures
    beat = source.tempo_map.beats
    return [(g.name, round(beat(g.start), 9), tuple(g.positions)) for g in gestures]


def test_pattern_part_as_table_equals_list():
    assert staged(piece(TABLE)) == staged(piece(LIST))
    assert digest_of(piece(TABLE)) == digest_of(piece(LIST))
    assert digest_of(piece(TABLE)) != digest_of(piece(TABLE.replace("chance 0.6", "chance 0.5")))


def test_patterns_become_gestures_on_a_key():
    result = staged(piece(TABLE))
    bars = [
        [(name, beat - 4 * bar) for name, beat, _ in result if 4 * bar <= beat < 4 * bar + 4]
        for bar in range(13)
    ]
    once = [("knock", 0), ("lean", 1), ("tap", 3), ("tap", 3.5)]
    assert bars[:2] == [once, once]
    assert bars[6:8] == [[("knock", 0.5), ("knock", 2), ("knock", 3)]] * 2
    assert {name for name, _ in bars[3]} == {"knock", "tap"}
    assert 2 <= len(bars[3]) <= 7
    for name, position, x in result:
        if 12 <= position < 16:  # the 4th and the 8th round are mirrored
            assert (min(x) < 0.0) == (position in (13.5, 15.5)), name
    swung_ = [round(position % 1, 6) for _, position, _ in result if position >= 36]
    assert set(swung_) == {0.0, round(2 / 3, 6)}
    assert [name for name, _ in bars[9]] != [name for name, _ in bars[10]]


def test_pattern_draws_with_another_seed():
    for_five, for_six = staged(piece(TABLE)), staged(piece(TABLE, 6))
    assert [g for g in for_five if g[1] < 12] == [g for g in for_six if g[1] < 12]
    assert for_five != for_six
    # What is staged with another seed is what a score with that seed says.
    from ergon.scores.staging.stage import stage

    other = stage(piece(TABLE), seed=6)
    beat = other.piece.tempo_map.beats
    again = [(g.name, round(beat(g.start), 9), tuple(g.positions)) for g in other.gestures]
    assert again == for_six


@pytest.mark.parametrize("cuts", [(3.0, 13.2, 37.1), (12.5, 24.0, 40.0)])
def test_pattern_gestures_staged_in_windows(cuts):
    """A session stages stretch by stretch what a render stages at once."""
    source = piece(TABLE)
    edges = (float("-inf"), *cuts, float("inf"))
    spans = [Span(source, Window(since, until)) for since, until in pairwise(edges)]
    assert sorted(staged(source, spans)) == sorted(staged(source))


def test_pattern_draws_with_additional_line():
    before = staged(piece(TABLE))
    more = TABLE + "    20|1  choose knock lean every 1 times 8 chance 0.5 do jitter 1ms 0.1mm\n"
    assert [g for g in staged(piece(more)) if g[1] < 76] == before


@pytest.mark.parametrize(
    ("row", "code", "words_", "column"),
    [
        ("1|1  knock laen every 1", "E301", "no gesture or take is called 'laen'", 16),
        ("1|1  knock ~ lean", "E103", "write `every`", 10),
        ("1|1  knock every 1 chance 1.5", "E202", "above the maximum of 1", 31),
        ("1|1  knock euclid 9 8", "E204", "a rhythm of 8 steps has 1 to 8 pulses", 23),
        ("1|1  knock every 1 swing 0.1", "E202", "is not a swing", 30),
        ("1|1  knock (lean every 1", "E204", "not closed", 16),
        ("1|1  choose knock lean", "E103", "write `every`", 10),
    ],
)
def test_pattern_mistakes_in_score_have_places(row, code, words_, column):
    loaded = load("s.yaml", text=SCORE.format(part=f"|\n    {row}\n"))
    assert loaded.piece is None
    result = loaded.diagnostics[0]
    assert (result.code, result.place.line, result.place.column) == (code, 12, column)
    assert words_ in result.message


def test_single_name_equals_group_of_one():
    plain, group = (
        piece("[{at: 1|1, play: knock, every: 1}]"),
        piece("|\n    1|1 (knock)*1 every 1"),
    )
    assert plain.parts[0].pattern is None
    assert staged(plain) == staged(group)


def test_endless_pattern_lines_cost_little():
    endless = "|\n    1|1  walk knock lean tap every 1/2 until 999|1\n"
    source = piece(endless)
    (places,) = source.starts
    assert len(places) == 7984
    late = staged(source, [Span(source, Window(3900.0, 3903.0))])
    assert [at for _, at, _ in late] == [3900 + n / 2 for n in range(6)]
    assert list(islice((name for name, *_ in late), 6)) == [
        source.parts[0].place_sequence(source.seed).played_name(7800 + n) for n in range(6)
    ]


# --- strikes -------------------------------------------------------------------------------------

STRUCK = """\
ergon: 1
seed: {seed}
tempo: [{{at: 1|1, bpm: 60, meter: 4/4}}]
instruments:
  sky: {{BANK: {{count: 5, f: 200Hz..2kHz, t60: 1s, M: 1g}}, out: {{SOX: sky.all}}}}
strikes:
  rain: {{to: sky.all, at: 1|1, impulse: 1mNs, {rain}}}
"""


class Struck:
    """A timeline that keeps what is struck."""

    def __init__(self) -> None:
        self.strikes: list[tuple[float, int]] = []

    def strike(self, mat: int, at: float, **more: object) -> None:
        self.strikes.append((at, mat))


def rain(text: str, within=(float("-inf"), float("inf")), seed: int = 3) -> list[tuple[float, int]]:
    loaded = load("s.yaml", text=STRUCK.format(rain=text, seed=seed))
    assert loaded.piece is not None, loaded.diagnostics
    struck, collector = Struck(), Collector()
    (first,) = loaded.piece.strikes
    Striking(loaded.piece, struck, first, range(5), 0, within).play(collector)
    assert not collector.has_errors()
    return struck.strikes


def test_strikes_with_euclid_and_swing_times():
    result = rain("euclid: 3 8, for: 2bar")
    assert result == [(at, mat) for at in (0, 1.5, 3, 4, 5.5, 7) for mat in range(5)]
    result = rain("every: 1/2, times: 4, swing: 2/3")
    assert result == [(pytest.approx(at), mat) for at in (0, 2 / 3, 1, 5 / 3) for mat in range(5)]


def test_strike_chance_draws_by_member():
    result = rain("every: 1/4, times: 400, chance: 30%")
    assert len(result) / 2000 == pytest.approx(0.3, abs=0.03)
    each = [[at for at, mat in result if mat == member] for member in range(5)]
    assert len({tuple(own) for own in each}) == 5
    assert result == rain("every: 1/4, times: 400, chance: 30%")
    assert result != rain("every: 1/4, times: 400, chance: 30%", seed=4)


@pytest.mark.parametrize("cut", [10.0, 33.3, 60.0])
def test_pattern_strikes_staged_in_windows(cut):
    text = "every: 1/4, times: 400, chance: 30%, swing: 0.6, euclid: 5 7"
    assert rain(text, (0.0, cut)) + rain(text, (cut, 1e9)) == rain(text)


@pytest.mark.parametrize(
    ("text", "code", "words_"),
    [
        ("rate: 1Hz, for: 4, chance: 0.5", "E111", "strikes by chance have no steps"),
        ("chance: 0.5", "E103", "write `every`"),
        ("euclid: 3 8, every: 0, times: 2", "E305", "'every' must be above 0"),
        ("euclid: 3 8, every: 1, times: 2, skip: 9", "E305", "leaves out every place"),
    ],
)
def test_pattern_strike_mistakes_codes(text, code, words_):
    loaded = load("s.yaml", text=STRUCK.format(rain=text, seed=3))
    assert loaded.piece is None
    assert loaded.diagnostics[0].code == code
    assert words_ in loaded.diagnostics[0].message
