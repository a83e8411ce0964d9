"""Parts of a score as banks of their modes, for programs that know resonators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ergon.api.errors import OptionError
from ergon.instruments.kinds.outputs import MOVEMENT_NAMES

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.api.modes import PartModes
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.built_network import BuiltNetwork
    from ergon.scores.staging.preparing import PreparedPiece
    from ergon.workshop.models.programs.bank import Bank, ModePath

_NONLINEAR_KINDS = ("BUT", "LNL", "BRISTLE", "DRY")
_INPUTS_MAX = 200  # struck or touched points of a bank, at most
_AMPLITUDE_SHARE_MIN = 1e-12  # share of the largest amplitude; less is rounding
_REFERENCE_LEVEL = 0.1  # share of full scale at the reference level


def is_heard(piece: Piece, part: str) -> bool:
    """Whether a part is an instrument with an output of positions, speeds or accelerations."""
    instrument = piece.instruments.get(part)
    return instrument is not None and any(output.is_movement for output in instrument.outputs)


def bank_of(piece: Piece, prepared: PreparedPiece, part_modes: PartModes, n_modes_max: int) -> Bank:
    """A part as resonators, `n_modes_max` at most: one for each mode from each input to each
    output.

    Raises OptionError if there are more, or if no motion of the part is heard.
    """
    from ergon.workshop.models.programs.bank import Bank

    is_oscillating = part_modes.poles.imag > 0.0
    poles = part_modes.poles[is_oscillating]
    instrument = piece.instruments.get(part_modes.part)
    outputs = [output for output in instrument.outputs if output.is_movement] if instrument else []
    labels = [f"out {output.name}" if output.name else "out" for output in outputs]
    audible_outputs = [
        (output, label)
        for output, label in zip(outputs, labels, strict=True)
        if label in part_modes.points
    ]
    if not audible_outputs:
        raise OptionError(
            "parts", f"{part_modes.part} has no output of motion; add a {MOVEMENT_NAMES}"
        )
    inputs = _inputs(piece, prepared, part_modes)
    ca_rate = instrument.ca_rate if instrument else None
    if len(inputs) > _INPUTS_MAX:
        problem = f"{part_modes.part} is struck at {len(inputs):,} points; a bank can have at most "
        problem += f"{_INPUTS_MAX}: name other PARTs"
        raise OptionError("parts", problem)
    paths: list[ModePath] = []
    for input_index, (_, shape, _) in enumerate(inputs):
        for output_index, (_, label) in enumerate(audible_outputs):
            gains = (shape * part_modes.points[label])[is_oscillating] / impulse_divisor(
                poles, ca_rate
            )
            paths += _mode_paths(input_index, output_index, part_modes, is_oscillating, gains)
    if sum(len(path.modes) for path in paths) > n_modes_max:
        problem = (
            f"a file holds at most {n_modes_max:,} resonators; use a lower --upto, or fewer outputs"
        )
        raise OptionError("upto", f"{part_modes.part} has too many modes: {problem}")
    return Bank(
        part_modes.part,
        piece.rate,
        prepared.n_frames / piece.rate,
        [name for name, _, _ in inputs],
        [strikes for _, _, strikes in inputs],
        [(label, output.kind_facts.order) for output, label in audible_outputs],
        [output.kind_facts.reference_amount / _REFERENCE_LEVEL for output, _ in audible_outputs],
        paths,
    )


def _inputs(
    piece: Piece, prepared: PreparedPiece, part_modes: PartModes
) -> list[tuple[str, NDArray[np.complex128], list[tuple[float, float]]]]:
    """The inputs of a bank: points that are struck, then those that links and contacts touch.

    Each is a name, the motion of each mode at the point, and the strikes on it (time, impulse).
    """
    network, index_by_name = (
        prepared.network,
        {name: index for index, name in enumerate(part_modes.masses)},
    )
    inputs = []
    for mat in range(network.n_mat):
        mass_index = index_by_name.get(network.name_of(mat))
        if mass_index is not None and (strikes := prepared.timeline.impulses_on(mat)):
            point_strikes = [(strike.at, strike.impulse) for strike in strikes]
            inputs.append(
                (part_modes.masses[mass_index], part_modes.shapes[:, mass_index], point_strikes)
            )
    struck_names = {name for name, _, _ in inputs}
    struck_names |= {
        target.text for strikes in piece.strikes for target in strikes.to
    }  # several points
    shapes_by_point = {
        **part_modes.points,
        **shapes_at_contacts(piece, prepared.built_network, part_modes),
    }
    for point_label, shape in shapes_by_point.items():
        is_output = point_label.split(" ")[0] == "out"
        if not is_output and point_label not in struck_names:
            inputs.append((point_label, shape, []))
    if not inputs:
        inputs = [
            (label, shape_at_point, []) for label, shape_at_point in part_modes.points.items()
        ]
    return inputs


def _mode_paths(
    input_index: int,
    output_index: int,
    part_modes: PartModes,
    is_oscillating: NDArray[np.bool_],
    gains: NDArray[np.complex128],
) -> Sequence[ModePath]:
    import numpy as np

    from ergon.workshop.models.programs.bank import ModePath

    magnitudes = np.abs(gains)
    is_audible = magnitudes > _AMPLITUDE_SHARE_MIN * magnitudes.max(initial=0.0)
    if not is_audible.any():
        return []
    poles = part_modes.poles[is_oscillating][is_audible]
    columns = (
        part_modes.frequencies[is_oscillating][is_audible],
        0.0 - poles.real,
        magnitudes[is_audible],
        np.angle(gains[is_audible]),
    )
    rows = list(zip(*(column.tolist() for column in columns), strict=True))
    return [ModePath(input_index, output_index, rows)]


def shapes_at_contacts(
    piece: Piece, built_network: BuiltNetwork, part_modes: PartModes
) -> Mapping[str, NDArray[np.complex128]]:
    """The motion of each mode at the ends of the part's own contacts and laws, such as its
    hammers'.
    """
    name_of_mat, index_by_name = (
        built_network.network.name_of,
        {name: index for index, name in enumerate(part_modes.masses)},
    )
    shapes_by_point = {}
    for owner, module in piece.modules():
        if owner != part_modes.part or module.kind not in _NONLINEAR_KINDS:
            continue
        for end in module.ends:
            names = [name_of_mat(mat) for mat in built_network.assembly.members(end)]
            indices = [index_by_name[name] for name in names if name in index_by_name]
            if indices:
                label = names[0] if len(names) == 1 else end.text
                shapes_by_point[label] = part_modes.shapes[:, indices].sum(axis=1)
    return shapes_by_point


def omissions(part_modes: PartModes) -> list[str]:
    """What a bank of modes leaves out, in sentences."""
    import numpy as np

    is_oscillating = part_modes.poles.imag > 0.0
    warnings = []
    if n_omitted := int(np.count_nonzero(~is_oscillating)):
        noun = "mode that does" if n_omitted == 1 else "modes that do"
        warnings.append(f"{n_omitted} {noun} not oscillate left out")
    if part_modes.n_laws:
        warnings.append("laws of its links were linearised at rest")
    if part_modes.n_contacts:
        warnings.append("its contacts counted as open")
    if not part_modes.is_certified:
        warnings.append("modes may be missing, because the search ended before all were known")
    return warnings


def impulse_divisor(poles: NDArray[np.complex128], ca_rate: float | None) -> NDArray[np.float64]:
    """The divisor that turns a product of two shapes into the response to 1 N·s [1/s]."""
    import numpy as np

    if ca_rate is None:
        return np.asarray(poles.imag)
    # The shapes of a discrete network belong to its poles z - 1.
    return np.asarray((np.exp(poles / ca_rate)).imag) / ca_rate
