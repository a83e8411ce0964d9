"""Strikes by what passes an instrument: fronts and heads, against a search in small steps."""

from math import cos, hypot, log, pi, sin
from pathlib import Path

import numpy as np
import pytest
from checked import check, check_reports
from sessions import Stepped
from sweep import few

from ergon.notation.text.errors import Collector
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.sweep_fields import SWEEPS
from ergon.scores.staging.built_network import BuiltNetwork, build_network
from ergon.scores.staging.stage import stage
from ergon.scores.staging.striking import ALL_INSTANTS, Striking

SCORE = """\
ergon: 1
seed: 5
tempo: [{at: 1|1, bpm: 120}, {at: 5|1, bpm: 120 -> 90, over: 8}]
instruments:
  sky:
    BANK: {count: 300, M: 0.5g, f: 60Hz..6kHz, t60: 0.2s..1s, place: galaxy, hole: 0.3}
    out: {SOX: sky.all}
  gong: {PLATE: {radius: 4, shape: disc, M: 1kg, f: 90Hz, t60: 2s}, out: {SOX: gong.all}}
strikes:
"""
SERPENT = "path: 1 0deg -> 0.3 1080deg, width: 0.1"


def piece(*lines: str) -> Piece:
    loaded = check(SCORE + "".join(f"  {line}\n" for line in lines))
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


class Struck:
    """A timeline that keeps what is struck."""

    def __init__(self) -> None:
        self.strikes: list[tuple[float, int, float]] = []

    def strike(self, mat: int, stepped_session: float, impulse: float, **more: object) -> None:
        self.strikes.append((stepped_session, mat, impulse))


def struck(
    created: Piece, within: tuple[float, float] = ALL_INSTANTS
) -> list[tuple[float, int, float]]:
    """(instant [s], MAT, impulse) of all strikes, as they are put on the timeline."""
    built, collector, timeline = built_of(created), Collector(), Struck()
    for item in created.strikes:
        mats = [mat for target in item.to for mat in built.assembly.members(target)]
        Striking(created, timeline, item, mats, 0, within, built.assembly).play(collector)  # type: ignore[arg-type]
    assert not collector.has_errors()
    return timeline.strikes


def built_of(made: Piece) -> BuiltNetwork:
    return build_network(made, ())


def places(created: Piece, part: str) -> dict[int, tuple[float, float]]:
    """Where the MATs of a part are, the distance of the farthest being 1."""
    built = built_of(created)
    (first,) = (mat for (name, _), mat in built.assembly.mats.items() if name == part)
    count = built.network.count(first)
    item = {mat: built.network.position_of(mat) for mat in range(first, first + count)}
    radius = max(hypot(x, y) for x, y in item.values())
    return {mat: (x / radius, y / radius) for mat, (x, y) in item.items()}


@pytest.mark.parametrize(
    ("direction", "measure"),
    [
        ("outward", lambda x, y: hypot(x, y)),
        ("inward", lambda x, y: -hypot(x, y)),
        ("rightward", lambda x, y: x),
        ("leftward", lambda x, y: -x),
        ("forward", lambda x, y: y),
        ("backward", lambda x, y: -y),
    ],
)
@pytest.mark.parametrize("part", ["sky", "gong"])
def test_sweep_strikes_each_member_once(part, direction, measure):
    built = piece(f"s: {{to: {part}.all, at: 2|1, for: 4, sweep: {direction}, impulse: 1mNs}}")
    where = places(built, part)
    values = {mat: measure(*place) for mat, place in where.items()}
    low, high = min(values.values()), max(values.values())
    hits = struck(built)
    assert sorted(mat for _, mat, _ in hits) == sorted(where)
    for instant, mat, _ in hits:  # from second 2 on, for 2 seconds
        assert instant == pytest.approx(2 + 2 * (values[mat] - low) / (high - low), abs=1e-9)
    assert [instant for instant, *_ in hits] == sorted(instant for instant, *_ in hits)


def test_sweep_clockwise_and_anticlockwise_angles():
    built = piece("s: {to: sky.all, at: 1|1, for: 4, sweep: anticlockwise, impulse: 1mNs}")
    where = places(built, "sky")
    for instant, mat, _ in struck(built):
        x, y = where[mat]
        turn = pi * instant  # 2 s a turn
        assert (sin(-turn) * hypot(x, y), cos(turn) * hypot(x, y)) == pytest.approx(
            (x, y), abs=1e-9
        )
    back = piece("s: {to: sky.all, at: 1|1, for: 4, sweep: clockwise, impulse: 1mNs}")
    ahead = {mat: instant for instant, mat, _ in struck(built)}
    assert all(
        stepped_session == pytest.approx(2 - ahead[mat]) for stepped_session, mat, _ in struck(back)
    )


