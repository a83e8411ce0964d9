"""Running a scene by a method, oversampled.

S times oversampled it is the same scene at S times the rate, every S-th frame. Speeds and
accelerations are derived from these frames: so they come as late at every S.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ergon import _core
from ergon.lab.metrics import Floats
from ergon.lab.names import PRECISIONS
from ergon.lab.scene import Scene, Set

if TYPE_CHECKING:
    from ergon.lab.names import Method
    from ergon.scores.staging.planning import Pins

_Derive = Callable[[Floats], None]  # in place, (n_frames, n_out)

_BLOCK = 512  # frames heard between two looks at the clock


@dataclass(frozen=True, slots=True)
class Setting:
    """How to compute. Method None is the planner's own choice, with all that belongs to it.

    The planner may be given an error of the waveform, `budget_db`; without one it plans by ear.
    """

    method: str | None = "ca"
    oversampling: int = 1
    precision: str = "f64"
    budget_db: float | None = None

    def __str__(self) -> str:
        """`ca ×4`, `ca ×4 f32`, `planner`, `planner -60 dB`."""
        if self.method is None:
            return "planner" if self.budget_db is None else f"planner {self.budget_db:g} dB"
        precision = "" if self.precision == "f64" else f" {self.precision}"
        return f"{self.method} ×{self.oversampling}{precision}"


class Run:
    """A scene on its way; `spent` is the processor time that it took so far [s], of its thread."""

    def __init__(
        self, simulation: Any, stride: int, derive: Callable[[], _Derive], chosen: str = ""
    ) -> None:
        """`stride` frames of the simulation make one that is heard; `derive` begins at frame 0."""
        self._simulation, self._stride = simulation, stride
        self._derive_anew, self._derive = derive, derive()
        self._start = simulation.snapshot()
        self.chosen = chosen
        self.n_out = int(simulation.n_out)
        self.spent = 0.0

    def rewind(self) -> None:
        """Back to frame 0, the clock too."""
        self._simulation.restore(self._start)
        self._derive = self._derive_anew()
        self.spent = 0.0

    def frames(self, n_frames: int) -> Floats:
        """The next outputs (n_frames, n_out). Raises DivergedError."""
        heard = np.empty((n_frames, self.n_out))
        block = np.empty((min(_BLOCK, n_frames) * self._stride, self.n_out))
        for at in range(0, n_frames, _BLOCK):
            part = block[: min(_BLOCK, n_frames - at) * self._stride]
            begin = time.thread_time()
            self._simulation.process(part)
            self.spent += time.thread_time() - begin
            heard[at : at + _BLOCK] = part[:: self._stride]
        self._derive(heard)
        return heard

    def energy(self) -> _core.Energy:
        """The ledger of a run that keeps one."""
        ledger: _core.Energy = self._simulation.energy()
        return ledger


def start(scene: Scene, setting: Setting, *, ledger: bool = False, unchecked: bool = False) -> Run:
    """Set a scene up at frame 0.

    Raises EngineError where the engine refuses (UnstableError where it would diverge); `unchecked`
    lets the CA scheme run all the same, and a mesh by another method. Raises StageError where the
    score itself is at fault.
    """
    if setting.precision not in PRECISIONS:
        raise _core.EngineError(f"there is no precision {setting.precision}")
    whole, derive = _whole(scene, setting.oversampling)
    if setting.method == "ca":
        simulation = _core.Simulation(
            whole.network, whole.timeline, ledger=ledger, unchecked=unchecked
        )
        return Run(simulation, setting.oversampling, derive)
    plan = _planned(scene, setting, unchecked=unchecked)
    simulation = _core.Simulation(whole.network, whole.timeline, plan=plan, ledger=ledger)
    chosen = "" if setting.method else describe(plan)
    return Run(simulation, setting.oversampling, derive, chosen)


def _whole(scene: Scene, times: int) -> tuple[Set, Callable[[], _Derive]]:
    """The scene at so many times its rate, and what derives speeds from frames at its own."""
    whole = scene.at(scene.rate * times)
    if times == 1:  # the engine derives them itself
        return whole, lambda: lambda frames: None
    network = whole.network
    positions = replace(whole, network=network.undifferentiated())
    return positions, lambda: _core.Derivatives(network, scene.rate).process


_SURELY = 64  # times finer, nothing that a map shows is refused


def _planned(scene: Scene, setting: Setting, *, unchecked: bool) -> _core.Plan:
    """The plan of a scene; `unchecked`: where it is refused, as it would be decided finer."""
    method = cast("Method | None", setting.method)

    def plan(finer: int, pins: Pins | None = None) -> _core.Plan:
        whole, _ = _whole(scene, setting.oversampling * finer)
        return _core.Plan(
            whole.network, whole.timeline, method=method, error_db=setting.budget_db, pins=pins
        )

    try:
        return plan(1)
    except _core.UnstableError as refused:
        if not unchecked:
            raise
        try:
            # What was decided once is not certified again.
            return plan(1, plan(_SURELY).choices())
        except _core.EngineError:
            raise refused from None


def describe(plan: _core.Plan) -> str:
    """A plan in a line: `bell: modes, action: stepped`."""
    return ", ".join(f"{' + '.join(row.parts)}: {row.what}" for row in plan.rows())
