"""What the core refuses with a sentence, rather than panic or play something else."""

from collections.abc import Callable

import numpy as np
import pytest

from ergon import _core

RATE = 44_100.0
Scene = tuple[_core.Network, _core.Timeline]


def scene() -> Scene:
    """Two masses a = 0 and b = 1 on link 0, a fixed point 2, key 0 on a."""
    network = _core.Network()
    network.part("p")
    network.mas("a", M=1.0, X0=1.0)
    network.mas("b", M=1.0, X0=2.0)
    network.sol("c")
    network.ref("l", 0, 1, K=10.0)
    network.listen("a", positions=[(0, 1, 1.0)])
    network.listen("b", positions=[(1, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.key("k", 0)
    return network, timeline


REFUSED: dict[str, tuple[Callable[[Scene], object], str]] = {
    "unknown key": (lambda it: it[1].gesture(7, [0.0, 1.0], [0.0, 0.1], ["line"] * 2), "no key 7"),
    "unknown link": (lambda it: it[1].couple(9, 0.0), "no such link"),
    "backward coupling": (lambda it: it[1].couple(0, 2.0, 1.0), "must end after it begins"),
    "fixed strike": (lambda it: it[1].strike(2, 0.0, mass=1.0, speed=1.0), "p.c is fixed"),
    "drive to nowhere": (lambda it: it[1].drive(1, "position", constant=np.nan), "finite"),
    "start at nowhere": (lambda it: it[0].start(0, np.nan, 0.0), "finite"),
    "listening round the end": (
        lambda it: it[0].listen("o", positions=[(2**64 - 1, 1, 1.0)]),
        "does not exist",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_core_refuses_invalid_input_with_message(name: str):
    attempt, sentence = REFUSED[name]
    with pytest.raises(_core.EngineError, match=sentence):
        attempt(scene())


def test_process_refuses_fortran_order_arrays():
    simulation = _core.Simulation(*scene())
    with pytest.raises(_core.EngineError, match="C-contiguous"):
        simulation.process(np.zeros((3, 2), order="F"))
    out = np.zeros((3, 2))
    simulation.process(out)
    np.testing.assert_allclose(out, [[1.0, 2.0]] * 3, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("t", "x", "curve", "point"),
    [
        ([0.0, 1.0, 1.0], [0.0, 0.1, 0.2], ["line"] * 3, 2),
        ([0.0, 1.0, 2.0], [0.0, 0.1, np.nan], ["line"] * 3, 2),
        ([0.0, 1.0, 2.0], [0.0, 0.1, 0.1], ["line", "hold", "line"], 1),
        ([], [], [], None),
    ],
)
def test_refused_gesture_has_the_index_of_its_point(
    t: list[float], x: list[float], curve: list[str], point: int | None
):
    _, timeline = scene()
    with pytest.raises(_core.EngineError) as refused:
        timeline.gesture(0, t, x, curve)
    assert refused.value.index == point
    assert refused.value.module == "gesture"
    assert str(refused.value) == f"gesture: {refused.value.sentence}"


def test_module_error_messages_without_module_names():
    network = _core.Network()
    network.part("p")
    network.mas("a", M=1e-9)
    network.sol("c")
    network.ref("l", 0, 1, K=1e6)
    with pytest.raises(_core.UnstableError) as unstable:
        _core.Simulation(network, _core.Timeline(network, RATE))
    assert unstable.value.module == "p.a"
    assert unstable.value.index is None
    assert str(unstable.value) == f"p.a: {unstable.value.sentence}"
