"""MODES: a body of which modes and their levels at places are known."""

import numpy as np
import pytest
from checked import check, codes

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.scores.reading.load import load
from ergon.scores.reading.outputs import Accuracy
from ergon.scores.staging import planning
from ergon.scores.staging.preparing import prepare

LISTS = "f: [220Hz, 220.5Hz, A4], t60: [12s, 11s, 6s]"
PLACES = ", places: {rim: [1, 0.8, 0.5], waist: [0.4, -6dB, -0.5]}"
SCORE = "ergon: 1\ninstruments:\n  b:\n    MODES: {M: 200g, %s}\n    out: {SOX: b.%s}\n"
F, T60 = (220.0, 220.5, 440.0), (12.0, 11.0, 6.0)


def network(text: str, part: str = "b"):
    piece = check(text).piece
    assembly = Assembly()
    assembly.add_part(part, piece.instruments[part].modules)
    return assembly


def rendered(text: str, n: int = 44100) -> np.ndarray:
    ready = prepare(load("x.yaml", text=text).piece)
    built = planning.make_plan(ready.network, ready.timeline, Accuracy())
    out = np.zeros((n, 1))
    _core.Simulation(ready.network, ready.timeline, plan=built.plan).process(out)
    return out[:, 0]


def test_modes_body_poles_and_levels_as_written():
    assembly = network(SCORE % (LISTS + PLACES, "waist"))
    modes = assembly.network.part_modes("b", count=3)
    poles, shapes = np.array(modes.poles), np.array(modes.shapes).real
    sigma = -poles.real
    assert np.abs(poles.imag) / (2 * np.pi) == pytest.approx(F, rel=1e-12)
    assert 3 * np.log(10) / sigma == pytest.approx(T60, rel=1e-9)
    ratio = shapes[:, 1] / shapes[:, 0]
    assert ratio == pytest.approx([0.4, 10 ** (-6 / 20) / 0.8, -1.0], rel=1e-6)


@pytest.mark.parametrize(("to", "place"), [("rim", "waist"), ("waist", "rim"), ("rim", "rim")])
def test_modes_body_strike_response_by_levels(to, place):
    levels = {"rim": (1.0, 0.8, 0.5), "waist": (0.4, 10 ** (-6 / 20), -0.5)}
    strike = "strikes: {s: {to: b.%s, at: 0s, impulse: 1mNs, lasts: 0s}}\n"
    out = rendered(SCORE % (LISTS + PLACES, place) + strike % to)
    t = np.arange(out.size) / 44100
    built = np.zeros(out.size)
    for f, t60, there, here in zip(F, T60, levels[to], levels[place], strict=True):
        level = 1e-3 * there * here / (0.2 * 2 * np.pi * f)
        built += level * np.exp(-3 * np.log(10) * t / t60) * np.sin(2 * np.pi * f * t)
    apart = out[200:] - built[200:]  # the modes that are added are over by then
    assert np.abs(apart).max() < 1e-9 * np.abs(built).max()


@pytest.mark.parametrize(
    "places",
    ["{rim: [1, 0.8, 0.5], waist: [0.4, -6dB, -0.5]}", "{rim: [1, 0.8, 0.5], mic: [30, 24, 15]}"],
)
def test_modes_body_stepped_under_ca(places):
    """In each step of CORDIS-ANIMA the ties of its masses take away what their springs add."""
    text = SCORE % (f"{LISTS}, places: {places}", "rim")
    text += "strikes: {s: {to: b.rim, at: 0s, impulse: 1mNs}}\n"
    ready = prepare(load("x.yaml", text=text).piece)
    out = np.zeros((4410, 1))
    _core.Simulation(ready.network, ready.timeline).process(out)
    exact = rendered(text, 4410)
    # Its pitches are those of the steps: 0.05 rad apart in a tenth of a second.
    assert np.abs(out[:, 0] - exact).max() < 0.08 * np.abs(exact).max()


def test_modes_body_mass_count_of_places():
    two = network(SCORE % (LISTS + PLACES, "waist")).network
    first = network(SCORE % (LISTS, "point")).network
    assert (two.n_mat, first.n_mat, two.count(0), first.count(0)) == (4, 3, 2, 1)


@pytest.mark.parametrize(("count", "places"), [(1, 3), (40, 5), (200, 2)])
def test_modes_body_random_counts_of_modes_and_places(count, places):
    rng = np.random.default_rng(count)
    f = np.sort(np.exp(rng.uniform(np.log(50), np.log(15e3), count)))
    t60 = rng.uniform(0.2, 20.0, count)
    levels = rng.uniform(-1, 1, (count, places))
    built = _core.Network()
    built.part("b")
    built.modal("", M=0.1, modes=list(zip(f, t60, strict=True)), levels=levels.tolist())
    modes = built.part_modes("b", count=built.n_mat)
    is_ours = np.array(modes.poles).real > -1000.0  # those that are added fall within 1 ms
    poles, shapes = np.array(modes.poles)[is_ours], np.array(modes.shapes).real[is_ours, :places]
    assert 1200 * np.abs(np.log2(np.abs(poles.imag) / (2 * np.pi) / f)).max() < 1e-5
    assert np.abs(3 * np.log(10) / -poles.real / t60 - 1).max() < 1e-9
    signs = np.sign(shapes[:, 0] * levels[:, 0])[:, None]
    seen, asked = shapes * signs / np.abs(shapes).max(), levels / np.abs(levels).max()
    assert np.allclose(seen, asked, atol=1e-5)


