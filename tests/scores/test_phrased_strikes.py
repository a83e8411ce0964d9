"""Words of phrasing in a score: strokes in seconds, their levels, their lengths at a damper."""

from itertools import pairwise

import pytest
from checked import check
from damped_bar import SCORE as DAMPED_BAR

from ergon.scores.reading.piece import Hit, Piece
from ergon.scores.staging.stage import stage

PLAYED = """\
ergon: 1
seed: 7
tempo: [{at: 1|1, bpm: 60}, {at: 1|2, bpm: 120}, {at: 2|1, bpm: 60}]
instruments:
  kick: {CEL: {M: 5g, f: 90Hz, t60: 0.2s}, play: {strike: {impulse: 1mNs..16mNs}}, out: {SOV: kick}}
  bar:
    CEL: {M: 1g, f: A4, t60: 1s}
    notes: C4..C6
    play: {strike: {impulse: 1mNs..4mNs}}
    out: {SOV: bar}
"""


def piece(fields: str, head: str = PLAYED) -> Piece:
    loaded = check(f"{head}strikes: {{s: {{{fields}}}}}\n")
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def hits(fields: str) -> list[tuple[float, Hit]]:
    score = piece(fields)
    return [(beat, hit) for beat, _, hit in score.strikes[0].played_hits(score)]


def falls(fields: str) -> list[str]:
    """Every stroke with its beat and how many beats it lasts."""
    return [
        f"{beat:.9g} {hit.struck_text} {hit.duration.beats:.9g}"
        for beat, hit in hits(fields)
        if hit.duration
    ]


# The first beat lasts a second, each other of the first bar half a second.
@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        # A note of 1.5 s at 4 Hz has six strokes: four in the slow beat, two in the fast one.
        ("rhythm: 'kick ~', do: tremolo 4Hz",
         "0 kick 0.25, 0.25 kick 0.25, 0.5 kick 0.25, 0.75 kick 0.25, 1 kick 0.5, 1.5 kick 0.5"),
        # The last stroke ends with the note.
        ("rhythm: '[kick ~] ~', do: tremolo 1.5Hz",
         "0 kick 0.666666667, 0.666666667 kick 0.333333333"),
        ("rhythm: '[kick ~] ~', do: [tremolo 2Hz, legato 0.5]", "0 kick 0.25, 0.5 kick 0.25"),
        ("rhythm: '[~ kick] ~', do: tremolo 1Hz", "1 kick 1"),
        ("rhythm: '[c4.maj ~] ~', to: bar, do: strum 100ms", "0 C4 1, 0.1 E4 1, 0.2 G4 1"),
        ("rhythm: '~ c4.maj', to: bar, do: strum -100ms", "2 G4 2, 2.2 E4 2, 2.4 C4 2"),
        ("rhythm: 'c4.maj ~', to: bar, do: arp up 1/8",
         "0 C4 0.5, 0.5 E4 0.5, 1 G4 0.5, 1.5 C4 0.5"),
        ("rhythm: '~ c4', to: bar, do: grace 1/16 2st", "1.75 c4+2 0.25, 2 c4 2"),
        ("rhythm: 'c4 ~ e4 _', to: bar, do: legato 0.5", "0 c4 1, 2 e4 1"),
        ("rhythm: 'c4 ~, kick*4', to: bar, do: legato 1",
         "0 c4 4, 0 kick 1, 1 kick 1, 2 kick 1, 3 kick 1"),
    ],
)  # fmt: skip
def test_strokes_of_a_bar(fields, expected):
    assert falls(f"{fields}, at: 0, times: 1") == expected.split(", ")


def impulses(fields: str) -> list[float]:
    """The impulse of each stroke [mN·s]."""
    return [1000 * hit.level.impulse(hit.impulse_range, max) for _, hit in hits(fields)]


def strength(value: float) -> float:
    """The impulse [mN·s] of a strength of the bar."""
    return 4.0**value


