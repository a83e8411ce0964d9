"""Scenes shared by several tests: random linear networks, and one with many features."""

import numpy as np

from oracle import bodies, laws
from oracle.scene import Mat, Scene

RATE = 44100.0
SMOOTH = ["smooth"] * 6


def random_network(seed: int, *, z: float = 1.0, ca: bool = False) -> Scene:
    """5 to 40 MAS and CEL, a chain and as many random REFs, some to a SOL."""
    rng = np.random.default_rng(seed)
    scene = Scene()
    unit = RATE**2 if ca else 1.0
    scene.part("net", ca_rate=RATE if ca else None)
    mats: list[Mat] = []
    for i in range(int(rng.integers(5, 41))):
        start = {"X0": rng.normal() * 1e-3, "V0": rng.normal() * 0.3}
        M = 10 ** rng.uniform(-3, -2) * unit
        if i % 3 == 0:
            mats.append(scene.mas(f"m{i}", M=M, **start))
        elif i % 3 == 1:
            damping = 0.1 * z * (RATE if ca else 1.0)
            mats.append(scene.cel(f"m{i}", M=M, K=2e3, Z=damping, rest=1e-4, **start))
        else:
            t60 = 0.8 if z else None
            mats.append(scene.cel(f"m{i}", M=M, f=10 ** rng.uniform(2, 3.5), t60=t60, **start))
    points = [*mats, scene.sol("s", X0=5e-4)]
    links = []
    for j in range(2 * len(mats)):
        a, b = (j, j + 1) if j < len(mats) else rng.choice(len(points), 2, replace=False)
        Z = rng.uniform(0, 0.05) * z * (RATE if ca else 1.0)
        links.append(
            scene.ref(
                f"l{j}",
                points[a],
                points[b],
                K=10 ** rng.uniform(2, 4),
                Z=Z,
                rest=rng.normal() * 1e-4,
            )
        )
    for i in range(5):
        scene.listen(f"x{i}", positions=[(mats[i], 1.0)])
    scene.listen("pair", positions=[(mats[0], 0.5), (mats[-1], -2.0)])
    scene.listen("f", forces=[(links[0], 1.0)])
    scene.listen("ff", forces=[(links[1], 1.0), (links[-1], 0.25)])
    return scene


def complete_scene(seconds: float = 1.0) -> Scene:
    """Two coupled keys, a bell, a string under a felt, a hard plate, an old cell, eight cells."""
    scene = Scene()
    scene.part("k1")
    first = scene.cel("m", M=0.4, K=60.0, Z=1.2)
    scene.part("k2")
    two = scene.cel("m", M=0.3, K=90.0, Z=0.8)
    scene.part("bell")
    bell = scene.cel("m", M=2e-3, f=220.0, t60=2.5)
    scene.part("string")
    mats = bodies.string(scene, "s", masses=20, M=8e-3, f=110.0, t60=3.0, stiffness=0.02)
    bow = scene.sol("bow")
    rub = scene.lnl("rub", mats[3], bow, laws.make("coulomb", k=30.0, F=2e-3, s=0.05))
    scene.part("gong")
    centre = bodies.plate(scene, "p", shape="hex", radius=3, M=0.12, f=90.0, t60=4.0, hardening=2e6)
    scene.part("old", ca_rate=44100.0)
    old = scene.cel("m", M=3e6, K=2e4, Z=200.0)
    scene.part("sky")
    sky = [scene.cel(f"c{i}", M=1e-3, f=300.0 * 1.3**i, t60=0.6 + 0.2 * i) for i in range(8)]
    floor = scene.sol("floor")
    scene.dry("felt", floor, sky[1], F=2e-4, static=3e-4, speed=1e-3)
    scene.dry("rub", sky[2], sky[3], F=1e-4, speed=1e-3)
    scene.part("links")
    hit = scene.but("hit", first, bell, K=900.0, Z=0.1, gap=1e-3)
    forces = scene.but("felt", two, mats[9], K=3e5, exponent=1.5, Z=0.05, gap=5e-4)
    # A small Z: the oracle multiplies it by a difference of positions, which rounds at 1e-18 m.
    push = scene.but("push", first, centre, K=600.0, gap=2e-3, clamp=True, Z=0.02)
    hook = scene.but("hook", two, old, K=300.0, gap=5e-4, side="above")
    scene.ref("duet", first, two, K=40.0, Z=0.2)
    scene.listen("keys", positions=[(first, 1.0), (two, -1.0)])
    for name, mat in (("bell", bell), ("left", mats[4]), ("right", mats[15])):
        scene.listen(name, positions=[(mat, 1.0)])
    scene.listen("gong", positions=[(centre, 1.0)])
    scene.listen("old", positions=[(old, 1.0)])
    scene.listen("sky", ground_forces=[(mat, 1.0 / (1 + i)) for i, mat in enumerate(sky)])
    for name, link in (("hit", hit), ("felt", forces), ("push", push)):
        scene.listen(name, forces=[(link, 1.0)])
    scene.listen("hook", forces=[(hook, 1.0), (rub, 0.5)])
    ada, remi = scene.key("k1", first), scene.key("k2", two)
    # Both gestures end with the compared second. A released key keeps the last rounding of its path
    # as a speed of 1e-17 m a sample, and so drifts by 1e-14 m.
    scene.gesture(ada, [0.0, 0.2, 0.4, 1.0], [0.0, 6e-3, 1e-3, 0.0], SMOOTH[:4])
    scene.gesture(
        remi, [0.0, 0.1, 0.3, 0.45, 1.0], [0.0, 3e-3, 3e-3, -3e-3, 0.0],
        ["smooth", "smooth", "hold", "smooth", "line"], touch="tracked",
    )  # fmt: skip
    for i, mat in enumerate(sky):
        for j in range(int(12 * seconds)):
            scene.strike(
                mat, 0.0131 + 0.0791 * j + 0.00171 * i * i, impulse=1e-6 * (1 + (i + j) % 4)
            )
    scene.strike(centre, 0.05, impulse=2e-4)
    scene.strike(mats[12], 0.03333, impulse=5e-5)
    scene.strike(old, 0.02, impulse=1e-4)
    return scene
