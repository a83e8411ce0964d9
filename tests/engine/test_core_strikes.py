"""Strikes: exact between samples, and rains whose every drop is keyed by name."""

import hashlib
import math

import numpy as np
import pytest
from oracle.core import deviation, play, simulation
from oracle.scene import Scene

from ergon import _core

RATE = 44100.0
MASK = (1 << 128) - 1
MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645  # PCG's own for 128 bits (O'Neill 2014)


@pytest.mark.parametrize(("f", "t60"), [(440.0, 1.0), (5000.0, 0.3), (15000.0, 0.1)])
@pytest.mark.parametrize("late", [0.0, 1e-6, 0.3, 0.5, 0.999])
def test_strike_between_samples_on_cell_closed_form(f: float, t60: float, late: float):
    scene = Scene()
    scene.part("p")
    mat = scene.cel("m", M=2e-3, f=f, t60=t60)
    scene.listen("o", positions=[(mat, 1.0)])
    position = (100 + late) / RATE
    scene.strike(mat, position, impulse=1e-4)
    scene.strike(mat, position + 0.0137, impulse=-3e-5)
    out = play(simulation(scene, RATE), 4410)[:, 0]
    sigma, omega = 3.0 * math.log(10.0) / t60, 2.0 * math.pi * f
    wanted = np.zeros(4410)
    for when, p in ((position, 1e-4), (position + 0.0137, -3e-5)):
        t = np.maximum(np.arange(4410) / RATE - when, 0.0)
        wanted += p / (2e-3 * omega) * np.exp(-sigma * t) * np.sin(omega * t)
    assert np.abs(out - wanted).max() < 1e-9 * np.abs(wanted).max()


def test_strikes_on_all_kinds_of_mats_agree_with_the_oracle():
    """Isolated cell P0/P1; linked cell and mass split linearly; key and CA whole."""
    scene = Scene()
    scene.part("a")
    free = scene.cel("free", M=1e-3, f=330.0, t60=1.0)
    linked = scene.cel("linked", M=1e-3, f=550.0, t60=1.0)
    mass = scene.mas("mass", M=3e-3)
    scene.ref("r", linked, mass, K=400.0, Z=0.01)
    scene.part("k")
    key = scene.cel("m", M=0.4, K=60.0, Z=1.2)
    scene.part("ca", ca_rate=RATE)
    old = scene.cel("m", M=2.0, K=0.02, Z=1e-4)
    mats = (free, linked, mass, key, old)
    for i, mat in enumerate(mats):
        scene.listen(f"o{i}", positions=[(mat, 1.0)])
    scene.key("k", key)
    for i, mat in enumerate(mats):
        for j in range(20):
            scene.strike(mat, 0.01 + 0.017 * j + 0.0013 * i + 1e-6, impulse=1e-4 * (1 + j % 3))
    assert deviation(scene, RATE, 22050) < 1e-12


@pytest.mark.parametrize(
    "arguments",
    [
        {"start": -1.0, "impulse": 1.0},
        {"start": math.nan, "impulse": 1.0},
        {"start": 0.1, "impulse": math.inf},
        {"start": 0.1},
        {"start": 0.1, "mass": 1e-3},
        {"start": 0.1, "mass": -1e-3, "speed": 1.0},
    ],
    ids=["early", "when", "infinite", "nothing", "still", "negative"],
)
def test_strike_refuses_invalid_arguments(arguments: dict[str, float]):
    network = _core.Network()
    network.part("p")
    mat = network.mas("m", M=1e-3)
    timeline = _core.Timeline(network, RATE)
    with pytest.raises(_core.EngineError):
        timeline.strike(mat, **arguments)


# --- chance ---


def generator(seed: int, kind: str, name: str, member: int, occurrence: int) -> np.random.Generator:
    """numpy's PCG64 in the state that the digest says, seeded as PCG's reference does."""
    digest = hashlib.sha256(f"{seed}/{kind}/{name}/{member}/{occurrence}".encode()).digest()
    start, stream = (int.from_bytes(digest[i : i + 16], "little") for i in (0, 16))
    inc = (stream << 1 | 1) & MASK
    state = ((inc + start) * MULTIPLIER + inc) & MASK
    bits = np.random.PCG64()
    bits.state = {
        "bit_generator": "PCG64",
        "state": {"state": state, "inc": inc},
        "has_uint32": 0,
        "uinteger": 0,
    }
    return np.random.Generator(bits)


KEYED = [
    (20181110, "strikes", "rain", 0, 0),
    (1, "jitter", "ada/knock", 3, 17),
    (2**40, "f", "é", 9, 1),
]


@pytest.mark.parametrize("key", KEYED)
def test_chance_is_pcg64_keyed_by_sha256(key: tuple[int, str, str, int, int]):
    chance, theirs = _core.Chance(*key), generator(*key)
    ours = [chance.uniform(0.0, 1.0) for _ in range(1000)]
    assert ours == list(theirs.random(1000))


