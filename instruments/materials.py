"""Density, stiffness and losses of each material, with sources.

`loss` is the loss factor η, the share of its elastic energy that a material loses in a radian;
it varies by a factor of two or more between samples. Woods have `young` along the grain and
`across` it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, choice


@dataclass(frozen=True, slots=True)
class Material:
    """Density [kg/m³], Young's modulus [Pa] (also `across` the grain), Poisson's ratio, loss
    factor.
    """

    density: float
    young: float
    poisson: float
    loss: float
    source: str
    across: float | None = None


# Values from the literature name their source; an engineering value is one without a source.
_METAL_SOURCE = (
    "W. D. Callister and D. G. Rethwisch, Materials Science and Engineering, app. B; in the ranges "
    "of J. Thomas, web.mst.edu, Properties of materials; "
)
_LOSS_SOURCE = (
    "loss: L. Cremer and M. Heckl, Structure-Borne Sound (1988), after help.solidworks.com, "
)
_NO_LOSS_SOURCE = "loss: engineering value"
_WOOD_SOURCE = "Forest Products Laboratory, Wood Handbook (2010), ch. 5; "
_STRING_SOURCE = "N. Lynch-Aird and J. Woodhouse, Materials "
_TUNED_SOURCE = "; E rises with tension, this one and the loss are engineering values"

MATERIALS: Mapping[str, Material] = {
    "steel": Material(7850.0, 207e9, 0.30, 3e-4, _METAL_SOURCE + _LOSS_SOURCE + "iron: 2 to 6e-4"),
    "bronze": Material(
        8800.0,
        110e9,
        0.35,
        5e-4,
        "engineering values: H. Jack, engineeronadisk.com, has 8200 to 8800 kg/m³, 96 to 120 GPa "
        "and 0.34; " + _NO_LOSS_SOURCE,
    ),
    "brass": Material(8530.0, 110e9, 0.35, 5e-4, _METAL_SOURCE + _LOSS_SOURCE + "below 1e-3"),
    "copper": Material(8890.0, 115e9, 0.33, 2e-3, _METAL_SOURCE + _LOSS_SOURCE + "2e-3"),
    "aluminium": Material(2710.0, 69e9, 0.33, 1e-4, _METAL_SOURCE + _LOSS_SOURCE + "1e-4"),
    "glass": Material(2500.0, 69e9, 0.23, 1e-3, _METAL_SOURCE + _NO_LOSS_SOURCE),
    "spruce": Material(
        430.0,
        10.9e9,
        0.37,
        8e-3,
        _WOOD_SOURCE
        + "a static test of Sitka spruce (Acta Acustica, 2025, aacus240113, table 5): 9.1 and "
        "0.82 GPa, 0.44; " + _NO_LOSS_SOURCE,
        0.85e9,
    ),
    "maple": Material(700.0, 13.9e9, 0.42, 1.1e-2, _WOOD_SOURCE + _NO_LOSS_SOURCE, 1.8e9),
    "rosewood": Material(
        830.0,
        13.5e9,
        0.37,
        4.5e-3,
        "engineering values; loss: H. Hill and S. Errede, Acoustics of the Marimba (University of "
        "Illinois): 0.45 % ± 0.09 %",
        2.2e9,
    ),
    "nylon": Material(1070.0, 5e9, 0.39, 3e-2, _STRING_SOURCE + "10 (2017) 497" + _TUNED_SOURCE),
    "gut": Material(
        1280.0,
        6.5e9,
        0.40,
        5e-2,
        _STRING_SOURCE
        + "11 (2018) 2160: E is the same at any tension; it and the loss are engineering "
        "values",
    ),
    "fluorocarbon": Material(
        1780.0, 7e9, 0.40, 3e-2, _STRING_SOURCE + "11 (2018) 2160" + _TUNED_SOURCE
    ),
    "skin": Material(1100.0, 0.5e9, 0.40, 3e-2, "engineering values for calfskin"),
    "mylar": Material(
        1390.0,
        4.9e9,
        0.38,
        1.5e-2,
        "DuPont Teijin Films, Mylar product information H-37232-3: 4.8 GPa along, 5.0 across; "
        + _NO_LOSS_SOURCE,
    ),
}


def _material(material_values: Values) -> Any:
    if any(name not in material_values.by_name for name in material_values.nodes):
        return MISSING  # reported
    base_material = material_values["like"]
    material_parameters = {
        name: value for name, value in material_values.by_name.items() if name != "like"
    }
    if base_material is not None:
        if "young" in material_parameters:  # a material without a grain
            material_parameters.setdefault("across", None)
        return replace(MATERIALS[base_material], **material_parameters)
    missing_names = [
        name for name in ("density", "young", "poisson", "loss") if name not in material_parameters
    ]
    if missing_names:
        message = (
            f"{material_values.context.label('material')} has no {', '.join(missing_names)}; write "
        )
        message += "them, or name a material with `like`"
        material_values.context.error("E103", message, material_values.node.place)
        return MISSING
    return Material(**material_parameters, source="written")


_MATERIAL_NAME = choice(*MATERIALS)
MATERIAL_RECORD = Record(
    "material",
    "a material of one's own, or a named one with other values",
    (
        Field("like", _MATERIAL_NAME, "the material whose values are used where none are written"),
        Field("density", value_kinds.DENSITY, "mass of a cubic metre"),
        Field("young", value_kinds.PRESSURE, "Young's modulus E; of wood along its grain"),
        Field("across", value_kinds.PRESSURE, "Young's modulus across the grain of a wood"),
        Field("poisson", value_kinds.POISSON, "Poisson's ratio"),
        Field("loss", value_kinds.UNIT_RATIO, "loss factor η: 1/η is the quality factor Q"),
    ),
    _material,
)


@dataclass(frozen=True)
class MaterialShape(Either):
    """`steel`, or `{like: bronze, density: 8600kg/m3}`: a `Material`."""

    def read(self, node: Any, name: str, context: Any) -> Any:
        """Read a node."""
        value = Either.read(self, node, name, context)
        return MATERIALS[value] if isinstance(value, str) else value


MATERIAL_SHAPE = MaterialShape(_MATERIAL_NAME, MATERIAL_RECORD)