def test_modes_body_with_hammer_planned_by_modes():
    text = """ergon: 1
instruments:
  b:
    modules:
      body: {MODES: {M: 200g, %s}}
      hammer: {CEL: {M: 8g, f: 1Hz, t60: 2s, V0: 1m/s}}
      felt: {BUT: {between: [hammer, body.rim], K: 1e6, exponent: 1.5}}
    out: {SOV: body.waist}
"""
    ready = prepare(load("x.yaml", text=text % (LISTS + PLACES)).piece)
    rows = planning.make_plan(ready.network, ready.timeline, Accuracy()).plan.rows()
    assert [row.modes.total for row in rows if row.modes is not None] == [4]


def test_modes_body_single_decay_and_default_place():
    fields = check(SCORE % ("f: [200Hz, 453Hz], t60: 2s", "point")).piece.instruments["b"]
    fields = fields.modules[0].fields
    assert fields["t60"] == (2.0, 2.0)
    assert fields["places"] == (("point", (1.0, 1.0)),)
    assert codes(SCORE % ("f: 200Hz, t60: 2s", "0")) == []


def test_modes_body_transpose_and_f_scaling():
    more = "  h: {like: b, transpose: 12st}\n  i: {like: b, f: A4, t60: 6s, M: 1kg}\n"
    more += "  s: {like: b, notes: [A3, A4], out: {SOX: s.rim}}\n"
    piece = check(SCORE % (LISTS + PLACES, "rim") + more).piece
    by_name = {name: one.modules[0].fields for name, one in piece.instruments.items()}
    assert by_name["h"]["f"] == (440.0, 441.0, 880.0)
    assert by_name["h"]["t60"] == (6.0, 5.5, 3.0)
    assert by_name["i"]["f"] == by_name["h"]["f"]
    assert (by_name["i"]["t60"], by_name["i"]["M"]) == ((6.0, 5.5, 3.0), 1.0)
    assert by_name["i"]["places"] == by_name["b"]["places"]
    assert by_name["s.A4"]["f"] == by_name["h"]["f"]


def test_modes_body_like_merges_fields():
    more = "  h: {like: b, MODES: {places: {rim: [0.1, 0.2, 0.3]}}, out: {SOX: h.rim}}\n"
    fields = check(SCORE % (LISTS + PLACES, "rim") + more).piece.instruments["h"].modules[0].fields
    assert fields["places"] == (("rim", (0.1, 0.2, 0.3)),)
    assert fields["f"] == (220.0, 220.5, 440.0)


@pytest.mark.parametrize(
    ("body", "place", "code"),
    [
        ("f: [200Hz, 300Hz], t60: [1s, 2s, 3s]", "point", "E106"),
        ("f: [200Hz, 300Hz], t60: 1s, places: {rim: [1, 2, 3]}", "rim", "E106"),
        ("f: [200Hz, 300Hz], t60: 1s, places: {rim: [0, 0]}", "rim", "E202"),
        ("f: [200Hz, 300Hz], t60: 1s, places: {last: [1, 1]}", "0", "E110"),
        ("f: [200Hz, 300Hz], t60: 1s, places: {}", "0", "E110"),
        ("f: [200Hz, 300Hz], t60: 1s, places: {rim: [1, 1]}", "rin", "E301"),
        ("f: [200Hz, 300Hz], t60: 1s, places: {a: [1, 1], b: [1, 2]}", "a, b", None),
        ("f: [200Hz, 300Hz]", "point", "E103"),
        ("t60: 1s", "point", "E103"),
        ("f: 200Hz, t60: 1s, modes: x.csv", "point", "E111"),
    ],
)
def test_modes_body_mistake_codes(body, place, code):
    if code is None:
        text = SCORE.replace("SOX: b.%s", "SOX: b") % body
        message = check(text).diagnostics[0].message
        assert "2 places" in message
        assert "b.a" in message
    else:
        assert codes(SCORE % (body, place)) == [code]


def test_modes_body_misspelt_place_suggestion():
    text = SCORE % ("f: 200Hz, t60: 1s, places: {shoulder: 1}", "sholder")
    assert "b.shoulder" in check(text).diagnostics[0].suggestion


def test_modes_body_glide_is_refused():
    more = "automation: [{set: b.f, at: 1|1, to: A4, over: 1bar}]\n"
    result = check(SCORE % (LISTS + PLACES, "rim") + more).diagnostics
    assert any("MODES" in one.message for one in result)


