"""Running a scene by a method, oversampled.

With oversampling S the scene runs at S times the rate, and every S-th frame is kept. Speeds and
accelerations are derived from the kept frames, so their delay is the same at every S.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ergon import _core
from ergon.workshop.lab.energy import energy_ratio_db
from ergon.workshop.lab.metrics import Floats
from ergon.workshop.lab.names import PRECISIONS
from ergon.workshop.lab.scene import NetworkAndTimeline, Scene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ergon.workshop.lab.names import Method

_BLOCK = 512  # frames heard between two looks at the clock


@dataclass(frozen=True, slots=True)
class Setting:
    """A way of computing. Method None is the planner's own choice, with everything that it decides.

    The planner can be given an error of the waveform, `budget_db`; without one it plans by ear.
    """

    method: str | None = "ca"
    oversampling: int = 1
    precision: str = "f64"
    budget_db: float | None = None

    def __str__(self) -> str:
        """`ca ×4`, `ca ×4 f32`, `planner`, `planner -60 dB`, `planner -120 dB ×2`."""
        if self.method is None:
            budget = "" if self.budget_db is None else f" {self.budget_db:g} dB"
            return f"planner{budget}" + (f" ×{self.oversampling}" if self.oversampling > 1 else "")
        precision = "" if self.precision == "f64" else f" {self.precision}"
        return f"{self.method} ×{self.oversampling}{precision}"


@dataclass(frozen=True, slots=True)
class OversampledScene(NetworkAndTimeline):
    """A scene set up at `oversampling` times its rate.

    If `oversampling` is above 1 its outputs are positions, from which `derivatives` makes speeds at
    the scene's own rate.
    """

    oversampling: int
    derivative_network: _core.Network
    rate: float  # [Hz], the scene's own

    @classmethod
    def from_scene(cls, scene: Scene, factor: int) -> OversampledScene:
        """A scene at `factor` its rate. Raises EngineError or StageError."""
        scene_at_rate = scene.build_at(scene.rate * factor)
        positions_only = scene_at_rate.network.undifferentiated()
        # At its own rate the engine derives speeds itself, and nothing is left to derive.
        stepped_network, derivative_network = (
            (scene_at_rate.network, positions_only)
            if factor == 1
            else (positions_only, scene_at_rate.network)
        )
        return cls(stepped_network, scene_at_rate.timeline, factor, derivative_network, scene.rate)

    def derivatives(self) -> _core.Derivatives:
        """The derivatives still to compute from every `oversampling`-th frame, from frame 0 on."""
        return _core.Derivatives(self.derivative_network, self.rate)


class Run:
    """A running scene; `cpu_time` is the processor time of its thread so far [s]."""

    def __init__(self, simulation: Any, oversampled: OversampledScene, plan_text: str = "") -> None:
        """Start at frame 0."""
        self._simulation, self._oversampled = simulation, oversampled
        self._derivatives = oversampled.derivatives()
        self._start = simulation.snapshot()
        self.plan_text = plan_text
        self.n_out = int(simulation.n_out)
        self.cpu_time = 0.0

    def rewind(self) -> None:
        """Go back to frame 0, and reset the clock."""
        self._simulation.restore(self._start)
        self._derivatives = self._oversampled.derivatives()
        self.cpu_time = 0.0

    def frames(self, n_frames: int) -> Floats:
        """The next outputs (n_frames, n_out). Raises DivergedError."""
        outputs = np.empty((n_frames, self.n_out))
        stride = self._oversampled.oversampling
        block = np.empty((min(_BLOCK, n_frames) * stride, self.n_out))
        for begin in range(0, n_frames, _BLOCK):
            part = block[: min(_BLOCK, n_frames - begin) * stride]
            start_time = time.thread_time()
            self._simulation.process(part)
            self.cpu_time += time.thread_time() - start_time
            outputs[begin : begin + _BLOCK] = part[::stride]
        self._derivatives.process(outputs)
        return outputs

    def created_db(self) -> float:
        """The energy that one link or mesh has made over the energy that was there [dB]."""
        return energy_ratio_db(self._simulation.created_share())

    def energy(self) -> _core.Energy:
        """The ledger of a run that keeps one."""
        ledger: _core.Energy = self._simulation.energy()
        return ledger


def start(scene: Scene, setting: Setting, *, ledger: bool = False, unchecked: bool = False) -> Run:
    """Set a scene up at frame 0.

    Raises EngineError if the engine refuses (UnstableError if the run would diverge).
    `unchecked` lets the CA scheme run nevertheless, and a mesh by another method too. Raises
    StageError if the score itself is at fault.
    """
    if setting.precision not in PRECISIONS:
        raise _core.EngineError(f"there is no precision {setting.precision}")
    oversampled = OversampledScene.from_scene(scene, setting.oversampling)
    if setting.method == "ca":
        simulation = _core.Simulation(
            oversampled.network, oversampled.timeline, ledger=ledger, unchecked=unchecked
        )
        return Run(simulation, oversampled)
    plan = _plan(scene, setting, unchecked=unchecked)
    simulation = _core.Simulation(
        oversampled.network, oversampled.timeline, plan=plan, ledger=ledger
    )
    plan_text = "" if setting.method else describe(plan)
    return Run(simulation, oversampled, plan_text)


_PERMISSIVE_REFINEMENT = 64  # times finer, nothing that a map shows is refused


def _plan(scene: Scene, setting: Setting, *, unchecked: bool) -> _core.Plan:
    """The plan of a scene; if it is refused and `unchecked`, the plan with the choices of a finer
    one.
    """
    method = cast("Method | None", setting.method)

    def plan(finer: int, pins: Sequence[_core.IslandChoice] | None = None) -> _core.Plan:
        oversampled = OversampledScene.from_scene(scene, setting.oversampling * finer)
        return _core.Plan(
            oversampled.network,
            oversampled.timeline,
            method=method,
            error_db=setting.budget_db,
            pins=pins,
        )

    try:
        return plan(1)
    except _core.UnstableError as refused:
        if not unchecked:
            raise
        try:
            # Choices that are given are not certified again.
            return plan(1, plan(_PERMISSIVE_REFINEMENT).choices())
        except _core.EngineError:
            raise refused from None


def describe(plan: _core.Plan) -> str:
    """A plan in a line: `bell: modes, action: stepped`."""
    return ", ".join(f"{' + '.join(row.parts)}: {row.what}" for row in plan.rows())
