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
from ergon.workshop.lab.chart import ROUNDS, Played, Point, played_beside, yardstick
from ergon.workshop.lab.maps import Map, Spot, compute_spot
from ergon.workshop.lab.names import MapMetric
from ergon.workshop.lab.runs import Setting
from ergon.workshop.lab.scene import Score


class _Sound(TypedDict):
    """A worker's result for a setting: its point, its samples (n_frames · n_channels of
    little-endian f64), and the seconds of its yardstick.
    """

    point: dict[str, Any]
    samples: bytes
    n_channels: int
    yardstick: float


class _Which(TypedDict):
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

    def played(
        self, settings_wanted: Sequence[Setting], n_frames: int, *, has_energy: bool
    ) -> Iterator[Played]:
        """Settings of the score. A cost is scaled by the ratio of the yardsticks here and at the
        worker.

        Raises ClusterError.
        """
        score_content = self.content
        assert score_content is not None
        engine_version, yardstick_here = version(), median(yardstick() for _ in range(ROUNDS))
        results = self.cluster.computed(
            # The most expensive first, so that none of them is left alone at the end.
            sorted(settings_wanted, key=lambda setting: -setting.oversampling),
            lambda pool, setting: pool.submit(
                play, engine_version, score_content, asdict(setting), n_frames, has_energy
            ),
        )
        for setting, worker_sound in results:
            worker_point = Point(setting, **worker_sound["point"])
            sound_samples = np.frombuffer(worker_sound["samples"], dtype="<f8").astype(np.float64)
            if worker_point.status != "ok":
                yield Played(worker_point, None)
                continue
            if len(sound_samples) != n_frames * worker_sound["n_channels"]:
                raise ClusterError("a worker sent a sound of another length")
            if worker_point.cost is not None:
                worker_point = replace(
                    worker_point,
                    cost=worker_point.cost * yardstick_here / worker_sound["yardstick"],
                )
            yield Played(worker_point, sound_samples.reshape(n_frames, worker_sound["n_channels"]))

    def surveyors(
        self,
        method: str,
        run_seconds: float,
        accurate: float | None,
        metric: MapMetric = "waveform",
    ) -> Surveyors:
        """The surveyors of columns of maps, for `maps`."""
        survey_choice = _Which(method=method, seconds=run_seconds, accurate=accurate, metric=metric)
        if self.content is not None:
            survey_choice["content"] = self.content
        return Surveyors(self.cluster, survey_choice)


@dataclass(frozen=True, slots=True)
class Surveyors:
    """A cluster that surveys columns of maps."""

    cluster: Cluster
    which: _Which

    def columns(
        self, columns_wanted: Sequence[tuple[str, float]]
    ) -> Iterator[tuple[str, list[Spot]]]:
        """Each column with its spots. Raises ClusterError."""
        engine_version = version()
        for (map_name, _), spots in self.cluster.computed(
            columns_wanted,
            lambda pool, column: pool.submit(survey, engine_version, self.which, *column),
        ):
            yield map_name, [Spot(**spot) for spot in spots]


# --- at a worker --------------------------------------------------------------------------------


def play(
    versions_asked: list[Any],
    score_content: ScoreBundle,
    setting: dict[str, Any],
    n_frames: int,
    has_energy: bool,
) -> _Sound:
    """Play a score by the Setting `setting`. Raises ClusterError if another version of ergon
    asks.
    """
    check_version(versions_asked)
    with staging_lock, unpack(score_content) as path:
        scene = Score(scores.piece_of(scores.read(path)))
        run_result, yardstick_seconds = played_beside(
            scene, Setting(**setting), n_frames, has_energy=has_energy
        )
        point_fields = {
            point_field.name: getattr(run_result.point, point_field.name)
            for point_field in fields(run_result.point)
        }
        del point_fields["setting"]
        point_fields["reason"] = with_local_paths(point_fields["reason"], path, score_content)
    sound = np.zeros((0, 1)) if run_result.sound is None else run_result.sound
    samples = sound.astype("<f8", copy=False).tobytes()
    return _Sound(
        point=point_fields, samples=samples, n_channels=sound.shape[1], yardstick=yardstick_seconds
    )


def survey(
    versions_asked: list[Any], survey_choice: _Which, map_name: str, x: float
) -> list[dict[str, Any]]:
    """Survey a column of a map. Raises ClusterError if another version of ergon asks."""
    check_version(versions_asked)
    with staging_lock:
        surveyed_map = _map(survey_choice, map_name)
        return [asdict(compute_spot(surveyed_map, x, y)) for y in surveyed_map.ys]


def _map(which_map: _Which, map_name: str) -> Map:
    score_content, map_options = (
        which_map.get("content"),
        (which_map["seconds"], which_map["accurate"], which_map["metric"]),
    )
    if score_content is None:
        return map_catalogue.maps(which_map["method"], None, *map_options)[map_name]
    with unpack(score_content) as path:
        piece = scores.piece_of(scores.read(path))
        return map_catalogue.maps(which_map["method"], piece, *map_options)[map_name]
