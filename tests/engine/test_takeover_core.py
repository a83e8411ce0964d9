"""A simulation takes over from another: offline by hand, live by a change at a frame."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from patience import PATIENCE

from ergon import _core
from ergon._core import EngineError

RATE = 44_100.0
EVERY = 64

Version = tuple[_core.Plan, _core.Simulation]


def network() -> _core.Network:
    """Two bells that a spring joins for a time."""
    net = _core.Network()
    net.part("bells")
    for name, f in (("a", 440.0), ("b", 667.0)):
        mat = net.cel(name, M=2e-3, f=f, t60=2.0)
        net.listen(name, positions=[(mat, 1, 1.0)])
    net.ref("l", 0, 1, K=500.0)
    return net


def version(
    net: _core.Network, struck: list[float], start: int, like: _core.Plan | None = None
) -> Version:
    """MAT 0 struck at some instants [s], from a frame on; link 0 closes at 0.1 s."""
    timeline = _core.Timeline(net, RATE)
    timeline.open()
    timeline.couple(0, 0.1)
    for position in struck:
        timeline.strike(0, position, impulse=1e-4)
    plan = _core.Plan(net, timeline, like=like)
    return plan, _core.Simulation(net, timeline, plan=plan, on_fault="mute", start=start)


def rendered(simulation: _core.Simulation, until: int) -> NDArray[np.float64]:
    out = np.zeros((until - simulation.frame, simulation.n_out))
    simulation.process(out)
    return out


def test_takeover_by_equal_version_same_bits() -> None:
    net = network()
    plan, complete = version(net, [0.01, 0.2], 0)
    _, first = version(net, [0.01], 0, plan)
    _, second = version(net, [0.01, 0.2], 6400, plan)
    all_of_it = rendered(complete, 20_000)
    before = rendered(first, 6400)
    copy = first.fork()
    second.take_over(first)
    assert second.frame == 6400
    after = rendered(second, 20_000)
    assert np.array_equal(np.concatenate([before, after]), all_of_it)
    assert not np.array_equal(rendered(copy, 20_000), after)


def _lug_on_string(
    stiffness: float, *, viscosity: float = 0.0, t60s: tuple[float, float] | None = (0.5, 0.02)
) -> _core.Network:
    """A string with a lug: complex modes, if both lose energy differently. A link that closes later
    joins the lug to a ball, so these modes are a body in an island."""
    net = _core.Network()
    net.part("lute")
    lug = net.cel("lug", M=2e-3, f=900.0, t60=None if t60s is None else t60s[1])
    ball = net.cel("ball", M=1e-3, f=2.0, t60=0.2)
    net.ref("join", ball, lug, K=10.0)
    t60 = None if t60s is None else t60s[0]
    string = net.string("string", masses=12, M=1e-2, f=300.0, t60=t60)
    net.ref("screw", string + 3, lug, K=stiffness, Z=viscosity)
    net.listen("out", positions=[(string + 5, 1, 1.0), (lug, 1, 1.0)])
    return net


@pytest.mark.parametrize(
    ("old", "new", "methods", "error_db_max"),
    [
        ({}, {"stiffness": 2e4 * (1 + 1e-9)}, ("complex modes", "complex modes"), -120.0),
        ({"t60s": None}, {"t60s": None, "viscosity": 1e-6}, ("modes", "complex modes"), -80.0),
        ({"t60s": None, "viscosity": 1e-6}, {"t60s": None}, ("complex modes", "modes"), -80.0),
    ],
    ids=["complex-complex", "normal-complex", "complex-normal"],
)
def test_takeover_by_nearly_equal_modes_continues(old, new, methods, error_db_max) -> None:
    """Positions and steps of the masses pass from one kind of modes to the other."""
    networks = [_lug_on_string(**{"stiffness": 2e4} | fields) for fields in (old, new)]
    (old_plan, uninterrupted), (_, first) = (version(networks[0], [0.01], 0) for _ in range(2))
    new_plan, second = version(networks[1], [0.01], 1_000)
    kinds = [{row.what for row in plan.rows()} for plan in (old_plan, new_plan)]
    assert all(method in kind for method, kind in zip(methods, kinds, strict=True)), kinds
    complete = rendered(uninterrupted, 5_000)
    rendered(first, 1_000)
    second.take_over(first)
    error = abs(rendered(second, 5_000) - complete[1_000:]).max() / abs(complete).max()
    assert 20 * np.log10(error) <= error_db_max


def test_takeover_refuses_different_frames() -> None:
    net = network()
    _, first = version(net, [0.01], 0)
    _, second = version(net, [0.01], 6400)
    with pytest.raises(EngineError, match="at 6400"):
        second.take_over(first)


def test_live_takeover_sound_equals_replay(tmp_path: Path) -> None:
    """Done or too late, as it is told: the file holds the samples of the same take-over by hand."""
    net = network()
    position, n_frames = 5_000 * EVERY, 9_000 * EVERY
    plan, first = version(net, [0.01], 0)
    _, second = version(net, [0.01, 7.5, 9.0], position, plan)
    mixer = _core.Mixer(RATE, 2, 1)
    mixer.route(0, 0)
    mixer.route(1, 0)
    path = tmp_path / "played.wav"
    played = _core.Performance(
        first, mixer, tick_frames=EVERY, audio=f"file:{path}", n_frames=n_frames
    )
    try:
        ticket = played.change(position, simulation=second, old=first)
        with pytest.raises(EngineError, match="not the first of a tick"):
            played.change(position + 1, gain=0.5)
        with pytest.raises(EngineError, match="`old` requires `simulation`"):
            played.change(position, old=first)
        assert played.wait(PATIENCE)
        output = played.events()
    finally:
        played.close(10.0)
    answers = {number: what for _, what, number in output if what in ("changed", "late")}
    assert list(answers) == [ticket]

    frames = rendered(first, position)
    if answers[ticket] == "changed":
        second.take_over(first)
        frames = np.concatenate([frames, rendered(second, n_frames)])
    else:
        frames = np.concatenate([frames, rendered(first, n_frames)])
    mixed = np.zeros((n_frames, 1))
    mixer.process(frames, mixed)
    sound = np.frombuffer(path.read_bytes()[-4 * n_frames :], dtype="<f4")
    assert np.abs(sound).max() > 1e-6
    assert np.array_equal(sound, mixed[:, 0].astype(np.float32))


def test_takeover_refuses_wrong_damping_time() -> None:
    _, simulation = version(network(), [0.0], 0)
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(EngineError, match="t60 must be"):
            simulation.damp(wrong)
    loud = np.abs(rendered(simulation, 4_410)).max()
    simulation.damp(0.1)
    rendered(simulation, 8_820)
    assert np.abs(rendered(simulation, 13_230)).max() < 2e-3 * loud


def test_takeover_glides_parameters() -> None:
    """A spring and a mass that come from other numbers: nothing jumps, and refusals say why."""
    position, over = 6_400, 64
    span = (position / RATE, (position + over) / RATE)

    def pair(k: float, tie: float) -> _core.Network:
        net = _core.Network()
        net.part("pair")
        for name in ("a", "b"):
            mat = net.cel(name, M=2e-3, K=tie, Z=1e-3, X0=1e-3 if name == "a" else 0.0)
            net.listen(name, positions=[(mat, 1, 1.0)])
        net.ref("l", 0, 1, K=k, Z=1e-6 * k)
        return net

    def joined(new: _core.Network, timeline: _core.Timeline) -> NDArray[np.float64]:
        old = pair(3e3, 900.0)
        quiet = _core.Timeline(old, RATE)
        quiet.open()
        before = _core.Simulation(old, quiet, plan=_core.Plan(old, quiet))
        after = _core.Simulation(new, timeline, plan=_core.Plan(new, timeline), start=position)
        sound = rendered(before, position)
        after.take_over(before)
        return np.concatenate([sound, rendered(after, 2 * position)])

    def roughness(sound: NDArray[np.float64]) -> float:
        third = np.abs(np.diff(sound, 3, axis=0)).max(axis=1)
        around = max(
            third[position - 1_500 : position - 4].max(), third[position + over + 4 :][:1_500].max()
        )
        return float(third[position - 4 : position + over + 4].max() / around)

    new = pair(4.5e3, 1_350.0)
    jumping, gliding = (_core.Timeline(new, RATE) for _ in range(2))
    jumping.open()
    gliding.open()
    gliding.fade(0, 1 / 1.5, 1.0, *span)
    for mat in (0, 1):
        gliding.glide(mat, 900.0, 1e-3, 2e-3, *span)
    assert roughness(joined(new, jumping)) > 2.0
    assert roughness(joined(new, gliding)) < 1.5
    for refused in (
        lambda: gliding.fade(0, 0.5, 1.0, *span),
        lambda: gliding.fade(7, 0.5, 1.0, *span),
        lambda: gliding.fade(0, -1.0, 1.0, *span, n=2),
        lambda: gliding.glide(0, 1.0, 1.0, 1.0, *span),
        lambda: jumping.glide(0, 1.0, 1.0, 0.0, *span),
        lambda: jumping.glide(0, 1.0, 1.0, 1.0, span[1], span[0]),
        lambda: jumping.couple(0, 0.0, fade=0.0),
    ):
        with pytest.raises(EngineError):
            refused()
