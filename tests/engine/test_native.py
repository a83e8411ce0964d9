"""Laws as native code: the bits of the core's own operations, compiled only where it pays."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ergon import _core
from ergon.instruments import native
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

RATE = 44100.0
CONSTANTS = {"k": 300.0, "q": 5e8, "z": 0.02, "F": 0.3, "a": 100.0, "u": 0.2, "w": 1e-3}
EDGES = [0.0, -0.0, 1.0, -1.0, 5e-324, -1e-310, 1e308, np.inf, -np.inf, np.nan, 0.5, 1e-9]
CHAIN = [
    ("k*d + q*d**3", "z*v"),
    ("-F*d/w*exp(0.5 - 0.5*(d/w)**2)", None),
    (None, "F*sqrt(2*a)*(v - u)*exp(0.5 - a*(v - u)**2)"),
]


def law(text: str | None, damping: str | None = None, reach: float = 1.0) -> _core.Law:
    return _core.Law(text, damping, CONSTANTS, None, reach)


def same(built: _core.Law, d: NDArray[np.float64], v: NDArray[np.float64]) -> None:
    """Native code, the core over a run and the core link by link give the same bits."""
    rows = built.rows()
    assert rows is not None
    compiled, run, alone = (np.empty_like(d) for _ in range(3))
    built.native(native.code_address(rows)).forces(d, v, compiled)
    built.forces(d, v, run)
    alone[:] = [built.force(x, y) for x, y in zip(d.tolist(), v.tolist(), strict=True)]
    for other in (run, alone):
        numbers = ~np.isnan(other)
        assert np.array_equal(np.isnan(compiled), ~numbers)
        assert np.array_equal(compiled.view(np.int64)[numbers], other.view(np.int64)[numbers])


def places(n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Usual elongations and rates, and every pair of unusual ones."""
    chance = np.random.default_rng(7)
    edges = np.array([(d, v) for d in EDGES for v in EDGES])
    d = np.concatenate([chance.normal(0.0, 1e-3, n), chance.normal(0.0, 30.0, n), edges[:, 0]])
    v = np.concatenate([chance.normal(0.0, 0.3, n), chance.normal(0.0, 30.0, n), edges[:, 1]])
    return d, v


OPERATIONS = [
    "-d", "abs(d)", "sqrt(d)", "sign(d)", "exp(d)", "tanh(d)", "noise(d)", "d + v", "d - v", "d*v",
    "d/v", "d**v", "min(d, v)", "max(d, v)", "d < v", "d <= v", "d > v", "d >= v", "d == v",
    "d != v", "where(d, v, d)", "d**0", "d**2", "d**-3", "d**63", "d**0.5", "3", "d",
    "exp(exp(d)*v) + tanh(v)**1.5*exp(d)", "(d > 0)**exp(d)", "1.5**d",
]  # fmt: skip


@pytest.mark.parametrize("text", OPERATIONS)
def test_native_law_bits_of_every_operation(text: str):
    same(law(None, text), *places(300))


@pytest.mark.parametrize(("text", "damping"), CHAIN)
@pytest.mark.parametrize("reach", [1.0, 0.7])
def test_native_law_bits_through_lever(text: str | None, damping: str | None, reach: float):
    same(law(text, damping, reach), *places(300))
    for n in (1, 7, 64, 65):  # alone, short of a vector, and around a chunk
        d, v = places(n)
        same(law(text, damping, reach), d[:n].copy(), v[:n].copy())


def expressions() -> st.SearchStrategy[str]:
    leaves = st.sampled_from(["d", "v", "k", "u", "1e-3", "2", "0", "0.75"])

    def grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        infix = ["+", "-", "*", "/", "**", "<", "<=", ">", ">=", "==", "!="]
        called = st.sampled_from(["-", "abs", "sqrt", "sign", "exp", "tanh", "noise"])
        return st.one_of(
            st.builds("({}){}({})".format, inner, st.sampled_from(infix), inner),
            st.builds("{}({})".format, called, inner),
            st.builds("{}({}, {})".format, st.sampled_from(["min", "max"]), inner, inner),
            st.builds("({})**{}".format, inner, st.integers(0, 8)),
            st.builds("where({}, {}, {})".format, inner, inner, inner),
        )

    return st.recursive(leaves, grown, max_leaves=20)


@settings(max_examples=12)
@given(st.lists(expressions(), min_size=2, max_size=2), st.sampled_from([1.0, 0.3]))
def test_native_law_bits_of_random_laws(texts: list[str], reach: float):
    # What may store energy knows no rate.
    same(law(texts[0].replace("v", "d"), texts[1], reach), *places(70))


def test_native_compilation_of_largest_laws():
    """The language is closed and bounded: whatever the core has read, numba compiles."""
    d, v = places(10)
    same(law("+".join(f"{i}*d**{i}" for i in range(2, 38))), d, v)
    same(law("exp(" * 60 + "d" + ")" * 60), d, v)


