"""SOE, the energy of moving masses, beside closed forms."""

import numpy as np
import pytest
from checked import check_reports

import ergon
from ergon.workshop.api.export import ExportOptions, faust_programs
from ergon.workshop.models.errors import ModelError

RATE = 44100.0
CEL = """\
ergon: 1
instruments:
  bell:
    modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 0.5s}}}
    out: {SOE: m}
strikes: {hit: {to: bell.m, at: 0.01s, impulse: 1mNs, lasts: 0s}}
render: {tail: 0.2s}
"""
FREE = """\
ergon: 1
instruments:
  a:
    modules: {m: {MAS: {M: 2g}}, n: {MAS: {M: 8g}}}
    out: {SOE: [m, n]}
strikes:
  first: {to: a.m, at: 0.01s, impulse: 1mNs}
  second: {to: a.n, at: 0.02s, impulse: 4mNs}
render: {tail: 50ms}
"""
PLATE = """\
ergon: 1
instruments:
  a:
    modules: {p: {PLATE: {shape: hex, radius: 2, M: 19g, f: 200Hz}}, m: {MAS: {M: 1g}}}
    out: {SOE: p.all}
strikes: {first: {to: a.p.all, at: 0.01s, impulse: 1mNs}}
render: {tail: 50ms}
"""
SPACE = """\
ergon: 1
instruments:
  a: {space: 2, modules: {m: {MAS: {M: 2g, X0: [0, 0], V0: [3, 4]}}}, out: {SOE: [m.x, m.y]}}
render: {tail: 50ms}
"""


def energy(text: str, **options) -> np.ndarray:
    """The first channel in joules: floats without a level are in SI units."""
    built = ergon.render("x.yaml", ergon.RenderOptions(text=text, bits="float", **options))
    return np.asarray(built.frames)[:, 0]


def test_energy_of_a_struck_cel_against_its_closed_form():
    sound = energy(CEL)
    frames = np.arange(600, 6000)
    t = (frames - 7.5) / RATE - 0.01
    s = complex(-np.log(1000.0) / 0.5, 2 * np.pi * 220)
    speed = (s * (1e-3 / 2e-3 / s.imag) * np.exp(s * t)).imag
    wanted = 0.5 * 2e-3 * speed**2
    assert np.abs(sound[frames] - wanted).max() < 1e-6 * wanted.max()


def test_energy_output_of_free_masses_adds():
    """After an impulse p a free mass has p²/2m: 0.25 mJ, then 1 mJ more."""
    sound = energy(FREE)
    assert sound[700] == pytest.approx(0.25e-3, rel=1e-6)
    assert sound[2000] == pytest.approx(1.25e-3, rel=1e-6)


def test_energy_of_all_members_of_a_plate():
    """19 masses of 1 g are struck by 1 mN·s each and move as one body: 0.5 mJ each."""
    assert energy(PLATE)[700] == pytest.approx(19 * 0.5e-3, rel=1e-6)


def test_energy_output_of_point_in_space():
    assert energy(SPACE)[700] == pytest.approx(0.5 * 2e-3 * 25.0, rel=1e-6)


def test_energy_output_level_of_one_millijoule():
    text = FREE + "mix: {master: {gain: 0dB}, route: [{from: a, to: 1, highpass: 0.001Hz}]}\n"
    built = ergon.render("x.yaml", ergon.RenderOptions(text=text))
    assert built.frames[2000, 0] == pytest.approx(0.125, rel=1e-3)


def test_energy_output_refuses_links_and_distances():
    between = check_reports(CEL.replace("{SOE: m}", "{SOE: {between: [m, m]}}"))
    message = "SOE of output is a mapping; expected: a module, or several in brackets"
    assert between == [("E106", 5, message)]
    link = (
        "modules: {m: {CEL: {M: 2g, f: 220Hz}}, g: {SOL: {}}, r: {RES: {between: [g, m], K: 1N/m}}}"
    )
    text = CEL.replace("modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 0.5s}}}", link)
    message = "SOE of 'bell': 'r' is a RES, a link: an <L> point joins <M> points only"
    assert check_reports(text.replace("SOE: m", "SOE: r")) == [("E304", 5, message)]


def test_energy_output_refused_by_nearest_and_radiate():
    def messages(route: str) -> list[str]:
        mix = f"mix: {{layout: layouts/stereo.yaml, route: [{{from: bell, {route}}}]}}\n"
        return [message for _, _, message in check_reports(CEL + mix)]

    nearest = "route: `nearest` needs masses, which have positions, and bell gives SOE"
    assert messages("to: nearest") == [nearest]
    radiated = "route: `radiate` takes an acceleration, and bell gives SOE"
    assert messages("to: 1, radiate: {distance: 2m, radius: 5cm}") == [radiated]


def test_energy_output_export_is_refused():
    with pytest.raises(ModelError, match="bell: the energy of m is not written yet"):
        faust_programs("x.yaml", ExportOptions(text=CEL))


def test_energy_output_with_blocks_and_threads():
    sound = energy(FREE)
    assert np.array_equal(energy(FREE, block=37, threads=2), sound)
