"""The modes of the parts of a score: their pitch and decay, and how each mass moves in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isinf
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.decay import LN_1000
from ergon.common.option import Integer, documented, option, renamed
from ergon.common.report import Report

from . import score as scores
from .errors import OptionError
from .options import ReadOptions
from .parts import frequency_option, selected_parts
from .pictures import Picture, table_html

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon import _core
    from ergon.instruments.model import Target
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.built_network import BuiltNetwork

N_MODES_DEFAULT = 20  # modes of each part, by default


@renamed(to="upto")
@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class ModesOptions(ReadOptions):
    """Which modes of which parts are computed.

    `parts` are names of instruments and keys; without any, all are meant. Frequencies are numbers
    [Hz] or texts such as "5kHz" and "A3".
    """

    parts: Sequence[str] = ()
    upto: float | str | None = option(
        None, "All modes up to this frequency, such as 5kHz.", metavar="FREQUENCY"
    )
    count: int | None = option(
        None,
        f"So many modes of each part; without --upto and --count {N_MODES_DEFAULT}.",
        Integer(1),
    )
    around: float | str | None = option(
        None, "The modes next to a frequency or note, such as A3.", metavar="FREQUENCY"
    )

    def search_arguments(self) -> dict[str, float | int]:
        """The arguments for the engine's search for modes. Raises OptionError."""
        if self.upto is not None:
            for name, option_value in (("count", self.count), ("around", self.around)):
                if option_value is not None:
                    raise OptionError(name, "; give one of the two", excludes="upto")
            return {"to": frequency_option("upto", self.upto)}
        n_modes = N_MODES_DEFAULT if self.count is None else self.count
        if n_modes < 1:
            raise OptionError("count", f"is {n_modes}; it must be at least 1")
        if self.around is not None:
            return {"count": n_modes, "around": frequency_option("around", self.around)}
        return {"count": n_modes}


_LEVEL_DB_MIN = -200.0  # [dB] lower levels are shown as no motion
_NOTE_FREQUENCY_MIN = 8.0  # [Hz] below it is the rigid motion of a free body
# A motion that seems to decay for longer than 11 days is undamped; the rest is rounding [s].
_T60_MAX = 1e6


@dataclass(frozen=True, slots=True)
class PartModes:
    """Modes of one part by itself, from low to high.

    `frequencies` (n_modes,) are damped ones [Hz], 0 beyond critical damping; `t60` (n_modes,)
    are the times to fall by 60 dB [s], infinite without loss; `poles` (n_modes,) are s of e^(st)
    [1/s]. `shapes` (n_modes, n_masses) say how each mass moves, as complex numbers x with xᵀ(2sM
    + Z)x = 2i·Im s [kg^-1/2]: without damping these are the modes of mass 1. `masses` are the
    names of the masses, `places` (n_masses, 2) their positions on the bench [m].

    `points` holds, for each place where the part is struck, touched or heard, how each mode
    moves there (n_modes,), summed over the masses of the place. After an impulse of 1 N·s at one
    point, a mode moves another point by the product of both over 2π·frequency [m].

    `is_certified` says that no mode is missing, as the inertia of the stiffness matrix shows,
    and that each is a separate mode, as its residual in the equations shows. `n_laws` links with
    a law were taken at their slope at rest, `n_contacts` contacts as open. `inputs` are the
    files that the modes were computed from.
    """

    part: str
    frequencies: NDArray[np.float64]
    t60: NDArray[np.float64]
    poles: NDArray[np.complex128]
    shapes: NDArray[np.complex128]
    masses: tuple[str, ...]
    places: NDArray[np.float64]
    points: Mapping[str, NDArray[np.complex128]]
    is_certified: bool
    n_laws: int
    n_contacts: int
    inputs: tuple[Path, ...]

    @property
    def notes(self) -> tuple[tuple[str, float], ...]:
        """The note next to each mode, and the distance from it [cents]; below 8 Hz "", 0."""
        from ergon.notation.tables.notes import nearest_note

        pitches = (float(frequency) for frequency in self.frequencies)
        return tuple(
            nearest_note(frequency) if frequency >= _NOTE_FREQUENCY_MIN else ("", 0.0)
            for frequency in pitches
        )

    def plot(self) -> Picture:
        """The modes by pitch, and cents from the nearest note."""
        return stave_picture((self,), self.part)

    def _repr_html_(self) -> str:
        header, *rows = mode_rows(self)
        return table_html(header, rows)

    def levels(self, point: str) -> NDArray[np.float64]:
        """The level of each mode at a point, relative to the mode that moves most [dB]
        (n_modes,).
        """
        import numpy as np

        magnitudes = np.abs(self.points[point])
        magnitude_max = magnitudes.max(initial=0.0)
        with np.errstate(divide="ignore"):
            return (
                20 * np.log10(magnitudes / magnitude_max)
                if magnitude_max > 0
                else np.full(magnitudes.shape, -np.inf)
            )


def stave_picture(part_modes: Sequence[PartModes], name: str) -> Picture:
    """The modes of parts on staves, by pitch and cents from the nearest note."""
    from ergon.view.structure import PitchedMode, stave

    modes_by_part = []
    for part in part_modes:
        modes_with_notes = zip(part.frequencies, part.notes, mode_labels(part), strict=True)
        modes = [
            PitchedMode(float(frequency), cents, label)
            for frequency, (note, cents), label in modes_with_notes
            if note
        ]
        modes_by_part.append((part.part, modes))
    return Picture(stave(modes_by_part, title=f"Modes of {name}"))


