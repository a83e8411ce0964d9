"""A scene of the size of existing pieces for 10,000 struck oscillators and a gong.

Everything is in algorithmic units at 44.1 kHz: the numbers define the network, and no plan may
change it.
"""

from __future__ import annotations

from functools import partial

from benches import sides
from benches.measure import Row
from benches.native import Loops
from benches.planned import planned
from ergon import _core

RATE = 44100.0
THREADS = 2
ROUNDS = 3
_COUNT = 10_000
_OUTPUTS = 24
_LENGTH = 60.0  # seconds over which ergons are laid
_STRIKES = 0.16  # a second on each oscillator
_FRAMES = 44_100
_MODULES_MIN = 230_000  # modules, each ergon counted as the MAS and the BUT it stands for


def quetzalcoatl(_: Loops | None) -> list[Row]:
    """The speed relative to real time, on two threads; and what the plan changed, if anything."""
    network, timeline, ergons = scene()
    modules = network.n_mat + network.n_lia + 2 * ergons
    assert modules >= _MODULES_MIN, f"{modules} modules"
    side = sides.engine("ergon", planned(network, timeline, threads=THREADS))
    taken = sides.seconds(ROUNDS, [side], _FRAMES)["ergon"]
    speed = _FRAMES / RATE / taken
    values: dict[str, float | int | str] = {
        "modules": modules,
        "ergons": ergons,
        "outputs": network.n_out,
        "threads": THREADS,
        "x_real_time": speed,
    }
    text = f"{speed:.2f} × real time on {THREADS} threads"
    name = f"Quetzalcoatl's size: {modules:,} modules, of which {ergons:,} ergons; 24 outputs"
    plain = sides.engine("whole", _core.Simulation(network, timeline))
    values["dB"] = error = sides.error(side.begin()(_FRAMES), plain.begin()(_FRAMES))
    complete = f"real time: 1; against the same scene stepped whole {error:.0f} dB"
    return [Row(name, text, complete, speed, "× real time", values)]


def scene() -> tuple[_core.Network, _core.Timeline, int]:
    """Oscillators, gong and keys, the strikes of one minute, and the number of ergons."""
    network = _core.Network()
    m, z = RATE**2, RATE  # algorithmic mass and damping of 1 kg and 1 N·s/m
    network.part("sky", ca_rate=RATE)
    sky = network.bank("", count=_COUNT, M=1e-3 * m, f=(20.0, 10_000.0), t60=(0.5, 8.0))
    network.part("gong", ca_rate=RATE)
    gong = network.plate(
        "", shape="hex", radius=58, M=0.3 * m, f=65.4, t60=14.0, rim="fixed", hardening=4e8
    )
    network.part("k1", ca_rate=RATE)
    first = network.cel("", M=0.4 * m, K=60.0, Z=1.2 * z)
    network.part("k2", ca_rate=RATE)
    second = network.cel("", M=0.3 * m, K=50.0, Z=1.0 * z)
    network.part("between", ca_rate=RATE)
    link = network.ref("link", first, second, K=10.0, Z=0.1 * z)
    centre = network.centre(gong)
    network.but("beater", first, centre, K=900.0, Z=0.1 * z, gap=1e-3)
    each = -(-_COUNT // (_OUTPUTS - 2))
    for i in range(_OUTPUTS - 2):
        some = min(each, _COUNT - i * each)
        network.listen(f"sky{i}", positions=[(sky + i * each, some, 1.0)])
    network.listen("gong", positions=[(centre, 1, 1.0)])
    network.listen("edge", positions=[(gong, 58, 1.0)])
    timeline = _core.Timeline(network, RATE)
    for name, key, reach in (("k1", first, 6e-3), ("k2", second, 4e-3)):
        hand = timeline.key(name, key)
        t = [0.05 + 0.25 * i for i in range(int(_LENGTH / 0.25))]
        x = [reach * (i % 2) for i in range(len(t))]
        timeline.gesture(hand, t, x, ["smooth"] * len(t))
    # The keys are coupled for the first half, then independent.
    timeline.couple(link, 0.0, 0.5 * _LENGTH)
    rain = partial(timeline.rain, start=0.0, stop=_LENGTH, seed=11)
    cells = range(sky, sky + _COUNT)
    ergons = rain(cells, rate=_STRIKES, impulse=(1e-6, 4e-6), name="hail")
    ergons += rain([centre, gong], rate=4.0, impulse=(1e-4, 1e-3), name="mallets")
    return network, timeline, ergons
