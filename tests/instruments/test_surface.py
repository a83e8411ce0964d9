"""Surfaces: strings and plates of one axis that points in space meet where they are."""

import numpy as np
import pytest
from checked import check, check_reports
from oracle.bodies import stiffness_of, string_edges
from scipy.integrate import solve_ivp

from ergon.scores.staging.stage import stage

G = 9.81
STRING = "{STRING: {masses: 5, M: 10g, f: 50Hz}}"
PLATE = "{PLATE: {shape: disc, radius: 3, M: 50g, f: 200Hz, t60: 1s, rim: fixed}}"


def rendered(text: str, rate: int = 44_100) -> np.ndarray:
    """Outputs of a score (n_frames, n_out)."""
    lines = f"rates: {{audio: {rate}Hz}}\naccuracy: {{method: ca}}\n"
    built = stage(check(lines + text).piece, planned=True)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound


def score(
    axes: int, modules: str, body: str, out: str, *, body_first: bool = False, tail: str = "60ms"
) -> str:
    parts = [
        f"""\
  thrown:
    space: {axes}
    gravity: {G}m/s2
    modules:
{modules}
""",
        f"""\
  body:
    modules: {{b: {body}}}
    out: {{{out}}}
""",
    ]
    if body_first:
        parts.reverse()
    return f"ergon: 1\ninstruments:\n{''.join(parts)}render: {{bits: float, tail: {tail}}}\n"


@pytest.mark.parametrize("axes", [2, 3])
def test_surface_contact_above_mass_equals_one_axis(axes: int):
    """The third of five masses, or the middle of a disc, is at the middle of its surface."""
    body, mass = (STRING, 2) if axes == 2 else (PLATE, 0)
    position = ", ".join("0" * (axes - 1))
    modules = f"      bead: {{MAS: {{M: 3g, X0: [{position}, 9mm], V0: [{position}, -0.5m/s]}}}}\n"
    surface = f"      skin: {{SURFACE: {{of: body.b, at: [{position}], across: 1m}}}}\n"
    meets = "      hit: {BUT: {between: [bead, skin.all], K: 3kN/m, Z: 0.1Ns/m, gap: 8mm}}"
    out = f"m: {{SOX: b.{mass}}}, bead: {{SOX: thrown.bead.{'xyz'[axes - 1]}}}"
    ours = rendered(score(axes, modules + surface + meets, body, out))
    text = score(axes, modules, body, out)
    link = f"{{BUT: {{between: [thrown.bead.{'xyz'[axes - 1]}, body.b.{mass}], K: 3kN/m, "
    link += "Z: 0.1Ns/m, gap: -8mm, side: above}}"
    text = text.replace("render:", f"  touch: {{modules: {{hit: {link}}}}}\nrender:")
    plain = rendered(text)
    assert np.abs(plain[:, 0]).max() > 1e-4
    np.testing.assert_allclose(ours, plain, rtol=0, atol=1e-12)


def test_surface_beads_on_string_against_dop853():
    """Two beads fall beside the masses of a string, which they push and roll off."""
    m, r, k_contact, gap, width = 3e-3, 10e-3 / 5, 2e3, 12e-3, 50e-3
    starts = np.array([[-7e-3, 14e-3], [9e-3, 16e-3]])
    modules = "\n".join(
        f"      b{i}: {{MAS: {{M: 3g, X0: [{x}, {y}], V0: [0.1m/s, -0.3m/s]}}}}\n"
        f"      h{i}: {{BUT: {{between: [b{i}, skin.all], K: 2kN/m, gap: 12mm, exponent: 1.5}}}}"
        for i, (x, y) in enumerate(starts)
    )
    modules += "\n      skin: {SURFACE: {of: body.b.all, at: [1mm], across: 5cm}}"
    out = ", ".join(f"o{i}{c}: {{SOX: thrown.b{i}.{c}}}" for i in range(2) for c in "xy")
    out += ", " + ", ".join(f"m{i}: {{SOX: b.{i}}}" for i in range(5))
    text = score(2, modules, STRING, out)
    stiff = stiffness_of(string_edges(5, "fixed", 0.0), 5)
    stiff *= r * (2 * np.pi * 50) ** 2 / np.linalg.eigvalsh(stiff)[0]
    # A string is as wide as its masses and its ends are apart: six springs.
    places = 1e-3 + width * (np.arange(1, 6) / 6 - 0.5)

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        x, v = y[:9], y[9:]
        beads, string = x[:4].reshape(2, 2), x[4:]
        push = np.zeros((2, 2))
        force = -stiff @ string
        for i, bead in enumerate(beads):
            apart = np.stack([bead[0] - places, bead[1] - string], 1)
            length = np.hypot(*apart.T)
            f = np.where(length < gap, k_contact * np.maximum(gap - length, 0) ** 1.5, 0.0)
            along = apart / length[:, None]
            push[i] = f @ along
            force -= f * along[:, 1]
        push[:, 1] -= m * G
        return np.concatenate([v, push.ravel() / m, force / r])

    errors = []
    for hertz in (88_200, 176_400):
        ours = rendered(text, hertz)
        when = np.arange(len(ours)) / hertz
        start = np.concatenate([ours[0], [0.1, -0.3] * 2, np.zeros(5)])
        done = solve_ivp(rate, (0, when[-1]), start, "DOP853", when, rtol=1e-11, atol=1e-14)
        errors.append(np.abs(ours - done.y[:9].T).max())
        assert np.abs(done.y[4:9]).max() > 3e-4, "the string is pushed"
    assert errors[1] < 1e-5
    assert errors[0] > 1.7 * errors[1]


