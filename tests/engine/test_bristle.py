"""BRISTLE, friction with memory: against DOP853 and its own formula, and from frame to frame."""

import numpy as np
import pytest
from bristles import RATE, SCENES, Bristles
from checked import check, codes
from planned_sound import off_db, planned, played, ready
from sweep import crossed, few

from ergon import _core
from ergon.scores.staging.implausible import warn_implausible

N = 4410  # frames that are judged: 0.1 s


@pytest.fixture(scope="module", params=few(SCENES, 1))
def solved(request):
    scene = SCENES[request.param]
    return scene, scene.exact(N)


@pytest.mark.parametrize("asked", few([-60.0, -80.0], [-60.0]))
def test_bristle_plans_within_requested_error(solved, asked):
    scene, exact = solved
    sound = played(scene.text, error_db=asked)
    assert off_db(sound[:N], exact) < asked, scene.name


def test_bristle_error_falls_with_oversampling(solved):
    scene, exact = solved
    base = planned(scene.text, error_db=-80.0)[1].choices()
    for parts, order in ((1, 0.8), (2, 0.9)):
        errors = []
        for steps in (1, 4):
            pins = [own._replace(oversampling=steps, contact_substeps=parts) for own in base]
            errors.append(off_db(played(scene.text, error_db=-80.0, pins=pins)[:N], exact))
        # Below -110 dB an error is next to that of the reference.
        fall = 20.0 * np.log10(4.0) * order
        assert errors[1] < max(errors[0] - fall, -110.0), (scene.name, parts, errors)


def test_bristle_ca_scheme_equals_its_formula():
    single = Bristles(-1, 0, 2e4, 0.2, 0.3, 0.2, 0.3, 0.05)
    m, k, step = 0.01, 3000.0, 1.0 / RATE
    text = (
        "ergon: 1\nrates: {audio: 44100Hz}\ninstruments:\n  s:\n    modules:\n"
        "      floor: {SOL: {}}\n"
        f"      m: {{MAS: {{M: {m}kg, X0: 1mm}}}}\n"
        f"      k: {{RES: {{between: [floor, m], K: {k}N/m}}}}\n"
        f"      rub: {single.text('floor, m')}\n    out: {{SOX: m}}\n"
        "accuracy: {method: ca}\nrender: {tail: 0.05s, bits: float}\n"
    )
    sound = played(text, method="ca")
    x, z = 1e-3, 0.0
    # The first step leads into frame 0 as the continuous motion does, to second order.
    d = 0.5 * step * step * k * x / m
    static = single.Fs or single.Fc
    for frame in range(len(sound)):
        assert abs(sound[frame, 0] - x) < 1e-9, frame
        pull, _ = single.pull(z, d / step)
        d += step * step / m * (-k * x - pull)
        x += d
        v = d / step
        level = single.Fc + (static - single.Fc) * np.exp(-((v / single.vs) ** 2))
        end = level / single.sigma0 * np.sign(v)
        z = end + (z - end) * np.exp(-single.sigma0 * abs(v) / level * step) if v else z


