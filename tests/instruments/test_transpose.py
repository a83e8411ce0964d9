"""Instruments at another pitch: exact in every mode, and the same as written by hand."""

import numpy as np
import pytest
from checked import check, check_reports, codes

from ergon.instruments import transpose as t
from ergon.notation.tables import quantities as q
from ergon.notation.text.errors import TextError
from ergon.scores.edits.matter import set_value
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import stage


def piece(instruments: str, rate: str = "44100Hz") -> Piece:
    loaded = check(f"ergon: 1\nrates: {{audio: {rate}}}\ninstruments:\n{instruments}")
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def fields(made: Piece, name: str, module: str = "") -> dict:
    return next(dict(m.fields) for m in made.instruments[name].modules if m.name == module)


# --- pitches ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("note", "interval", "other"),
    [
        ("C5", "7st", "G5"),
        ("A3+5cents", "7st", "E4+5cents"),
        ("C#2", "-14cents", "C#2-14cents"),
        ("B3", "1st", "C4"),
        ("F7", "-60st", "F2"),
        ("G#9-30cents", "-100st", "E1-30cents"),
        ("220Hz", "x1.5", "330Hz"),
        ("453Hz", "x1.1", "498.3Hz"),
        ("100.1Hz", "x0.3", "30.03Hz"),
    ],
)
def test_pitch_after_interval_exact(note, interval, other):
    assert t.transposed_frequency(q.frequency(note), t.parse_interval(interval)) == q.frequency(
        other
    )


def test_interval_between_any_two_notes_exact():
    notes = [q.frequency(f"{letter}{octave}") for octave in range(9) for letter in "CDEFGAB"]
    for low in notes:
        for high in notes:
            assert t.transposed_frequency(low, t.interval_between(low, high)) == high


@pytest.mark.parametrize(
    ("text", "code", "suggestion"),
    [
        ("7", "E203", "7st"),
        ("-0.5", "E203", "-0.5st"),
        ("seven", "E201", None),
        ("7 semitones", "E201", None),
        ("121st", "E202", None),
        ("-99999cents", "E202", None),
        ("x0", "E202", None),
        ("x-2", "E202", None),
        ("x1e9", "E202", None),
        ("x", "E201", None),
        ("", "E201", None),
        ("1e999st", "E201", None),
    ],
)
def test_parse_interval_refuses_wrong_text(text, code, suggestion):
    with pytest.raises(TextError) as refused:
        t.parse_interval(text)
    assert (refused.value.code, refused.value.suggestion) == (code, suggestion)


# --- what is transposed -------------------------------------------------------------------------

CHAIN = """\
  b:
    transpose: {interval}
    modules:
      wall: {{SOL: {{}}}}
      a: {{CEL: {{M: 3g, f: 300Hz, t60: 1.5s}}}}
      b: {{CEL: {{M: 2g, K: 9kN/m, Z: 60mNs/m}}}}
      c: {{MAS: {{M: 1g}}}}
      d: {{MAS: {{M: 2g}}}}
      string: {{STRING: {{masses: 6, M: 4g, f: 200Hz, t60: 2s, inharmonicity: 1e-3}}}}
      plate: {{PLATE: {{radius: 2, M: 20g, f: 150Hz, t60: {{150Hz: 3s, 2kHz: 0.5s}}, rim: fixed}}}}
      sky: {{BANK: {{count: 4, M: 1g, f: 200Hz..2kHz, t60: 1s..3s}}}}
      ab: {{REF: {{between: [a, b], K: 4kN/m, Z: 90mNs/m}}}}
      bc: {{RES: {{between: [b, c], K: 3kN/m}}}}
      cd: {{REF: {{between: [c, d], K: 2kN/m, Z: 0.4Ns/m}}}}
      dw: {{RES: {{between: [d, wall], K: 5kN/m}}}}
      ds: {{REF: {{between: [d, string.2], K: 1kN/m, Z: 1Ns/m}}}}
      sp: {{RES: {{between: [string.4, plate.centre], K: 2kN/m}}}}
      ps: {{RES: {{between: [plate.5, sky.1], K: 500N/m}}}}
    out: {{SOX: [a, b, c, d, string.all, plate.all, sky.all]}}
"""


