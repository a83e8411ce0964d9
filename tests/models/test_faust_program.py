"""Scores as programs of Faust: what a program computes is what the engine steps."""

import re
from pathlib import Path

import numpy as np
import pytest
import soundfile
from faust_built import needs_faust, rendered
from oracle import mims
from planned_sound import off_db, played

from ergon.cli import app
from ergon.workshop.api.export import ExportOptions, faust_programs
from ergon.workshop.api.model import ModelOptions, import_model

pytestmark = pytest.mark.usefixtures("work_folder")
RATE = 44_100
SCORE = """\
ergon: 1
title: Networks
instruments:
  wire: {modules: {s: {STRING: {masses: 12, M: 4g, f: D4, t60: 2s}}}, out: {SOX: s.centre}}
  sheet:
    modules: {p: {PLATE: {radius: 2, M: 50g, f: 300Hz, t60: 1s, rim: fixed, X0: 0.2mm, V0: 0.1m/s}}}
    out: {SOX: p.centre}
  sky: {modules: {b: {BANK: {count: 9, M: 2g, f: 200Hz..900Hz, t60: 1s}}}, out: {SOX: b.all}}
  mesh:
    units: ca
    at: 44100Hz
    modules:
      m: {CEL: {M: 1, K: 0.01, Z: 0.001, X0: 1mm, V0: 1m/s}}
      n: {MAS: {M: 2, X0: 2mm}}
      g: {SOL: {X0: 1mm}}
      l: {REF: {between: [m, n], K: 0.1, Z: 0.01, rest: 0.3mm}}
      k: {RES: {between: [n, g], K: 0.2}}
      z: {FRO: {between: [g, m], Z: 0.02}}
    out: {SOX: m}
  bell:
    modules:
      hammer: {CEL: {M: 20g, f: 1Hz, t60: 0.6s, X0: -2mm, V0: 1m/s}}
      p: {CEL: {M: 1kg, f: 880Hz, t60: 3s, X0: 0.1mm, rest: 0.2mm}}
      slow: {CEL: {M: 1kg, K: 1N/m, Z: 9Ns/m, X0: 1mm}}
      fall: {ENF: {to: slow, from: -2N}}
      hit: {BUT: {between: [hammer, p], K: 1e5N/m, gap: 1mm, exponent: 1.5, Z: 2Ns/m}}
      up: {BUT: {between: [slow, p], K: 1e4N/m, gap: 0.3mm, side: above, clamp: true}}
      tie: {REF: {between: [slow, p], K: 3e3N/m, Z: 0.1Ns/m, rest: 1mm}}
    out: {a: {SOX: p}, b: {SOF: [hit, tie]}, v: {SOV: [slow, p]}, w: {SOA: p}}
strikes:
  a: {to: [wire.s.3], at: 0s, impulse: 1mNs, lasts: 0s}
  b: {to: [sheet.p.7], at: 0s, impulse: 1mNs, lasts: 0s}
  c: {to: [mesh.n], at: 0s, impulse: 1mNs, lasts: 0s}
render: {tail: 1s}
"""
HAND = """
@in1 posInput 0
@in2 frcInput @m
@m mass 1 0.01 0
@g ground 0
@s springDamper @g @m 0.01 0.001
@c springDamper @in1 @m 0.02 0.003
@out1 posOutput @m
@out2 posOutput @in1
"""


@needs_faust
def test_faust_program_output_equals_engine() -> None:
    Path("s.yaml").write_text(SCORE)
    exact = played(SCORE, method="ca")
    (built,) = faust_programs("s.yaml")
    assert "// input 1: force on wire.s.3 [N]" in built.text
    assert "// output 7: bell.v [m/s]" in built.text
    Path("s.dsp").write_text(built.text)
    fed = np.zeros((len(exact), 3))
    fed[0] = 1e-3 * RATE  # an impulse of 1 mNs within a sample
    sound = rendered(Path("s.dsp"), fed, RATE)
    assert sound.shape == exact.shape == (RATE, 8)
    sounding = np.abs(exact).max(axis=0) > 0
    assert np.count_nonzero(sounding) == 7  # nothing strikes the bank
    assert off_db(sound[:, sounding], exact[:, sounding]) < -220
    assert not sound[:, ~sounding].any()