def test_sweep_by_pitch_is_logarithmic():
    built = piece("s: {to: sky.all, at: 1|1, for: 4, sweep: upward, impulse: 1mNs}")
    network = built_of(built).network
    modes = [mode.f for mode in network.modes("sky", 300)]  # of single cells, from low to high
    hits = struck(built)
    shares = [log(f / modes[0]) / log(modes[-1] / modes[0]) for f in modes]
    assert [instant for instant, *_ in hits] == pytest.approx(
        [2 * share for share in shares], abs=1e-4
    )


def searched(where: dict[int, tuple[float, float]], points, width: float, n: int = 60_000):
    """(share, MAT) of each time that a head is nearest to a MAT that it comes near to."""
    steps = np.arange(n + 1) / n
    leg = np.minimum((steps * (len(points) - 1)).astype(int), len(points) - 2)
    part = steps * (len(points) - 1) - leg
    ends = np.array(points)
    radius, azimuth = (ends[leg] + part[:, None] * (ends[leg + 1] - ends[leg])).T
    x, y = -radius * np.sin(np.radians(azimuth)), radius * np.cos(np.radians(azimuth))
    result = []
    for mat, (mx, my) in where.items():
        away = np.hypot(x - mx, y - my)
        near = np.flatnonzero(away <= width / 2)
        for run in np.split(near, np.flatnonzero(np.diff(near) > 1) + 1) if len(near) else ():
            result.append((steps[run[np.argmin(away[run])]], mat))
    return sorted(result)


@pytest.mark.parametrize(
    ("path", "points", "width"),
    few(
        [
            ("1 0deg -> 0.3 1080deg", [(1, 0), (0.3, 1080)], 0.1),
            ("1 30deg -> 1 -330deg", [(1, 30), (1, -330)], 0.3),
            ("1 90deg -> 1 90.001deg -> 0 90deg", [(1, 90), (1, 90.001), (0, 90)], 0.5),
            ("0.9 0deg -> 0.4 200deg -> 0.9 -200deg", [(0.9, 0), (0.4, 200), (0.9, -200)], 0.08),
        ],
        3,
    ),
)
@pytest.mark.parametrize("part", ["sky", "gong"])
def test_path_strikes_nearest_members_within_width(part, path, points, width):
    line = f"path: {path}, width: {width}, impulse: 1mNs"
    built = piece(f"s: {{to: {part}.all, at: 1|1, for: 8, {line}}}")
    hits = [(instant / 4, mat) for instant, mat, _ in struck(built)]
    # A member at the very edge of the width may be passed by one and not by the other.
    sure = searched(places(built, part), points, width * 0.995)
    limit = searched(places(built, part), points, width * 1.005)
    assert len(hits) >= 3
    assert sure
    assert {mat for _, mat in sure} <= {mat for _, mat in hits} <= {mat for _, mat in limit}
    # The chords of 2° leave the way by so little that the nearest moment is off by 1/100 at most;
    # where the head turns back it may come near twice to a member at the edge of the width.
    assert all(is_among(limit, share, mat, 0.01) for share, mat in hits)
    assert all(is_among(hits, share, mat, 0.02) for share, mat in sure)


def is_among(visits: list[tuple[float, int]], share: float, mat: int, tolerance: float) -> bool:
    return any(
        mat == other and abs(share - stepped_session) < tolerance
        for stepped_session, other in visits
    )


def test_sweep_rounds_follow_tempo():
    built = piece(
        "s: {to: sky.all, at: 4|1, for: 8, every: 8, times: 2, sweep: inward, impulse: 1mNs}"
    )
    tempo, hits = built.tempo_map, struck(built)
    assert len(hits) == 600
    first, second = hits[:300], hits[300:]
    assert first[0][0] == tempo.seconds(12.0)
    assert first[-1][0] == pytest.approx(tempo.seconds(20.0))
    assert second[-1][0] == pytest.approx(tempo.seconds(28.0))
    for (position, mat, _), (again, other, _) in zip(first, second, strict=True):
        assert mat == other
        share = (beat(tempo, position) - 12.0) / 8.0
        assert again == pytest.approx(tempo.seconds(20.0 + 8.0 * share), abs=1e-6)


