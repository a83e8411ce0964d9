"""`ergon.stats`: counts, totals, static answers and energies, against closed forms."""

from pathlib import Path

import numpy as np
import pytest

import ergon
from tests.api.test_tune import SCORE


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("bars.yaml").write_text(SCORE)
    return work_folder


def stats(part: str, **options: object) -> ergon.PartStats:
    (found,) = ergon.stats("bars.yaml", ergon.StatsOptions(parts=[part], **options))  # type: ignore[arg-type]
    return found


def test_stats_masses_and_links_of_chain():
    bar = stats("bar")
    assert (bar.n_masses, bar.n_held, bar.n_free) == (8, 1, 0)
    assert bar.mass == pytest.approx(31e-3)
    assert bar.masses == (3e-3, 5e-3)
    (springs,) = bar.links
    assert springs == ergon.LinkStats("REF", 8, (9e3, 20e3), (0.02, 1.0))
    assert len(bar.modes.poles) == bar.counts.sum() == 8
    assert bar.highest == pytest.approx(np.abs(bar.modes.poles[-1]) / (2 * np.pi), rel=1e-9)
    assert (bar.guarantee, bar.oversampling) == ("proved", 1)


def test_stats_third_octave_bands_of_modes():
    bar = stats("bar")
    lowest, highest = bar.modes.frequencies[[0, -1]]
    assert bar.third_octaves[0] / 2 ** (1 / 6) <= lowest <= bar.third_octaves[0] * 2 ** (1 / 6)
    assert bar.third_octaves[-1] / 2 ** (1 / 6) <= highest
    assert bar.third_octaves[1:] / bar.third_octaves[:-1] == pytest.approx(2 ** (1 / 3))


def test_stats_compliance_of_points_in_series_springs():
    out, struck = stats("bar").points  # through 9 kN/m and seven, or three, of 20 kN/m
    assert out.compliance == pytest.approx(1 / 9e3 + 7 / 20e3, rel=1e-8)
    assert struck.compliance == pytest.approx(1 / 9e3 + 3 / 20e3, rel=1e-8)
    assert (out.mass, struck.mass, struck.name) == (4e-3, 3e-3, "bar.m3")
    assert stats("k1").points == ()  # nothing plays it


def test_stats_compliance_of_free_body_infinite():
    free = stats("free")
    assert (free.n_held, free.n_free) == (0, 1)
    assert np.isinf(free.points[0].compliance)
    assert free.counts.sum() == 5
    assert free.points[0].shares[0] == pytest.approx(5e-3 / 24e-3, rel=1e-6)  # as one mass


def test_stats_mode_energy_shares_sum_to_one():
    for point in stats("wire").points:
        assert point.shares.sum() == pytest.approx(1.0, rel=1e-6)
    part = stats("wire", upto="1kHz")
    assert len(part.modes.poles) == len(part.points[0].shares) == 3
    shape = np.sin(np.pi * np.arange(1, 4) * 18 / 25) ** 2 * 2 / 25
    assert part.points[0].shares == pytest.approx(shape, rel=1e-6)
    wanted = shape @ part.modes.frequencies / shape.sum()
    assert part.points[0].centroid == pytest.approx(wanted, rel=1e-6)


def test_stats_of_every_part_with_massless_parts():
    result = ergon.stats("bars.yaml")
    assert [part.part for part in result] == [
        "k1",
        "bar",
        "free",
        "wire",
        "soft",
        "discrete",
        "bowl",
        "wall",
    ]
    wall = result[-1]
    assert (wall.n_masses, wall.n_held, wall.mass, wall.highest) == (0, 1, 0.0, 0.0)
    assert result[4].links[0].kind == "LNL"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parts": ["barr"]}, "parts: no instrument or key is called 'barr'; did you mean 'bar'?"),
        ({"upto": "h3"}, "upto: 'h3' is neither a frequency"),
    ],
)
def test_stats_refuses_wrong_parts_and_options(options: dict, message: str):
    with pytest.raises(ergon.OptionError) as refused:
        ergon.stats("bars.yaml", ergon.StatsOptions(**options))
    assert str(refused.value).startswith(message)


def test_stats_mode_mass_of_modes_module(work_folder: Path):
    """Its mass M is that of a mode: a strike at a place moves it by its level over M."""
    body = "{M: 150g, f: [220Hz, 447Hz], t60: [4s, 3s], places: {rim: [1, 0.5], waist: [0.4, -1]}}"
    Path("modes.yaml").write_text(
        "ergon: 1\ninstruments:\n"
        f"  one: {{modules: {{b: {{MODES: {body}}}}}, out: {{SOX: b.rim}}}}\n"
        "strikes: {a: {to: one.b.rim, at: 0.02s, impulse: 2mNs}}\nrender: {tail: 1s}\n"
    )
    (part,) = ergon.stats("modes.yaml")
    assert part.mode_masses == {"b": 0.15}
    shapes = part.modes.points["out"][:2].real
    assert np.abs(shapes) == pytest.approx(np.array([1, 0.5]) / np.sqrt(0.15), rel=1e-3)
    assert stats("bar").mode_masses == {}


def test_stats_compliance_of_mass_with_damper_only(work_folder: Path):
    """What a spring holds beside it gives way as without it."""
    Path("loose.yaml").write_text(
        "ergon: 1\ninstruments:\n  one:\n    modules:\n"
        "      m: {CEL: {M: 5g, f: 200Hz, t60: 1s}}\n      loose: {MAS: {M: 60g}}\n"
        "      d: {FRO: {between: [m, loose], Z: 0.04Ns/m}}\n    out: {SOX: [m, loose]}\n"
        "strikes: {a: {to: one.m, at: 0.02s, impulse: 2mNs}}\nrender: {tail: 1s}\n"
    )
    (part,) = ergon.stats("loose.yaml")
    arguments = {point.name: point.compliance for point in part.points}
    assert arguments["one.m"] == pytest.approx(1 / (5e-3 * (2 * np.pi * 200) ** 2), rel=1e-3)
    assert sorted(np.isinf(x) for x in arguments.values()) == [False] * (len(arguments) - 1) + [
        True
    ]


@pytest.mark.parametrize(
    ("values", "stiffness"), [("M: 1, K: 1, Z: 1", 1), ("M: 2, K: 8, Z: 2", 8)]
)
def test_stats_compliance_of_discrete_body_at_rest(values: str, stiffness: int):
    """Its poles have no logarithm, and the static answer was asked for at no frequency."""
    score = "ergon: 1\ninstruments:\n  body:\n    units: ca\n    at: 44100Hz\n"
    score += f"    modules: {{m: {{CEL: {{{values}}}}}}}\n    out: {{SOX: m}}\n"
    Path("bars.yaml").write_text(score)
    body = stats("body")
    assert body.points[0].compliance == pytest.approx(1 / stiffness, rel=1e-6)
