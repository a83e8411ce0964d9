"""A replay as a score for the page: asked, real, model and residual as moving curves.

Each curve is a chain of points in space. Its first point moves as the key does; each next point
follows later, so that a chain shows the last half second as an oscilloscope does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from .comparison import Replay
    from .gesture import Floats

_CHAIN_POINTS, _CHAIN_LENGTH, _SHOWN_DURATION = (
    100,
    1.0,
    0.5,
)  # points of a chain; its length [m]; the time shown [s]
_DEFLECTION_MAX = 0.1  # largest deflection of a curve [m]


@dataclass(frozen=True, slots=True)
class _Curve:
    """The content of a chain: values (n,), their unit and its size in SI, and its position [m]."""

    name: str
    values: Floats
    unit: tuple[str, float]
    z: float
    y: float = 0.0


def write_scene(replay: Replay, folder: Path) -> Path:
    """Write a score of a replay into a folder, with its take; returns the path of the score."""
    gesture = replay.gesture
    t = np.arange(gesture.force.size) / gesture.rate
    position = np.interp(t, replay.instants, gesture.position[gesture.is_compared]) - gesture.start
    curves = (
        [_Curve("asked", gesture.force, ("N", 1.0), 0.5)],
        [
            _Curve("real", position, ("mm", 1e-3), 0.25),
            _Curve("model", replay.model_position - gesture.start, ("mm", 1e-3), 0.25, 0.05),
        ],
        [_Curve("residual", np.interp(t, replay.instants, replay.residual), ("um", 1e-6), 0.0)],
    )
    columns, chains, comments = {}, "", []
    for curve_group in curves:
        unit, unit_in_si = curve_group[0].unit
        units_per_cm = _rounded_scale(
            max(float(np.abs(curve.values).max()) for curve in curve_group) / unit_in_si
        )
        names = " and ".join(curve.name for curve in curve_group)
        comments.append(f"{names} {units_per_cm:g} {unit} a cm")
        for curve in curve_group:
            columns[curve.name] = curve.z + 0.01 / (units_per_cm * unit_in_si) * curve.values
            chains += _chain_text(curve)
    np.savez(folder / "replay.npz", allow_pickle=False, t=t, **columns)
    takes = "".join(f"  {name}: {{file: replay.npz, channel: {name}}}\n" for name in columns)
    score_path = folder / "replay.yaml"
    # A piece ends with its last event. This one has no event, so all of it is its tail.
    score_path.write_text(
        f"ergon: 1\ntitle: 'from above: {', '.join(comments)}'\nrates: {{audio: 8kHz}}\n"
        f"render: {{tail: {t[-1]:.3f}s}}\ntakes:\n{takes}"
        f"instruments:\n  replay:\n    space: 3\n    modules:\n{chains}",
        encoding="utf-8",
    )
    return score_path


def _rounded_scale(value_max: float) -> float:
    """The value of one centimetre, of 1, 2, 5, 10 …, for which the greatest value fits the
    height.
    """
    scale_min = value_max / (100 * _DEFLECTION_MAX) or 1.0
    decade = 10.0 ** np.floor(np.log10(scale_min))
    return float(next(step * decade for step in (1, 2, 5, 10) if step * decade >= scale_min))


def _chain_text(curve: _Curve) -> str:
    """Modules: points that follow a take, each later than the one before."""
    place = f"{curve.y}m, {curve.z}m"
    drive_lines = "".join(
        f"      {curve.name}_{i}: "
        f"{{ENX: {{to: {curve.name}.{i}.z, from: {curve.name}, "
        f"at: {i * _SHOWN_DURATION / (_CHAIN_POINTS - 1):.5f}s}}}}\n"
        for i in range(_CHAIN_POINTS)
    )
    # The springs are drawn; they are too weak to pull the heavy points sideways.
    return (
        f"      {curve.name}: "
        f"{{CHAIN: {{masses: {_CHAIN_POINTS}, ends: free, M: {_CHAIN_POINTS}kg, "
        f"K: 1e-9N/m, from: [0m, {place}], to: [-{_CHAIN_LENGTH}m, "
        f"{place}]}}}}\n{drive_lines}"
    )