def beat(tempo, instant: float) -> float:
    """The beat of an instant, by bisection."""
    low, high = 0.0, 100.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if tempo.seconds(middle) < instant else (low, middle)
    return low


def test_sweep_until_completes_begun_round():
    line = "to: sky.all, at: 1|1, for: 4, every: 4, sweep: inward, impulse: 1mNs"
    built = piece(f"s: {{{line}, until: 2|3}}")
    hits = struck(built)
    assert len(hits) == 600
    assert hits[-1][0] == pytest.approx(4.0)


def test_sweep_chance_and_impulses_by_member():
    line = "to: sky.all, at: 1|1, for: 4, sweep: inward"
    complete = struck(piece(f"s: {{{line}, impulse: -1mNs..1mNs}}"))
    some = struck(piece(f"s: {{{line}, chance: 40%, impulse: -1mNs..1mNs}}"))
    assert 80 < len(some) < 160  # of 300: 120 ± 8.5
    assert set(some) < set(complete)  # the same instants and impulses
    assert min(one[2] for one in complete) < -0.8e-3 < 0.8e-3 < max(one[2] for one in complete)


def test_sweep_strikes_within_window():
    built = piece(
        f"s: {{to: sky.all, at: 1|1, for: 8, every: 8, times: 3, {SERPENT}, impulse: 1uNs..2uNs}}"
    )
    complete = struck(built)
    inside = struck(built, (1.5, 5.25))
    assert inside == [one for one in complete if 1.5 <= one[0] < 5.25]
    assert len(inside) > 100


def test_sweep_with_mass_and_speed_equals_impulse():
    line = "to: sky.all, at: 1|1, for: 4, sweep: inward"
    staged = [
        stage(piece(f"s: {{{line}, {how}}}")) for how in ("impulse: 1mNs", "mass: 1g, speed: 1m/s")
    ]
    counts = [one.simulation.process(np.zeros((2000, one.simulation.n_out))) for one in staged]
    assert counts[0] == counts[1]


def test_sweep_inward_raises_spectral_centroid():
    """A front that goes from the rim of a galaxy to its hole is heard to rise."""
    built = piece("s: {to: sky.all, at: 1|1, for: 4, sweep: inward, impulse: 1mNs}")
    staged = stage(built)
    out = np.zeros((2 * int(built.rate), staged.simulation.n_out))
    staged.simulation.process(out)
    assert np.abs(out[:1000]).max() > 0
    low, high = (np.abs(np.fft.rfft(part[:, 0])) for part in (out[:8000], out[-8000:]))
    centre = [float((np.arange(len(one)) * one).sum() / one.sum()) for one in (low, high)]
    assert centre[1] > 2 * centre[0]  # the low ones lie at the rim of a galaxy


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("to: sky.all, at: 1|1, sweep: inward, impulse: 1mNs", "E103", "has no 'for'"),
        ("at: 1|1, for: 4, sweep: inward, impulse: 1mNs", "E103", "has no 'to'"),
        ("to: sky.all, at: 1|1, for: 4, sweep: inwards, impulse: 1mNs", "E206", "is not one of"),
        ("to: gong.all, at: 1|1, for: 4, sweep: upward, impulse: 1mNs", "E304", "no pitch each"),
        ("to: sky.all, at: 1|1, for: 4, sweep: inward, rate: 2Hz, impulse: 1mNs", "E111", "rate"),
        ("to: sky.all, at: 1|1, for: 4, sweep: inward, width: 1, impulse: 1mNs", "E111", "width"),
        (
            "to: sky.all, at: 1|1, for: 4, every: 1, width: 1, impulse: 1mNs",
            "E111",
            "needs `path` beside it",
        ),
        (
            "to: sky.all, at: 1|1, for: 4, sweep: inward, path: 1 0deg -> 0 0deg, impulse: 1mNs",
            "E111",
            "path",
        ),
        ("to: sky.all, at: 1|1, for: 4, path: 1 0deg, impulse: 1mNs", "E106", "2 to 1,000 points"),
        (
            "to: sky.all, at: 1|1, for: 4, path: 1 0deg -> 0.3, impulse: 1mNs",
            "E201",
            "a radius and an angle",
        ),
        ("to: sky.all, at: 1|1, for: 4, path: 1 0deg -> 0.3 9mm, impulse: 1mNs", "E203", "mm"),
        (
            "to: sky.all, at: 1|1, for: 4, path: 1 0deg -> 1 36000deg -> 1 0deg, impulse: 1mNs",
            "E202",
            "100 times",
        ),
        ("to: sky.all, at: 1|1, for: 4, sweep: inward, mass: 1g", "E103", "both mass and speed"),
        (
            "to: sky.all, at: 1|1, for: 4, every: 0, times: 3, sweep: inward, impulse: 1mNs",
            "E305",
            "above 0",
        ),
        (
            "to: sky.all, at: 1|1, for: 4, every: 1/9, times: 99999, sweep: inward, impulse: 1mNs",
            "E105",
            "strikes",
        ),
    ],
)
def test_sweep_mistakes_codes_and_lines(line, code, words):
    reports = check_reports(SCORE + f"  s: {{{line}}}\n")
    assert [(one, stepped_session) for one, stepped_session, _ in reports] == [(code, 10)], reports
    assert words in reports[0][2]