@pytest.mark.parametrize("interval", ["7st", "x0.371", "-23.5st", "x3"])
def test_transposed_body_modes_scaled_by_ratio(interval):
    ratio = t.parse_interval(interval).ratio
    low = stage(piece(CHAIN.format(interval="x1"))).network.modes("b", 30)
    high = stage(piece(CHAIN.format(interval=interval))).network.modes("b", 30)
    assert len(low) == len(high) == 30
    for a, b in zip(low, high, strict=True):
        assert b.f == pytest.approx(ratio * a.f, rel=1e-9)
        assert b.t60 == pytest.approx(a.t60 / ratio, rel=1e-7)


NET = """\
  b:
    transpose: {interval}
    modules:
      wall: {{SOL: {{}}}}
      a: {{CEL: {{M: 3g, f: 300Hz, t60: 0.1s}}}}
      b: {{CEL: {{M: 2g, K: 9kN/m, Z: 600mNs/m}}}}
      c: {{MAS: {{M: 1g}}}}
      d: {{MAS: {{M: 2g}}}}
      ab: {{REF: {{between: [a, b], K: 4kN/m, Z: 900mNs/m}}}}
      bc: {{RES: {{between: [b, c], K: 3kN/m}}}}
      cd: {{REF: {{between: [c, d], K: 2kN/m, Z: 0.4Ns/m}}}}
      dw: {{FRO: {{between: [d, wall], Z: 7Ns/m}}}}
"""


def eigenvalues(built: Piece) -> np.ndarray:
    """Of the equations of motion, from the fields alone."""
    by_name = {module.name: module for module in built.instruments["b"].modules}
    moving = [name for name in by_name if by_name[name].kind in ("MAS", "CEL")]
    n = len(moving)
    mass, stiffness, damping = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    for name, module in by_name.items():
        f = module.fields
        if name in moving:
            i = moving.index(name)
            mass[i] = f["M"]
            k, z = f.get("K") or 0.0, f.get("Z") or 0.0
            if f.get("f"):
                sigma = np.log(1000.0) / f["t60"]
                k = f["M"] * ((2 * np.pi * f["f"]) ** 2 + sigma**2)
                z = 2 * f["M"] * sigma
            stiffness[i, i] += k
            damping[i, i] += z
        elif "between" in f:
            ends = [moving.index(e.module) for e in f["between"] if e.module in moving]
            for i in ends:
                for j in ends:
                    sign = 1.0 if i == j else -1.0
                    stiffness[i, j] += sign * (f.get("K") or 0.0)
                    damping[i, j] += sign * (f.get("Z") or 0.0)
    upper = np.hstack([np.zeros((n, n)), np.eye(n)])
    lower = np.hstack([-stiffness / mass[:, None], -damping / mass[:, None]])
    return np.sort_complex(np.linalg.eigvals(np.vstack([upper, lower])))


@pytest.mark.parametrize("interval", ["7st", "x0.371", "-23.5st", "x3"])
def test_transposed_network_eigenvalues_scaled_by_ratio(interval):
    ratio = t.parse_interval(interval).ratio
    low, high = (eigenvalues(piece(NET.format(interval=i))) for i in ("x1", interval))
    assert np.abs(high - ratio * low).max() < 1e-10 * np.abs(high).max()


STRUCK = """\
  b:
    transpose: {interval}
    modules:
      wall: {{SOL: {{}}}}
      ball: {{MAS: {{M: 3g, X0: -2mm, V0: 1.5m/s}}}}
      cell: {{CEL: {{M: 3g, f: 300Hz, t60: 1.5s, X0: 0.2mm}}}}
      felt: {{FRO: {{between: [wall, gong.1], Z: 5Ns/m}}}}
      string: {{STRING: {{masses: 8, M: 4g, f: 200Hz, t60: 2s, hardening: 1e9N/m3,
               stretching: {{young: 200GPa, radius: 0.2mm, length: 70cm}},
               V0: {{at: 3, v: 2m/s}}}}}}
      gong: {{PLATE: {{radius: 2, M: 20g, f: 150Hz, t60: 3s, rim: fixed, hardening: 1e9N/m3}}}}
      hit: {{BUT: {{between: [ball, gong.centre], K: 2e6, Z: 1Ns/m, exponent: 1.5, gap: 1mm}}}}
      tip: {{BUT: {{between: [string.5, wall], K: 9kN/m, contact: exact, gap: 0.1mm}}}}
      bend: {{LNL: {{between: [cell, gong.2], law: cubic, k: 2kN/m, q: 1e9N/m3, z: 50mNs/m}}}}
      rope: {{LNL: {{between: [cell, string.1], law: "where(d > 0, k*d, 0)",
             damping: "z*v*abs(d)", k: 3kN/m, z: 100Ns/m2}}}}
      dots: {{LNL: {{between: [gong.4, wall], points: [[-1mm, -3N], [0mm, 0N], [1mm, 1N]]}}}}
    out: {{SOX: [ball, cell, string.all, gong.all]}}
"""


