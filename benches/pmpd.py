"""A cloth and a chain compared with pmpd in Pure Data's batch mode, on one thread each: CPU
time.
"""

from __future__ import annotations

from benches.measure import Row
from benches.mi_physics import beside, chain, cloth
from benches.peers.pmpd import Program

_SIDE = 30  # points along each side of the cloth: Pure Data takes minutes to load a larger one
_WARM, _FRAMES = 100, 1_000  # its clock counts hundredths of a second
_SAME = 0.1  # of the way of a mass: in f32 a spring of the cloth is as long as rounding is


def pmpd(_: object) -> list[Row]:
    """The same masses and springs at the same steps, in f32 in pmpd; both must reach the same
    places.
    """
    scenes = ((scene, _WARM, _FRAMES) for scene in (cloth(_SIDE), chain()))
    return beside("pmpd", Program, scenes, (_WARM + _FRAMES, _SAME))
