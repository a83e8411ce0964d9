"""Bodies of a named material against the formulas of the literature."""

import math

import numpy as np
import pytest
from checked import check, check_reports, codes
from numpy.polynomial import legendre
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import iv, ivp, jv, jvp

from ergon.instruments.assemble import Assembly
from ergon.instruments.materials import MATERIALS

SCORE = "ergon: 1\ninstruments:\n  s: {modules: {body: {%s}}}\n"
WIRE = "STRING: {material: steel, %s}"
STEEL, BRONZE = MATERIALS["steel"], MATERIALS["bronze"]


def body(fields: str) -> dict:
    (module,) = check(SCORE % fields).piece.instruments["s"].modules
    return dict(module.fields)


def modes(fields: str, count: int) -> np.ndarray:
    assembly = Assembly()
    assembly.add_part("s", check(SCORE % fields).piece.instruments["s"].modules)
    listened = np.array(assembly.network.modes("s", count + 3))
    return listened[listened[:, 0] > 1.0][:count]


def refused(fields: str) -> list[tuple[str, str]]:
    return [(report[0], report[2]) for report in check_reports(SCORE % fields)]


def test_materials_with_plausible_values_and_source():
    for name, item in MATERIALS.items():
        assert 400.0 <= item.density <= 9000.0, name
        assert 4e8 <= item.young <= 2.2e11, name
        assert 0.0 < item.poisson <= 0.5, name
        assert 1e-5 < item.loss < 0.1, name
        assert len(item.source) > 20, name


# f from T and μ, B = π³·E·d⁴/(64·T·L²): Fletcher and Rossing, The Physics of Musical Instruments.
def test_wire_of_material_stiff_string_modes():
    length, d, tension = 0.65, 0.4e-3, 70.0
    wire = WIRE % "length: 65cm, diameter: 0.4mm, tension: 70N"
    line = STEEL.density * math.pi * d**2 / 4
    b = math.pi**3 * STEEL.young * d**4 / (64 * tension * length**2)
    n = np.arange(1, 21)
    wanted = n * math.sqrt(tension / line) / (2 * length) * np.sqrt(1 + b * n**2)
    listened = modes(wire, 20)
    assert np.abs(1200 * np.log2(listened[:, 0] / wanted)).max() < 1.0
    fields = body(wire)
    assert fields["inharmonicity"] == pytest.approx(b, rel=1e-12)
    # A mode of a held string moves half of the whole mass.
    assert fields["M"] * (fields["masses"] + 1) / fields["masses"] == pytest.approx(line * length)

    def t60(f: float) -> float:
        drag = 2 * math.pi * (1.81e-5 + d * math.sqrt(math.pi * 1.81e-5 * 1.204 * f))
        bending = STEEL.young * math.pi * d**4 / 64 * line * (2 * math.pi * f / tension) ** 2
        q = 1 / (drag / (line * 2 * math.pi * f) + STEEL.loss * bending)
        return math.log(1000) * q / (math.pi * f)

    assert listened[0, 1] == pytest.approx(t60(wanted[0]), rel=1e-6)
    near = listened[np.argmin(np.abs(listened[:, 0] - 2000.0))]
    assert near[1] == pytest.approx(t60(near[0]), rel=0.05)


@pytest.mark.parametrize("ends", ["fixed", "left", "free"])
@pytest.mark.parametrize("more", ["", ", inharmonicity: 1e-4", ", masses: 90, stiffness: 0.01"])
def test_wire_fourth_of_length_diameter_tension_and_f(ends, more):
    sizes = {"length": 0.65, "diameter": 1e-3, "tension": 70.0}
    units = {"length": "m", "diameter": "m", "tension": "N", "f": "Hz"}

    def wire_body(names) -> dict:
        written = ", ".join(f"{name}: {sizes[name]!r}{units[name]}" for name in names)
        return body(WIRE % f"ends: {ends}, {written}{more}")

    first = wire_body(("length", "diameter", "tension"))
    sizes["f"] = first["f"]
    for left_out in ("length", "diameter", "tension"):
        again = wire_body([name for name in sizes if name != left_out])
        for name in ("masses", "M", "f", "inharmonicity"):
            if first[name] is None:
                continue
            assert again[name] == pytest.approx(first[name], rel=1e-9), (left_out, name)