def samples(built: Piece, count: int = 4000) -> np.ndarray:
    out = np.zeros((count, 1))
    stage(built).simulation.process(out)
    return out


@pytest.mark.parametrize(("interval", "rate"), [("x2", "88200Hz"), ("-12st", "22050Hz")])
def test_transposed_motion_equals_scaled_time(interval, rate):
    single = samples(piece(STRUCK.format(interval="x1")))
    moved = samples(piece(STRUCK.format(interval=interval), rate))
    assert np.abs(single).max() > 1e-4
    assert np.abs(moved - single).max() < 1e-9 * np.abs(single).max()


def test_transpose_leaves_friction_law_and_mechanics():
    text = (
        "  b: {transpose: 12st, modules: {hammer: {CEL: {M: 8g, f: 1Hz, t60: 2s}},"
        " slow: {CEL: {M: 1g, K: 10N/m}}, m: {CEL: {M: 8g, f: A3, t60: 2s}},"
        " rub: {LNL: {between: [hammer, m], damping: bow, F: 0.8N}}}}\n"
    )
    built = piece(text)
    assert (fields(built, "b", "hammer")["f"], fields(built, "b", "hammer")["t60"]) == (1.0, 2.0)
    assert fields(built, "b", "slow")["K"] == 10.0
    assert fields(built, "b", "m")["f"] == 440.0
    rub = fields(built, "b", "rub")
    assert rub["damping"] == "F*sqrt(2*a)*(v - u)*exp(0.5 - a*(v - u)**2)"
    assert rub["constants"] == {"F": 0.8, "a": 60.0, "u": 0.0}


# --- the same as by hand ------------------------------------------------------------------------

BELL = """\
  bell:
    modules:
      hammer: {CEL: {M: 8g, f: 1Hz, t60: 2s}}
      hum: {CEL: {M: 200g, f: %s, t60: %s}}
      prime: {CEL: {M: 40g, f: %s, t60: %s}}
      tierce: {CEL: {M: 4g, K: %s, Z: %s}}
      b1: {BUT: {between: [hammer, hum], K: %s, Z: %s, gap: 7mm}}
    out: {SOX: [hum, prime]}
"""
LOW = BELL % ("C4", "12s", "D5+30cents", "6s", "40kN/m", "20mNs/m", "1e6", "2Ns/m")
HIGH = BELL % ("C5", "6s", "D6+30cents", "3s", "160kN/m", "40mNs/m", "4e6", "4Ns/m")
BEGINNING = "\nstrikes: {s: {to: bell.hum, at: 0.1s, impulse: 1mNs}}\nrender: {tail: 0.2s}\n"


def written(instruments: str) -> Piece:
    loaded = check(f"ergon: 1\ninstruments:\n{instruments}{BEGINNING}")
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


