"""Laws of LNL as functions of Faust: what they compute is what the engine computes."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from faust_built import needs_faust, rendered
from planned_sound import off_db, played

from ergon import _core
from ergon.workshop.api.export import faust_programs
from ergon.workshop.models.programs.elements import Law
from ergon.workshop.models.programs.faust_law import Laws

pytestmark = pytest.mark.usefixtures("work_folder")
RATE = 44_100
SCORE = """\
ergon: 1
title: Laws
instruments:
  violin:
    modules:
      s: {STRING: {masses: 24, M: 4g, f: D4, t60: 2s}}
      bow: {SOL: {X0: 0mm}}
      hair: {LNL: {between: [bow, s.5], damping: bow, F: 0.2N, a: 60, u: 0.2m/s}}
    out: {x: {SOX: s.17}, f: {SOF: hair}}
  piano:
    modules:
      s: {STRING: {masses: 24, M: 6g, f: A3, t60: 3s}}
      hammer: {MAS: {M: 8g, X0: -1mm, V0: 2m/s}}
      felt:
        LNL:
          between: [s.3, hammer]
          law: where(d < 0, -k*(-d)**p, 0)
          damping: where(d < 0, k*(-d)**p*z*v, 0)
          k: 4e8
          p: 2.5
          z: 0.1s/m
          rest: -0.2mm
    out: {x: {SOV: s.20}, f: {SOF: felt}}
  reed:
    modules:
      m: {CEL: {M: 20g, f: 300Hz, t60: 2s, X0: 1mm, rest: 0.1mm}}
      w: {SOL: {}}
      b:
        LNL:
          between: [w, m]
          points: [[-1mm, -20N], [-0.4mm, -3N], [-0.1mm, 0N], [0.2mm, 0.1N], [0.9mm, 12N]]
          damping: coulomb
          F: 1mN
          rest: 0.05mm
    out: {x: {SOX: m}, f: {SOF: b}}
  mesh:
    units: ca
    at: 44100Hz
    modules:
      m: {MAS: {M: 3, X0: 1mm}}
      n: {MAS: {M: 2}}
      w: {SOL: {}}
      k: {RES: {between: [w, n], K: 0.01}}
      a: {LNL: {between: [w, m], law: cubic, k: 0.004, q: 9e3, z: 0.0001}}
      b: {LNL: {between: [m, n], law: cubic, k: 0.004, q: 9e3, z: 0.0001}}
    out: {x: {SOX: m}, f: {SOF: [a, b]}}
render: {tail: 0.5s}
"""
LAWS: list[dict[str, Any]] = [
    {"law": "k*d + q*d**3", "damping": "z*v", "constants": {"k": 3e2, "q": 5e8, "z": 0.1}},
    {"law": "-d**2*-2e1 - (d - 1.e-3) - (.5 - d)"},
    {"law": "2**-3*d/(2*0.001)/(1/(d*d + 1e-6))"},
    {"damping": "F*tanh(v/s) + sign(v)*(abs(v) > .3)", "constants": {"F": 0.3, "s": 0.1}},
    {"law": "max(-F, min(F, 1e4*d))", "constants": {"F": 4.0}},
    {"law": "where((d > 0)*(d <= 1e-3), 1, where(d != 0, sqrt(abs(d)), 7))"},
    {"law": "where(d, 2, 3) + where(1 - (d >= 0) - (d == -1e-3), abs(d)**1.5, exp(-1e3*d))"},
    {"law": "1e3*d**7 + (1e3*d)**-2 + (d + 2)**0.5 + (1 + d)**65 + (1 + d)**64 + (1 + d)**1"},
    {
        "law": "(1 + d)**n*lambda + with_ + with2_",
        "constants": {"n": 5.0, "lambda": -2.0, "with_": 1.0, "with2_": 3.0},
    },
    {"law": "émile*é*d + e5*1e5", "constants": {"émile": 1.0, "é": 2.0, "e5": 3.0}},
    {"points": [(-1e-3, 4.0), (1e-3, -2.0)], "damping": "0.2*v"},
    {"points": [(-1e-3, 4.0), (0.0, 0.0), (1e-3, -2.0)]},
    {"points": [(1e-4 * n**3, (-1.0) ** n * n) for n in range(-9, 14)]},
]


def law(fields: dict[str, Any]) -> Law:
    terms = ("law", "damping", "constants", "points")
    complete = {one: fields.get(one) for one in terms} | {"constants": fields.get("constants", {})}
    return Law(complete, _core.Law(*(complete[one] for one in terms)), 1.0)


@needs_faust
def test_faust_law_force_equals_engine() -> None:
    built, laws = Laws(), [law(fields) for fields in LAWS]
    names = [built.function_name(item, f"w{index}") for index, item in enumerate(laws)]
    called = ", ".join(f"{name}(d, v)" for name in names)
    Path("l.dsp").write_text("\n".join([*built.program_lines(), f"process(d, v) = {called};\n"]))
    # Also where a table's lines meet, and beyond its ends.
    index = [0.0, -0.0, *(1e-4 * n**3 for n in (-9, -8, 2, 13)), *np.linspace(-3e-3, 3e-3, 41), 1.0]
    fed = np.array(list(product(index, (-1.0, -0.3, 0.0, 1e-3, 0.5))))
    result = rendered(Path("l.dsp"), fed, RATE)
    for item, column in zip(laws, result.T, strict=True):
        wanted = np.array([item.compiled.force(d, v) for d, v in fed])
        assert np.isfinite(wanted).sum() > 200
        np.testing.assert_allclose(column, wanted, rtol=1e-13, atol=1e-15, err_msg=str(item.fields))


def test_faust_laws_of_equal_links_share_function() -> None:
    built = Laws()
    cubic, same, other = (
        law(LAWS[0]),
        law({**LAWS[0]}),
        law({**LAWS[0], "constants": {"k": 3e2, "q": 5e8, "z": 0.2}}),
    )
    named_laws = ((cubic, "a"), (same, "b"), (other, "c"))
    names = [built.function_name(each, word) for each, word in named_laws]
    assert names == ["law_a", "law_a", "law_c"]
    assert sum(line.startswith("law_") for line in built.program_lines()) == 2


@needs_faust
def test_faust_program_with_laws_equals_engine() -> None:
    Path("s.yaml").write_text(SCORE)
    exact = played(SCORE, method="ca")
    (built,) = faust_programs("s.yaml")
    Path("s.dsp").write_text(built.text)
    sound = rendered(Path("s.dsp"), np.zeros((len(exact), built.text.count("// input"))), RATE)
    assert exact.shape[1] == 8
    assert np.abs(exact).max(axis=0).min() > 1e-6
    assert off_db(sound, exact) < -220