@pytest.mark.parametrize("key", KEYED)
def test_chance_bends_uniform_draws_by_their_formulas(key: tuple[int, str, str, int, int]):
    u = generator(*key).random(600)
    chance = _core.Chance(*key)
    for i in range(0, 600, 3):
        assert chance.uniform(-2.0, 5.0) == pytest.approx(-2.0 + 7.0 * u[i], rel=1e-14)
        assert chance.logarithmic(20.0, 10e3) == pytest.approx(20.0 * 500.0 ** u[i + 1], rel=1e-13)
        gap = -0.7 * math.log1p(-u[i + 2])
        assert chance.exponential(0.7) == pytest.approx(gap, rel=1e-12)


def test_chance_depends_on_every_part_of_key():
    base = (1, "strikes", "rain", 0, 0)
    others = [(2, *base[1:]), (1, "f", *base[2:]), (1, "strikes", "hail", 0, 0),
              (1, "strikes", "rain", 1, 0), (1, "strikes", "rain", 0, 1)]  # fmt: skip
    draws = {_core.Chance(*key).uniform(0.0, 1.0) for key in [base, *others]}
    assert len(draws) == 6


# --- rain ---


def rain(members: int, *, seed: int = 7, name: str = "rain") -> tuple[int, dict[str, np.ndarray]]:
    """(number told, ergons recorded) of 5 Hz for 10 s from 1 s on, 1..4 µNs."""
    network = _core.Network()
    network.part("sky")
    first = network.bank("", count=members, M=1e-3, f=(100.0, 5000.0), t60=(0.5, 4.0))
    network.listen("o", positions=[(first, members, 1.0)])
    timeline = _core.Timeline(network, RATE)
    output = timeline.rain(
        range(first, first + members), start=1.0, stop=11.0, rate=5.0,
        impulse=(1e-6, 4e-6), seed=seed, name=name,
    )  # fmt: skip
    sim = _core.Simulation(network, timeline, record=True)
    play(sim, int(11.1 * RATE), 4096)
    return output, sim.ergons()


def test_rain_is_a_poisson_process_for_each_member():
    output, drops = rain(200)
    n = len(drops["time"])
    assert output == n
    assert abs(n - 10_000) < 4.0 * math.sqrt(10_000)
    p = drops["impulse"]
    assert ((p >= 1e-6) & (p < 4e-6)).all()
    assert abs(p.mean() - 2.5e-6) < 4.0 * 3e-6 / math.sqrt(12.0 * n)
    assert abs(p.var() / (9e-12 / 12.0) - 1.0) < 4.0 * math.sqrt(0.8 / n)  # kurtosis of uniform
    t, mat = drops["time"], drops["mat"].astype(int)
    assert ((t >= 1.0) & (t < 11.0)).all()
    counts = np.bincount(mat - mat.min(), minlength=200)
    # counts of a Poisson process: variance equals mean
    assert abs(counts.var() / 50.0 - 1.0) < 4.0 * math.sqrt(2.0 / 200.0)
    gaps = np.concatenate([np.diff(np.sort(t[mat == m])) for m in np.unique(mat)])
    assert abs(gaps.mean() / 0.2 - 1.0) < 4.0 / math.sqrt(len(gaps)) + 0.02  # cut at the end
    early = (t - 1.0) % 1.0 < 0.5
    assert abs(early.sum() - n / 2) < 4.0 * math.sqrt(n) / 2.0


def test_rain_with_added_member_leaves_others_unchanged():
    few, many = rain(30)[1], rain(31)[1]
    saved = many["mat"] < few["mat"].max() + 0.5
    for column in ("time", "mat", "impulse"):
        assert (few[column] == many[column][saved]).all()
    assert (~saved).sum() > 10


def test_rain_differs_by_seed_or_name():
    base = rain(5)[1]["time"]
    assert rain(5)[1]["time"].tolist() == base.tolist()
    assert rain(5, seed=8)[1]["time"].tolist() != base.tolist()
    assert rain(5, name="hail")[1]["time"].tolist() != base.tolist()


def test_rain_of_member_from_its_chance_stream():
    """Gaps are exponential, impulses uniform, in turn, from Chance(seed, strikes, name, i, 0)."""
    drops = rain(3)[1]
    for member in range(3):
        chance = _core.Chance(7, "strikes", "rain", member, 0)
        mine = drops["mat"] == drops["mat"].min() + member
        t, result = 1.0, []
        while (t := t + chance.exponential(0.2)) < 11.0:
            result.append((t, chance.uniform(1e-6, 4e-6)))
        assert drops["time"][mine] == pytest.approx([t for t, _ in result], abs=1e-12)
        assert drops["impulse"][mine] == pytest.approx([p for _, p in result], rel=1e-15)
