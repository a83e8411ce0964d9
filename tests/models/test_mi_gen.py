"""Scores as models of mi-gen: imported again they are the same bytes of sound."""

from pathlib import Path

import numpy as np
import pytest
import soundfile
from imported import rendered
from oracle import mims
from planned_sound import off_db, played

from ergon.cli import app
from ergon.workshop.api.export import ExportOptions, mi_gen_models
from ergon.workshop.api.model import ModelOptions, import_model

pytestmark = pytest.mark.usefixtures("work_folder")
RATE = 44_100
CA = """\
ergon: 1
takes: {push: {file: push.wav}, in4: {file: path.wav}}
instruments:
  net:
    units: ca
    at: 44100Hz
    modules:
      m: {CEL: {M: 1.3, K: 0.01, Z: 0.001}}
      n: {MAS: {M: 2, X0: 2mm}}
      g: {SOL: {X0: 1mm}}
      d: {SOL: {}}
      s: {STRING: {masses: 12, M: 17, K: 0.05, Z: 0.0005}}
      f: {STRING: {masses: 7, M: 9, K: 0.05, Z: 0.0005, ends: free}}
      e: {STRING: {masses: 5, M: 9, K: 0.05, Z: 0.0005, ends: left}}
      p: {PLATE: {shape: rectangle, sides: [4, 3], M: 13, K: 0.04, Z: 0.0002, rim: fixed}}
      t: {PLATE: {shape: rectangle, sides: [3, 5], M: 13, K: 0.04, Z: 0.0002}}
      mover: {MAS: {M: 1}}
      l: {REF: {between: [m, n], K: 0.1, Z: 0.01}}
      k: {RES: {between: [n, g], K: 0.2}}
      z: {FRO: {between: [g, m], Z: 0.02}}
      j: {REF: {between: [n, s.3], K: 0.01, Z: 0.002}}
      i: {RES: {between: [s.11, p.5], K: 0.03}}
      b: {RES: {between: [n, "f.0..6"], K: 0.003}}
      a: {RES: {between: [e.2, t.7], K: 0.003}}
      o: {REF: {between: [mover, e.4], K: 0.02, Z: 0.001}}
      y: {RES: {between: [t.0, d], K: 0.02}}
      w: {ENF: {to: n, from: -0.000001N}}
      v: {ENF: {to: p.2, from: push, at: 0s}}
      x: {ENX: {to: mover, from: in4, at: 0s}}
    out:
      out2: {SOX: s.5}
      out1: {SOX: p.2}
      here: {SOX: m}
      f: {SOX: f.6}
      e: {SOX: e.3}
      t: {SOX: t.14}
      pull: {SOF: y}
render: {tail: 0.3s}
"""
LAWS = """\
ergon: 1
instruments:
  net:
    units: ca
    at: 44100Hz
    modules:
      m: {CEL: {M: 1.3, K: 0.01, Z: 0.001, V0: 3m/s}}
      c: {CEL: {M: 3, K: 0.02, Z: 0.0007, X0: 1mm}}
      e: {CEL: {M: 3, K: 0.03, Z: 0.0007, X0: -1mm}}
      r: {CEL: {M: 2, K: 0.02, Z: 0.0007, rest: 0.3mm}}
      g: {SOL: {X0: 0.05mm}}
      h: {BUT: {between: [c, m], K: 0.1, Z: 0.01, gap: 0.1mm, side: above}}
      i: {BUT: {between: [e, g], K: 0.1, Z: 0.01, gap: -0.1mm}}
      q: {LNL: {between: [c, m], law: "k*d + q*d**3", damping: z*v, k: 0.01, q: 20, z: 0.001}}
      a: {LNL: {between: [r, m], law: "k*d+q * d*abs(d)", damping: z*v, k: 0.01, q: 2, z: 0.001}}
      b: {LNL: {between: [e, m], damping: "0.63*z*v*exp(0.5 - 4*(v/scale)**2)", z: 0.01,
          scale: 1e-4}}
    out: {a: {SOX: m}, b: {SOX: c}, c: {SOX: e}, d: {SOX: r}}
render: {tail: 0.1s}
"""
SI = """\
ergon: 1
instruments:
  bell:
    modules:
      hammer: {CEL: {M: 20g, f: 1Hz, t60: 0.6s, X0: -2mm, V0: 1m/s}}
      p: {CEL: {M: 1kg, f: 880Hz, t60: 3s, X0: 0.1mm}}
      wire: {STRING: {masses: 12, M: 4g, f: D4, t60: 2s}}
      sheet: {PLATE: {radius: 2, M: 50g, f: 300Hz, t60: 1s, rim: fixed}}
      hit: {BUT: {between: [hammer, p], K: 1e5N/m, gap: 1mm, Z: 2Ns/m}}
      tie: {REF: {between: [p, wire.2], K: 3e3N/m, Z: 0.1Ns/m}}
      hard: {LNL: {between: [p, sheet.9], law: "k*d + q*d**3", damping: z*v, k: 300N/m,
             q: 1e9N/m3, z: 0.1Ns/m}}
      fall: {ENF: {to: hammer, from: -0.2N}}
    out: {a: {SOX: p}, b: {SOX: wire.7}, c: {SOX: sheet.centre}, d: {SOX: hammer}}
render: {tail: 0.2s}
"""


