"""Parts of a score, points in them and frequencies, as options name them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .errors import OptionError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon import _core
    from ergon.instruments.model import Target
    from ergon.scores.reading.piece import Piece


def frequency_option(option: str, frequency_value: float | str) -> float:
    """A frequency [Hz] as a number or a text such as "5kHz" and "A3". Raises OptionError."""
    from ergon.notation.tables.quantities import frequency
    from ergon.notation.text.errors import TextError

    try:
        return frequency(
            frequency_value if isinstance(frequency_value, str) else f"{float(frequency_value)!r}Hz"
        )
    except TextError as error:
        hint = f"; did you mean '{error.suggestion}'?" if error.suggestion else ""
        raise OptionError(option, f"{error.message}{hint}") from None


def selected_parts(piece: Piece, names: Sequence[str]) -> tuple[str, ...]:
    """The parts that are asked for; without names, all that move along one axis.

    Raises OptionError.
    """
    from ergon.notation.text.spelling import nearest

    part_names = (*piece.keys, *piece.instruments)
    for asked_name in names:
        if asked_name not in part_names:
            nearest_part = nearest(asked_name, part_names)
            part_list = f"there are {', '.join(part_names)}" if part_names else "the score has none"
            reason = f"did you mean '{nearest_part}'?" if nearest_part else part_list
            raise OptionError("parts", f"no instrument or key is called '{asked_name}'; {reason}")
        refuse_several_axes("parts", piece, asked_name)
    flat_parts = [
        part_name
        for part_name in part_names
        if part_name not in piece.instruments or not _is_in_space(piece, part_name)
    ]
    if part_names and not flat_parts and not names:
        refuse_several_axes("parts", piece, part_names[0])
    return tuple(dict.fromkeys(names)) or tuple(flat_parts)


def refuse_several_axes(option: str, piece: Piece, name: str) -> None:
    """Refuse a part in space: its stiffness depends on where it is. Raises OptionError."""
    if name in piece.instruments and _is_in_space(piece, name):
        reason = f"{name} is an instrument in space, which has no modes of its own: its stiffness "
        raise OptionError(option, f"{reason}depends on where its points are")


def _is_in_space(piece: Piece, name: str) -> bool:
    return piece.instruments[name].space is not None


def target_named(piece: Piece, option: str, text: str) -> Target:
    """The masses that a name reaches, such as `bell.m` and `string.s.12`. Raises OptionError."""
    from ergon.notation.text.errors import TextError
    from ergon.scores.reading.named_points import named_point

    try:
        return named_point(piece, text)
    except TextError as error:
        hint = f"; did you mean '{error.suggestion}'?" if error.suggestion else ""
        raise OptionError(option, f"{error.message}{hint}") from None


def link_elongations(
    shapes: NDArray[np.complex128], elements: _core.Elements
) -> NDArray[np.complex128]:
    """The elongation of each link in each mode (n_modes, n_links)."""
    import numpy as np

    shapes_with_fixed = np.column_stack([shapes, np.zeros(len(shapes))])  # index -1: a held end
    return np.asarray(shapes_with_fixed[:, elements.a] - shapes_with_fixed[:, elements.b])


def stretches_no_spring(
    shapes: NDArray[np.complex128], elements: _core.Elements
) -> NDArray[np.bool_]:
    """Which modes stretch no spring, such as the rigid motion of a free body (n_modes,)."""
    import numpy as np

    shapes_with_fixed = np.column_stack([shapes, np.zeros(len(shapes))])
    element_weights = np.array([kind != "BUT" for kind in elements.kinds], dtype=float)
    element_weights *= elements.stiffness
    stretch_energy = np.abs(link_elongations(shapes, elements)) ** 2 @ element_weights
    motion_energy = (
        np.abs(shapes_with_fixed[:, elements.a]) ** 2
        + np.abs(shapes_with_fixed[:, elements.b]) ** 2
    ) @ element_weights
    return np.asarray(stretch_energy <= 1e-12 * motion_energy)