def mode_labels(part: PartModes) -> list[str]:
    """`1  A4 +2.1  0.5 s` for each mode."""
    mode_facts = zip(part.frequencies, part.t60, part.notes, strict=True)
    return [
        f"{number}  {f'{note} {cents:+.1f}' if note else f'{frequency:.3g} Hz'}  "
        f"{_t60_text(float(t60))}"
        for number, (frequency, t60, (note, cents)) in enumerate(mode_facts, 1)
    ]


def mode_rows(part: PartModes) -> list[tuple[str, ...]]:
    """A table of the modes for reading: its head, and a row for each mode."""
    levels = [part.levels(point) for point in part.points]
    mode_facts = zip(part.frequencies, part.t60, part.notes, strict=True)
    rows = [
        (
            str(mode_index + 1),
            note,
            f"{cents:+.1f}" if note else "",
            f"{frequency:.2f} Hz",
            _t60_text(float(t60)),
            *(
                "–" if level[mode_index] < _LEVEL_DB_MIN else f"{level[mode_index]:.1f} dB"
                for level in levels
            ),
        )
        for mode_index, (frequency, t60, (note, cents)) in enumerate(mode_facts)
    ]
    return [("", "note", "cents", "frequency", "T60", *part.points), *rows]


def _t60_text(t60: float) -> str:
    if isinf(t60):
        return "no loss"
    minutes, seconds = divmod(int(t60), 60)
    return f"{t60:.3g} s" if t60 < 120 else f"{minutes} min {seconds:02} s"


def modes(
    score: str | Path, options: ModesOptions | None = None, *, report: Report | None = None
) -> tuple[PartModes, ...]:
    """The modes of parts of a score, each without its links to others.

    Contacts are open, and laws are taken at their slope at rest. Raises ScoreError and OptionError.
    """
    from ergon.scores.staging.preparing import prepare

    options = options or ModesOptions()
    search_bounds = options.search_arguments()
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    part_names = selected_parts(piece, options.parts)
    with scores.staging(lambda: loaded, report), (report or Report()).waiting("computing modes"):
        built = prepare(piece).built_network
        return tuple(
            compute_modes(piece, built, name, search_bounds, loaded.inputs) for name in part_names
        )


def compute_modes(
    piece: Piece,
    built: BuiltNetwork,
    name: str,
    search_bounds: Mapping[str, float | int],
    inputs: Sequence[Path],
) -> PartModes:
    """Modes of a part of a network, within `search_bounds` of the engine. Raises OptionError."""
    import numpy as np

    network = built.network
    engine_modes = _engine_modes(network, name, search_bounds)
    decay_rates = -engine_modes.poles.real
    is_damped = decay_rates > LN_1000 / _T60_MAX
    t60 = np.where(is_damped, LN_1000 / np.where(is_damped, decay_rates, 1.0), np.inf)
    indices_by_point = find_points(piece, built, name, engine_modes.mats)
    shapes_at_points = {
        label: engine_modes.shapes[:, indices].sum(axis=1)
        for label, indices in indices_by_point.items()
    }
    positions = [network.position_of(mat) for mat in engine_modes.mats]
    return PartModes(
        name,
        engine_modes.poles.imag / (2 * np.pi),
        t60,
        engine_modes.poles,
        engine_modes.shapes,
        tuple(network.name_of(mat) for mat in engine_modes.mats),
        np.array(positions, dtype=float).reshape(len(positions), 2),
        shapes_at_points,
        engine_modes.is_certified,
        engine_modes.n_laws,
        engine_modes.n_contacts,
        tuple(inputs),
    )


def _engine_modes(
    network: _core.Network, part_name: str, search_bounds: Mapping[str, float | int]
) -> _core.PartModes:
    """Modes by the engine. Raises OptionError where there are too many."""
    from ergon import _core

    try:
        return network.part_modes(part_name, **search_bounds)  # type: ignore[arg-type]
    except _core.EngineError as error:
        raise OptionError("upto" if "to" in search_bounds else "count", str(error)) from None


def find_points(
    piece: Piece, built: BuiltNetwork, name: str, mats: Sequence[int]
) -> Mapping[str, Sequence[int]]:
    """The points where a part is struck, touched or heard, each with its slots among the masses
    `mats`.
    """
    index_by_mat = {mat: slot for slot, mat in enumerate(mats)}
    indices_by_point = {}
    for point_text, targets in _named_points(piece, name):
        point_mats = [mat for target in targets for mat in built.assembly.members(target)]
        indices = [index_by_mat[mat] for mat in point_mats if mat in index_by_mat]
        if indices:
            is_single = len(point_mats) == 1
            label = point_text or (
                built.network.name_of(point_mats[0]) if is_single else targets[0].text
            )
            indices_by_point[label] = indices
    return indices_by_point


def _named_points(piece: Piece, part_name: str) -> Iterator[tuple[str, Sequence[Target]]]:
    """The points where a part is heard, named after the output, and those where it is struck or
    touched, with the name "".
    """
    if part_name in piece.instruments:
        for output in piece.instruments[part_name].outputs:
            if output.is_movement:
                yield f"out {output.name}" if output.name else "out", output.targets
    struck_targets = [target for strike in piece.strikes for target in strike.to]
    for owner, module in piece.modules():
        end_targets = module.ends
        if len({end.part for end in end_targets} | {owner}) > 1:
            struck_targets += end_targets
    yield from (("", (target,)) for target in struck_targets if target.part == part_name)