F, P = strength(5 / 7), strength(2 / 7)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        # The strokes of one note are as strong as it is, and levels go on from note to note.
        ("rhythm: 'c4 e4', do: tremolo 2", [F, F, P, P]),
        ("rhythm: 'c4 e4', do: tremolo 1Hz", [F, F, P]),
        ("rhythm: 'c4.maj e4', do: strum 1ms", [F, F, F, P]),
        ("rhythm: 'c4 e4', do: rolled", [F, P]),
        ("rhythm: '~ c4 e4', do: grace 1/16", [F / 2, F, P / 2, P]),
        ("rhythm: 'c4 e4', do: 'grace 1/16'", [F, P / 2, P, F / 2]),
        ("rhythm: 'c4:ppp e4', do: tremolo 2", [1.0, 1.0, P, P]),
        ("rhythm: 'c4 e4, [f4 ~ ~ ~]', do: tremolo 2", [F, P, P, F, F, F]),
        # An arpeggio has notes of its own, as `ply` has strokes.
        ("rhythm: 'c4.maj', do: arp up", [F, P, F]),
        ("rhythm: 'c4 ~', do: ply 2", [F, P]),
        # In the reach of an instrument a roll rises evenly in strength.
        ("rhythm: 'c4 ~', do: roll 3", [F / 4, F / 2, F]),
        # A second at 2.5 Hz: three strokes.
        ("rhythm: '~ c4', do: roll 2.5Hz 1/4 1", [F / 4, F / 2, F]),
    ],
)
def test_levels_of_phrased_strokes(fields, expected):
    assert impulses(f"{fields}, to: bar, at: 0, times: 1, impulse: f p") == pytest.approx(expected)


@pytest.mark.parametrize(
    "do",
    ["strum 300ms", "tremolo 3Hz", "roll 11Hz, strum 1s", "grace 1/3 1st", "legato 1, arp up 1/8"],
)
def test_same_strokes_from_the_middle(do):
    """Strokes between two beats are those of the entire rhythm, also where a note began before."""
    score = piece(
        f"rhythm: '<c4.maj e4/3 [a4? c5]>*3 [e4|g4.min7]', to: bar, at: 1, times: 40, do: '{do}'"
    )
    strikes = score.strikes[0]
    every = sorted(strikes.played_hits(score), key=lambda fall: fall[:2])
    assert len(every) > 100
    for since, before in [(0.0, 9.0), (17.3, 50.0), (130.0, 1e9), (33.0, 33.0)]:
        part = [fall for fall in every if since - 1e-9 <= fall[0] < before - 1e-9]
        played = sorted(strikes.played_hits(score, since, before), key=lambda fall: fall[:2])
        assert played == part
    numbers = {(number, hit.to) for _, number, hit in every}
    assert len(numbers) == len(every)  # each draws by itself


def damper(fields: str) -> list[tuple[float, float]]:
    """The strikes on dampers: instants [s] and directions; those on the bar are stronger."""
    staged = stage(piece(f"{fields}, to: bar, at: 0", DAMPED_BAR + "tempo: {bpm: 60}\n"))
    each = (staged.timeline.strikes_on(mat) for mat in range(staged.network.n_mat))
    strikes = [(round(e.at, 9), e.impulse / 0.02) for some in each for e in some]
    return sorted(strike for strike in strikes if abs(strike[1]) < 2)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ("'c4 ~ c4 ~', times: 1, do: legato 0.3", [(0, -1), (0.6, 1), (2, -1), (2.6, 1)]),
        ("'c4 ~ c4 ~', times: 1, do: legato 1", [(0, -1), (2, 1), (2, -1), (4, 1)]),
        # A rest at the beginning of the next bar ties the note over its line.
        (
            "'<[~ ~ ~ c4] [~ c4 ~ ~]>', times: 2, do: legato 1",
            [(3, -1), (5, 1), (5, -1), (11, 1)],
        ),
        ("'c4 ~', times: 1, do: tremolo 2", [(0, -1), (1, 1), (1, -1), (2, 1)]),
        (
            "'c4 ~', times: 1, do: [tremolo 1Hz, legato 1/8]",
            [(0, -1), (0.125, 1), (1, -1), (1.125, 1)],
        ),
    ],
)
def test_notes_end_at_the_damper(fields, expected):
    assert damper(f"rhythm: {fields}") == sorted(expected)


@pytest.mark.parametrize(
    ("fields", "code", "part"),
    [
        ("rhythm: kick, cycle: 100, do: tremolo 100Hz", "E305", "more than 4,096 strokes"),
        ("rhythm: kick, do: grace 1/16 1st", "E306", "no note that could be transposed"),
        ("rhythm: c4, to: bar, do: grace 1/16 -1st", "E301", "has no note 'B3'"),
        ("rhythm: kick, do: strum 2s", "E204", "a time up to a second"),
        ("rhythm: kick*1000, do: tremolo 5", "E306", "up to 5,000 steps"),
        ("rhythm: kick*4, do: 'legato 1, tremolo 300'", "E306", "steps"),
    ],
)
def test_phrasing_field_mistakes(fields, code, part):
    loaded = check(f"{PLAYED}strikes: {{s: {{{fields}, at: 0, times: 1}}}}\n")
    (error,) = [each for each in loaded.diagnostics if each.severity == "error"]
    assert part in error.message
    assert error.code == code