@needs_faust
def test_faust_program_inputs_of_imported_model() -> None:
    t = np.arange(4410) / RATE
    path, push = 0.01 * np.sin(2 * np.pi * 90.0 * t) ** 2, 1e-4 * np.sin(2 * np.pi * 300.0 * t)
    fed = np.float64(np.float32([path, push]))  # as files hold them
    for name, samples in zip(("path.wav", "push.wav"), fed, strict=True):
        soundfile.write(name, samples, RATE, subtype="FLOAT")
    path, push = fed
    exact = mims.played(HAND, "v2", len(t) / RATE, inputs={"in1": path, "in2": push})
    Path("m.mdl").write_text(HAND)
    asked = ModelOptions(dialect="v2", inputs={"in1": "path.wav", "in2": "push.wav"})
    Path("m.yaml").write_text(import_model("m.mdl", asked).text)
    (built,) = faust_programs("m.yaml")
    assert "// input 1: position of model.in1 [m]\n// input 2: force on model.m [N]\n" in built.text
    Path("m.dsp").write_text(built.text)
    sound = rendered(Path("m.dsp"), fed.T, RATE)
    assert off_db(sound, exact) < -220


def test_faust_program_of_part_without_outer_links(capsys: pytest.CaptureFixture[str]) -> None:
    text = SCORE.replace(
        "      hit: {BUT: {between: [hammer,", "      hit: {BUT: {between: [mesh.m,"
    )
    Path("s.yaml").write_text(text.replace("hit, tie", "tie"))
    assert app.run(["export", "s.yaml", "bell", "wire", "--to", "faust", "-o", "d"]) == 0
    err = capsys.readouterr().err
    assert "bell: bell.hit, which joins mesh.m is left out" in err
    program = Path("d/bell.dsp").read_text()
    assert "// input 1: force on bell.p [N]" in program
    assert "mesh_m" not in program
    assert {path.name for path in Path("d").iterdir()} == {"bell.dsp", "wire.dsp"}


