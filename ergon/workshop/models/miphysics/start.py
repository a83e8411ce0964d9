"""Initial speeds of a score of a model of miPhysics.

miPhysics keeps two places of each mass, and steps x+ = 2x - x₋ + F/M - g - (x - x₋)·f/M. A score
in space has a place and a speed V0 in seconds, and computes x₋ from them with half of the force
at 0 s; so V0 is chosen to give the model's own x₋.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from ergon.workshop.models.miphysics.reading import Network, Part

_ROUNDS = 60  # at most, of a fixed point; each adds some digits
Vector = tuple[float, float, float]


def drag(friction: float, mass: float) -> float:
    """Viscosity [kg per sample] by which a score's drag takes friction/mass of a step."""
    return -mass * math.log1p(-friction / mass)


def speeds(network: Network, rate: float) -> dict[str, Vector]:
    """V0 of each Mass3D, in units per sample; a file has them per second."""
    places = {one.name: place(one) for one in network.masses}
    masses = {one.name: one.values["mass"] for one in network.masses if one.kind == "Mass3D"}
    steps = {one.name: step(one, rate) for one in network.masses if one.kind == "Mass3D"}
    still = (0.0, 0.0, 0.0)
    speed_by_mass = dict(steps)
    for _ in range(_ROUNDS):
        forces = {name: [0.0, 0.0, -network.gravity * mass] for name, mass in masses.items()}
        for link in network.links:
            _push(forces, link, places, speed_by_mass)
        better = {}
        for name, mass in masses.items():
            wanted = [s + 0.5 * f / mass for s, f in zip(steps[name], forces[name], strict=True)]
            if network.friction:
                a = drag(network.friction, mass) / mass
                wanted = [one * a / math.expm1(a) for one in wanted]
            better[name] = (wanted[0], wanted[1], wanted[2])
        change = max(
            (math.dist(better[name], speed_by_mass.get(name, still)) for name in masses),
            default=0.0,
        )
        size = max((math.hypot(*one) for one in better.values()), default=0.0)
        speed_by_mass = better
        if change <= 1e-16 * size:
            break
    return speed_by_mass


def place(one: Part) -> Vector:
    """Where a mass begins [m]."""
    return one.values["initPos.x"], one.values["initPos.y"], one.values["initPos.z"]


def step(part: Part, rate: float) -> Vector:
    """The step [per sample] that a mass made before the first sample."""
    values = part.values
    return values["initVel.x"] / rate, values["initVel.y"] / rate, values["initVel.z"] / rate


def _push(
    forces: Mapping[str, list[float]],
    link: Part,
    places: Mapping[str, Vector],
    steps: Mapping[str, Vector],
) -> None:
    """Add the force of a link at 0 s."""
    values = link.values
    k, z = values.get("stiffness", 0.0), values.get("damping", 0.0)
    still = (0.0, 0.0, 0.0)
    if link.kind == "PlaneContact3D":
        axis, name = int(values["orientation"]), link.ends[0]
        above = places[name][axis] - values["position"] - values["drest"]
        if above < 0.0 and name in forces:
            forces[name][axis] -= k * above + z * steps[name][axis]
        return
    a, b = link.ends
    apart = [q - p for p, q in zip(places[a], places[b], strict=True)]
    length = math.hypot(*apart)
    beyond = length - values.get("drest", 0.0)
    if link.kind in ("Rope3D", "Bubble3D") and beyond <= 0.0:
        return
    if (link.kind == "Contact3D" and beyond >= 0.0) or length == 0.0:
        return
    along = [one / length for one in apart]
    pairs = zip(steps.get(a, still), steps.get(b, still), along, strict=True)
    force = k * beyond + z * sum((q - p) * to for p, q, to in pairs)
    for name, sign in ((a, 1.0), (b, -1.0)):
        if name in forces:
            for axis in range(3):
                forces[name][axis] += sign * force * along[axis]
