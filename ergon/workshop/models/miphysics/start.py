"""Initial speeds of a score of a model of miPhysics.

miPhysics keeps two places of each mass, and steps x+ = 2x - x₋ + F/M - g - (x - x₋)·f/M. A score
in space has a place and a speed V0 in seconds, and computes x₋ from them with half of the force
at 0 s; so V0 is chosen to give the model's own x₋.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from ergon.workshop.models.miphysics.reading import Network, Part

_ITERATIONS_MAX = 60  # largest number of fixed-point iterations; each adds some digits
Vector = tuple[float, float, float]


def drag_viscosity(friction: float, mass: float) -> float:
    """The viscosity [kg per sample] with which a score's drag removes friction/mass of a step."""
    return -mass * math.log1p(-friction / mass)


def initial_speeds(network: Network, rate: float) -> dict[str, Vector]:
    """V0 of each Mass3D, in units per sample; a file has them per second."""
    positions = {mass.name: initial_position(mass) for mass in network.masses}
    masses = {mass.name: mass.values["mass"] for mass in network.masses if mass.kind == "Mass3D"}
    initial_steps = {
        mass.name: initial_step(mass, rate) for mass in network.masses if mass.kind == "Mass3D"
    }
    zero = (0.0, 0.0, 0.0)
    speed_by_mass = dict(initial_steps)
    for _ in range(_ITERATIONS_MAX):
        forces_by_mass = {
            name: [0.0, 0.0, -network.gravity * mass] for name, mass in masses.items()
        }
        for link in network.links:
            _add_link_force(forces_by_mass, link, positions, speed_by_mass)
        new_speeds = {}
        for mass_name, m in masses.items():
            components = [
                step_component + 0.5 * force_component / m
                for step_component, force_component in zip(
                    initial_steps[mass_name], forces_by_mass[mass_name], strict=True
                )
            ]
            if network.friction:
                drag_rate = drag_viscosity(network.friction, m) / m
                components = [
                    component * drag_rate / math.expm1(drag_rate) for component in components
                ]
            new_speeds[mass_name] = (components[0], components[1], components[2])
        change = max(
            (math.dist(new_speeds[name], speed_by_mass.get(name, zero)) for name in masses),
            default=0.0,
        )
        speed_max = max((math.hypot(*speed) for speed in new_speeds.values()), default=0.0)
        speed_by_mass = new_speeds
        if change <= 1e-16 * speed_max:
            break
    return speed_by_mass


def initial_position(mass: Part) -> Vector:
    """Where a mass begins [m]."""
    return mass.values["initPos.x"], mass.values["initPos.y"], mass.values["initPos.z"]


def initial_step(part: Part, rate: float) -> Vector:
    """The displacement of a mass [per sample] before the first sample."""
    values = part.values
    return values["initVel.x"] / rate, values["initVel.y"] / rate, values["initVel.z"] / rate


def _add_link_force(
    forces_by_mass: Mapping[str, list[float]],
    link: Part,
    positions: Mapping[str, Vector],
    steps: Mapping[str, Vector],
) -> None:
    """Add the force of a link at 0 s."""
    values = link.values
    k, z = values.get("stiffness", 0.0), values.get("damping", 0.0)
    zero = (0.0, 0.0, 0.0)
    if link.kind == "PlaneContact3D":
        axis, mass_name = int(values["orientation"]), link.ends[0]
        clearance = positions[mass_name][axis] - values["position"] - values["drest"]
        if clearance < 0.0 and mass_name in forces_by_mass:
            forces_by_mass[mass_name][axis] -= k * clearance + z * steps[mass_name][axis]
        return
    a, b = link.ends
    separation = [
        second_component - first_component
        for first_component, second_component in zip(positions[a], positions[b], strict=True)
    ]
    length = math.hypot(*separation)
    elongation = length - values.get("drest", 0.0)
    if link.kind in ("Rope3D", "Bubble3D") and elongation <= 0.0:
        return
    if (link.kind == "Contact3D" and elongation >= 0.0) or length == 0.0:
        return
    direction = [component / length for component in separation]
    pairs = zip(
        steps.get(a, zero),
        steps.get(b, zero),
        direction,
        strict=True,
    )
    force = k * elongation + z * sum(
        (second_component - first_component) * cosine
        for first_component, second_component, cosine in pairs
    )
    for mass_name, sign in ((a, 1.0), (b, -1.0)):
        if mass_name in forces_by_mass:
            for axis in range(3):
                forces_by_mass[mass_name][axis] += sign * force * direction[axis]
