"""SOV and SOA beside closed forms, for every method and in every way of computing."""

import numpy as np
import pytest
from checked import check_reports, codes

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

RATE = 44100.0
CEL = """\
ergon: 1
instruments:
  bell:
    modules: {m: {CEL: {M: 2g, f: %s, t60: 0.5s}}}
    out: {x: {SOX: m}, v: {SOV: m}, a: {SOA: m}}
strikes:
  hit: {to: bell.m, at: 0.01s, impulse: 1mNs, lasts: 0s}
accuracy: {method: %s}
"""
STRING = """\
ergon: 1
instruments:
  s:
    modules:
      body: {STRING: {masses: 40, M: 6g, f: 200Hz, t60: 2s}}
    out: {x: {SOX: body.9}, v: {SOV: body.9}, a: {SOA: body.9}}
strikes:
  hit: {to: s.body.9, at: 0.01s, impulse: 0.1mNs}
accuracy: {method: %s}
"""


def simulation(text: str, **options) -> _core.Simulation:
    return stage(load("x.yaml", text=text).piece, planned=True, **options).simulation


def rendered(text: str, n_frames: int, block: int = 4096) -> np.ndarray:
    single, out = simulation(text), np.zeros((n_frames, 3))
    for index in range(0, n_frames, block):
        single.process(out[index : index + block])
    return out


def motion(f: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Speed [m/s] and acceleration [m/s²] of the CEL at t [s] after the blow: its closed form."""
    sigma = np.log(1000.0) / 0.5
    damped, speed = 2 * np.pi * f, 1e-3 / 2e-3
    s = complex(-sigma, damped)
    # x = Im(e^(s·t)) · v0/damped
    complete = speed / damped * np.exp(s * t)
    return (s * complete).imag, (s * s * complete).imag


@pytest.mark.parametrize("method", ["modal", "ca"])
@pytest.mark.parametrize(
    ("f", "errors"), [(220, (-120, -120)), (5000, (-120, -120)), (11025, (-82, -74))]
)
def test_sov_and_soa_of_cell_closed_form(f, errors, method):
    sound = rendered(CEL % (f"{f}Hz", method), 8000)
    frames = np.arange(600, 8000)
    for column, delay, wanted in ((1, 7.5, 0), (2, 8.0, 1)):
        truth = motion(f, (frames - delay) / RATE - 0.01)[wanted]
        error = np.linalg.norm(sound[frames, column] - truth) / np.linalg.norm(truth)
        assert 20 * np.log10(error) < errors[wanted], (column, 20 * np.log10(error))


@pytest.mark.parametrize("method", ["modal", "ca", "bm4"])
def test_sov_and_soa_of_string_by_each_method(method):
    """The rate of change of what SOX hears, by the spectrum, for modes and for a stepped mesh."""
    sound = rendered(STRING % method, 20_000)
    size, position = 16_384, slice(50, 1900)  # 135 Hz to 5.1 kHz
    s = 2j * np.pi * np.fft.rfftfreq(size, 1 / RATE)[position]

    def spectrum(column: int, order: int, late: float) -> np.ndarray:
        """Of an output under the derivative of a window that comes early."""
        turn = 2 * np.pi / size
        phase = turn * (np.arange(size) + late)
        shape = (0.5 - 0.5 * np.cos(phase), np.sin(phase) / 2, np.cos(phase) / 2)[order]
        return np.fft.rfft((turn * RATE) ** order * shape * sound[2000 : 2000 + size, column])[
            position
        ]

    for order, late in ((1, 7.5), (2, 8.0)):
        # w·x' = (w·x)' − w'·x, and so on.
        x = [spectrum(0, i, late) for i in range(3)]
        wanted = s * x[0] - x[1] if order == 1 else s * s * x[0] - 2 * s * x[1] + x[2]
        wanted *= np.exp(-s * late / RATE)
        error = spectrum(order, 0, 0.0) - wanted
        assert np.linalg.norm(error) < 1e-4 * np.linalg.norm(wanted), order


def test_sov_bytes_in_blocks_and_from_snapshot():
    text = STRING % "ca"
    complete = rendered(text, 4000)
    for block in (1, 64, 333):
        assert np.array_equal(rendered(text, 4000, block), complete)
    single, out = simulation(text), np.zeros((2000, 3))
    single.process(out)
    saved, once, again = single.snapshot(), np.zeros((2000, 3)), np.zeros((2000, 3))
    single.process(once)
    single.restore(saved)
    single.process(again)
    assert np.array_equal(once, complete[2000:])
    assert np.array_equal(again, once)


def test_sov_and_soa_continue_after_takeover():
    network = _core.Network()
    network.part("bell")
    mat = network.cel("m", M=2e-3, f=440.0, t60=2.0)
    network.listen("speed", positions=[(mat, 1, 1.0)], order=1)
    network.listen("acceleration", positions=[(mat, 1, 1.0)], order=2)

    def version(start: int) -> _core.Simulation:
        timeline = _core.Timeline(network, RATE)
        timeline.open()
        timeline.strike(0, 0.001, impulse=1e-4)
        plan = _core.Plan(network, timeline)
        return _core.Simulation(network, timeline, plan=plan, start=start)

    complete, out = np.zeros((2000, 2)), np.zeros((2000, 2))
    version(0).process(complete)
    first, second = version(0), version(1000)
    first.process(out[:1000])
    second.take_over(first)
    second.process(out[1000:])
    assert np.array_equal(out, complete)


def test_sov_of_displaced_resting_mass_silent():
    """However far: a constant has no speed, and a start with a speed is a blow."""
    still = CEL.replace("strikes:\n  hit: {to: bell.m, at: 0.01s, impulse: 1mNs, lasts: 0s}\n", "")
    still = still.replace(
        "CEL: {M: 2g, f: %s, t60: 0.5s}", "CEL: {M: 2g, f: %s, rest: 3mm, X0: 3mm}"
    )
    assert not rendered(still % ("220Hz", "ca"), 1000)[:, 1:].any()


def test_mode_selection_by_output_kind():
    """High modes are quiet in a position and loud in an acceleration."""
    by_kind = {}
    for kind in ("SOX", "SOA"):
        text = (STRING % "modal").replace(
            "out: {x: {SOX: body.9}, v: {SOV: body.9}, a: {SOA: body.9}}",
            f"out: {{{kind}: body.9}}",
        )
        text = text.replace("accuracy: {method: modal}", "accuracy: {error: -40dB}")
        plan = stage(load("x.yaml", text=text).piece, planned=True).plan
        by_kind[kind] = sum(len(kept) for choice in plan.choices() for kept in choice.bodies)
    assert by_kind["SOX"] < by_kind["SOA"]


def test_sov_of_link_is_refused():
    text = CEL % ("220Hz", "ca")
    text = text.replace(
        "modules: {m:", "modules: {b: {SOL: {}}, r: {RES: {between: [m, b], K: 1N/m}}, m:"
    )
    assert "E304" in codes(text.replace("{SOV: m}", "{SOV: r}"))
    assert not check_reports(text)