@pytest.mark.parametrize(
    "moved",
    [
        LOW.replace("bell:\n", "bell:\n    transpose: 12st\n"),
        LOW.replace("bell:\n", "bell:\n    transpose: x2\n"),
        f"{LOW.replace('bell:', 'low:')}  bell: {{like: low, transpose: 12st}}\n",
        f"{LOW.replace('bell:', 'low:')}  mid: {{like: low, transpose: -12st}}\n"
        "  bell: {like: mid, transpose: 2400cents}\n",
        f"{LOW.replace('bell:', 'low:').replace('modules:', 'f: C4' + chr(10) + '    modules:')}"
        "  bell: {like: low, f: C5}\n",
        f"{LOW.replace('bell:', 'low:').replace('modules:', 'f: D5' + chr(10) + '    modules:')}"
        "  bell: {like: low, f: A5, transpose: 5st}\n",
    ],
)
def test_transposed_bell_equals_bell_by_hand(moved):
    by_hand = written(HIGH)
    built = written(moved)
    assert [dict(m.fields, between=None) for m in built.instruments["bell"].modules] == [
        dict(m.fields, between=None) for m in by_hand.instruments["bell"].modules
    ]
    single = stage(built)
    out = np.zeros((6000, single.simulation.n_out))
    single.simulation.process(out)
    assert np.abs(out).max() > 0
    assert out[:, -1:].tobytes() == samples(by_hand, 6000).tobytes()


def test_bundled_instruments_retuned_by_f():
    built = piece(
        "  up: {from: bell/bell, f: C5}\n  low: {from: string/string, f: C3}\n"
        "  tam: {from: gong/tamtam, transpose: -14cents}\n  old: {from: gong/plate, f: A1}\n"
    )
    assert fields(built, "up", "prime")["f"] == q.frequency("C5")
    assert fields(built, "up", "hum-2")["f"] == q.frequency("C4+5cents")
    assert fields(built, "low", "body")["f"] == q.frequency("C3")
    assert fields(built, "low", "hammer")["f"] == 1.0
    assert fields(built, "tam", "body")["f"] == q.frequency("F2-14cents")
    assert fields(built, "old")["f"] == 55.0
    assert fields(built, "old")["t60"] == 30.0  # `f` of a generator is its own field alone


# --- what merges --------------------------------------------------------------------------------


def test_like_and_from_merge_fields_by_module():
    built = piece(
        "  low: {from: string/string,"
        " modules: {body: {STRING: {f: C3}}, felt: {BUT: {gap: 5mm}}}}\n"
        "  g: {from: gong/plate, PLATE: {f: C3}}\n"
        "  c: {modules: {m: {CEL: {M: 2g, f: A3, t60: 2s}}, l: {LNL: {between: [m, n],"
        " law: cubic, k: 2N/m, q: 1e3}}, n: {CEL: {M: 2g, K: 1kN/m, Z: 1}}}}\n"
        "  d: {like: c, modules: {m: {CEL: {K: 3kN/m}}, n: {CEL: {Z: 2}}, l: {LNL: {k: 3N/m}}}}\n"
        "  e: {like: c, modules: {l: {LNL: {law: a*d, a: 3N/m}}, m: {MAS: {M: 1g}}}}\n"
    )
    body = fields(built, "low", "body")
    assert (body["f"], body["masses"], body["inharmonicity"]) == (q.frequency("C3"), 60, 1.5e-4)
    assert (fields(built, "low", "felt")["gap"], fields(built, "low", "felt")["K"]) == (5e-3, 5e8)
    assert (fields(built, "g")["f"], fields(built, "g")["radius"]) == (q.frequency("C3"), 8)
    m = fields(built, "d", "m")
    assert (m["M"], m["K"], m["Z"], m["f"], m["t60"]) == (2e-3, 3e3, None, None, None)
    assert (fields(built, "d", "n")["K"], fields(built, "d", "n")["Z"]) == (1e3, 2.0)
    assert fields(built, "d", "l")["constants"] == {"k": 3.0, "q": 1e3, "z": 0.0}
    assert fields(built, "e", "l")["constants"] == {"a": 3.0}
    assert [m.kind for m in built.instruments["e"].modules] == ["MAS", "LNL", "CEL"]


def test_like_merges_modules_of_keys():
    loaded = check(
        "ergon: 1\nkeys:\n  k1: {struck: m, modules: {m: {MAS: {M: 400g}}, g: {SOL: {}},"
        " r: {REF: {between: [g, m], K: 60N/m, Z: 1Ns/m}}}}\n"
        "  k2: {like: k1, modules: {r: {REF: {K: 80N/m}}}}\n"
        "players: {a: {key: k1}, b: {key: k2}}\n"
    )
    assert loaded.piece is not None, loaded.diagnostics
    link = loaded.piece.keys["k2"].modules[2]
    assert (link.fields["K"], link.fields["Z"], len(link.fields["between"])) == (80.0, 1.0, 2)
    assert link.fields["between"][1].part == "k2"