def test_native_laws_of_same_text_share_code():
    item, other = (_core.Law("k*d + q*d**3", None, {"k": k, "q": 2.0}) for k in (1.0, 7.0))
    assert item.rows() == other.rows()
    assert native.code_address(item.rows() or []) == native.code_address(other.rows() or [])
    d = np.linspace(-1.0, 1.0, 9)
    for built in (item, other):
        same(built, d, d)
    assert native.code_address(law("k*d").rows() or []) != native.code_address(item.rows() or [])


def test_point_laws_have_no_native_rows():
    points = _core.Law(points=[(-1.0, -1.0), (1.0, 2.0)])
    assert points.rows() is None
    with pytest.raises(ValueError, match="native"):
        points.native(1)


def chain(links: int) -> _core.Network:
    """Masses in a row; their links have three laws in turn."""
    network = _core.Network()
    network.part("chain")
    for i in range(links + 1):
        network.cel(f"m{i}", M=2e-3, f=200.0 + i, t60=1.0, X0=1e-4 * (i % 5))
    for i in range(links):
        network.lnl(f"l{i}", i, i + 1, law(*CHAIN[i % 3]))
    network.listen("all", positions=[(0, links, 1.0)])
    return network


def sound(network: _core.Network, **how: bool) -> bytes:
    simulation = _core.Simulation(network, _core.Timeline(network, RATE), **how)
    out = np.empty((600, 1))
    simulation.process(out[:137])
    begun = simulation.snapshot()
    simulation.process(out[137:])
    again = np.empty_like(out[137:])
    simulation.restore(begun)
    simulation.process(again)
    assert again.tobytes() == out[137:].tobytes()
    assert np.isfinite(out).all()
    return out.tobytes()


def test_native_laws_in_network_same_sound():
    plain, fast = chain(30), chain(30)
    laws = fast.laws()
    assert [(alone, in_runs) for _, alone, in_runs in laws] == [(10, 0)] * 3
    assert native.speed_up(fast, 600) == 0
    assert native.speed_up(fast, 10**9) == 3
    assert sound(fast) == sound(plain)
    assert sound(fast, ledger=True) == sound(plain)
    with pytest.raises(IndexError):
        fast.native([(3, native.code_address(laws[0][0]))])


SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 120}]
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}
instruments:
  i:
    modules:
      m: {CEL: {M: 1g, f: A3, t60: 1s}}
      l: {LNL: {between: [k, m], law: k*d + q*d**3, k: 0.1kN/m, q: 1e6N/m3}}
      f: {LNL: {between: [k, m], damping: F*tanh(v/s), F: 0.01N, s: 0.1m/s}}
    out: {SOX: m}
gestures: {g: 0mm@0 smooth 2mm@1/8}
players: {p: {key: k}}
parts: {p: [{at: 1|1, play: g}]}
render: {tail: 50ms}
"""


def test_native_laws_in_score_same_sound(monkeypatch: pytest.MonkeyPatch):
    piece = load("s.yaml", text=SCORE).piece
    assert piece is not None
    compiled: list[int] = []
    speed_up = native.speed_up

    def watched(network: _core.Network, n_frames: int) -> int:
        compiled.append(speed_up(network, n_frames))
        return compiled[-1]

    monkeypatch.setattr(native, "speed_up", watched)
    sounds = []
    for cost in (native._COMPILE_SECONDS, -1.0):
        monkeypatch.setattr(native, "_COMPILE_SECONDS", cost)
        simulation = stage(piece).simulation
        out = np.empty((2000, simulation.n_out))
        simulation.process(out)
        sounds.append(out.tobytes())
    assert compiled == [0, 1]
    assert sounds[0] == sounds[1]
    assert np.abs(out).max() > 0.0


def test_native_compilation_only_for_long_runs():
    rows = law(*CHAIN[0]).rows() or []
    assert not native.is_worth_compiling(rows, 1, 0, int(60 * RATE))
    assert native.is_worth_compiling(rows, 1000, 0, int(10 * RATE))
    assert not native.is_worth_compiling(rows, 0, 1000, int(10 * RATE))
    assert native.is_worth_compiling(rows, 0, 100_000, int(10 * RATE))
    assert not native.is_worth_compiling(law("tanh(d)").rows() or [], 10**6, 0, int(RATE))


def test_render_without_numba_import(tmp_path: Path):
    path = tmp_path / "s.yaml"
    path.write_text(SCORE)
    code = (
        "import sys\nfrom ergon.cli.app import main\n"
        f"try:\n    main(['render', {str(path)!r}, '-o', {str(tmp_path / 's.wav')!r}])\n"
        "except SystemExit as end:\n    assert not end.code, end.code\n"
        "assert 'numba' not in sys.modules\nassert 'ergon.instruments.native' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    assert (tmp_path / "s.wav").exists()