def test_surface_body_before_or_after_in_score():
    modules = """\
      beads: {GRAINS: {count: 6, M: 12g, from: [-2cm, -2cm, 1cm], to: [2cm, 2cm, 2cm]}}
      skin: {SURFACE: {of: body.b.all, at: [0, 1mm], across: 8cm}}
      hit: {BUT: {between: [beads.all, skin.all], K: 2kN/m, Z: 0.05Ns/m, gap: 9mm}}"""
    out = "m: {SOV: b.3}, f: {SOF: thrown.hit}"
    item, other = (
        rendered(score(3, modules, PLATE, out, body_first=first)) for first in (False, True)
    )
    assert np.abs(item[:, 0]).max() > 1e-3
    np.testing.assert_allclose(item, other, rtol=0, atol=1e-12)


def test_surface_ledger_and_weight_of_resting_bead():
    """What lies on a plate weighs on it, and what was lost is told."""
    modules = """\
      bead: {MAS: {M: 5g, X0: [2mm, 0, 9mm], drag: 20mNs/m}}
      skin: {SURFACE: {of: body.b.all, at: [0, 0], across: 6cm}}
      hit: {BUT: {between: [bead, skin.all], K: 2kN/m, Z: 0.1Ns/m, gap: 1cm}}"""
    out = "f: {SOF: thrown.hit}, z: {SOX: b.0}"
    text = score(3, modules, PLATE, out, tail="3s")
    built = stage(check(f"accuracy: {{method: ca}}\n{text}").piece, ledger=True)
    block = np.empty((built.n_frames, 2))
    built.simulation.process(block)
    energy = built.simulation.energy()
    assert energy.lost > 1e-5
    assert abs(energy.residual) < 1e-9 * energy.flow
    assert block[-1, 1] < -1e-7
    # Pushes of several masses under it are aslant, so that their sum is more than its weight.
    assert 1.0 <= block[-1, 0] / (5e-3 * G) < 1.5


@pytest.mark.parametrize(
    ("written", "code", "message"),
    [
        ("of: bead", "E304", "is a point in space"),
        ("of: body.c", "E304", "'body.c' is a CEL; a surface is that of a STRING or a PLATE"),
        ("of: body.b.40", "E304", "body.b has members 0 to 18"),
        ("of: gone.all", "E301", "nothing is called 'gone.all'"),
        ("of: body.b.all, at: [0]", "E106", "the number of items is 1, but must be 2: x and y"),
        ("of: body.b.all, across: 0", "E202", "'0' is not positive"),
    ],
)
def test_surface_fields_with_mistakes(written: str, code: str, message: str):
    defaults = {"at": "[0, 0]", "across": "6cm"}
    rest = "".join(f", {n}: {v}" for n, v in defaults.items() if f"{n}:" not in written)
    modules = f"""\
      bead: {{MAS: {{M: 5g, X0: [0, 0, 2cm]}}}}
      skin: {{SURFACE: {{{written}{rest}}}}}
      hit: {{BUT: {{between: [bead, skin.all], K: 2kN/m, gap: 1cm}}}}"""
    text = score(3, modules, PLATE, "m: {SOX: b.0}").replace(
        "b: {PLATE", "c: {CEL: {M: 1g, f: 1Hz}}, b: {PLATE"
    )
    errors = check_reports(text)
    assert any(code == own and message in message for own, _, message in errors), errors


def test_surface_last_axis_error_names_body_mass():
    modules = """\
      bead: {MAS: {M: 5g, X0: [0, 0, 2cm]}}
      skin: {SURFACE: {of: body.b.all, at: [0, 0], across: 6cm}}
      hit: {BUT: {between: [bead, skin.all], K: 2kN/m, gap: 1cm}}"""
    errors = check_reports(score(3, modules, PLATE, "m: {SOX: thrown.skin.3.z}"))
    assert (
        "'thrown.skin.3.z' moves with a mass of body.b; write that mass, such as body.b.0"
        in errors[0][2]
    )