def _model(text: str, *parts: str) -> str:
    Path("s.yaml").write_text(text)
    (built,) = mi_gen_models("s.yaml", ExportOptions(parts=parts))
    Path("s.mdl").write_text(built.text)
    return built.text


def _fed() -> dict[str, np.ndarray]:
    t = np.arange(RATE) / RATE
    fed = {"path.wav": 0.01 * np.sin(2 * np.pi * 90.0 * t) ** 2, "push.wav": 1e-4 * np.sin(900 * t)}
    fed["push.wav"][0] = 1e-5
    for name, samples in fed.items():
        soundfile.write(name, samples, RATE, subtype="FLOAT")
    return {name: np.float64(np.float32(samples)) for name, samples in fed.items()}


def test_mi_gen_model_imports_to_same_sound_bytes() -> None:
    fed = _fed()
    text = _model(CA)
    for line in (
        "@s string 14 1.4166666666666667 0.05 0.0005 0 0",
        "@f chain 7 1.2857142857142858 0.05 0.0005 0 0",
        "@p closedMesh 5 6 1.0833333333333333 0.04 0.0002 0 0",
        "@t mesh 5 3 0.8666666666666667 0.04 0.0002 0 0",
        "@in4 posInput 0",
        "@in1 frcInput [@p 0.25 0.6]",
        "@out3 posOutput @m",
        "@out7 frcOutput @d",
    ):
        assert line in text.splitlines()
    asked = ModelOptions(inputs={"in1": "push.wav", "in4": "path.wav"})
    again = rendered(import_model("s.mdl", asked).text, 0.3)
    exact = played(CA, method="ca")[:, [1, 0, 2, 3, 4, 5, 6]]
    assert (np.abs(exact).max(axis=0) > 1e-7).all()
    assert again.tobytes() == exact.tobytes()
    alone = mims.played(text, "v2", 0.3, inputs={"in1": fed["push.wav"], "in4": fed["path.wav"]})
    assert off_db(alone, exact) < -220


@pytest.mark.parametrize(("text", "bound"), [(LAWS, -180), (SI, -180)])
def test_mi_gen_export_of_laws_and_si_units(text: str, bound: float) -> None:
    exact = played(text, method="ca")
    seconds = len(exact) / RATE
    model = _model(text)
    again = rendered(import_model("s.mdl", ModelOptions(dialect="v2")).text, seconds)
    assert off_db(again, exact) < bound
    assert off_db(mims.played(model, "v2", seconds), exact) < bound


