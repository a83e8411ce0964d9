"""Points of charts and columns of maps, computed by workers of a cluster.

Only names, texts, numbers and samples are sent to a worker and back; a worker computes by the
functions of this module.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from statistics import median
from typing import Any, NotRequired, TypedDict

import numpy as np

from ergon.api import score as scores
from ergon.api.cluster import Cluster
from ergon.api.cluster_worker import check_version, staging_lock, version
from ergon.api.score_bundle import ScoreBundle, unpack, with_local_paths
from ergon.rendering.remote import ClusterError
from ergon.workshop.lab import map_catalogue
from ergon.workshop.lab.chart import (
    TIMING_ROUNDS,
    PlayedSetting,
    Point,
    play_beside_yardstick,
    yardstick,
)
from ergon.workshop.lab.maps import Map, Spot, compute_spot
from ergon.workshop.lab.names import MapMetric
from ergon.workshop.lab.runs import Setting
from ergon.workshop.lab.scene import Score


class _PlayResult(TypedDict):
    """A worker's result for a setting: its point, its samples (n_frames · n_channels of
    little-endian f64), and the seconds of its yardstick.
    """

    point: dict[str, Any]
    samples: bytes
    n_channels: int
    yardstick: float


class _SurveyChoice(TypedDict):
    """The maps of a `method`, or those of the score if there is one, for `seconds` of it."""

    method: str
    seconds: float
    accurate: float | None
    metric: MapMetric
    content: NotRequired[ScoreBundle]


@dataclass(frozen=True, slots=True)
class Workers:
    """A cluster that computes points of a score, which is sent with its files."""

    cluster: Cluster
    content: ScoreBundle | None = None

    def play_settings(
        self, settings_to_run: Sequence[Setting], n_frames: int, *, has_energy: bool
    ) -> Iterator[PlayedSetting]:
        """Settings of the score. A cost is scaled by the ratio of the yardsticks here and at the
        worker.

        Raises ClusterError.
        """
        content = self.content
        assert content is not None
        engine_version, local_yardstick = (
            version(),
            median(yardstick() for _ in range(TIMING_ROUNDS)),
        )
        results = self.cluster.compute_items(
            # The most expensive first, so that none of them is left alone at the end.
            sorted(settings_to_run, key=lambda setting: -setting.oversampling),
            lambda pool, setting: pool.submit(
                play, engine_version, content, asdict(setting), n_frames, has_energy
            ),
        )
        for setting, result in results:
            point = Point(setting, **result["point"])
            samples = np.frombuffer(result["samples"], dtype="<f8").astype(np.float64)
            if point.status != "ok":
                yield PlayedSetting(point, None)
                continue
            if len(samples) != n_frames * result["n_channels"]:
                raise ClusterError("a worker sent a sound of another length")
            if point.cost is not None:
                point = replace(point, cost=point.cost * local_yardstick / result["yardstick"])
            yield PlayedSetting(point, samples.reshape(n_frames, result["n_channels"]))

    def surveyors(
        self, method: str, duration: float, accurate: float | None, metric: MapMetric = "waveform"
    ) -> Surveyors:
        """The surveyors of columns of maps, for `maps`."""
        survey_choice = _SurveyChoice(
            method=method, seconds=duration, accurate=accurate, metric=metric
        )
        if self.content is not None:
            survey_choice["content"] = self.content
        return Surveyors(self.cluster, survey_choice)


@dataclass(frozen=True, slots=True)
class Surveyors:
    """A cluster that surveys columns of maps."""

    cluster: Cluster
    choice: _SurveyChoice

    def columns(
        self, wanted_columns: Sequence[tuple[str, float]]
    ) -> Iterator[tuple[str, list[Spot]]]:
        """Each column with its spots. Raises ClusterError."""
        engine_version = version()
        for (map_name, _), spots in self.cluster.compute_items(
            wanted_columns,
            lambda pool, column: pool.submit(survey, engine_version, self.choice, *column),
        ):
            yield map_name, [Spot(**spot) for spot in spots]


# --- at a worker --------------------------------------------------------------------------------


def play(
    client_version: list[Any],
    content: ScoreBundle,
    setting: dict[str, Any],
    n_frames: int,
    has_energy: bool,
) -> _PlayResult:
    """Play a score by the Setting `setting`. Raises ClusterError if another version of ergon
    asks.
    """
    check_version(client_version)
    with staging_lock, unpack(content) as path:
        scene = Score(scores.piece_of(scores.read(path)))
        played, yardstick_time = play_beside_yardstick(
            scene, Setting(**setting), n_frames, has_energy=has_energy
        )
        point_fields = {
            point_field.name: getattr(played.point, point_field.name)
            for point_field in fields(played.point)
        }
        del point_fields["setting"]
        point_fields["reason"] = with_local_paths(point_fields["reason"], path, content)
    sound = np.zeros((0, 1)) if played.sound is None else played.sound
    samples = sound.astype("<f8", copy=False).tobytes()
    return _PlayResult(
        point=point_fields, samples=samples, n_channels=sound.shape[1], yardstick=yardstick_time
    )


def survey(
    client_version: list[Any], choice: _SurveyChoice, map_name: str, x: float
) -> list[dict[str, Any]]:
    """Survey a column of a map. Raises ClusterError if another version of ergon asks."""
    check_version(client_version)
    with staging_lock:
        surveyed_map = _map(choice, map_name)
        return [asdict(compute_spot(surveyed_map, x, y)) for y in surveyed_map.ys]


def _map(choice: _SurveyChoice, map_name: str) -> Map:
    content, options = (
        choice.get("content"),
        (choice["seconds"], choice["accurate"], choice["metric"]),
    )
    if content is None:
        return map_catalogue.maps(choice["method"], None, *options)[map_name]
    with unpack(content) as path:
        piece = scores.piece_of(scores.read(path))
        return map_catalogue.maps(choice["method"], piece, *options)[map_name]
