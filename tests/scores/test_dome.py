"""Radius and pitch reach the nearest loudspeaker: layouts by angles, `place`, a galaxy's hole."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ergon import _core
from ergon.instruments.model import Layout, Placing
from ergon.scores.reading.load import Loaded, load
from ergon.scores.staging.built_network import build_network
from ergon.scores.staging.loudspeakers import Loudspeakers
from ergon.scores.staging.stage import stage

SCORE = """\
ergon: 1
instruments:
  sky:
    BANK: {count: 400, f: 20Hz..10kHz, t60: 1s, M: 1g, %s}
    out: {SOX: sky.all}
    %s
strikes: {s: {to: sky.%d, at: 1|1, impulse: 1uNs}}
mix: {layout: %s, route: {from: sky, to: nearest}}
"""


def scored(bank: str, lying: str, member: int = 0, layout: str = "layouts/dome24.yaml") -> Loaded:
    return load("a.yaml", text=SCORE % (bank, lying, member, layout))


def sounding(bank: str, lying: str, member: int, layout: str = "layouts/dome24.yaml") -> set[int]:
    """Loudspeakers, from 0, that are heard when one member is struck."""
    loaded = scored(bank, lying, member, layout)
    assert loaded.piece is not None, loaded.diagnostics
    staged = stage(loaded.piece)
    frames = np.zeros((2000, staged.simulation.n_out))
    staged.simulation.process(frames)
    sound = np.zeros((2000, staged.n_channels))
    staged.mixer().process(frames, sound)
    return {int(channel) for channel in np.flatnonzero(np.abs(sound).max(0))}


def dome() -> Layout:
    piece = scored("place: galaxy", "").piece
    assert piece is not None
    assert piece.mix.layout is not None
    return piece.mix.layout


def galaxy(count: int, hole: float) -> list[tuple[float, float]]:
    network = _core.Network()
    network.part("sky")
    first = network.bank(
        "", count=count, M=1e-3, f=(20.0, 1e4), t60=(1.0, 2.0), spread="random", place="galaxy",
        hole=hole, seed=7,
    )  # fmt: skip
    return [network.position_of(first + i) for i in range(count)]


def rings(places: list[tuple[float, float]], placing: Placing | None) -> np.ndarray:
    """How many of 100 members are heard at the horizon, at 35° and at 70°."""
    ears = Loudspeakers(dome(), placing)
    counts = np.bincount([ears.nearest(place) for place in places], minlength=24)
    shares = [counts[:12].sum(), counts[12:20].sum(), counts[20:].sum()]
    return 100.0 * np.array(shares) / len(places)


def test_galaxy_place_covers_dome_rings():
    """Its hole decides how many are overhead; without `across` all of them are."""
    across = Placing(6.0, (0.0, 0.0), None)
    np.testing.assert_allclose(rings(galaxy(4000, 0.3), across), (11, 50, 39), atol=2.0)
    np.testing.assert_allclose(rings(galaxy(4000, 0.1), across), (3, 13, 84), atol=2.0)
    assert rings(galaxy(400, 0.3), None)[2] == 100.0


def test_galaxy_place_maps_pitch_to_height():
    lying = "place: {across: 6m}"
    assert min(sounding("place: galaxy", lying, 0)) < 12
    assert min(sounding("place: galaxy", lying, 399)) >= 20
    assert min(sounding("place: galaxy, hole: 1", lying, 399)) < 12, "no hole: all at the rim"


def test_place_at_and_height_select_loudspeakers():
    behind = sounding("place: galaxy", "place: {across: 0.1m, at: [0m, -3m]}", 0)
    right = sounding("place: galaxy", "place: {across: 0.1m, at: [3m, 0m]}", 0)
    above = sounding("place: galaxy", "place: {across: 6m, height: 30m}", 0)
    assert (behind, right) == ({6}, {9})
    assert min(above) >= 20


def test_place_height_is_apart_from_plan_angle():
    """3 m to the right and 3.5 m high is nearest to the ring at 35°."""
    (listened,) = sounding(
        "place: galaxy", "place: {across: 0.1m, at: [2.5m, 0.6m], height: 1.7m}", 0
    )
    assert 12 <= listened < 20


def test_flat_layout_nearest_by_angle_only():
    """A flat layout, on the bench: the angle alone decides, at whatever distance."""
    layout = "layouts/ring24.yaml"
    for member in (0, 7, 50):
        x, y = _spiral(member, 400)
        angle = np.degrees(np.arctan2(y, x)) % 360.0
        wanted = round(angle / 15.0) % 24
        assert sounding("place: spiral", "", member, layout) == {wanted}


def _spiral(i: int, count: int) -> tuple[float, float]:
    radius, angle = 0.5 * np.sqrt((i + 0.5) / count), 2.399963229728653 * i
    return radius * np.cos(angle), radius * np.sin(angle)


def test_layout_by_angles_equals_layout_by_places(tmp_path: Path):
    """Seen from above, as files without `project` are."""
    (tmp_path / "angles.yaml").write_text(
        "ergon: 1\nspeakers: [{az: 45, r: 2m}, {az: -45deg, el: 30deg}, [1m, -1m], {az: 180}]\n"
    )
    text = SCORE % ("place: line", "", 0, "angles.yaml")
    loaded = load(tmp_path / "a.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    layout = loaded.piece.mix.layout
    assert layout is not None
    assert not layout.is_equidistant
    half = np.sqrt(0.5)
    wanted = [(-2 * half, 2 * half, 0), (half * 0.75**0.5, half * 0.75**0.5, 0.5), (1, -1, 0)]
    np.testing.assert_allclose(layout.speakers, [*wanted, (0, -1, 0)], atol=1e-12)


def _places(bank: str, seed: int = 0) -> np.ndarray:
    """The positions of the members of a bank on its bench, (n, 2)."""
    piece = scored(bank, "").piece
    assert piece is not None
    network = build_network(replace(piece, seed=seed), frozenset()).assembly.network
    return np.array([network.position_of(mat) for mat in range(network.n_mat)])


@pytest.mark.parametrize("bank", ["place: galaxy", "place: galaxy, hole: 0.5"])
def test_random_angles_of_a_galaxy_by_seed(bank: str):
    even, random = _places(bank), _places(f"{bank}, angles: random")
    np.testing.assert_allclose(np.hypot(*random.T), np.hypot(*even.T), rtol=1e-12)
    np.testing.assert_array_equal(random, _places(f"{bank}, angles: random"))
    other = _places(f"{bank}, angles: random", seed=8)
    assert not np.allclose(other, random)
    np.testing.assert_array_equal(even, _places(f"{bank}, angles: even", seed=8))
    turns = np.sort(np.arctan2(random[:, 1], random[:, 0]) / (2 * np.pi) + 0.5)
    n = len(turns)
    distance = np.abs(turns - (np.arange(n) + 0.5) / n).max() + 0.5 / n
    assert distance < 1.63 / np.sqrt(n)  # Kolmogorov and Smirnov: even over the circle, at 1 %


@pytest.mark.parametrize(
    ("bank", "lying", "code", "words"),
    [
        ("place: galxy", "", "E206", "galaxy"),
        ("place: galaxy, angles: randm", "", "E206", "random"),
        ("place: galaxy, hole: 0", "", "E202", "hole"),
        ("place: galaxy, hole: 2", "", "E202", "maximum"),
        ("place: galaxy", "place: {accross: 6m}", "E101", "across"),
        ("place: galaxy", "place: {across: -6m}", "E202", "across"),
        ("place: galaxy", "place: {at: [1m]}", "E106", "must be 2"),
        ("place: galaxy", "place: {at: [1m, 2s]}", "E203", "does not measure length"),
    ],
)
def test_place_mistakes_and_codes(bank: str, lying: str, code: str, words: str):
    result = [one for one in scored(bank, lying).diagnostics if one.severity == "error"]
    assert [one.code for one in result] == [code], result
    assert words in f"{result[0].message} {result[0].suggestion}"
    assert result[0].place.line in (4, 6)


def test_nearest_for_link_force_is_refused():
    text = SCORE % ("place: galaxy", "", 0, "layouts/dome24.yaml")
    modules = "wall: {SOL: {}}, m: {MAS: {M: 1g}}, spring: {RES: {between: [wall, m], K: 1N/m}}"
    spring = f"  spring: {{modules: {{{modules}}}, out: {{SOF: {{RES: spring}}}}}}\nstrikes:"
    text = text.replace("strikes:", spring).replace("from: sky", "from: spring")
    (result,) = (one for one in load("a.yaml", text=text).diagnostics if one.severity == "error")
    assert (result.code, result.place.line) == ("E304", 9)
    assert "`nearest` needs masses" in result.message
    named = load("a.yaml", text=text.replace("to: nearest", "to: 1"))
    assert named.piece is not None, named.diagnostics


def test_like_copies_and_overrides_place():
    """`like` brings `place`, and the copy may lie elsewhere."""
    text = SCORE % ("place: galaxy", "place: {across: 6m}", 0, "layouts/dome24.yaml")
    copies = "  same: {like: sky}\n  other: {like: sky, place: {at: [1m, 0m]}}\n"
    text = text.replace("strikes:", f"{copies}strikes:")
    loaded = load("a.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    placed = {name: one.placing for name, one in loaded.piece.instruments.items()}
    assert placed["same"] == Placing(6.0, (0.0, 0.0), None)
    assert placed["other"] is not None
    assert placed["other"].at == (1.0, 0.0)
