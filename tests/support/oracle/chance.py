"""Small random scenes: bodies, cells, hammers and keys that meet."""

import numpy as np

from oracle.scene import Mat, Scene

SPAN = 0.1  # [s] to look at


class Dice:
    """Draws of one seed."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def by_ratio(self, low: float, high: float) -> float:
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def integer(self, low: int, high: int) -> int:
        """low … high, both inclusive."""
        return int(self.rng.integers(low, high + 1))

    def chance(self, p: float) -> bool:
        return bool(self.rng.random() < p)


def body(scene: Scene, dice: Dice, count: int, *, even: bool = True) -> list[Mat]:
    """A row of masses held at one end, with one or two chords; `even`: damping is proportional to
    stiffness.
    """
    M, f = dice.by_ratio(1e-3, 3e-2), dice.by_ratio(60.0, 800.0)
    K, beta = M * (2.0 * np.pi * f) ** 2, dice.by_ratio(1e-7, 1e-5) * dice.chance(0.7)

    def viscosity(k: float) -> float:
        return k * (beta if even else dice.by_ratio(1e-7, 1e-5))

    mats: list[Mat] = []
    for i in range(count):
        single, k = M * dice.between(0.5, 2.0), K * dice.between(0.0, 0.2)
        if dice.chance(0.3):
            mats.append(scene.cel(f"m{i}", M=single, K=k, Z=viscosity(k)))
        else:
            mats.append(scene.mas(f"m{i}", M=single))
    points = [scene.sol("g", X0=0.0), *mats]
    links = [(i, i + 1) for i in range(count)]
    for _ in range(dice.integer(0, 2)):
        a, b = dice.integer(0, count), dice.integer(0, count)
        links += [(a, b)] if a != b else []
    for i, (a, b) in enumerate(links):
        k = K * dice.between(0.5, 2.0)
        scene.ref(f"l{i}", points[a], points[b], K=k, Z=viscosity(k))
    return mats


def cell(scene: Scene, dice: Dice, name: str) -> Mat:
    t60 = dice.by_ratio(0.1, 4.0) if dice.chance(0.8) else None
    return scene.cel(name, M=dice.by_ratio(1e-3, 3e-2), f=dice.by_ratio(60.0, 1500.0), t60=t60)


def strikes(scene: Scene, dice: Dice, mats: list[Mat]) -> None:
    """Strikes between frames, so hard that masses leave at up to 1 m/s."""
    for _ in range(dice.integer(1, 3)):
        mat = mats[dice.integer(0, len(mats) - 1)]
        push = scene.mats[int(mat)].M * dice.between(-1.0, 1.0)
        scene.strike(mat, dice.between(0.0, 0.2 * SPAN), impulse=push)


def meet(scene: Scene, dice: Dice, striker: Mat, struck: Mat, index: int, *, gap: float) -> None:
    """A contact that lasts one to ten milliseconds, by the mass of the lighter one."""
    light = min(scene.mats[int(mat)].M for mat in (striker, struck))
    K = light * (np.pi / dice.by_ratio(1e-3, 1e-2)) ** 2
    Z = dice.between(0.0, 0.1) * np.sqrt(K * light) if dice.chance(0.3) else 0.0
    scene.but(f"b{index}", striker, struck, K=K, Z=Z, gap=gap)


def hammer(scene: Scene, dice: Dice, name: str) -> tuple[Mat, float]:
    """A moving hammer, and the gap of its contact."""
    gap = dice.between(0.0, 2e-3)
    away, M = dice.between(1e-4, 3e-3), dice.by_ratio(1e-3, 3e-2)
    return scene.mas(name, M=M, X0=-gap - away, V0=dice.between(0.1, 1.5)), gap


def key(scene: Scene, dice: Dice, name: str) -> tuple[Mat, float]:
    """A key moved by a hand, and the gap of its contact."""
    mat = scene.cel("m", M=dice.by_ratio(0.05, 0.5), K=dice.by_ratio(20.0, 200.0), Z=1.0)
    times = np.cumsum([dice.between(0.0, 0.005), *(dice.between(0.012, 0.02) for _ in range(2))])
    path = [0.0, dice.between(1e-3, 4e-3), dice.between(-1e-3, 1e-3)]
    scene.gesture(scene.key(name, mat), [float(t) for t in times], path, ["smooth"] * 3)
    return mat, dice.between(0.0, 1e-3)


def scene(seed: int, *, even: bool = True) -> Scene:
    """One to three sounding bodies, each alone or hit by a hammer or a key.

    A plan can compute `even` scenes exactly except for their contacts: damping is proportional
    to stiffness, and bodies have enough masses to be cut out. Bodies of other scenes are also
    joined across.
    """
    dice, built = Dice(seed), Scene()
    all_mats: list[Mat] = []
    for i in range(dice.integer(1, 3)):
        built.part(f"p{i}")
        met = dice.chance(0.6)
        if dice.chance(0.6):
            mats = body(built, dice, dice.integer(4 if met and even else 1, 8), even=even)
        else:
            mats = [cell(built, dice, "c")]
        struck = mats[dice.integer(0, len(mats) - 1)]
        if met:
            built.part(f"s{i}")
            by = key if dice.chance(0.4) else hammer
            striker, gap = by(built, dice, f"s{i}")
            meet(built, dice, striker, struck, i, gap=gap)
            built.listen(f"s{i}", positions=[(striker, 1.0)])
        if not met or dice.chance(0.3):
            strikes(built, dice, mats)
        built.listen(f"o{i}", positions=[(mats[-1], 1.0), (mats[0], dice.between(-1.0, 1.0))])
        all_mats += mats
    if not even and len(all_mats) > 1:
        a, b = all_mats[0], all_mats[-1]
        built.ref("across", a, b, K=dice.by_ratio(10.0, 1e3), Z=dice.between(0.0, 0.1))
    return built
