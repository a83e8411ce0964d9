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
_MASSES, _MASS, _PITCH, _T60 = 40, 4e-3, 220.0, 2.0  # of the string; [kg], [Hz], [s]
_PULLED_MASS, _LISTENED_MASS = 7, 30
_STRIKE_TIME = 47 / RATE  # [s]; no frame of a pull for most R
_BUDGET_DB = -100.0  # so that no mode is left out
_HIDING_STEP = 4.0  # a power of two: a factor that changes no bit
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


SOFT = Key((0.08, 0.05, 0.05, 0.05), (200.0, 300.0, 300.0, 300.0))  # to 23 Hz
QUICK = Key((0.08, 0.05, 0.05, 0.001), (1800.0, 2700.0, 2700.0, 2700.0))  # to 264 Hz


@dataclass(frozen=True, slots=True)
class SlowKeyScene:
    """A key struck at its first mass; its last mass pulls the string by K [N/m].

    The key is stepped once in `every` frames; None: at every frame. The certificate sees K over
    `hidden`: the rest is a factor of the spring's force, which the certificate does not see.
    """

    key: Key
    K: float
    every: int | None
    hidden: float = 1.0

    @property
    def rate(self) -> float:
        """The one rate for which its numbers hold."""
        return RATE

    def build_at(self, rate: float) -> NetworkAndTimeline:
        """Build the scene again at its own rate; `rate` is not used."""
        network = _core.Network()
        network.part("key", ca_rate=RATE, macrostep=self.every)
        M, K, Z = self.key.M, self.key.K, self.key.Z
        cell_row = [network.cel("m0", M=M[0] * RATE**2, K=K[0], Z=Z[0] * RATE)]
        for i in range(1, len(M)):
            cell_row.append(network.mas(f"m{i}", M=M[i] * RATE**2))
            network.ref(f"r{i}", cell_row[i - 1], cell_row[i], K=K[i], Z=Z[i] * RATE)
        network.part("string", ca_rate=RATE)
        string = network.string("s", masses=_MASSES, M=_MASS * RATE**2, f=_PITCH, t60=_T60)
        network.part("cut", ca_rate=RATE)
        joint = network.ref("c", cell_row[-1], string + _PULLED_MASS, K=self.K / self.hidden)
        network.listen("string", positions=[(string + _LISTENED_MASS, 1, 1.0)])
        timeline = _core.Timeline(network, RATE)
        timeline.strike(cell_row[0], _STRIKE_TIME, impulse=0.05)
        if self.hidden != 1.0:
            timeline.fade(joint, self.hidden, self.hidden, 0.0, 1.0)
        return NetworkAndTimeline(network, timeline)

    def hear(self, frames: Floats) -> Floats:
        """The string alone."""
        return frames


@cache
def reference_truth(key: Key, K: float, n_frames: int) -> Truth:
    """The reference: the same scene with all springs at every frame."""
    played = SlowKeyScene(key, K, None).build_at(RATE)
    truth_frames = np.zeros((n_frames, 1))
    try:
        _core.Simulation(played.network, played.timeline).process(truth_frames)
    except _core.UnstableError:
        return Truth(None, np.inf)
    return Truth(truth_frames, EXACT_DB)


@dataclass(frozen=True, slots=True)
class SlowKeyPoint:
    """A scene whose key is stepped by its exact flow (E4), once in `every` frames."""

    scene: SlowKeyScene

    def refusal(self) -> str:
        """Why a plan refuses to step the key slowly; empty if it does not."""
        try:
            _planned(self.scene)
        except _core.UnstableError as error:
            return str(error)
        return ""

    def run(self, n_frames: int) -> Outcome:
        """Run by that plan; if it is refused, by a plan that sees a softer spring."""
        scene = self.scene
        while scene.hidden <= _HIDDEN_MAX:
            try:
                played, plan = _planned(scene)
            except _core.UnstableError as error:
                failure_reason = str(error)
                scene = replace(scene, hidden=scene.hidden * _HIDING_STEP)
            else:
                return self._ran(played, plan, n_frames)
        return Outcome(None, reason=failure_reason)

    def _ran(self, played: NetworkAndTimeline, plan: _core.Plan, n_frames: int) -> Outcome:
        run_frames = np.zeros((n_frames, 1))
        try:
            _core.Simulation(played.network, played.timeline, plan=plan).process(run_frames)
        except _core.DivergedError as error:
            return Outcome(False, reason=str(error))
        if not np.all(np.isfinite(run_frames)):
            return Outcome(False, reason="an output is not finite")
        true = self.truth(n_frames).frames
        # A planned run has no ledger here; energy goes as the square of the amplitude of the
        # string.
        amplitude_ratio = (
            0.0 if true is None else float(np.abs(run_frames).max() / np.abs(true).max())
        )
        if amplitude_ratio**2 > 10.0 ** (RUNAWAY_DB / 10.0):
            return Outcome(
                False, run_frames, f"it swings {amplitude_ratio:.3g} times as far as it should"
            )
        return Outcome(True, run_frames)

    def truth(self, n_frames: int) -> Truth:
        """The same scene with all springs at every frame."""
        return reference_truth(self.scene.key, self.scene.K, n_frames)


def _planned(scene: SlowKeyScene) -> tuple[NetworkAndTimeline, _core.Plan]:
    """The plan of the scene, with its key slow. Raises UnstableError if the plan does not allow
    that.
    """
    played = scene.build_at(RATE)
    plan = _core.Plan(played.network, played.timeline, error_db=_BUDGET_DB)
    for _, reason in plan.stay():
        raise _core.UnstableError(reason)
    return played, plan


@cache
def load(slow_key: Key, K: float) -> float:
    """λ over the limit of the part that is stepped at every frame: the string and the mass that
    pulls it.

    It does not depend on R: beyond this limit no rate of the key helps.
    """
    n, m = _MASSES, _MASS / _MASSES
    # CA gives the string its pitch exactly.
    k = m * (np.sin(np.pi * _PITCH / RATE) / np.sin(np.pi / (2.0 * (n + 1)))) ** 2 * RATE**2
    sigma = 3.0 * np.log(10.0) / _T60
    omega = 2.0 * np.pi * _PITCH
    stiffness = np.zeros((n + 1, n + 1))
    stiffness[:n, :n] = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    stiffness *= k * (1.0 + 4.0 * sigma / omega**2 * RATE)
    joint_row = np.zeros(n + 1)
    joint_row[[_PULLED_MASS, n]] = 1.0, -1.0
    root_mass = np.sqrt(np.array([m] * n + [slow_key.M[-1]])) * RATE
    scaled = (stiffness + K * np.outer(joint_row, joint_row)) / np.outer(root_mass, root_mass)
    return float(np.linalg.eigvalsh(scaled)[-1]) / 4.0
