"""`ergon.tune`: targets reached to 1e-6 cents, those that cannot be, and what is written."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import ergon


def chain(n: int, *, is_held: bool) -> str:
    modules = {f"m{i}": f"{{MAS: {{M: {3 + i % 3}g}}}}" for i in range(n)}
    modules |= {
        f"r{i}": f"{{REF: {{between: [m{i}, m{i + 1}], K: 20kN/m, Z: 0.02Ns/m}}}}"
        for i in range(n - 1)
    }
    if is_held:
        modules |= {"wall": "{SOL: {}}", "hold": "{REF: {between: [m0, wall], K: 9kN/m, Z: 1Ns/m}}"}
    return "".join(f"      {name}: {module}  # its own\n" for name, module in modules.items())


SCORE = f"""\
ergon: 1
keys: {{k1: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}}}
laws: {{cubic: {{law: k*d + q*d**3, k: 200N/m, q: 4e7N/m3}}}}
instruments:
  bar:
    modules:
{chain(8, is_held=True)}    out: {{SOX: m7}}
  free:
    modules:
{chain(6, is_held=False)}    out: {{SOX: m5}}
  wire: {{modules: {{s: {{STRING: {{masses: 24, M: 4g, f: D4, t60: 2s}}}}}}, out: {{SOX: s.17}}}}
  soft:
    modules:
      m: {{MAS: {{M: 20g}}}}
      floor: {{SOL: {{}}}}
      l: {{LNL: {{between: [m, floor], law: cubic}}}}
    out: {{SOX: m}}
  discrete:
    units: ca
    at: 44100Hz
    modules: {{m: {{CEL: {{M: 1, K: 0.002, Z: 0.0005}}}}, n: {{CEL: {{M: 2, K: 0.01, Z: 0.0001}}}}}}
    out: {{SOX: m}}
  bowl: {{MODES: {{M: 20g, f: [220Hz, 450Hz], t60: 2s}}}}
  wall: {{modules: {{w: {{SOL: {{}}}}}}}}