@pytest.fixture
def filed(tmp_path):
    def loaded_modes(table: str, place: str = "rim"):
        (tmp_path / "bell.csv").write_bytes(table.encode())
        text = SCORE % ("modes: bell.csv", place) + "  h: {like: b, transpose: 12st}\n"
        (tmp_path / "s.yaml").write_text(text)
        return load(tmp_path / "s.yaml")

    return loaded_modes


def test_modes_body_file_equals_lists(filed):
    rows = "220Hz, 12s, 1, 0.4\n# beats\n220.5, 11, 0.8, -6dB\nA4, 6s, 0.5, -0.5\n"
    loaded = filed("f, t60, rim, waist\n" + rows)
    assert loaded.diagnostics == []
    lists = check(SCORE % (LISTS + PLACES, "rim")).piece.instruments["b"].modules[0].fields
    assert loaded.piece.instruments["b"].modules[0].fields == lists
    assert loaded.piece.instruments["h"].modules[0].fields["f"] == (440.0, 441.0, 880.0)


@pytest.mark.parametrize(
    ("table", "code", "part"),
    [
        ("f, t60, rim\n", "E106", "200Hz, 4s, 0.5"),
        ("f, t60, rim\n200Hz, 1s\n", "E106", "a level at rim"),
        ("f, t60, rim, rim\n200Hz, 1s, 1, 1\n", "E110", "two places"),
        ("f, t60, 1st\n200Hz, 1s, 1\n", "E110", "name for a place"),
        ("f, t60, rim\n200Hz, 1s, loud\n", "E201", "loud"),
    ],
)
def test_modes_body_file_mistakes_with_place(filed, table, code, part):
    result = filed(table).diagnostics[0]
    assert result.code == code
    assert part in result.message


BANDED = (
    "f: [220Hz, A4], t60: [12s, 6s], places: {rim: [1, 0.5], air: [0.4, -0.5]}, "
    "band: {count: 20, f: 500Hz..8kHz, t60: 0.4s..2s, places: {rim: 0.8, air: 0.3}, seed: 4}"
)


def banded(text: str = BANDED, more: str = "") -> dict:
    return check(SCORE % (text, "air") + more).piece.instruments["b"].modules[0].fields


def test_band_frequencies_decays_and_levels_in_range():
    fields = banded()
    f, t60 = np.array(fields["f"][2:]), np.array(fields["t60"][2:])
    assert len(f) == 20
    assert np.all(np.diff(f) > 0)
    steps = np.floor(20 * np.log(f / 500) / np.log(8000 / 500))
    assert np.array_equal(steps, np.arange(20))
    line = 2.0 * (0.4 / 2.0) ** (np.log(f / 500) / np.log(16))
    assert np.all(np.abs(np.log2(t60 / line)) < 0.5001)
    assert np.ptp(np.log2(t60 / line)) > 0.5
    levels = {name: np.array(column[2:]) for name, column in fields["places"]}
    assert np.all((levels["rim"] >= 0.4) & (levels["rim"] <= 0.8))
    assert np.all((np.abs(levels["air"]) >= 0.15) & (np.abs(levels["air"]) <= 0.3))
    assert np.array_equal(np.sign(levels["air"]), [1, -1] * 10)


def test_band_with_another_seed():
    assert banded() == banded()
    assert banded()["f"] != banded(BANDED.replace("seed: 4", "seed: 5"))["f"]


@pytest.mark.parametrize("more", ["    f: 440Hz\n", "    transpose: 1200cents\n"])
def test_band_transposed_with_its_instrument(more):
    assert banded(more=more)["f"] == pytest.approx([2 * f for f in banded()["f"]], rel=1e-5)


def test_band_equals_its_listed_modes():
    fields = banded()
    pitches = ", ".join(f"{f!r}Hz" for f in fields["f"])
    decays = ", ".join(f"{t!r}s" for t in fields["t60"])
    places = ", ".join(f"{name}: {list(column)}" for name, column in fields["places"])
    text = f"f: [{pitches}], t60: [{decays}], places: {{{places}}}"
    strike = "strikes: {s: {to: b.rim, at: 0s, impulse: 1mNs}}\n"
    listed = rendered(SCORE % (text, "air") + strike, 4410)
    assert np.array_equal(rendered(SCORE % (BANDED, "air") + strike, 4410), listed)


@pytest.mark.parametrize(
    ("written", "replaced", "code"),
    [
        ("air: 0.3", "waist: 0.3", "E110"),
        ("count: 20", "count: 499", "E110"),
        ("count: 20", "count: 0", "E202"),
        ("t60: 0.4s..2s", "t60: 2s..0.4s", "E202"),
        ("count: 20, ", "", "E103"),
    ],
)
def test_band_with_wrong_fields(written, replaced, code):
    assert codes(SCORE % (BANDED.replace(written, replaced, 1), "air")) == [code]