def test_transpose_with_written_fields_unchanged():
    built = piece("  b: {from: bell/bell, transpose: 7st, modules: {prime: {CEL: {f: A4}}}}\n")
    assert fields(built, "b", "prime")["f"] == 440.0
    assert fields(built, "b", "prime")["M"] == 40e-3


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("instruments", "report"),
    [
        (
            "  h: {modules: {m: {CEL: {M: 1g, K: 8kN/m}}}}\n  b: {like: h, f: C3}\n",
            (
                "E103",
                4,
                "f of instrument 'b': instrument 'h' has no named pitch; write `f` beside its "
                "modules, the pitch at which they are written, or `transpose`",
            ),
        ),
        (
            "  b: {transpose: 7, modules: {m: {CEL: {M: 1g, K: 8kN/m}}}}\n",
            (
                "E203",
                3,
                "transpose of instrument 'b': '7' is not an interval such as 7st, -14cents or 3/2",
            ),
        ),
        (
            "  b: {units: ca, at: 44100Hz, transpose: 7st, modules: {m: {CEL: {M: 1, K: 0.1}}}}\n",
            (
                "E111",
                3,
                "transpose of instrument 'b': under `units: ca` K and Z are those of a discrete "
                "network, whose modes no factor moves alike; write them in SI units",
            ),
        ),
        (
            "  b: {modules: {m: {CEL: {f: A3}}}}\n",
            ("E103", 3, "module 'b.m' has no 'M': a mass, such as 400g"),
        ),
        (
            "  b: {from: bell/bell, modules: {new: {BUT: {K: 1kN/m}}}}\n",
            (
                "E103",
                3,
                "module 'b.new' has no 'between': a list, each a module, such as m, bell.m, "
                "gong.centre or a key",
            ),
        ),
        (
            "  b: {from: bell/bell, f: A3..A4}\n",
            ("E202", 3, "f of instrument 'b': only a BANK has a range"),
        ),
    ],
)
def test_failed_transposition_is_reported_once(instruments, report):
    assert check_reports(f"ergon: 1\ninstruments:\n{instruments}") == [report]


def test_broken_transposition_reported_once():
    assert codes("ergon: 1\ninstruments:\n  b: {from: bell/bell, transpose: 7}\n") == ["E203"]


# --- at the prompt ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("instrument", "target", "value", "field", "expected"),
    [
        ("b: {from: bell/bell, transpose: 7st}", "b.prime.f", "A4", "f", 440.0),
        ("b: {from: bell/bell, transpose: 7st}", "b.prime.f", "x2", "f", 2 * q.frequency("E5")),
        ("b: {from: bell/bell, transpose: 7st}", "b.prime.t60", "5s", "t60", 5.0),
        ("b: {transpose: 7st, modules: {m: {CEL: {M: 1g, f: A3}}}}", "b.m.f", "A4", "f", 440.0),
        ("b: {transpose: x2, modules: {m: {CEL: {M: 1g, f: A3}}}}", "b.m.f", "x2", "f", 880.0),
        ("b: {transpose: x2, modules: {m: {CEL: {M: 1g, K: 9kN/m}}}}", "b.m.K", "5kN/m", "K", 5e3),
        ("b: {from: gong/plate, transpose: 12st}", "b.f", "A2", "f", 110.0),
        ("b: {from: gong/plate, f: A2, transpose: 12st}", "b.f", "x2", "f", 440.0),
    ],
)
def test_set_value_of_transposed_instrument(instrument, target, value, field, expected):
    texts = Texts("s.yaml", f"ergon: 1\ninstruments:\n  {instrument}\n")
    before = texts.load().piece
    assert before is not None
    loaded = set_value(texts, before, target, value).load()
    assert loaded.piece is not None, loaded.diagnostics
    module = target.split(".")[1] if target.count(".") == 2 else ""
    assert fields(loaded.piece, "b", module)[field] == pytest.approx(expected, rel=1e-8)