def test_written_wire_fields_override_derived():
    plain = body(WIRE % "length: 65cm, diameter: 0.4mm, tension: 70N")
    single = "masses: 70, t60: 3s, inharmonicity: 2e-4"
    text = body(WIRE % f"length: 65cm, diameter: 0.4mm, tension: 70N, {single}")
    assert (text["masses"], text["t60"], text["inharmonicity"]) == (70, 3.0, 2e-4)
    # A wound string: twice the mass, the pitch half an octave lower, the stiffness of its core.
    wound = f"M: {2 * plain['M']!r}kg, length: 65cm, diameter: 0.4mm, tension: 70N"
    heavy = body(WIRE % f"masses: {plain['masses']}, {wound}")
    assert heavy["f"] == pytest.approx(plain["f"] / math.sqrt(2.0), rel=1e-9)
    assert heavy["inharmonicity"] == pytest.approx(plain["inharmonicity"], rel=1e-9)
    copper = body(
        "STRING: {material: {like: steel, young: 115GPa, density: 8890kg/m3}, "
        "length: 65cm, diameter: 0.4mm, tension: 70N}"
    )
    assert copper["f"] < plain["f"]
    assert copper["inharmonicity"] < plain["inharmonicity"]


def _free_disc(n: int, poisson: float, number: int = 0) -> float:
    """λ² of mode (n, number) of a free disc: Leissa, Vibration of Plates (1969), eq. 2.13."""

    def error(x: float) -> float:
        def moment(w: float, slope: float, bend: float) -> float:
            return bend - (1 - poisson) * (slope - n * n * w)

        def shear(w: float, slope: float, bend: float) -> float:
            return bend - (1 - poisson) * n * n * (slope - w)

        j, jp, i, ip = jv(n, x), x * jvp(n, x), iv(n, x), x * ivp(n, x)
        return moment(j, jp, -x * x * j) * shear(i, ip, x * x * ip) - moment(
            i, ip, x * x * i
        ) * shear(j, jp, -x * x * jp)

    grid = np.linspace(1.2, 9.0, 800)
    values = [error(x) for x in grid]
    signs = [i for i in range(799) if values[i] * values[i + 1] < 0]
    return brentq(error, grid[signs[number]], grid[signs[number] + 1]) ** 2


def _speed(matter, thickness: float) -> float:
    """√(D/(ρ·h)) [m²/s]"""
    return thickness * math.sqrt(matter.young / (12 * matter.density * (1 - matter.poisson**2)))


def test_free_bronze_disc_modes():
    gong = "PLATE: {material: bronze, radius: 30cm, thickness: 2mm, masses: 300}"
    scale = _speed(BRONZE, 2e-3) / (2 * math.pi * 0.3**2)
    fields = body(gong)
    assert fields["M"] == pytest.approx(BRONZE.density * math.pi * 0.09 * 2e-3)
    assert fields["f"] == pytest.approx(_free_disc(2, 0.35) * scale, rel=2e-5)
    # Modes (2, 0) twice, (0, 1), (3, 0) twice, (1, 1) twice, (4, 0) twice.
    squares = [_free_disc(2, 0.35), _free_disc(0, 0.35), _free_disc(3, 0.35)]
    squares += [_free_disc(1, 0.35), _free_disc(4, 0.35)]
    wanted = np.array([squares[i] for i in (0, 0, 1, 2, 2, 3, 3, 4, 4)]) * scale
    listened = modes(gong, 9)
    assert np.sort(listened[:, 0]) == pytest.approx(np.sort(wanted), rel=0.025)
    assert listened[0, 1] == pytest.approx(math.log(1000) / (math.pi * fields["f"] * BRONZE.loss))


