"""A key whose springs pull once in R frames, and the string that it pulls at every frame.

Everything is under `units: ca`. The same scene with all springs at every frame is the exact
reference, so the difference is only the effect of the slow key.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ergon import _core
from ergon.workshop.lab.map_point import RUNAWAY_DB, Outcome
from ergon.workshop.lab.metrics import Floats
from ergon.workshop.lab.scene import NetworkAndTimeline
from ergon.workshop.lab.truth import EXACT_DB, Truth

RATE = 44_100.0
_N_MASSES, _STRING_MASS, _STRING_FREQUENCY, _STRING_T60 = (
    40,
    4e-3,
    220.0,
    2.0,
)  # of the string; [kg], [Hz], [s]
_PULLED_INDEX, _LISTENED_INDEX = 7, 30
_STRIKE_TIME = 47 / RATE  # [s]; no frame of a pull for most R
_BUDGET_DB = -100.0  # so that no mode is left out
_HIDING_FACTOR = 4.0  # a power of two: a factor that changes no bit
_HIDDEN_MAX = 4.0**10  # the stiffest spring is then looser than any that is refused


@dataclass(frozen=True, slots=True)
class Key:
    """Masses in a row [kg], the spring [N/m] and damper [N·s/m] before each, from the ground."""

    M: tuple[float, ...]
    K: tuple[float, ...]
    Z: tuple[float, ...] = (
        0.4,
        0.05,
        0.3,
        0.02,
    )  # not proportional to M or K: damping couples the modes


SOFT_KEY = Key((0.08, 0.05, 0.05, 0.05), (200.0, 300.0, 300.0, 300.0))  # to 23 Hz
QUICK_KEY = Key((0.08, 0.05, 0.05, 0.001), (1800.0, 2700.0, 2700.0, 2700.0))  # to 264 Hz


@dataclass(frozen=True, slots=True)
class SlowKeyScene:
    """A key struck at its first mass; its last mass pulls the string by K [N/m].

    The key is stepped once in `frames_per_pull` frames; None: at every frame. The certificate sees
    K over `hidden_factor`: the rest is a factor of the spring's force, which the certificate does
    not see.
    """

    key: Key
    K: float
    frames_per_pull: int | None
    hidden_factor: float = 1.0

    @property
    def rate(self) -> float:
        """The one rate for which its numbers hold."""
        return RATE

    def build_at(self, rate: float) -> NetworkAndTimeline:
        """Build the scene again at its own rate; `rate` is not used."""
        network = _core.Network()
        network.part("key", ca_rate=RATE, macrostep=self.frames_per_pull)
        M, K, Z = self.key.M, self.key.K, self.key.Z
        key_mats = [network.cel("m0", M=M[0] * RATE**2, K=K[0], Z=Z[0] * RATE)]
        for i in range(1, len(M)):
            key_mats.append(network.mas(f"m{i}", M=M[i] * RATE**2))
            network.ref(f"r{i}", key_mats[i - 1], key_mats[i], K=K[i], Z=Z[i] * RATE)
        network.part("string", ca_rate=RATE)
        string = network.string(
            "s", masses=_N_MASSES, M=_STRING_MASS * RATE**2, f=_STRING_FREQUENCY, t60=_STRING_T60
        )
        network.part("cut", ca_rate=RATE)
        joint = network.ref(
            "c", key_mats[-1], string + _PULLED_INDEX, K=self.K / self.hidden_factor
        )
        network.listen("string", positions=[(string + _LISTENED_INDEX, 1, 1.0)])
        timeline = _core.Timeline(network, RATE)
        timeline.strike(key_mats[0], _STRIKE_TIME, impulse=0.05)
        if self.hidden_factor != 1.0:
            timeline.fade(joint, self.hidden_factor, self.hidden_factor, 0.0, 1.0)
        return NetworkAndTimeline(network, timeline)

    def to_sound(self, frames: Floats) -> Floats:
        """The string alone."""
        return frames


@cache
def reference_truth(key: Key, K: float, n_frames: int) -> Truth:
    """The reference: the same scene with all springs at every frame."""
    built = SlowKeyScene(key, K, None).build_at(RATE)
    frames = np.zeros((n_frames, 1))
    try:
        _core.Simulation(built.network, built.timeline).process(frames)
    except _core.UnstableError:
        return Truth(None, np.inf)
    return Truth(frames, EXACT_DB)


@dataclass(frozen=True, slots=True)
class SlowKeyPoint:
    """A scene whose key is stepped by its exact flow (E4), once in `frames_per_pull` frames."""

    scene: SlowKeyScene

    def refusal(self) -> str:
        """Why a plan refuses to step the key slowly; empty if it does not."""
        try:
            _plan(self.scene)
        except _core.UnstableError as error:
            return str(error)
        return ""

    def run(self, n_frames: int) -> Outcome:
        """Run by that plan; if it is refused, by a plan that sees a softer spring."""
        scene = self.scene
        while scene.hidden_factor <= _HIDDEN_MAX:
            try:
                built, plan = _plan(scene)
            except _core.UnstableError as error:
                reason = str(error)
                scene = replace(scene, hidden_factor=scene.hidden_factor * _HIDING_FACTOR)
            else:
                return self._run_planned(built, plan, n_frames)
        return Outcome(None, reason=reason)

    def _run_planned(self, built: NetworkAndTimeline, plan: _core.Plan, n_frames: int) -> Outcome:
        frames = np.zeros((n_frames, 1))
        try:
            _core.Simulation(built.network, built.timeline, plan=plan).process(frames)
        except _core.DivergedError as error:
            return Outcome(False, reason=str(error))
        if not np.all(np.isfinite(frames)):
            return Outcome(False, reason="an output is not finite")
        true_frames = self.truth(n_frames).frames
        # A planned run has no ledger here; energy goes as the square of the amplitude of the
        # string.
        amplitude_ratio = (
            0.0 if true_frames is None else float(np.abs(frames).max() / np.abs(true_frames).max())
        )
        if amplitude_ratio**2 > 10.0 ** (RUNAWAY_DB / 10.0):
            return Outcome(
                False, frames, f"it swings {amplitude_ratio:.3g} times as far as it should"
            )
        return Outcome(True, frames)

    def truth(self, n_frames: int) -> Truth:
        """The same scene with all springs at every frame."""
        return reference_truth(self.scene.key, self.scene.K, n_frames)


def _plan(scene: SlowKeyScene) -> tuple[NetworkAndTimeline, _core.Plan]:
    """The plan of the scene, with its key slow. Raises UnstableError if the plan does not allow
    that.
    """
    built = scene.build_at(RATE)
    plan = _core.Plan(built.network, built.timeline, error_db=_BUDGET_DB)
    for _, reason in plan.stay():
        raise _core.UnstableError(reason)
    return built, plan


@cache
def eigenvalue_load(slow_key: Key, K: float) -> float:
    """λ over the limit of the part that is stepped at every frame: the string and the mass that
    pulls it.

    It does not depend on R: beyond this limit no rate of the key helps.
    """
    n, m = _N_MASSES, _STRING_MASS / _N_MASSES
    # CA gives the string its pitch exactly.
    k = (
        m
        * (np.sin(np.pi * _STRING_FREQUENCY / RATE) / np.sin(np.pi / (2.0 * (n + 1)))) ** 2
        * RATE**2
    )
    sigma = 3.0 * np.log(10.0) / _STRING_T60
    omega = 2.0 * np.pi * _STRING_FREQUENCY
    stiffness = np.zeros((n + 1, n + 1))
    stiffness[:n, :n] = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    stiffness *= k * (1.0 + 4.0 * sigma / omega**2 * RATE)
    incidence = np.zeros(n + 1)
    incidence[[_PULLED_INDEX, n]] = 1.0, -1.0
    root_masses = np.sqrt(np.array([m] * n + [slow_key.M[-1]])) * RATE
    scaled = (stiffness + K * np.outer(incidence, incidence)) / np.outer(root_masses, root_masses)
    return float(np.linalg.eigvalsh(scaled)[-1]) / 4.0
