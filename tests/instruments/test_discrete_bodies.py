"""K and Z of the links of a STRING or PLATE under `units: ca`."""

from itertools import pairwise

import jsonschema
import numpy as np
import pytest
import yaml
from planned_sound import played

from ergon.scores.reading.load import load
from ergon.scores.reading.schema import schema

HEAD = "ergon: 1\nrates: {audio: 44100Hz}\n"
END = "mix: {channels: 1, route: [{from: b, to: 1}]}\nrender: {tail: 50ms}\n"


def instrument(modules: str, out: str, units: str = "units: ca, at: 44100Hz, ") -> str:
    return f"{HEAD}instruments:\n  b: {{{units}modules: {{{modules}}}, out: {{SOX: {out}}}}}\n{END}"


def sound(modules: str, out: str) -> np.ndarray:
    return played(instrument(modules, out), method="ca")[:, 0]


def test_discrete_string_equals_masses_and_springs():
    complete = sound(
        "s: {STRING: {masses: 5, M: 10, K: 0.1, Z: 0.002, X0: {at: 1, x: 1mm}}}", "s.3"
    )
    masses = [f"m{i}: {{MAS: {{M: 2{', X0: 1mm' if i == 1 else ''}}}}}" for i in range(5)]
    ends = ["a", *(f"m{i}" for i in range(5)), "b"]
    links = [
        f"l{i}: {{REF: {{between: [{p}, {q}], K: 0.1, Z: 0.002}}}}"
        for i, (p, q) in enumerate(pairwise(ends))
    ]
    spelled = sound(", ".join(["a: {SOL: {}}", "b: {SOL: {}}", *masses, *links]), "m3")
    assert np.abs(spelled).max() > 1e-4
    assert np.abs(complete - spelled).max() < 1e-15


def test_discrete_plate_lowest_mode_closed_form():
    """The lowest mode of a held rectangle of springs K: sin²(θ/2) = K/M·Σ sin²(π/(2n + 2))."""
    form = "PLATE: {shape: rectangle, sides: [3, 2], rim: fixed, M: 6"
    listened = sound(f"p: {{{form}, K: 0.01, Z: 0, X0: 1mm}}}}", "p.1")
    across, up = np.sin(np.pi / 8.0) ** 2, np.sin(np.pi / 6.0) ** 2
    theta = 2.0 * np.arcsin(np.sqrt(0.01 * (across + up)))
    tuned = sound(f"p: {{{form}, f: {float(theta / (2.0 * np.pi) * 44100)!r}Hz, X0: 1mm}}}}", "p.1")
    assert np.abs(listened - tuned).max() < 1e-12


@pytest.mark.parametrize(
    ("modules", "units", "wanted"),
    [
        ("s: {STRING: {masses: 5, M: 1, K: 1, f: 220Hz}}", None, "K is written too"),
        ("s: {STRING: {masses: 5, M: 1, K: 1, inharmonicity: 1e-4}}", None, "K is written too"),
        ("s: {PLATE: {radius: 3, M: 1, K: 1, bending: true}}", None, "K is written too"),
        ("s: {STRING: {masses: 5, M: 1}}", None, "needs f (and t60), or K (and Z)"),
        ("s: {STRING: {masses: 5, M: 1, K: -1}}", None, ""),
        ("s: {STRING: {masses: 5, M: 1, K: 1}}", "", "unknown field 'K'"),
        ("s: {BANK: {count: 5, M: 1, K: 1}}", None, "unknown field 'K'"),
    ],
)
def test_discrete_body_refuses_wrong_k_and_z(modules: str, units: str | None, wanted: str):
    text = instrument(modules, "s.0") if units is None else instrument(modules, "s.0", units)
    loaded = load("s.yaml", text=text)
    messages = [one.message for one in loaded.diagnostics if one.code.startswith("E")]
    if wanted:
        assert any(wanted in message for message in messages), messages
    else:
        with pytest.raises(Exception, match="K is -1: it must not be negative"):
            played(text, method="ca")


def test_discrete_body_refuses_f_beside_k():
    text = HEAD + (
        "instruments:\n  b: {units: ca, at: 44100Hz, f: 220Hz, "
        "STRING: {masses: 5, M: 1, K: 0.1}, out: {SOX: b.2}}\n"
    )
    messages = [one.message for one in load("s.yaml", text=text).diagnostics]
    assert any("K is written too" in message for message in messages), messages


def test_discrete_body_like_replaces_f_by_k():
    text = HEAD + (
        "instruments:\n"
        "  a: {units: ca, at: 44100Hz, modules: {s: {STRING: {masses: 5, M: 1, f: 220Hz}}}, "
        "out: {SOX: s.2}}\n"
        "  b: {like: a, units: ca, at: 44100Hz, modules: {s: {STRING: {K: 0.01, Z: 0}}}}\n"
    )
    loaded = load("s.yaml", text=text)
    assert not [one for one in loaded.diagnostics if one.code.startswith("E")], loaded.diagnostics
    assert loaded.piece is not None
    fields = loaded.piece.instruments["b"].modules[0].fields
    assert (fields["f"], fields["K"]) == (None, 0.01)


def test_discrete_body_fields_known_to_editors():
    validator = jsonschema.Draft7Validator(schema())
    text = instrument("s: {STRING: {masses: 5, M: 1, K: 0.1, Z: 0}}", "s.2")
    assert list(validator.iter_errors(yaml.safe_load(text))) == []
    wrong = yaml.safe_load(text.replace("Z: 0", "Zed: 0"))
    assert list(validator.iter_errors(wrong))