def test_fixed_rim_disc_pitch_closed_form():
    fields = body("PLATE: {material: steel, radius: 20cm, thickness: 3mm, rim: fixed}")

    def error(x: float) -> float:  # Leissa, eq. 2.9
        return jv(1, x) / jv(0, x) + iv(1, x) / iv(0, x) - 2 * x / (1 - STEEL.poisson)

    square = brentq(error, 1.8, 2.39) ** 2
    assert fields["f"] == pytest.approx(
        square * _speed(STEEL, 3e-3) / (2 * math.pi * 0.04), rel=1e-5
    )


def _free_rectangle(ratio: float, poisson: float, size: int = 10) -> np.ndarray:
    """ω·a²·√(ρh/D) by a Ritz series of Legendre polynomials; sides 1 and `ratio`."""
    x, w = legendre.leggauss(2 * size)
    basis = [
        np.array([legendre.legval(x, legendre.legder(np.eye(size)[i], d)) for i in range(size)])
        for d in range(3)
    ]
    gram = lambda d, e: (basis[d] * w) @ basis[e].T / 2  # noqa: E731
    sx, sy = 4.0, 4.0 / ratio**2
    mixed = np.kron(gram(2, 0), gram(0, 2)) * sx * sy
    stiffness = (
        np.kron(gram(2, 2), gram(0, 0)) * sx * sx + np.kron(gram(0, 0), gram(2, 2)) * sy * sy
    )
    stiffness += poisson * (mixed + mixed.T)
    stiffness += 2 * (1 - poisson) * np.kron(gram(1, 1), gram(1, 1)) * sx * sy
    squares = eigh(stiffness, np.kron(gram(0, 0), gram(0, 0)), eigvals_only=True)
    return np.sqrt(squares[3:])


@pytest.mark.parametrize("ratio", [1.0, 0.62, 0.25, 0.1])
@pytest.mark.parametrize("poisson", [0.0001, 0.35, 0.5])
def test_free_rectangle_pitch_by_ritz_series(ratio, poisson):
    high = f"{1000 * ratio:.6g}mm"
    plate = f"material: steel, sides: [1m, {high}], thickness: 5mm, bending: {{poisson: {poisson}}}"
    speed = 5e-3 * math.sqrt(STEEL.young / (12 * STEEL.density * (1 - poisson**2)))
    wanted = _free_rectangle(ratio, poisson)[0] * speed / (2 * math.pi)
    assert body(f"PLATE: {{{plate}}}")["f"] == pytest.approx(wanted, rel=5e-4)


def test_free_square_modes_of_leissa_table():
    # Vibration of Plates, table 4.72, ν = 0.3.
    listened = modes(
        "PLATE: {material: steel, sides: [40cm, 40cm], thickness: 3mm, masses: 600}", 5
    )[:, 0]
    scale = _speed(STEEL, 3e-3) / (2 * math.pi * 0.16)
    assert listened / scale == pytest.approx([13.49, 19.79, 24.43, 35.02, 35.02], rel=0.02)


def test_fixed_rectangle_and_membrane_closed_form():
    plate = body("PLATE: {material: glass, sides: [40cm, 25cm], thickness: 3mm, rim: fixed}")
    speed = _speed(MATERIALS["glass"], 3e-3)
    assert plate["f"] == pytest.approx(math.pi / 2 * speed * (1 / 0.16 + 1 / 0.0625), rel=1e-12)
    head = "PLATE: {material: mylar, sides: [40cm, 25cm], thickness: 0.2mm, tension: 3kN/m}"
    density = 1390.0 * 0.2e-3
    wanted = [
        0.5 * math.sqrt(3000.0 / density * ((m / 0.4) ** 2 + (n / 0.25) ** 2))
        for m in range(1, 6)
        for n in range(1, 4)
    ]
    assert modes(head, 5)[:, 0] == pytest.approx(sorted(wanted)[:5], rel=0.015)


