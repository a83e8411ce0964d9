"""The laboratory's own scenes: small networks whose stability borders are known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import cos, exp, inf, log, pi, sin, sqrt

import numpy as np

from ergon import _core
from ergon.workshop.lab.metrics import Floats
from ergon.workshop.lab.scene import BareNetwork

RATE = 44_100.0
_MASS = 1e-3  # [kg]
_START_POSITION = 1e-3  # [m]

# Method → (limit, weight): linear networks are stable while λmax(M⁻¹(K + weight·Z)) < limit, in the
# numbers of the discrete scheme. Methods whose limit is infinite are always stable.
_LIMITS: Mapping[str, tuple[float, float]] = {
    "ca": (4.0, 2.0),
    "ca2p": (12.0, 6.0),
    "bm4": (3.164**2, 2.0),
    "ieq": (inf, 0.0),
    "modal": (inf, 0.0),
}

_DEFAULT_METHOD = "ca"

# A method for meshes needs at least this many masses. A scene of one or two masses is copied: the
# copies start alike, so the very weak springs that join them exert no force.
_MESH_MASSES_MIN = 4
_WEAK_SPRING_RATIO = 1e-9  # share of the scene's stiffness
_MESH_METHODS = ("ca2p", "bm4", "ieq")


def eigenvalue_limit(method: str) -> float:
    """Largest λ of a linear network that a method can step."""
    return _LIMITS[method][0]


def damping_weight(method: str) -> float:
    """The weight of Z relative to K in λ."""
    return _LIMITS[method][1]


def _n_copies(masses: int, method: str) -> int:
    """The number of copies of a linear scene of so few masses that a method needs."""
    return _MESH_MASSES_MIN // masses if method in _MESH_METHODS else 1


# --- one mass on a spring and a damper ----------------------------------------------------------


def cell(kappa: float, zeta: float, method: str = _DEFAULT_METHOD) -> BareNetwork:
    """A mass on a link to a fixed point, with κ = K·T²/M and ζ = Z·T/M at 44.1 kHz, released from 1
    mm.
    """
    stiffness, viscosity = kappa * _MASS * RATE**2, zeta * _MASS * RATE

    def build(network: _core.Network) -> None:
        network.part("cell")
        ground = network.sol("g")
        masses = [
            network.mas(f"m{i}", M=_MASS, X0=_START_POSITION) for i in range(_n_copies(1, method))
        ]
        for i, mass in enumerate(masses):
            network.ref(f"r{i}", mass, ground, K=stiffness, Z=viscosity)
        for i, (mass_before, mass_after) in enumerate(pairwise(masses)):
            network.ref(f"j{i}", mass_before, mass_after, K=_WEAK_SPRING_RATIO * stiffness)
        network.listen("m", positions=[(masses[0], 1, 1.0)])

    return BareNetwork(build, RATE)


def exact_cell_motion(kappa: float, zeta: float, n_frames: int) -> Floats:
    """The same motion from the differential equation: for any damping, by its two exponentials."""
    root = np.sqrt(complex(zeta * zeta / 4.0 - kappa))
    frames = np.arange(n_frames)
    s1, s2 = -zeta / 2.0 + root, -zeta / 2.0 - root
    if abs(s1 - s2) < 1e-6:  # critically damped: their limit
        relative_positions = (1.0 - s1 * frames) * np.exp(s1 * frames)
    else:
        relative_positions = (s1 * np.exp(s2 * frames) - s2 * np.exp(s1 * frames)) / (s1 - s2)
    positions: Floats = _START_POSITION * np.real(relative_positions)[:, None]
    return positions


def cell_load(kappa: float, zeta: float, method: str) -> float:
    """λ over the limit (Jury for the CA scheme: K + 2Z < 4M): 1 is the border."""
    return (kappa + damping_weight(method) * zeta) / eigenvalue_limit(method)


# --- two cells and what joins them --------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Cell:
    """M [kg], f [Hz], t60 [s], X0 [m]."""

    M: float
    f: float
    t60: float
    X0: float = 0.0

    def load(self, rate: float, weight: float) -> float:
        """κ + weight·ζ of the cell whose poles are exact at `rate`."""
        decay_factor = exp(-3.0 * log(10.0) / (self.t60 * rate))
        kappa = (1.0 - decay_factor) ** 2 + 4.0 * decay_factor * sin(pi * self.f / rate) ** 2
        return kappa + weight * (1.0 - decay_factor * decay_factor)


HAMMER, BAR = Cell(8e-3, 40.0, 2.0, X0=3e-3), Cell(20e-3, 220.0, 1.0)
LEFT_CELL, RIGHT_CELL = Cell(2e-3, 220.0, 1.0, X0=_START_POSITION), Cell(2e-3, 330.0, 1.0)


def _stiffness(kappa: float, first_cell: Cell, second_cell: Cell) -> float:
    """K [N/m] of a link whose κ = K·T²·(1/M₁ + 1/M₂) at 44.1 kHz."""
    return kappa * RATE**2 / (1.0 / first_cell.M + 1.0 / second_cell.M)


def contact(kappa: float) -> BareNetwork:
    """A hammer on a weak spring that falls on a bar and bounces repeatedly."""
    return _pair(HAMMER, BAR, lambda network, hammer_mat, bar_mat: network.but(
        "b", hammer_mat, bar_mat, K=_stiffness(kappa, HAMMER, BAR), side="above"))  # fmt: skip


def coupled(kappa: float, method: str = _DEFAULT_METHOD) -> BareNetwork:
    """Two cells a fifth apart, joined by a spring."""
    stiffness = _stiffness(kappa, LEFT_CELL, RIGHT_CELL)

    def join(network: _core.Network, left_mat: int, right_mat: int) -> int:
        return network.ref("k", left_mat, right_mat, K=stiffness)

    return _pair(LEFT_CELL, RIGHT_CELL, join, _n_copies(2, method), _WEAK_SPRING_RATIO * stiffness)


def _pair(
    first_cell: Cell,
    second_cell: Cell,
    join: Callable[[_core.Network, int, int], int],
    n_copies: int = 1,
    copy_stiffness: float = 0.0,
) -> BareNetwork:
    """Two cells and the link that joins them; `copy_stiffness` [N/m] joins the first cells of the
    copies.
    """

    def build(network: _core.Network) -> None:
        network.part("pair")
        mass_pairs = []
        for _ in range(n_copies):
            first_mat, second_mat = (
                network.cel(name, M=cell.M, f=cell.f, t60=cell.t60, X0=cell.X0)
                for name, cell in (("a", first_cell), ("b", second_cell))
            )
            join(network, first_mat, second_mat)
            mass_pairs.append((first_mat, second_mat))
        for (mat_before, _), (mat_after, _) in pairwise(mass_pairs):
            network.ref("j", mat_before, mat_after, K=copy_stiffness)
        network.listen("b", positions=[(mass_pairs[0][1], 1, 1.0)])

    return BareNetwork(build, RATE)


_STOP_GAP = 1e-4  # [m] from where the spring holds the mass to the stop
_N_SPANS = 10  # spans of a run, each with many turns of the mass


def rattle(f: float, ratio: float) -> BareNetwork:
    """An undamped mass on a spring of pitch f [Hz], released from 1 mm, that meets a stop `ratio`
    times as stiff as the spring.
    """
    stiffness = _MASS * (2.0 * pi * f) ** 2

    def build(network: _core.Network) -> None:
        network.part("rattle")
        ground, stop_mat = network.sol("g"), network.sol("s", X0=-_STOP_GAP)
        mass_mat = network.mas("m", M=_MASS, X0=_START_POSITION)
        network.ref("r", ground, mass_mat, K=stiffness)
        network.but("c", stop_mat, mass_mat, K=ratio * stiffness)
        network.listen("m", positions=[(mass_mat, 1, 1.0)])

    return BareNetwork(build, RATE)


def energy_rise(frames: Floats) -> float:
    """The rise of the energy of `rattle` over its initial energy.

    Where the mass turns away from the stop, all energy is in the spring. It is proportional to the
    square of the distance there.
    """
    spans = np.array_split(frames[:, 0], _N_SPANS)
    spring_energies = np.array([span.max() for span in spans]) ** 2
    return float(max(0.0, spring_energies.max() / spring_energies[0] - 1.0))


def contact_load(kappa: float, rate_multiple: float, method: str) -> float:
    """λ over the limit while the contact is closed, at `rate_multiple` the rate."""
    return _pair_load(HAMMER, BAR, kappa, rate_multiple, _DEFAULT_METHOD)


def coupled_load(kappa: float, rate_multiple: float, method: str) -> float:
    """λ over the limit, at `rate_multiple` the rate."""
    return _pair_load(LEFT_CELL, RIGHT_CELL, kappa, rate_multiple, method)


def _pair_load(
    first_cell: Cell, second_cell: Cell, kappa: float, rate_multiple: float, method_name: str
) -> float:
    rate, stiffness = RATE * rate_multiple, _stiffness(kappa, first_cell, second_cell)
    first_load, second_load = (
        cell.load(rate, damping_weight(method_name)) + stiffness / (cell.M * rate**2)
        for cell in (first_cell, second_cell)
    )
    coupling = stiffness / (sqrt(first_cell.M * second_cell.M) * rate**2)
    return (
        0.5 * (first_load + second_load)
        + sqrt(0.25 * (first_load - second_load) ** 2 + coupling * coupling)
    ) / eigenvalue_limit(method_name)


# --- strings ------------------------------------------------------------------------------------

_STRING_MASS, _STRING_FREQUENCY = 8e-3, 110.0  # [kg], [Hz]
_STRING_MASSES, _HARDENING = 40, 1e11  # masses; q [N/m³] of k·d + q·d³


def string(n_masses: int, rate: float) -> BareNetwork:
    """A string without losses, displaced near its end and released; sampled at `rate`."""

    def build(network: _core.Network) -> None:
        network.part("string")
        first_mat = network.string("s", masses=n_masses, M=_STRING_MASS, f=_STRING_FREQUENCY)
        # The position is a share of the length: the same shape for any number of masses.
        for i in range(n_masses):
            position = (i + 1) / (n_masses + 1)
            network.start(
                first_mat + i, _START_POSITION * min(position / 0.2, (1.0 - position) / 0.8), 0.0
            )
        network.listen("s", positions=[(first_mat + (2 * n_masses) // 3, 1, 1.0)])

    return BareNetwork(build, rate)


def string_load(n_masses: float, rate: float, method: str) -> float:
    """λ over the limit for the highest mode of a row of masses."""
    stiffness, mass = _string_stiffness(n_masses), _STRING_MASS / n_masses
    return (
        4.0
        * stiffness
        / mass
        / rate**2
        * cos(pi / (2.0 * (n_masses + 1.0))) ** 2
        / eigenvalue_limit(method)
    )


def _string_stiffness(n_masses: float) -> float:
    """K [N/m] of each spring of a string that sounds at its pitch."""
    omega = 2.0 * pi * _STRING_FREQUENCY
    return _STRING_MASS / n_masses * (omega / (2.0 * sin(pi / (2.0 * (n_masses + 1.0))))) ** 2


def struck(speed: float) -> BareNetwork:
    """A string whose springs harden; one mass is struck and leaves at `speed` [m/s]."""

    def build(network: _core.Network) -> None:
        network.part("string")
        first_mat = network.string(
            "s",
            masses=_STRING_MASSES,
            M=_STRING_MASS,
            f=_STRING_FREQUENCY,
            t60=3.0,
            hardening=_HARDENING,
        )
        network.start(first_mat + 7, 0.0, speed)
        network.listen("s", positions=[(first_mat + 26, 1, 1.0)])

    return BareNetwork(build, RATE)


def struck_load(speed: float, rate_multiple: float, method: str) -> float:
    """λ over the limit if all the energy of the stroke is in one spring: an upper bound.

    The elongation d then satisfies ½k·d² + ¼q·d⁴ = ½m·v², and the slope is k + 3q·d².
    """
    stiffness, mass, hardening = (
        _string_stiffness(_STRING_MASSES),
        _STRING_MASS / _STRING_MASSES,
        _HARDENING,
    )
    elongation_squared = (
        sqrt(stiffness * stiffness + 2.0 * hardening * mass * speed * speed) - stiffness
    ) / hardening
    # Modes do not step laws: there CA does.
    method_of_steps = _DEFAULT_METHOD if method == "modal" else method
    return (1.0 + 3.0 * hardening * elongation_squared / stiffness) * string_load(
        _STRING_MASSES, RATE * rate_multiple, method_of_steps
    )
