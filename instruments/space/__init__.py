"""Modules of an instrument in space: points with two or three coordinates, and nets of them.

Links of such an instrument measure the distance between two points, and act along the line
between them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ergon import _core
from ergon.instruments.space import nets
from ergon.instruments.space.points import Chance, add_grains, add_point

NETS: Mapping[str, Callable[..., nets.Net]] = {
    "CHAIN": nets.chain,
    "CLOTH": nets.cloth,
    "DISC": nets.disc,
    "BLOCK": nets.block,
    "BALL": nets.ball,
    "MESH": nets.mesh,
}


@dataclass(frozen=True, slots=True)
class Space:
    """The number of axes of an instrument, and the gravity [m/s²] against the last of them."""

    axes: int
    gravity: float


def count(kind_name: str, module_fields: Mapping[str, Any]) -> int:
    """How many points a module has."""
    if kind_name in nets.COUNTS:
        return nets.COUNTS[kind_name](module_fields)
    if kind_name == "SURFACE":
        return int(module_fields["of"].count)
    return int(module_fields.get("masses") or module_fields.get("count") or 1)


def add(
    network: _core.Network,
    kind_name: str,
    module_name: str,
    module_fields: Any,
    chance: Chance,
    module_label: str,
) -> int:
    """Add the points of a module, and the springs of a generator; returns the index of the first
    MAT.

    `module_fields` are those of the kind (`ChainFields` and so on). `chance` gives the random
    numbers of a member by its index; `module_label` names the module in error messages. Raises
    EngineError.
    """
    if kind_name == "GRAINS":
        return add_grains(network, module_name, module_fields, chance, module_label)
    if kind_name in NETS:
        return nets.add(network, module_name, NETS[kind_name](module_fields), module_fields)
    return add_point(network, module_name, module_fields)