def test_plate_third_of_size_thickness_and_pitch():
    for rim in ("free", "fixed"):
        form = f"material: spruce, sides: [40cm, 30cm], rim: {rim}"
        first = body(f"PLATE: {{{form}, thickness: 3mm}}")
        again = body(f"PLATE: {{{form}, f: {first['f']!r}Hz}}")
        assert again["M"] == pytest.approx(first["M"], rel=1e-9)
        heavy = body(f"PLATE: {{{form}, thickness: 3mm, M: 2kg}}")
        assert (heavy["M"], heavy["f"]) == (2.0, first["f"])
    head = "material: skin, sides: [40cm, 30cm]"
    first = body(f"PLATE: {{{head}, thickness: 0.3mm, tension: 2kN/m}}")
    for rest in ("thickness: 0.3mm, bending: false", "tension: 2kN/m"):
        again = body(f"PLATE: {{{head}, {rest}, f: {first['f']!r}Hz}}")
        assert again["M"] == pytest.approx(first["M"], rel=1e-9)


def test_body_default_masses_reach_5_khz():
    for fields in (
        WIRE % "length: 65cm, diameter: 0.4mm, tension: 70N",
        "PLATE: {material: bronze, radius: 20cm, thickness: 4mm}",
        "PLATE: {material: spruce, sides: [40cm, 25cm], thickness: 4mm}",
    ):
        assert modes(fields, 2000)[-1, 0] > 5000.0
    assert (
        body("PLATE: {material: steel, radius: 30cm, thickness: 2mm, masses: 200}")["radius"] == 8
    )


INSTRUMENTS = """\
ergon: 1
instruments:
  low: {modules: {body: {STRING: {material: steel, length: 65cm, diameter: 1mm, f: A3}}}}
  high: {like: low, transpose: 12st}
  other: {like: low, modules: {body: {STRING: {f: C4}}}}
  tighter: {like: low, modules: {body: {STRING: {tension: 200N}}}}
  all: {like: low, notes: [A3, A4]}
  lone: {f: A3, STRING: {material: gut, length: 65cm, diameter: 1mm}}
  tuned: {f: C4, STRING: {material: gut, length: 65cm, diameter: 1mm, f: A3}}
"""


def test_body_of_material_transposed_by_like():
    piece = check(INSTRUMENTS).piece
    fields = {name: one.modules[0].fields for name, one in piece.instruments.items()}
    low, high = fields["low"], fields["high"]
    assert (high["f"], high["M"]) == (440.0, low["M"])
    assert high["inharmonicity"] == low["inharmonicity"]
    assert high["t60"][0] == (440.0, low["t60"][0][1] / 2.0)
    # Another pitch of the same wire is another tension.
    assert fields["other"]["f"] == pytest.approx(261.6256)
    assert fields["other"]["inharmonicity"] < low["inharmonicity"]
    assert fields["tighter"]["f"] > 0.0
    assert fields["all.A4"] == high
    assert (fields["lone"]["f"], fields["tuned"]["f"]) == (220.0, pytest.approx(261.6256))
    assert fields["tuned"]["M"] == fields["lone"]["M"]