def test_faust_program_reports_outer_feeds_and_outputs(capsys: pytest.CaptureFixture[str]) -> None:
    Path("s.yaml").write_text(
        "ergon: 1\ninstruments:\n  a:\n    modules:\n      m: {CEL: {M: 5g, f: 200Hz, t60: 1s}}\n"
        "      push: {ENF: {to: b.m, from: -5N}}\n    out: {SOX: [m, b.m]}\n"
        "  b: {modules: {m: {CEL: {M: 5g, f: 300Hz, t60: 1s}}}}\n"
        "strikes: {s: {to: a.m, at: 0.02s, impulse: 2mNs}}\n"
    )
    assert app.run(["export", "s.yaml", "a", "--to", "faust", "-o", "d"]) == 0
    err = capsys.readouterr().err
    assert "a: a.push, which feeds b.m is left out" in err
    assert "a: b.m, which a hears is left out" in err


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("t60: 2s}}", "t60: 2s, hardening: 1e6N/m3}}", 4, "a STRING that hardens"),
        ("t60: 2s}}", "t60: 2s, X0: {at: 3, x: 1mm}}}", 4, "members that start elsewhere"),
        ("count: 9", "count: 2000", 8, "2,000 masses, and at most 200"),
        (
            "{RES: {between: [n, g], K: 0.2}}",
            "{BRISTLE: {between: [n, g], sigma0: 1, Fc: 1}}",
            17,
            "mesh.k: BRISTLE is not written yet",
        ),
        ("\n    out: {SOX: m}", "", 13, "mesh has no output"),
        ("at: 44100Hz", "at: 22050Hz", 13, "mesh: its numbers are for 22,050 Hz"),
        ("gap: 1mm, ", "gap: 1mm, contact: exact, ", 26, "a contact that is exact"),
    ],
)
def test_faust_export_refuses_unsupported_modules(
    old: str, new: str, line: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = SCORE.replace(old, new)
    if "exact" in new:
        text = text.replace("exponent: 1.5, Z: 2Ns/m", "exponent: 1.5")
    Path("s.yaml").write_text(text)
    only = ["mesh"] if "no output" in says else []
    assert app.run(["export", "s.yaml", *only, "--to", "faust", "-o", "d"]) == 2
    err = capsys.readouterr().err
    assert f"s.yaml:{line}: " in err
    assert says in err
    assert not Path("d").exists()


def test_faust_export_reports_every_omitted_module(capsys: pytest.CaptureFixture[str]) -> None:
    Path("s.yaml").write_text(
        SCORE.replace("t60: 2s", "t60: 2s, hardening: 1e6N/m3").replace("count: 9", "count: 2000")
    )
    assert app.run(["export", "s.yaml", "--to", "faust", "-o", "d"]) == 2
    err = capsys.readouterr().err
    assert "s.yaml:4: wire.s" in err
    assert "s.yaml:8: sky.b" in err


BELL = """\
ergon: 1
instruments:
  bell:
    modules:
      b: {MODES: {M: 30g, f: [440Hz, 921Hz, 1500Hz], t60: [3s, 2s, 1s],
          places: {rim: [1, 0.4, 0.7], crown: [-0.4, 1, 0.2]}}}
    out: {a: {SOX: b.crown}, b: {SOX: [b.rim, b.crown]}, c: {SOV: b.crown}, d: {SOA: b.rim}}
  wire: {modules: {s: {STRING: {masses: 12, M: 4g, f: D4, t60: 2s}}}, out: {SOX: s.centre}}
strikes:
  a: {to: [bell.b.rim], at: 0s, impulse: 2mNs, lasts: 0s}
  b: {to: [bell.b.crown], at: 0s, impulse: 1mNs, lasts: 0s}
render: {tail: 0.3s}
"""


@needs_faust
def test_faust_program_of_modes_body_as_resonators() -> None:
    Path("s.yaml").write_text(BELL)
    exact = played(BELL, method="modal")[:, :4]
    bell, wire = faust_programs("s.yaml", ExportOptions(parts=("bell", "wire")))
    assert (bell.part, wire.part) == ("bell", "wire")
    assert "// input 1: force on bell.b.0 [N]\n// input 2: force on bell.b.1 [N]\n" in bell.text
    assert "// output 3: out c [m/s]" in bell.text
    Path("b.dsp").write_text(bell.text)
    fed = np.zeros((len(exact), 2))
    fed[0] = 2e-3 * RATE, 1e-3 * RATE
    assert off_db(rendered(Path("b.dsp"), fed, RATE), exact) < -200
    # At another rate it is the same body.
    fed = np.zeros((round(0.3 * 88_200), 2))
    fed[0] = 2e-3 * 88_200, 1e-3 * 88_200
    assert off_db(rendered(Path("b.dsp"), fed, 88_200)[::2, :2], exact[:, :2]) < -200


def test_faust_export_of_modes_needs_named_part(capsys: pytest.CaptureFixture[str]) -> None:
    Path("s.yaml").write_text(BELL)
    assert app.run(["export", "s.yaml", "--to", "faust", "-o", "d"]) == 2
    assert "s.yaml:5: bell.b: MODES is a bank of resonators" in capsys.readouterr().err
    assert app.run(["export", "s.yaml", "belt", "--to", "faust", "-o", "d"]) == 2
    assert "did you mean 'bell'?" in capsys.readouterr().err


BODIES = """\
ergon: 1
instruments:
  wire:
    modules: {s: {STRING: {masses: 40, M: 4g, f: D3, t60: 2s, inharmonicity: 1e-5}}}
    out: {a: {SOX: s.17}, v: {SOV: s.20}}
  sheet:
    modules: {p: {PLATE: {radius: 5, M: 50g, f: 300Hz, t60: 1s, rim: fixed}}}
    out: {SOA: p.centre}
  sky: {modules: {b: {BANK: {count: 9, M: 2g, f: 200Hz..900Hz, t60: 1s}}}, out: {SOX: b.all}}
  desk:
    modules:
      s: {STRING: {masses: 20, M: 4g, f: D4, t60: 2s}}
      m: {CEL: {M: 20g, f: 100Hz, t60: 0.3s}}
      r: {REF: {between: [s.5, m], K: 3kN/m, Z: 0.1Ns/m}}
    out: {SOX: s.9}
  still: {modules: {m: {CEL: {M: 20g, f: 100Hz, t60: 0.3s}}}}
strikes:
  a: {to: [wire.s.3], at: 0s, impulse: 1mNs, lasts: 0s}
  b: {to: [sheet.p.7], at: 0s, impulse: 1mNs, lasts: 0s}
  c: {to: [sky.b.all], at: 0s, impulse: 1mNs, lasts: 0s}
  d: {to: [desk.s.2], at: 0s, impulse: 1mNs, lasts: 0s}
render: {tail: 0.3s}
"""


@needs_faust
def test_faust_program_of_bodies_as_mode_banks() -> None:
    Path("s.yaml").write_text(BODIES)
    exact = played(BODIES, method="modal")
    built = faust_programs("s.yaml", ExportOptions(upto="20kHz"))
    assert [one.part for one in built] == ["wire", "sheet", "sky", "desk"]  # what is heard
    # One program of all: each is compiled as an environment of its own.
    texts = [f"p_{one.part} = environment {{\n{one.text}\n}}.process;" for one in built]
    texts = [re.sub("declare .*", "", text) for text in texts]
    complete = ", ".join(f"p_{one.part}" for one in built)
    Path("s.dsp").write_text("\n".join([*texts, f"process = {complete};"]))
    counts = [one.text.count("// input") for one in built]
    assert counts == [1, 1, 9, 1]
    fed = np.zeros((len(exact), sum(counts)))
    fed[0] = 1e-3 * RATE
    sound = rendered(Path("s.dsp"), fed, RATE)
    assert sound.shape == exact.shape
    assert off_db(sound, exact) < -200


def test_faust_program_without_modes_above_frequency() -> None:
    Path("s.yaml").write_text(BODIES)
    low, high = (
        faust_programs("s.yaml", ExportOptions(parts=("wire",), upto=upto))[0].text.count("mode(")
        for upto in ("1kHz", 20_000.0)
    )
    assert (low - 1, high - 1) == (2 * 6, 2 * 40)  # of a string at 147 Hz


def test_faust_export_refuses_too_many_resonators(capsys: pytest.CaptureFixture[str]) -> None:
    modes = ", ".join(f"{100 + 5 * n}Hz" for n in range(450))
    outs = ", ".join(f"o{n}: {{SOX: b.point}}" for n in range(5))
    Path("s.yaml").write_text(
        "ergon: 1\ninstruments:\n  a:\n    modules:\n"
        f"      b: {{MODES: {{M: 1kg, f: [{modes}], t60: 9s}}}}\n    out: {{{outs}}}\n"
    )
    assert app.run(["export", "s.yaml", "a", "--to", "faust", "-o", "d"]) == 2
    assert "a file holds at most 2,000 resonators" in capsys.readouterr().err


PROXIES = """
ergon: 1
instruments:
  i:
    modules:
      a: {MAS: {M: 2g, X0: 1mm}}
      b: {CEL: {M: 3g, K: 900N/m, V0: 0.3m/s}}
      ab: {RES: {between: [a, b], K: 700N/m}}
      h: {MAS: {M: 4g, X0: -0.5mm, V0: 0.5m/s}}
      p: {PROXY: {of: [a, b], shares: [0.5, 0.75]}}
      q: {PROXY: {of: [a, b], at: 0.25}}
      hit: {BUT: {between: [h, p], K: 3kN/m, Z: 0.2Ns/m}}
      rub: {LNL: {between: [h, q], law: "300*d + 4e6*d**3", damping: "0.1*v"}}
      push: {ENF: {to: q, from: 20mN}}
    out: {a: {SOX: a}, h: {SOX: h}, p: {SOV: p}, f: {SOF: rub}}
render: {tail: 50ms}
"""


@needs_faust
def test_faust_program_of_proxies() -> None:
    Path("s.yaml").write_text(PROXIES)
    exact = played(PROXIES, method="ca")
    (built,) = faust_programs("s.yaml")
    Path("s.dsp").write_text(built.text)
    sound = rendered(Path("s.dsp"), np.zeros((len(exact), 0)), RATE)
    assert np.abs(exact).max(axis=0).min() > 0
    assert off_db(sound, exact) < -220


def test_faust_and_mdl_export_refuse_moving_proxy(capsys: pytest.CaptureFixture[str]) -> None:
    Path("s.yaml").write_text(PROXIES.replace("at: 0.25", "follows: h"))
    assert app.run(["export", "s.yaml", "--to", "faust", "-o", "d"]) == 2
    assert "s.yaml:11: i.q: a PROXY that follows a MAT is not written yet" in (
        capsys.readouterr().err
    )
    Path("s.yaml").write_text(PROXIES)
    assert app.run(["export", "s.yaml", "--to", "mdl", "-o", "d"]) == 2
    assert "i.p: a PROXY that lies at no place of one whole STRING" in capsys.readouterr().err