def test_sweep_by_pitch_of_springless_cell_is_refused():
    text = "ergon: 1\ninstruments:\n  a: {CEL: {M: 1g, K: 0, Z: 1Ns/m}, out: {SOX: a}}\n"
    text += "strikes: {s: {to: a, at: 1|1, for: 4, sweep: upward, impulse: 1mNs}}\n"
    loaded = check(text)
    assert loaded.piece is not None
    with pytest.raises(Exception, match="a has no pitch, so a sweep by pitch cannot reach it"):
        stage(loaded.piece)


def test_sweep_directions_cover_every_quantity():
    assert {quantity for quantity, _ in SWEEPS.values()} == {"radius", "angle", "x", "y", "pitch"}
    assert all(list(SWEEPS.values()).count((q, up)) == 1 for q, up in SWEEPS.values())


# --- at the prompt --------------------------------------------------------------------------------

TYPED = """\
ergon: 1
tempo: [{at: 1|1, bpm: 240}]
instruments:
  sky:
    BANK: {count: 12, M: 1g, f: 200Hz..3kHz, t60: 0.1s..0.2s, place: galaxy}
    out: {SOX: sky.all}
"""


@pytest.fixture
def stepped_session(tmp_path: Path):
    stepped = Stepped(TYPED, tmp_path)
    yield stepped
    stepped.close()


def test_sweep_typed_saved_and_replayed_as_scene(stepped_session):
    stepped_session.ok("play")
    stepped_session.ok("front strikes sky.all sweep inward for 2 every 1bar impulse 1mNs")
    stepped_session.ok(
        "worm strikes sky.all path 1 0deg -> 0.3 720deg width 0.3 for 4 every 2bar impulse 1mNs"
    )
    stepped_session.run(4.5)
    (front, worm) = stepped_session.session.schedule.head.piece.strikes
    assert front.passing is not None
    assert front.passing.sweep == "inward"
    assert worm.passing is not None
    assert worm.passing.path == ((1.0, 0.0), (0.3, 720.0))
    assert np.abs(stepped_session.sound).max() > 0
    stepped_session.ok("keep 2bar as verse")
    saved = (stepped_session.journal.with_name("verse.yaml")).read_text()
    assert "for: 2" in saved
    assert "sweep: inward" in saved
    assert "path: 1 0deg -> 0.3 720deg" in saved
    stepped_session.ok("rest front\nrest worm")
    stepped_session.run(3.0)
    silence = stepped_session.sound[-int(0.4 * stepped_session.rate) :]
    assert np.abs(silence).max() < 1e-9
    stepped_session.ok("scene verse")
    stepped_session.run(4.0)
    assert np.abs(stepped_session.sound[-int(2.0 * stepped_session.rate) :]).max() > 1e-6
    again = [
        strike
        for strike in stepped_session.session.schedule.head.piece.strikes
        if strike.passing is not None
    ]
    assert {one.passing.sweep for one in again if one.passing} == {"inward", None}
    stepped_session.ok("undo")
    stepped_session.run(0.5)
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("front strikes sky.all sweep inside for 2 impulse 1mNs", "is not one of"),
        ("front strikes sky.all path 1 0deg -> for 2 impulse 1mNs", "'path' needs a value"),
        ("front strikes sky.all sweep inward impulse 1mNs", "has no 'for'"),
    ],
)
def test_sweep_lines_with_mistakes_are_refused(stepped_session, line, message):
    reply = stepped_session.type(line)
    assert not reply.taken
    assert message in reply.text