@pytest.mark.parametrize(
    ("fields", "code", "part"),
    [
        ("STRING: {material: steal, length: 1m, diameter: 1mm, f: A3}", "E206", "steal"),
        (WIRE % "length: 1m, diameter: 1mm", "E103", "write f or tension too"),
        (WIRE % "length: 1m, diameter: 1mm, tension: 70N, f: A3", "E111", "remove one of"),
        (WIRE % "length: 10cm, diameter: 9mm, tension: 1N", "E202", "thinner or longer wire"),
        (WIRE % "length: 10cm, diameter: 9mm, f: 20Hz", "E202", "bending alone"),
        (WIRE % "length: 1mm, diameter: 1um, tension: 1e9N", "E202", "maximum is 1e+06 Hz"),
        (WIRE % "M: 3g, diameter: 1mm, tension: 70N, f: A3", "E103", "needs the length"),
        (
            "STRING: {masses: 9, M: 1g, f: A3, length: 1m}",
            "E103",
            "write for instance `material: steel`",
        ),
        ("PLATE: {M: 1g, f: A3, radius: 30cm}", "E103", "radius: 12, rings"),
        (
            "PLATE: {M: 1g, f: A3, radius: 3, thickness: 2mm}",
            "E103",
            "write for instance `material: steel`",
        ),
        (
            "PLATE: {M: 1g, f: A3, radius: 3, masses: 90}",
            "E103",
            "write for instance `material: steel`",
        ),
        ("PLATE: {material: steel, radius: 12, thickness: 1mm}", "E103", "needs its size"),
        ("PLATE: {material: steel, radius: 9cm}", "E103", "write thickness or f too"),
        ("PLATE: {material: steel, radius: 9cm, f: A3, thickness: 1mm}", "E111", "remove one of"),
        ("PLATE: {material: steel, radius: 9cm, shape: hex, f: A3}", "E111", "is a disc"),
        ("PLATE: {material: steel, radius: 9cm, sides: [1m, 1m], f: A3}", "E111", "keep one"),
        ("PLATE: {material: steel, sides: [9m, 1cm], f: A3}", "E202", "squarer"),
        ("PLATE: {material: skin, sides: [9cm, 9cm], bending: false}", "E103", "all but one of"),
        (
            "PLATE: {material: skin, sides: [9cm, 9cm], f: A3, tension: 1kN/m, bending: true}",
            "E111",
            "does not bend",
        ),
        (
            "PLATE: {material: skin, sides: [9cm, 9cm], f: A3, tension: 1kN/m, rim: free}",
            "E111",
            "rim: fixed",
        ),
        (
            "PLATE: {material: {density: 1g/cm3}, radius: 9cm, f: A3}",
            "E103",
            "young, poisson, loss",
        ),
        ("PLATE: {material: {like: tin}, radius: 9cm, f: A3}", "E206", "tin"),
    ],
)
def test_wrong_material_fields_report_code_and_text(fields, code, part):
    reports = refused(fields)
    assert [(own, True) for own, _ in reports] == [(code, part in reports[0][1])]


def test_discrete_network_refuses_material():
    text = SCORE % (WIRE % "length: 1m, diameter: 1mm, tension: 70N")
    text = text.replace("s: {", "s: {units: ca, at: 44100Hz, ", 1)
    assert codes(text) == ["E111"]


def test_drumhead_modes_of_round_membrane():
    head = "PLATE: {material: skin, radius: 16cm, thickness: 0.3mm, tension: 2kN/m, masses: 800}"
    speed = math.sqrt(2000.0 / (1100.0 * 0.3e-3))
    # Zeros of J0, J1, J2, J0: modes (0, 1), (1, 1) twice, (2, 1) twice, (0, 2).
    zeros = np.array([2.404826, 3.831706, 3.831706, 5.135622, 5.135622, 5.520078])
    wanted = zeros * speed / (2.0 * math.pi * 0.16)
    assert modes(head, 6)[:, 0] == pytest.approx(wanted, rel=0.01)
    assert modes(head, 1)[0, 0] == pytest.approx(wanted[0], rel=1e-6)
    # The mass of the whole sheet less that of the rim, which rests.
    fields = body(head)
    rings = fields["radius"]
    inner = ((rings - 0.5) / rings) ** 2
    assert fields["M"] == pytest.approx(1100.0 * 0.3e-3 * math.pi * 0.0256 * inner)
