"""How closely keys followed their gestures: one report for each player, gesture and key."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ergon._core import Report


@dataclass(frozen=True, slots=True)
class GestureFidelity:
    """All plays of one gesture by one player on one key; SI units as in `_core.Report`.

    `is_layer`: nothing was compared, because a layer adds to the path of another gesture. With
    `n_ergons` 0 it was cut before it began. `worst_at` is NaN if the path was followed exactly.
    """

    player: str
    name: str
    key: str
    times: int
    is_layer: bool
    n_ergons: int
    rms: float
    worst: float
    worst_at: float
    pushed_by: str | None  # the MAT that pushed the key most at `worst_at`
    strongest: float
    low: float
    high: float
    missed: int
    first_points_missed: int


def gesture_fidelities(stage: Any) -> list[GestureFidelity]:
    """The reports of a staged piece that was run to its end."""
    simulation = stage.simulation
    reports_by_gesture: dict[tuple[str, str, str], list[Report]] = {}
    for report in simulation.reports():
        gesture = stage.gestures[report.gesture]
        reports_by_gesture.setdefault((gesture.player, gesture.name, gesture.key), []).append(
            report
        )
    keys = stage.piece.keys
    return [
        _merged_fidelity(*group_key, reports, keys[group_key[2]].reach)
        for group_key, reports in reports_by_gesture.items()
    ]


def _merged_fidelity(
    player: str, gesture_name: str, key_name: str, reports: list[Report], lever_ratio: float
) -> GestureFidelity:
    # The engine moves a key as the piece sees it, `lever_ratio` times as far; results are those of
    # the key.
    worst_report = max(reports, key=lambda report: report.worst)
    n_compared = sum(report.compared for report in reports)
    squares = sum(report.rms * report.rms * report.compared for report in reports)
    n_ergons = sum(report.n_ergons for report in reports)
    return GestureFidelity(
        player=player,
        name=gesture_name,
        key=key_name,
        times=len(reports),
        is_layer=not n_compared and n_ergons > 0,
        n_ergons=n_ergons,
        rms=sqrt(squares / n_compared) / lever_ratio if n_compared else 0.0,
        worst=worst_report.worst / lever_ratio,
        worst_at=worst_report.worst_at,
        pushed_by=worst_report.pushed_by,
        strongest=max(report.strongest for report in reports) / lever_ratio,
        low=min(report.low for report in reports) / lever_ratio,
        high=max(report.high for report in reports) / lever_ratio,
        missed=sum(report.missed for report in reports),
        first_points_missed=sum(report.first_point_missed for report in reports),
    )