def test_mi_gen_export_of_imported_score_round_trip() -> None:
    _fed()
    text = _model(CA)
    Path("m.mdl").write_text(text)
    asked = ModelOptions(inputs={"in1": "push.wav", "in4": "path.wav"})
    score = import_model("m.mdl", asked).text
    message, again = (
        sorted(one for one in t.splitlines() if one[:1] == "@") for t in (text, _model(score))
    )
    assert message == again


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("K: 0.2}}", "K: 0.2, rest: 1mm}}", 19, "net.k: a spring of mi-gen has no length"),
        ("{SOX: m}", "{SOV: m}", 33, "net.here: mi-gen hears positions and forces"),
        ("{SOX: m}", "{SOX: [m, n]}", 33, "net.here: an output of mi-gen hears one point"),
        ("{SOF: y}", "{SOF: k}", 37, "mi-gen hears the force of all links of one mass"),
        ("RES: {between: [n, g]", "DRY: {F: 1, between: [n, g]", 19, "DRY is not written yet"),
        ("RES: {between: [n, g]", "BUT: {exponent: 1.5, between: [n, g]", 19, "with an exponent"),
        (
            "RES: {between: [n, g], K: 0.2}",
            "LNL: {between: [n, g], law: d**5}",
            19,
            "none of mi-gen",
        ),
        ("ergon: 1", "ergon: 1\nrates: {audio: 48kHz}", 9, "net: its numbers are for 44,100 Hz"),
        ("M: 1.3, K: 0.01", "M: 1.3, K: -0.01", 8, "net.m: a stiffness or a viscosity below 0"),
    ],
)
def test_mi_gen_export_refuses_fields_without_equivalent(
    old: str, new: str, line: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    _fed()
    text = CA.replace(old, new)
    Path("s.yaml").write_text(text)
    assert app.run(["export", "s.yaml", "--to", "mdl", "-o", "d"]) == 2
    err = capsys.readouterr().err
    assert f"s.yaml:{line}: " in err
    assert says in err
    assert not Path("d").exists()


def test_mi_gen_export_keeps_names_unique(capsys: pytest.CaptureFixture[str]) -> None:
    Path("s.yaml").write_text(
        "ergon: 1\ninstruments:\n"
        "  a: {modules: {out1: {CEL: {M: 5g, f: 200Hz, t60: 1s}}}, out: {SOX: out1}}\n"
        "  b: {modules: {o-é: {CEL: {M: 5g, f: 300Hz, t60: 1s}}}, out: {SOX: o-é}}\n"
        "  c: {modules: {out1: {SOL: {}}, r: {RES: {between: [out1, a.out1], K: 9N/m}}},\n"
        "      out: {SOX: out1}}\n"
    )
    assert app.run(["export", "s.yaml", "--to", "mdl", "-o", "d"]) == 0
    text = Path("d/s.mdl").read_text()
    for line in ("@a_out1 osc", "@o__ osc", "@c_out1 ground 0", "@r spring @c_out1 @a_out1 9"):
        assert f"\n{line}" in text
    assert app.run(["export", "s.yaml", "c", "--to", "mdl", "-o", "d"]) == 0
    assert "c: c.r, which joins a.out1 is left out" in capsys.readouterr().err
    import_model("d/s.mdl", ModelOptions(dialect="v2"))


def test_mi_gen_export_refuses_other_audio_rates(capsys: pytest.CaptureFixture[str]) -> None:
    Path("s.yaml").write_text(SI.replace("ergon: 1", "ergon: 1\nrates: {audio: 48kHz}"))
    assert app.run(["export", "s.yaml", "--to", "mdl", "-o", "d"]) == 2
    assert "s.yaml:6: a model of mi-gen is for 44,100 Hz" in capsys.readouterr().err


BETWEEN = """\
ergon: 1
takes: {push: {file: push.wav}}
instruments:
  net:
    units: ca
    at: 44100Hz
    modules:
      nut: {SOL: {}}
      s: {STRING: {masses: 12, M: 17, K: 0.05, Z: 0.0005}}
      f: {STRING: {masses: 7, M: 9, K: 0.05, Z: 0.0005, ends: free}}
      p: {PLATE: {shape: rectangle, sides: [4, 3], M: 13, K: 0.04, Z: 0.0002, rim: fixed}}
      t: {PLATE: {shape: rectangle, sides: [3, 5], M: 13, K: 0.04, Z: 0.0002}}
      a: {PROXY: {of: [nut, s, nut], at: 0.3}}
      b: {PROXY: {of: [nut, s, nut], at: 12.75}}
      c: {PROXY: {of: s, at: 4.6}}
      d: {PROXY: {of: f, at: 2.25}}
      e: {PROXY: {of: p, at: [1.3, 2.2]}}
      g: {PROXY: {of: t, at: [3.5, 0.25]}}
      h: {PROXY: {of: [s.3, s.4], shares: [0.8, 0.2]}}
      m: {CEL: {M: 3, K: 0.01, Z: 0.001, X0: 1mm}}
      hit: {BUT: {between: [m, c], K: 0.04, Z: 0.002, side: above}}
      i: {REF: {between: [a, d], K: 0.02, Z: 0.001}}
      j: {REF: {between: [e, b], K: 0.03, Z: 0.001}}
      k: {LNL: {between: [g, h], law: "k*d + q*d*abs(d)", damping: "z*v", k: 0.02, q: 9, z: 0.001}}
      v: {ENF: {to: e, from: push, at: 0s}}
    out: {out1: {SOX: c}, out2: {SOX: g}, out3: {SOX: e}, out4: {SOX: d}, out5: {SOX: s.7}}
render: {tail: 0.3s}
"""


def test_mi_gen_export_of_proxies_as_macro_places():
    t = np.arange(RATE // 2) / RATE
    push = np.float64(np.float32(1e-5 * np.sin(2 * np.pi * 300.0 * t)))
    soundfile.write("push.wav", push, RATE, subtype="FLOAT")
    Path("net.yaml").write_text(BETWEEN)
    (model,) = mi_gen_models("net.yaml", ExportOptions())
    built = model.text
    Path("net.mdl").write_text(built)
    back = import_model("net.mdl", ModelOptions(dialect="v2", inputs={"in1": "push.wav"})).text
    ours, theirs = played(BETWEEN, method="ca")[:8000], rendered(back, 8000 / RATE)
    listened = mims.played(built, "v2", 8000 / RATE, inputs={"in1": push})
    assert np.abs(ours).max(axis=0).min() > 1e-7
    assert off_db(theirs, ours) < -200.0
    assert off_db(listened, ours) < -180.0


@pytest.mark.parametrize("source", ["[s.3, s.6], shares: [0.5, 0.5]", "[s.3, s.4], shares: [1, 1]"])
def test_mi_gen_export_refuses_proxies_off_strings(source: str, capsys: pytest.CaptureFixture[str]):
    soundfile.write("push.wav", np.zeros(10), RATE, subtype="FLOAT")
    Path("net.yaml").write_text(BETWEEN.replace("[s.3, s.4], shares: [0.8, 0.2]", source))
    assert app.run(["export", "net.yaml", "--to", "mdl", "-o", "out"]) != 0
    assert "net.yaml:19: net.h: a PROXY that lies at no place" in capsys.readouterr().err
