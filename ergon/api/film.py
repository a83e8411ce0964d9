"""The motion of a staged piece for pages and files: the manifest, and the name of the file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon.common.shown_paths import shown
from ergon.exchange.safe import MARK
from ergon.scores.reading.digest import digest_of

from . import score as scores
from .errors import OptionError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import LookRun, MotionLook, MotionRecorder, Simulation, Window
    from ergon.rendering.filmed import MotionRecording
    from ergon.rendering.job import RenderJob
    from ergon.scores.staging.stage import Stage

FPS = 60.0  # samples of the motion a second
SUFFIX = ".motion"
_INSTRUMENT_SPACING = 1.3  # [m] between instruments that the score does not place
_KEYS_Y = -1.3  # [m] in front of the instruments
_KEY_WIDTH = 0.1  # [m]
_LOOSE_ROW_LENGTH = 0.6  # width of the row in which unplaced points are drawn, in bench units
_LAYOUTS = {"BANK": "bank", "MODES": "bank", "STRING": "string", "PLATE": "plate"}


def film(stage: Stage, job: RenderJob) -> MotionRecording:
    """The motion file that is written beside the sound of `job`. Raises OptionError."""
    from ergon.rendering.filmed import MotionRecording

    if job.target == "-":
        raise OptionError(
            "motion",
            "sound on stdout gives the motion file no name; write the sound into a file by -o",
        )
    stop_frame = min(job.stop, stage.n_analysed_frames) if job.has_open_end else job.stop

    def start_recorder(simulation: Simulation) -> MotionRecorder:
        return recorder(stage, simulation, stop_frame / stage.rate)

    return MotionRecording(
        Path(job.target).with_suffix(SUFFIX), stop_frame, stage.n_channels, start_recorder
    )


def recorder(stage: Stage, simulation: Simulation, duration: float | None) -> MotionRecorder:
    """A recorder of the motion of a simulation at frame 0. Raises EngineError."""
    from ergon import _core

    return _core.MotionRecorder(**_recorder_arguments(stage, simulation, duration))


def window(stage: Stage, simulation: Simulation) -> Window:
    """The view that pages get of a simulation that is about to play. Raises EngineError."""
    from ergon import _core

    return _core.Window(**_recorder_arguments(stage, simulation, None))


def _recorder_arguments(
    stage: Stage, simulation: Simulation, duration: float | None
) -> dict[str, Any]:
    """The arguments of a recorder and of a window."""
    from ergon import _core

    if stage.timeline is None:
        raise OptionError(
            "motion",
            "this performance consists of parts that were computed before, which "
            "have no motion; leave motion out",
        )
    motion_look = _core.MotionLook(simulation)
    return {
        "simulation": simulation,
        "look": motion_look,
        "timeline": stage.timeline,
        "manifest": json.dumps(manifest(stage, motion_look, duration), ensure_ascii=False),
        "places": _point_places(stage, motion_look),
        "keys": [mat for _, mat, _ in _key_entries(stage)],
        "n_speakers": stage.n_channels,
        "fps": FPS,
    }


def _key_entries(stage: Stage) -> list[tuple[str, int, bool]]:
    """Keys, with the MAT of each and whether a real hand plays it.

    Keys without a real hand come first.
    """
    mat_by_key = {hand.key: hand.mat for hand in stage.live_hands}
    mat_by_module = stage.built_network.assembly.mats
    key_entries = [
        (name, mat_by_module[name, key.struck], False)
        for name, key in stage.piece.keys.items()
        if name not in mat_by_key
    ]
    return key_entries + [(name, mat, True) for name, mat in mat_by_key.items()]


def manifest(stage: Stage, look: MotionLook, duration: float | None) -> dict[str, Any]:
    """The manifest of a motion file (docs/motion.md); `duration` [s] is None if it is not known."""
    from ergon import _core

    piece = stage.piece
    point_index = {mat: index for index, mat in enumerate(look.mats())}
    player_by_key = {player.key: player.name for player in piece.players.values()}
    points_in_space = (
        [point_index.get(mat) for mat in axes] for axes in stage.built_network.points_in_space()
    )
    contacts = [
        (contact.name, point_index.get(contact.a), point_index.get(contact.b))
        for contact in look.contacts()
    ]
    return {
        "made_by": f"{MARK.decode()} {_core.__version__}",
        "format": 3,
        "bound": None if duration is None else _core.motion_bound(),
        "title": piece.title,
        "score": shown(piece.place.file),
        "score_sha256": digest_of(piece),
        "plan_sha256": stage.plan.hash if stage.plan else None,
        "seed": piece.seed,
        "rate": stage.rate,
        "fps": FPS,
        "duration": duration,
        "points": len(point_index),
        "modes": look.n_modes,
        "parts": [_part_entry(stage, run.part, run) for run in look.runs()],
        "space": [axes for axes in points_in_space if None not in axes],
        "keys": [
            {
                "name": name,
                "point": point_index.get(mat),
                "player": player_by_key.get(name),
                "hand": is_real,
            }
            for name, mat, is_real in _key_entries(stage)
        ],
        "contacts": [
            {"name": name, "a": first_index, "b": second_index}
            for name, first_index, second_index in contacts
        ],
        "speakers": list(_speakers(stage)),
        "sources": [
            {"name": None, "file": shown(place.file), "line": place.line}
            for place in stage.ergon_places
        ],
        "marks": [
            {"name": name, "seconds": instant} for name, instant in scores.mark_instants(piece)
        ],
    }


def _part_entry(stage: Stage, instrument_name: str, run: LookRun) -> dict[str, Any]:
    mode_table = None
    if run.modes is not None:
        mode_table = dict(zip(("first", "count", "of"), run.modes, strict=True))
    is_frozen = run.why == "unheard" and instrument_name in stage.listening.silent_instruments
    return {
        "name": instrument_name,
        "first": run.first,
        "count": run.count,
        "kind": run.kind,
        "layout": _layout_kind(stage, instrument_name),
        "why": "frozen" if is_frozen else run.why,
        "modes": mode_table,
        "exaggeration": 1.0
        if _axis_count(stage, instrument_name) > 1
        else None,  # positions in space are true to scale
    }


def _axis_count(stage: Stage, name: str) -> int:
    """How many axes the masses of a key or an instrument move along."""
    instrument = stage.piece.instruments.get(name)
    return instrument.axes if instrument else 1


def _layout_kind(stage: Stage, instrument_name: str) -> str:
    if instrument_name in stage.piece.keys:
        return "key"
    instrument = stage.piece.instruments.get(instrument_name)
    kinds = [module.kind for module in instrument.modules] if instrument else []
    return next((_LAYOUTS[kind] for kind in kinds if kind in _LAYOUTS), "loose")


def _speakers(stage: Stage) -> Iterator[dict[str, Any]]:
    """The loudspeakers of the layout; without one, two at ±30°, or others evenly spaced from the
    front on.
    """
    from ergon.space.directions import angles, point

    layout = stage.piece.mix.layout
    n_channels = stage.n_channels
    speaker_places, channels = (
        tuple(
            point(-360.0 * speaker_index / n_channels, 0.0, 3.0)
            for speaker_index in range(n_channels)
        ),
        tuple(range(n_channels)),
    )
    if layout is not None and layout.n_channels == n_channels:
        speaker_places, channels = layout.speakers, layout.channels
    elif n_channels == 2:
        speaker_places = (point(30.0, 0.0, 3.0), point(-30.0, 0.0, 3.0))
    for channel, speaker_place in zip(channels, speaker_places, strict=True):
        azimuth, elevation, distance = angles(speaker_place)
        yield {
            "name": str(channel + 1),
            "channel": channel,
            "az": azimuth,
            "el": elevation,
            "r": distance,
            "xyz": list(speaker_place),
        }


def _point_places(stage: Stage, look: MotionLook) -> NDArray[np.float64]:
    """The position of each point at rest [m], (n_points, 3).

    Instruments lie where the score places them; without a place, in the middle of the layout, or
    side by side if there is no layout.
    """
    import numpy as np

    piece, network = stage.piece, stage.network
    mats = look.mats()
    point_places = np.zeros((len(mats), 3))
    points_by_part: dict[str, list[int]] = {}
    for run in look.runs():
        points_by_part.setdefault(run.part, []).extend(range(run.first, run.first + run.count))
    instrument_names = [name for name in points_by_part if name not in piece.keys]
    for instrument_name, point_indices in points_by_part.items():
        point_indices.sort(key=lambda point: mats[point])
        if instrument_name in piece.keys:
            point_places[point_indices] = _key_places(
                list(piece.keys).index(instrument_name), len(piece.keys), len(point_indices)
            )
        else:
            width, middle = _size_and_place(stage, instrument_name, instrument_names)
            if (
                _axis_count(stage, instrument_name) == 1
            ):  # points in space are where their coordinates say
                bench_positions = np.array(
                    [network.position_of(mats[point]) for point in point_indices]
                )
                point_places[point_indices, :2] = width * _centred_bench(bench_positions)
            point_places[point_indices] += middle
    return point_places


def _key_places(key_index: int, n_keys: int, n_points: int) -> NDArray[np.float64]:
    """Positions of the points of a key, one behind the other; keys lie in a row before the
    instruments.
    """
    import numpy as np

    key_x = (key_index - 0.5 * (n_keys - 1)) * _KEY_WIDTH
    return np.array([(key_x, _KEYS_Y - 0.5 * _KEY_WIDTH * row, 0.0) for row in range(n_points)])


def _size_and_place(
    stage: Stage, instrument_name: str, instrument_names: list[str]
) -> tuple[float, tuple[float, float, float]]:
    """The size of an instrument, and where its middle lies [m]."""
    instrument = stage.piece.instruments.get(instrument_name)
    placing = instrument.placing if instrument else None
    if placing is not None:
        return placing.across, (*placing.at, placing.height or 0.0)
    if stage.piece.mix.layout is not None:
        return 1.0, (0.0, 0.0, 0.0)
    instrument_index = instrument_names.index(instrument_name)
    n_columns = max(1, math.isqrt(max(0, len(instrument_names) - 1)) + 1)
    instrument_x = (instrument_index % n_columns - 0.5 * (n_columns - 1)) * _INSTRUMENT_SPACING
    return 1.0, (instrument_x, instrument_index // n_columns * _INSTRUMENT_SPACING, 0.0)


def _centred_bench(bench_positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions on the bench (n_points, 2); points that are all in its middle are set in a row."""
    import numpy as np

    unplaced_points = np.flatnonzero((bench_positions == 0.0).all(axis=1))
    spread_bench = bench_positions.copy()
    if len(unplaced_points) > 1:
        spread_bench[unplaced_points, 0] = _LOOSE_ROW_LENGTH * (
            np.arange(len(unplaced_points)) / (len(unplaced_points) - 1) - 0.5
        )
    return spread_bench