@pytest.mark.parametrize(
    ("name", "wishes"),
    crossed(["bow", "key", "stick-slip"], [{"method": "ca"}, {"error_db": -80.0}]),
)
def test_bristle_snapshot_continues_bit_identical(name: str, wishes: dict):
    stage, plan = planned(SCENES[name].text, **wishes)
    complete = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=1)
    sound = np.empty((stage.n_frames, complete.n_out))
    complete.process(sound)
    half = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=1)
    head = np.empty((stage.n_frames // 2, half.n_out))
    half.process(head)
    saved = half.snapshot()
    for _ in range(2):
        tail = np.empty((stage.n_frames - len(head), half.n_out))
        half.process(tail)
        assert tail.tobytes() == sound[len(head) :].tobytes()
        half.restore(saved)


def test_bristle_ledger_closes_and_only_loses():
    stage = ready(SCENES["pair"].text)
    simulation = _core.Simulation(stage.network, stage.timeline, ledger=True)
    lost = 0.0
    for _ in range(20):
        simulation.process(np.empty((441, simulation.n_out)))
        energy = simulation.energy()
        assert abs(energy.residual) <= 1e-12 * energy.flow
        assert energy.lost >= lost * (1.0 - 1e-3)
        lost = energy.lost
    assert lost > 0.0


def test_bristles_in_free_copy_of_key():
    text = (
        "ergon: 1\nrates: {audio: 44100Hz}\n"
        "keys:\n  k1:\n    struck: m\n    modules:\n      g: {SOL: {}}\n"
        "      m: {CEL: {M: 0.2kg, K: 50N/m, Z: 1Ns/m}}\n"
        "      rub: {BRISTLE: {between: [g, m], sigma0: 5kN/m, sigma1: 1Ns/m, Fc: 0.3N}}\n"
        "instruments: {i: {modules: {p: {CEL: {M: 1kg, f: 20Hz}}, "
        "r: {RES: {between: [k1, p], K: 1mN/m}}}, out: {SOX: k1}}}\n"
        "gestures: {press: 0mm@0 5mm@1/8 5mm@1/4 0mm@3/8}\n"
        "players: {ada: {key: k1}}\nparts: {ada: [{at: 1|1, play: press}]}\n"
        "render: {tail: 0.1s, bits: float}\n"
    )
    sound = played(text, method="ca")
    position = [0.125 * RATE, 0.25 * RATE]  # where the gesture has its points at 5 mm
    assert sound[[int(frame + 0.5) for frame in position], 0] == pytest.approx(5e-3, rel=1e-3)


def test_bristle_level_automation_without_jumps():
    scene = SCENES["stick-slip"]
    led = "automation: [{at: 1|1, set: s.rub.Fc, to: 0.5N@0 line 0.1N@1/16}]\n"
    text = scene.text.replace("render:", led + "render:")
    still, moved = (played(one, error_db=-60.0) for one in (scene.text, text))
    assert np.abs(moved).max() < 0.8 * np.abs(still).max()
    assert np.abs(np.diff(moved[:, 0], n=2)).max() < 3.0 * np.abs(np.diff(still[:, 0], n=2)).max()


BLOCK = (
    "ergon: 1\ninstruments: {{i: {{modules: {{g: {{SOL: {{}}}}, "
    "m: {{CEL: {{M: 100g, f: 20Hz, X0: 5mm}}}}, "
    "rub: {{BRISTLE: {{between: [g, m], {}}}}}}}, out: {{SOX: m}}}}}}\nrender: {{tail: 100ms}}\n"
)


@pytest.mark.parametrize(
    ("fields", "outcome"),
    [
        ("sigma0: 10kN/m, Fc: 0.2N", []),
        ("sigma0: 10kN/m", ["E103"]),
        ("sigma0: 10kN/m, Fc: 0.2N, Fs: 0.1N", ["E111"]),
        ("sigma0: 10kN/m, Fc: 0.2kg", ["E203"]),
        ("sigma0: 10kN/m, Fc: 0.2N, Fs: 0.3N, sigma1: 10Ns/m", ["W333"]),
        ("sigma0: 10kN/m, Fc: 0.2N, Fs: 0.3N, sigma1: 1Ns/m, sigma2: 0.5Ns/m", []),
    ],
)
def test_diagnostics_of_bristle_fields(fields: str, outcome: list[str]):
    text = BLOCK.format(fields)
    piece = check(text).piece
    output = [] if piece is None else [one.code for one in warn_implausible(piece)]
    assert codes(text) + output == outcome


def test_bristle_defaults_are_dahl_friction():
    piece = check(BLOCK.format("sigma0: 10kN/m, Fc: 0.2N")).piece
    assert piece is not None
    fields = piece.instruments["i"].modules[2].fields
    assert (fields["sigma1"], fields["sigma2"], fields["Fs"]) == (0.0, 0.0, None)


def test_stiff_bristles_refused_with_suggested_rate():
    stage = ready(BLOCK.format("sigma0: 1e9N/m, Fc: 1N"))
    with pytest.raises(_core.UnstableError) as caught:
        _core.Plan(stage.network, stage.timeline, method="ca")
    assert caught.value.args


@pytest.mark.parametrize("wishes", [{"method": "ca"}, {"error_db": -60.0}])
def test_bristle_state_preserved_at_takeover(wishes: dict):
    """Of another viscosity its island is another one; the block stays where it sticks."""
    before = SCENES["stick-slip"].text
    after = before.replace("Z: 0.05Ns/m", "Z: 0.0501Ns/m")
    n_frames = 700

    def version(text: str, start: int) -> _core.Simulation:
        stage = ready(text)
        plan = _core.Plan(stage.network, stage.timeline, **wishes)
        return _core.Simulation(stage.network, stage.timeline, plan=plan, start=start)

    complete, old, new = version(before, 0), version(before, 0), version(after, n_frames)
    exact = np.empty((n_frames + 441, complete.n_out))
    complete.process(exact)
    old.process(np.empty((n_frames, old.n_out)))
    new.take_over(old)
    rest = np.empty((441, new.n_out))
    new.process(rest)
    assert np.abs(rest - exact[n_frames:]).max() < 1e-2 * np.abs(exact).max()
