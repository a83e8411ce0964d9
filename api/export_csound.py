"""Parts of a score as orchestras of Csound: banks of their modes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report

from . import score as scores
from .errors import OptionError
from .export import HIGHEST, ExportedPart, ExportOptions, left_out, swing, touched
from .modes import modes_of
from .parts import hertz, named

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.models.csound import Bank, Way
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Ready

    from .modes import PartModes

_MOST = 20_000  # modes times ways: each is an instrument that Csound runs
_POINTS = 200  # that are struck or touched
_LEAST = 1e-12  # of the largest amplitude: less is no sound, but rounding
_LEVEL = 0.1  # of full scale, of what is at the reference level


def csound_orchestras(
    score: str | Path, options: ExportOptions | None = None, *, report: Report | None = None
) -> tuple[ExportedPart, ...]:
    """The modes of parts of a score as orchestras of Csound, a `.csd` for each part with modes.

    A resonator for each mode goes from each point that is struck or touched to each output of
    positions, speeds or accelerations; the score of the file has the strikes of the piece, each on
    the nearest sample. Modes are those of `mode_tables`. Raises ScoreError and OptionError.
    """
    from ergon.models.csound import orchestra
    from ergon.scores.staging.stage import prepare

    options = options or ExportOptions()
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    upto = HIGHEST if options.upto is None else hertz("upto", options.upto)
    upto = min(upto, 0.499 * piece.rate)
    made = []
    with scores.staging(lambda: loaded, report), (report or Report()).waiting("computing modes"):
        ready = prepare(piece)
        for name in named(piece, options.parts):
            found = modes_of(piece, ready.built, name, {"to": upto}, loaded.inputs)
            if not found.masses:
                continue
            bank = _bank(piece, ready, found)
            text = orchestra(bank)
            made.append(ExportedPart(name, text, tuple(left_out(found)), loaded.inputs))
    return tuple(made)


def _bank(piece: Piece, ready: Ready, found: PartModes) -> Bank:
    """Raises OptionError where it has too many modes, or nothing of it is heard."""
    from ergon.models.csound import Bank

    swings = found.poles.imag > 0.0
    poles = found.poles[swings]
    instrument = piece.instruments.get(found.part)
    outputs = [one for one in instrument.outputs if one.is_movement] if instrument else []
    labels = [f"out {one.name}" if one.name else "out" for one in outputs]
    heard = [one for one in zip(outputs, labels, strict=True) if one[1] in found.points]
    if not heard:
        raise OptionError("parts", f"nothing of {found.part} is heard: it has no SOX, SOV or SOA")
    inputs = _inputs(piece, ready, found)
    ca_rate = instrument.ca_rate if instrument else None
    if len(inputs) > _POINTS:
        why = f"{found.part} is struck at {len(inputs):,} points, and at most {_POINTS} are written"
        raise OptionError("parts", why)
    ways: list[Way] = []
    for struck, (_, moves, _) in enumerate(inputs):
        for at, (_, label) in enumerate(heard):
            gain = (moves * found.points[label])[swings] / swing(poles, ca_rate)
            ways += _way(struck, at, found, swings, gain)
    if sum(len(way.rows) for way in ways) > _MOST:
        most = f"at most {_MOST:,} resonators are written; name a lower --upto, or fewer outputs"
        raise OptionError("upto", f"; {found.part} has too many modes: {most}")
    return Bank(
        found.part,
        piece.rate,
        ready.n_frames / piece.rate,
        [name for name, _, _ in inputs],
        [strikes for _, _, strikes in inputs],
        [(label, output.order) for output, label in heard],
        [output.reference / _LEVEL for output, _ in heard],
        ways,
    )


def _inputs(
    piece: Piece, ready: Ready, found: PartModes
) -> list[tuple[str, NDArray[np.complex128], list[tuple[float, float]]]]:
    """Points that are struck, then those that links and contacts touch: how each mode moves."""
    network, slots = ready.network, {name: at for at, name in enumerate(found.masses)}
    inputs = []
    for mat in range(network.n_mat):
        slot = slots.get(network.name_of(mat))
        if slot is not None and (strikes := ready.timeline.strikes_on(mat)):
            each = [(one.at, one.impulse) for one in strikes]
            inputs.append((found.masses[slot], found.shapes[:, slot], each))
    known = {name for name, _, _ in inputs}
    known |= {target.text for one in piece.strikes for target in one.to}  # several points
    others = {**found.points, **touched(piece, ready.built, found)}
    for label, moves in others.items():
        is_output = label.split(" ")[0] == "out"
        if not is_output and label not in known:
            inputs.append((label, moves, []))
    if not inputs:
        inputs = [(label, moves, []) for label, moves in found.points.items()]
    return inputs


def _way(
    struck: int,
    heard: int,
    found: PartModes,
    swings: NDArray[np.bool_],
    gain: NDArray[np.complex128],
) -> Sequence[Way]:
    import numpy as np

    from ergon.models.csound import Way

    sizes = np.abs(gain)
    kept = sizes > _LEAST * sizes.max(initial=0.0)
    if not kept.any():
        return []
    poles = found.poles[swings][kept]
    columns = found.frequencies[swings][kept], 0.0 - poles.real, sizes[kept], np.angle(gain[kept])
    rows = list(zip(*(column.tolist() for column in columns), strict=True))
    return [Way(struck, heard, rows)]
