"""Masses and links of Synth-A-Modeler as numbers, and where a score of them begins.

In a sample n the language computes links from positions of sample n - 1, and masses from these
links: x[n] = x[n-1] + v[n], v[n] = v[n-1] + F/(m fs²). Before sample 0 every position is 0. So
in sample 0 links feel their offsets alone, and in sample 1 their dampers feel masses jump from 0
to where they begin. A score has its frame 0 at sample 0: X0 and V0 include the first effect, and
a strike is the second.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ergon.workshop.models.sam.words import RATE

# The library takes T60 as 6.9078 time constants; 60 dB are 3·ln 10 of them.
T60_RATIO = 3.0 * math.log(10.0) / 6.9078


@dataclass(frozen=True, slots=True)
class Resonance:
    """One of `resonators`: f [Hz], T60 [s], m [kg]."""

    f: float
    T60: float
    m: float

    @property
    def mass_ratio(self) -> float:
        """Factor by which the mass of the score's cell is greater.

        A cell x[n+1] = 2r·cos(θ)·x[n] - r²·x[n-1] + F/M takes the force as the library's impulse
        invariance does, with a gain of r·sin(θ)/(2π·f·m·fs).
        """
        theta = 2.0 * math.pi * self.f / RATE
        return theta / (math.exp(-6.9078 / (self.T60 * RATE)) * math.sin(theta))

    @property
    def mobility(self) -> float:
        """1/M [1/kg] of that cell in the units of the discrete network."""
        return 1.0 / (self.m * RATE * RATE * self.mass_ratio)


@dataclass(frozen=True, slots=True)
class Mass:
    """`mobility` is the step [m] per newton in one sample; 0 for a mass that cannot move."""

    kind: str
    x0: float
    v0: float
    mobility: float
    is_body: bool = False  # a MODES of the score


@dataclass(frozen=True, slots=True)
class Link:
    """A link or a touch of two masses by their names."""

    kind: str
    a: str
    b: str
    k: float
    R: float
    offset: float


@dataclass(frozen=True, slots=True)
class InitialState:
    """Where each mass is at sample 0 [m], its last step [m], and strikes there [N in a sample]."""

    positions: Mapping[str, float]
    steps: Mapping[str, float]
    forces: Mapping[str, float]


def initial_state(masses: Mapping[str, Mass], links: Sequence[Link]) -> InitialState:
    """Where a score begins."""
    initial_forces = dict.fromkeys(masses, 0.0)
    for link in links:
        if link.kind == "link" or link.offset < 0.0:
            _push(initial_forces, link, -link.offset * (link.k + link.R * RATE))
    positions, steps = {}, {}
    for name, mass in masses.items():
        step = initial_forces[name] * mass.mobility
        positions[name] = mass.x0 + step
        steps[name] = mass.v0 / RATE + step
    damper_forces = dict.fromkeys(masses, 0.0)
    for link in links:
        length = positions[link.a] - positions[link.b]
        if link.kind == "link" or length - link.offset > 0.0:
            _push(
                damper_forces,
                link,
                link.R * RATE * (length - (steps[link.a] - steps[link.b])),
            )
    forces_on_mobile = {name: f for name, f in damper_forces.items() if f and masses[name].mobility}
    return InitialState(positions, steps, forces_on_mobile)


def _push(forces: dict[str, float], link: Link, force: float) -> None:
    """Add a force of a link; it pulls the ends together if it is above 0."""
    forces[link.a] -= force
    forces[link.b] += force