# --- strikes by the clock -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ("to: kick, every: 1, times: 2, do: ply 2", "0 x 0.5, 0.5 x 0.5, 1 x 0.5, 1.5 x 0.5"),
        ("to: kick, every: 1/2, for: 2, do: every 2 degrade 1", "0.5 x 0.5, 1.5 x 0.5"),
        ("to: kick, euclid: 3 8, every: 1/2, do: rev", "0.5 x 0.5, 2 x 0.5, 3.5 x 0.5"),
        ("to: bar, notes: C4 ~ E4, every: 1, do: legato 1", "0 C4 2, 2 E4 1"),
        ("to: bar, notes: C4 ~ E4, every: 1, times: 2, do: legato 1/2",
         "0 C4 1, 2 E4 0.5, 3 C4 1, 5 E4 0.5"),
        ("to: bar, notes: C4 (E4 G4), every: 1, do: 'transpose 12st, rev'",
         "0 G4+12 0.5, 0.5 E4+12 0.5, 1 C4+12 1"),
        ("to: bar, notes: C4.minor-pentatonic, every: 1/2, do: fast 1",
         "0 C4 0.5, 0.5 D#4 0.5, 1 F4 0.5, 1.5 G4 0.5, 2 A#4 0.5"),
    ],
)  # fmt: skip
def test_do_of_strikes_by_the_clock(fields, expected):
    assert falls(f"{fields}, at: 0") == expected.split(", ")


@pytest.mark.parametrize(
    "fields",
    [
        "to: [kick, bar.C4], every: 1/3, times: 7, impulse: f p",
        "to: kick, every: 1/3, times: 8, impulse: f 2mNs 0.3",
        "to: bar, notes: C4 (E4 G4) ~ C5, every: 1/2, times: 3, impulse: f!",
        "to: kick, euclid: 5 8 rotate 2, times: 3",
        "to: bar, notes: D4, euclid: 3 8, every: 1/2, until: 7|2.5",
    ],
)
def test_do_without_effect_on_strikes(fields):
    ergons = []
    for do in ("", ", do: fast 1"):
        staged = stage(piece(f"{fields}, at: 1|2{do}"))
        each = (staged.timeline.strikes_on(mat) for mat in range(staged.network.n_mat))
        ergons.append([sorted((e.at, e.impulse) for e in strikes) for strikes in each])
    assert len([ergon for strikes in ergons[0] for ergon in strikes]) > 6
    for before, after in zip(*ergons, strict=True):
        assert [time for ergon in after for time in ergon] == pytest.approx(
            [time for ergon in before for time in ergon]
        )


def test_do_with_named_values():
    text = PLAYED + "let: {fifth: 7st}\n"
    for fields in ("rhythm: c4", "notes: C4, every: 1", "play: call"):
        do = "transpose fifth, legato 0.5"
        phrase = "phrases: {call: {entries: '0 C4 mf'}}\n"
        loaded = check(
            f"{text}{phrase}strikes: {{s: {{{fields}, to: bar, at: 0, times: 1, do: '{do}'}}}}\n"
        )
        assert loaded.piece is not None, loaded.diagnostics
        assert [target.part for target in loaded.piece.strikes[0].to] == ["bar.G4"]


def test_walk_under_do_visits_neighbours():
    fields = "to: bar, notes: walk C4 E4 G4, every: 1, times: 400, at: 0, do: fast 1"
    places = [["C4", "E4", "G4"].index(hit.struck_text) for _, hit in hits(fields)]
    assert places[0] == 0
    assert {b - a for a, b in pairwise(places)} == {-1, 0, 1}


@pytest.mark.parametrize(
    ("fields", "code", "part"),
    [
        ("to: kick, do: rev", "E306", "no cycle to transform"),
        ("to: kick, rate: 3Hz, for: 4, do: rev", "E306", "no cycle to transform"),
        ("to: kick, every: 1, times: 3, do: revv", "E204", "unknown transformation 'revv'"),
        ("to: bar, notes: shuffle C4 E4, every: 1, do: rev", "E306", "in a new order"),
        ("to: bar, notes: walk C4 E4, euclid: 3 8, do: rev", "E306", "at each pulse"),
        ("to: bar, notes: C4 E4, every: 1, swing: 0.6, do: rev", "E306", "use do swing"),
        ("to: bar, notes: C4 C9, every: 1, do: rev", "E301", "has no note 'C9'"),
        ("to: bar, notes: C4, every: 1, times: 2, do: transpose 40st", "E301", "has no note"),
        ("to: kick, every: 1, times: 4, impulse: p -> f, do: rev", "E306", "a line of levels"),
    ],
)
def test_mistakes_of_do_on_strikes_by_clock(fields, code, part):
    loaded = check(f"{PLAYED}strikes: {{s: {{{fields}, at: 0}}}}\n")
    (error,) = [each for each in loaded.diagnostics if each.severity == "error"]
    assert part in error.message
    assert error.code == code