strikes: {{a: {{to: [bar.m3], at: 0.1s, impulse: 1mNs}}}}
render: {{tail: 0.5s}}
"""


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("bars.yaml").write_text(SCORE)
    return work_folder


def tune(part: str, targets: object, *by: str, **options: object) -> ergon.Tuned:
    return ergon.tune("bars.yaml", part, targets, ergon.TuneOptions(by=by, **options))  # type: ignore[arg-type]


def pitches(outcome: ergon.Tuned, count: int = 12) -> np.ndarray:
    """The modes of the part as the edited text says it, by `ergon.modes`."""
    assert outcome.edited is not None
    options = ergon.ModesOptions(text=outcome.edited, parts=[outcome.part], count=count)
    (part,) = ergon.modes("bars.yaml", options)
    return part.frequencies[part.frequencies > 1.0]


@pytest.mark.parametrize(
    ("part", "by"),
    [("bar", ()), ("bar", ("masses",)), ("bar", ("springs",)), ("free", ()), ("free", ("masses",))],
)
def test_tune_reaches_frequency_ratios(part: str, by: tuple[str, ...]):
    result = tune(part, "1:2.76:5.4", *by)
    assert result.is_reached
    assert result.modes == (1, 2, 3)
    single = pitches(result)[:3]
    assert np.abs(1200 * np.log2(single / single[0] / [1, 2.76, 5.4])).max() < 1e-6
    assert single == pytest.approx(result.frequencies, rel=1e-12)
    assert single[0] == pytest.approx(result.before[0], rel=1e-9)
    assert all(value.name.endswith(".M") for value in result.values) or by != ("masses",)


def test_tune_with_base_note_and_skipped_modes():
    result = tune("bar", "1:_:5", base="A3")
    assert result.modes == (1, 3)
    assert np.abs(1200 * np.log2(pitches(result)[[0, 2]] / [220.0, 1100.0])).max() < 1e-6
    again = tune("bar", {1: "A3", 3: 1100.0})
    assert again.values == result.values


def test_tune_of_single_value_closed_form():
    result = tune("wire", ["A3"])
    assert [(value.name, value.before) for value in result.values] == [
        ("wire.s.f", pytest.approx(293.66476791740756))
    ]
    assert result.values[0].after == pytest.approx(220.0, rel=1e-12)
    result = tune("k1", [3.0], "K")
    (value,) = result.values
    assert value.name == "k1.K"
    assert value.after == pytest.approx(0.4 * ((2 * np.pi * 3.0) ** 2 + 1.5**2), rel=1e-10)
    result = tune("soft", [20.0], "k")
    assert result.values[0].after == pytest.approx(0.02 * (2 * np.pi * 20.0) ** 2, rel=1e-10)


def test_tune_of_modes_module_frequencies():
    result = tune("bowl", "1:2", base="A3")
    assert [(value.name, value.after) for value in result.values] == [("bowl.f.2", 440.0)]
    assert result.edited == SCORE.replace("[220Hz, 450Hz]", "[220Hz, 440.0Hz]")
    assert tune("bowl", ["A3", "A4"], "pitches").values == result.values
    assert tune("bowl", ["A3", "A4"], "f.2").values == result.values
    assert np.abs(1200 * np.log2(pitches(result)[:2] / [220.0, 440.0])).max() < 1e-6


def test_tune_of_modes_module_held_by_spring():
    """Its poles are the roots of 1 + (K + sZ) Σ 1/(M (s² + 2σs + ω² + σ²)) = 0."""
    mass, k, z, t60 = 0.02, 1e3, 0.05, (2.0, 1.0, 0.5)
    Path("held.yaml").write_text(
        "ergon: 1\ninstruments:\n  one:\n    modules:\n"
        f"      b: {{MODES: {{M: {mass}kg, f: [A3, 450Hz, 610Hz], t60: [2s, 1s, 0.5s]}}}}\n"
        "      w: {SOL: {}}\n"
        f"      l: {{REF: {{between: [b.point, w], K: {k}N/m, Z: {z}Ns/m}}}}\n"
        "    out: {SOX: b.point}\nstrikes: {a: {to: [one.b.point], at: 0s, impulse: 1mNs}}\n"
    )
    targets = np.array([231.0, 462.0, 600.0])
    result = ergon.tune("held.yaml", "one", targets.tolist(), ergon.TuneOptions(by=["b.f"]))
    assert result.is_reached
    assert [value.name for value in result.values] == [f"one.b.f.{i}" for i in (1, 2, 3)]
    alone = []
    for value, seconds in zip(result.values, t60, strict=True):
        sigma = np.log(1000.0) / seconds
        alone.append(np.array([1.0, 2 * sigma, (2 * np.pi * value.after) ** 2 + sigma**2]))
    poles = np.polymul(np.polymul(alone[0], alone[1]), alone[2])
    for i in range(3):
        others = np.polymul(*(alone[j] for j in range(3) if j != i))
        poles = np.polyadd(poles, np.polymul([z / mass, k / mass], others))
    roots = np.roots(poles).imag
    listened = np.sort(roots[roots > 0]) / (2 * np.pi)
    assert np.abs(1200 * np.log2(listened / targets)).max() < 1e-6


@pytest.mark.parametrize(
    ("bowl", "trouble"),
    [
        (
            "MODES: {M: 20g, modes: bowl.csv}",
            "'low.f': the modes are read from a file and cannot be set here",
        ),
        (
            "MODES: {M: 20g, f: [220Hz, 450Hz], t60: 2s}, transpose: -12st",
            "'low.f': 'transpose' of the instrument transposes all its pitches; "
            "remove 'transpose' before",
        ),
    ],
)
def test_tune_of_modes_list_without_literal_values(bowl: str, trouble: str):
    Path("bowl.csv").write_text("f, t60, rim\n220Hz, 2s, 1\n450Hz, 2s, 1\n")
    text = SCORE.replace("\n  wall: ", f"\n  low: {{{bowl}}}\n  wall: ")
    result = tune("low", "1:2", text=text)
    assert result.is_reached
    assert result.edited is None
    assert trouble in result.trouble


def test_tune_of_inherited_modes_list_writes_override():
    text = SCORE.replace("\n  wall: ", "\n  low: {like: bowl}\n  wall: ")
    result = tune("low", ["A3", "A4"], text=text)
    assert result.is_reached
    assert result.edited is not None
    assert "bowl: {MODES: {M: 20g, f: [220Hz, 450Hz], t60: 2s}}" in result.edited
    assert np.abs(1200 * np.log2(pitches(result)[:2] / [220.0, 440.0])).max() < 1e-6


def test_tune_of_discrete_network():
    result = tune("discrete", [300.0, 600.0], "K")
    assert result.is_reached
    assert [value.text for value in result.values] == [repr(value.after) for value in result.values]
    assert np.abs(1200 * np.log2(pitches(result) / [300.0, 600.0])).max() < 1e-6


def test_tune_changes_values_least():
    """Of all small changes that reach the targets none has smaller logarithms."""
    result = tune("bar", [58.4, 178.5], "masses")
    change = np.log([value.after / value.before for value in result.values])
    slopes = []
    for value in result.values:  # by differences, from the first score
        name = value.name.removeprefix("bar.").removesuffix(".M")
        line = next(one for one in SCORE.splitlines() if one.startswith(f"      {name}: {{MAS"))
        heavier = SCORE.replace(
            line, f"      {name}: {{MAS: {{M: {value.before * 1.0001!r}kg}}}}", 1
        )
        (part,) = ergon.modes("bars.yaml", ergon.ModesOptions(text=heavier, parts=["bar"], count=2))
        slopes.append(np.log(part.frequencies / result.before) / np.log(1.0001))
    slopes = np.array(slopes).T
    least = np.linalg.pinv(slopes) @ slopes @ change
    assert change == pytest.approx(least, abs=0.02 * np.abs(change).max())


def test_tune_of_unreachable_targets_reports_rank():
    result = tune("wire", "1:2.1:3.3")
    assert not result.is_reached
    assert result.rank < 2
    assert np.abs(result.cents).max() > 80.0
    result = tune("bar", ["A3", "E5"], "m1.M")
    assert not result.is_reached
    assert result.rank == 1
    assert np.abs(result.cents).max() > 1.0


def test_tune_edit_preserves_comments():
    result = tune("bar", {2: 170.0}, "m3.M")
    (value,) = result.values
    assert result.edited == SCORE.replace(
        "m3: {MAS: {M: 3g}}", f"m3: {{MAS: {{M: {value.text}}}}}", 1
    )


def test_tune_of_values_in_used_file_unedited():
    Path("tools.yaml").write_text(
        "ergon: 1\ninstruments:\n  bar: {modules: {m: {CEL: {M: 1g, f: 200Hz}}}}\n"
    )
    Path("used.yaml").write_text(
        "ergon: 1\nuse: [tools.yaml]\nstrikes: {a: {to: [bar], at: 0s, impulse: 1mNs}}\n"
    )
    result = ergon.tune("used.yaml", "bar", ["A3"])
    assert result.is_reached
    assert result.values[0].after == pytest.approx(220.0)
    if result.edited is None:
        assert "tools.yaml" in result.trouble


@pytest.mark.parametrize(
    ("part", "targets", "options", "message"),
    [
        ("barr", "1:2", {}, "parts: no instrument or key is called 'barr'; did you mean 'bar'?"),
        ("bar", "1:x", {}, "targets: 'x' is not a ratio above 0"),
        ("bar", "1:_", {}, "targets: '1:_' is not a ratio"),
        ("bar", [], {}, "targets: no target is given"),
        ("bar", ["A3", "A2"], {}, "targets: the targets must rise from mode to mode"),
        ("bar", {0: "A3"}, {}, "targets: there is no mode 0; modes count from 1"),
        ("bar", {9: "A3"}, {}, "targets: mode 9 is wanted, but bar has 8 modes that swing"),
        ("bar", ["h3"], {}, "targets: 'h3' is neither a frequency"),
        ("bar", ["A3"], {"base": "A3"}, "base: a base is used with ratios only"),
        (
            "bar",
            "1:2",
            {"by": ["mases"]},
            "by: bar has no value 'mases' above 0; did you mean 'masses'?",
        ),
        ("wire", "1:2", {"by": ["M"]}, "by: no mode depends on wire.s.M"),
        ("wall", "1:2", {}, "part: wall has no value above 0 that moves its modes"),
        ("bowl", "1:2", {"by": ["M"]}, "by: no mode depends on bowl.M"),
        ("bowl", "1:2", {"by": ["f.3"]}, "by: bowl has no value 'f.3' above 0; did you mean"),
        ("bowl", "1:2", {"by": ["springs"]}, "by: bowl has no value 'springs' above 0; there are"),
    ],
)
def test_tune_refuses_wrong_parts_and_targets(
    part: str, targets: object, options: dict, message: str
):
    with pytest.raises(ergon.OptionError) as refused:
        ergon.tune("bars.yaml", part, targets, ergon.TuneOptions(**options))  # type: ignore[arg-type]
    assert str(refused.value).startswith(message)


def test_tune_ratios_in_ascending_mode_order():
    own = pitches(tune("bar", "1:2:3:4:5"))[:5]
    assert all(a < b for a, b in pairwise(own))


def test_tune_with_relative_and_absolute_path():
    for path in ("./bars.yaml", Path("bars.yaml").absolute()):
        assert ergon.tune(path, "wire", ["A3"]).edited is not None


def test_tune_of_value_at_its_limit():
    stiff = SCORE.replace("masses: 24, M: 4g", "masses: 40, M: 4g, inharmonicity: 1e-4")
    result = tune("wire", "1:2.3", text=stiff)
    assert not result.is_reached
    assert 0.09 < next(v.after for v in result.values if v.name.endswith("inharmonicity")) <= 0.1
