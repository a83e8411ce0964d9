"""Initial speeds of a score of a model of miPhysics.

miPhysics keeps two places of each mass, and steps x+ = 2x - x₋ + F/M - g - (x - x₋)·f/M. A score
in space has a place and a speed V0 in seconds, and computes x₋ from them with half of the force
at 0 s; so V0 is chosen to give the model's own x₋.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from ergon.workshop.models.miphysics.reading import Network, Part

_ROUNDS_MAX = 60  # largest number of fixed-point iterations; each adds some digits
Vector = tuple[float, float, float]


def drag(friction: float, mass: float) -> float:
    """The viscosity [kg per sample] with which a score's drag removes friction/mass of a step."""
    return -mass * math.log1p(-friction / mass)


def speeds(network: Network, rate: float) -> dict[str, Vector]:
    """V0 of each Mass3D, in units per sample; a file has them per second."""
    places = {mass.name: place(mass) for mass in network.masses}
    masses = {mass.name: mass.values["mass"] for mass in network.masses if mass.kind == "Mass3D"}
    first_steps = {mass.name: step(mass, rate) for mass in network.masses if mass.kind == "Mass3D"}
    zero_speed = (0.0, 0.0, 0.0)
    speed_by_mass = dict(first_steps)
    for _ in range(_ROUNDS_MAX):
        forces_by_mass = {
            name: [0.0, 0.0, -network.gravity * mass] for name, mass in masses.items()
        }
        for link in network.links:
            _push(forces_by_mass, link, places, speed_by_mass)
        next_speeds = {}
        for mass_name, mass_number in masses.items():
            speed_wanted = [
                s + 0.5 * f / mass_number
                for s, f in zip(first_steps[mass_name], forces_by_mass[mass_name], strict=True)
            ]
            if network.friction:
                a = drag(network.friction, mass_number) / mass_number
                speed_wanted = [component * a / math.expm1(a) for component in speed_wanted]
            next_speeds[mass_name] = (speed_wanted[0], speed_wanted[1], speed_wanted[2])
        change = max(
            (math.dist(next_speeds[name], speed_by_mass.get(name, zero_speed)) for name in masses),
            default=0.0,
        )
        size = max((math.hypot(*speed) for speed in next_speeds.values()), default=0.0)
        speed_by_mass = next_speeds
        if change <= 1e-16 * size:
            break
    return speed_by_mass


def place(mass: Part) -> Vector:
    """Where a mass begins [m]."""
    return mass.values["initPos.x"], mass.values["initPos.y"], mass.values["initPos.z"]


def step(part: Part, rate: float) -> Vector:
    """The displacement of a mass [per sample] before the first sample."""
    values = part.values
    return values["initVel.x"] / rate, values["initVel.y"] / rate, values["initVel.z"] / rate


def _push(
    forces_by_mass: Mapping[str, list[float]],
    model_link: Part,
    mass_places: Mapping[str, Vector],
    mass_steps: Mapping[str, Vector],
) -> None:
    """Add the force of a link at 0 s."""
    link_values = model_link.values
    k, z = link_values.get("stiffness", 0.0), link_values.get("damping", 0.0)
    zero_speed = (0.0, 0.0, 0.0)
    if model_link.kind == "PlaneContact3D":
        axis_index, mass_name = int(link_values["orientation"]), model_link.ends[0]
        clearance = (
            mass_places[mass_name][axis_index] - link_values["position"] - link_values["drest"]
        )
        if clearance < 0.0 and mass_name in forces_by_mass:
            forces_by_mass[mass_name][axis_index] -= (
                k * clearance + z * mass_steps[mass_name][axis_index]
            )
        return
    first_end, second_end = model_link.ends
    difference = [
        q - p for p, q in zip(mass_places[first_end], mass_places[second_end], strict=True)
    ]
    link_length = math.hypot(*difference)
    elongation = link_length - link_values.get("drest", 0.0)
    if model_link.kind in ("Rope3D", "Bubble3D") and elongation <= 0.0:
        return
    if (model_link.kind == "Contact3D" and elongation >= 0.0) or link_length == 0.0:
        return
    direction = [component / link_length for component in difference]
    pairs = zip(
        mass_steps.get(first_end, zero_speed),
        mass_steps.get(second_end, zero_speed),
        direction,
        strict=True,
    )
    link_force = k * elongation + z * sum((q - p) * cosine for p, q, cosine in pairs)
    for mass_name, force_sign in ((first_end, 1.0), (second_end, -1.0)):
        if mass_name in forces_by_mass:
            for axis_index in range(3):
                forces_by_mass[mass_name][axis_index] += (
                    force_sign * link_force * direction[axis_index]
                )
