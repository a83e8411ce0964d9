"""`ergon.modes`: which modes of which parts, where they move, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

import ergon

SCORE = """\
ergon: 1
title: Wires
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
laws: {cubic: {law: k*d + q*d**3, k: 200N/m, q: 4e7N/m3}}
instruments:
  wire: {modules: {s: {STRING: {masses: 24, M: 4g, f: D4, t60: 2s}}}, out: {SOX: s.17}}
  pad:
    modules:
      m: {MAS: {M: 20g}}
      floor: {SOL: {}}
      soft: {LNL: {between: [m, floor], law: cubic}}
      hit: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
      stop: {BUT: {between: [m, floor], K: 900N/m, gap: 1mm}}
    out: {low: {SOX: m}, push: {SOF: soft}}
  wall: {modules: {w: {SOL: {}}}}
strikes: {a: {to: [wire.s.3], at: 0.1s, impulse: 1mNs}}
gestures: {knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2}
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: knock}]}
render: {tail: 0.5s}
"""


@pytest.fixture(autouse=True)
def folder(work_folder: Path) -> Path:
    Path("wires.yaml").write_text(SCORE)
    return work_folder


def modes(*parts: str, **options: object) -> tuple[ergon.PartModes, ...]:
    return ergon.modes("wires.yaml", ergon.ModesOptions(parts=parts, **options))  # type: ignore[arg-type]


def test_modes_of_undamped_motion_have_infinite_t60():
    """What rounding leaves of its decay is none: a free plate drifts for good."""
    Path("free.yaml").write_text(
        "ergon: 1\ninstruments: {s: {modules: {b: {PLATE: {shape: hex, radius: 3, f: 220Hz, "
        "t60: 2s, M: 60g, rim: free}}, l: {FRO: {between: [b.0, b.9], Z: 10mNs/m}}}, "
        "out: {SOX: b.8}}}\n"
    )
    (part,) = ergon.modes("free.yaml")
    assert np.isinf(part.t60[part.frequencies < 1e-6]).all()
    assert (part.t60[part.frequencies > 1.0] < 2.1).all()


def test_modes_of_string_and_its_points():
    (wire,) = modes("wire", count=24)
    assert wire.frequencies[0] == pytest.approx(293.6647679174076, rel=1e-12)
    assert wire.t60[0] == pytest.approx(2.0, rel=1e-9)
    assert wire.masses[3] == "wire.s.3"
    assert wire.places.shape == (24, 2)
    assert wire.is_certified
    # All shapes of all modes: each is of mass 1, and where a point is struck is a column of them.
    i = np.arange(1, 25)
    sine = np.sin(np.pi * np.outer(i, i) / 25) * np.sqrt(2 / 25 / (4e-3 / 24))
    assert np.abs(wire.shapes) == pytest.approx(np.abs(sine), rel=1e-6, abs=1e-6)
    assert list(wire.points) == ["out", "wire.s.3"]
    assert np.array_equal(wire.points["out"], wire.shapes[:, 17])
    assert np.array_equal(wire.points["wire.s.3"], wire.shapes[:, 3])
    assert wire.levels("out").max() == 0.0


def test_modes_of_all_parts_in_score_order():
    result = modes()
    assert [part.part for part in result] == ["k1", "wire", "pad", "wall"]
    assert [len(part.poles) for part in result] == [1, 20, 1, 0]
    key, _, pad, _ = result
    assert key.poles[0] == pytest.approx(-1.5 + 1j * np.sqrt(150.0 - 1.5**2))
    # The law at its slope at rest, the contact with the floor open, that with the key left out.
    assert (pad.n_laws, pad.n_contacts) == (1, 1)
    assert pad.poles[0].imag == pytest.approx(100.0)
    assert list(key.points) == ["k1"]
    assert list(pad.points) == ["out low", "pad.m"]


def test_modes_upto_frequency_and_around_note():
    (all_of_it,) = modes("wire", count=24)
    (below,) = modes("wire", upto="2kHz")
    assert below.frequencies == pytest.approx(all_of_it.frequencies[:7])
    (near,) = modes("wire", around="A5", count=2)
    assert near.frequencies == pytest.approx(all_of_it.frequencies[1:3])
    (nearer,) = modes("wire", around=880.0, count=1)
    assert nearer.frequencies == pytest.approx(all_of_it.frequencies[2:3])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parts": ["wirr"]}, "parts: no instrument or key is called 'wirr'; did you mean 'wire'?"),
        (
            {"parts": ["x"]},
            "parts: no instrument or key is called 'x'; there are k1, wire, pad, wall",
        ),
        ({"upto": "h3"}, "upto: 'h3' is neither a frequency such as 220Hz nor a note .*mean 'B3'"),
        ({"upto": -1.0}, "upto: "),
        ({"upto": 1e3, "count": 2}, "count: excludes upto; give one of the two"),
        ({"upto": 1e3, "around": "A3"}, "around: excludes upto; give one of the two"),
        ({"count": 0}, "count: is 0; it must be at least 1"),
    ],
)
def test_modes_refuses_wrong_parts_and_options(options: dict, message: str):
    with pytest.raises(ergon.OptionError, match=message.replace("?", "\\?")):
        modes(**options) if "parts" not in options else modes(*options["parts"])


def test_modes_of_score_with_mistake_raises():
    with pytest.raises(ergon.ScoreError, match="E203"):
        ergon.modes("wires.yaml", ergon.ModesOptions(text=SCORE.replace("400g", "400h")))
