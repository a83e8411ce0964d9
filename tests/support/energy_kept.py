"""Renders of small scenes by every way of planning, with what is said of energy that was made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from accuracy.equations import ELASTIC, REST, read
from random_networks import Floats, Link, RandomNetwork

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.reading.outputs import Accuracy
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import StageTakeover, stage

_IN_SESSION = StageTakeover(spans=())
WAYS: dict[str, tuple[Accuracy, dict[str, Any]]] = {
    "by ear": (Accuracy(), {}),
    "-60 dB": (Accuracy(error=-60.0), {}),
    "draft": (Accuracy(), {"is_draft": True}),
    "session": (Accuracy(), {"takeover": _IN_SESSION}),
    "ca": (Accuracy(method="ca"), {}),
    "modal": (Accuracy(method="modal"), {}),
    "bm4": (Accuracy(method="bm4"), {}),
    "ieq": (Accuracy(method="ieq"), {}),
}


@dataclass(frozen=True)
class Looked:
    """Positions (n_frames, n_out), what was said of energy or stability, and the plan's rows."""

    x: Floats
    stated: str
    computed: tuple[str, ...] = ()


def look(text: str, method: str, seconds: float) -> Looked:
    """A scene computed in a way of WAYS; a part that diverges ends it."""
    piece = load("scene.yaml", text=text).piece
    assert piece is not None
    accuracy, how = WAYS[method]
    n_frames = round(seconds * piece.rate)
    try:
        played = stage(replace(piece, accuracy=accuracy), planned=True, **how)
    except StageError as refused:
        return Looked(np.zeros((0, 0)), refused.diagnostics[0].message)
    assert played.plan is not None
    out = np.zeros((n_frames, played.simulation.n_out))
    try:
        played.simulation.process(out)
        message = "; ".join(gain.message for gain in played.energy_gains())
    except _core.DivergedError as error:
        message = str(error)
    return Looked(out, message, tuple(row.what for row in played.plan.rows()))


def network_of_text(text: str) -> RandomNetwork:
    """Masses, springs and contacts of a score whose outputs are the positions of all masses."""
    scene = read(text)
    moving = [i for i, m in enumerate(scene.mass) if np.isfinite(m)]
    assert [i for _, i in scene.outputs] == moving, "an output for each mass, in their order"
    place = {mass: i for i, mass in enumerate(moving)}
    links = []
    for (a, b), (kind, _), row in zip(scene.ends, scene.kinds, scene.numbers, strict=True):
        held = [0.0 if end in place else scene.x0[end] for end in (a, b)]
        link = (place.get(a, -1), place.get(b, -1), {})
        links.append(Link(*link, _potential(kind, row, held[1] - held[0])))
    return RandomNetwork(
        [scene.mass[i] for i in moving],
        [scene.ground[i] for i in moving],
        [scene.x0[i] for i in moving],
        [scene.v0[i] for i in moving],
        links,
    )


def _potential(kind: int, row: list[float], held: float):
    k = row[0]
    if kind == ELASTIC["linear"]:
        return lambda d: 0.5 * k * (d + held - row[REST]) ** 2
    assert kind == ELASTIC["contact"], "only springs and contacts are known here"
    _, exponent, gap, _, sign, _ = row[:6]
    order = exponent + 1.0
    return lambda d: k * np.maximum(-sign * (d + held) - gap, 0.0) ** order / order
