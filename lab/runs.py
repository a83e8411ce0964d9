"""Running a scene by a method, oversampled, in a precision: the one place that knows how.

The engine's planner (`_core.Plan`) chooses and applies methods. Without one there is the CA scheme
in double precision: S times oversampled it is the same scene at S times the rate, every S-th frame.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from ergon import _core
from ergon.lab.metrics import Floats
from ergon.lab.names import METHODS, PRECISIONS
from ergon.lab.scene import Scene

_BLOCK = 512  # frames heard between two looks at the clock


@dataclass(frozen=True, slots=True)
class Setting:
    """How to compute. Method None is the planner's own choice, with all that belongs to it."""

    method: str | None = "ca"
    oversampling: int = 1
    precision: str = "f64"

    def __str__(self) -> str:
        """`ca ×4`, `ca ×4 f32`, `planner`."""
        if self.method is None:
            return "planner"
        precision = "" if self.precision == "f64" else f" {self.precision}"
        return f"{self.method} ×{self.oversampling}{precision}"


def _planner() -> Any:
    return getattr(_core, "Plan", None)


def has_planner() -> bool:
    """Whether the engine plans."""
    return _planner() is not None


def methods() -> tuple[str, ...]:
    """Methods that this engine may be asked for; a scene may still refuse one."""
    return METHODS if has_planner() else METHODS[:1]


def precisions() -> tuple[str, ...]:
    """Precisions that this engine may be asked for."""
    return PRECISIONS if has_planner() else PRECISIONS[:1]


class Run:
    """A scene on its way; `spent` is the processor time that it took so far [s]."""

    def __init__(self, simulation: Any, stride: int, chosen: str = "") -> None:
        """`stride` frames of the simulation make one that is heard."""
        self._simulation, self._stride = simulation, stride
        self._start = simulation.snapshot()
        self.chosen = chosen
        self.n_out = int(simulation.n_out)
        self.spent = 0.0

    def rewind(self) -> None:
        """Back to frame 0, the clock too."""
        self._simulation.restore(self._start)
        self.spent = 0.0

    def frames(self, n_frames: int) -> Floats:
        """The next outputs (n_frames, n_out). Raises DivergedError."""
        heard = np.empty((n_frames, self.n_out))
        block = np.empty((min(_BLOCK, n_frames) * self._stride, self.n_out))
        for at in range(0, n_frames, _BLOCK):
            part = block[: min(_BLOCK, n_frames - at) * self._stride]
            begin = time.process_time()
            self._simulation.process(part)
            self.spent += time.process_time() - begin
            heard[at : at + _BLOCK] = part[:: self._stride]
        return heard

    def energy(self) -> _core.Energy:
        """The ledger of a run that keeps one."""
        ledger: _core.Energy = self._simulation.energy()
        return ledger


def start(scene: Scene, setting: Setting, *, ledger: bool = False, unchecked: bool = False) -> Run:
    """Set a scene up at frame 0.

    Raises EngineError where the engine refuses (UnstableError where it would diverge); `unchecked`
    lets the CA scheme run all the same. Raises StageError where the score itself is at fault.
    """
    plan_of = _planner()
    is_plain = setting.method == "ca" and setting.precision == "f64"
    if plan_of is None or (unchecked and is_plain):
        if not is_plain:
            raise _core.EngineError(f"this engine has no {setting}")
        whole = scene.at(scene.rate * setting.oversampling)
        simulation = _core.Simulation(
            whole.network, whole.timeline, ledger=ledger, unchecked=unchecked
        )
        return Run(simulation, setting.oversampling)
    whole = scene.at(scene.rate)
    plan = plan_of(whole.network, whole.timeline, **_wishes(setting))
    make: Any = _core.Simulation
    simulation = make(whole.network, whole.timeline, plan=plan, threads=1, ledger=ledger)
    return Run(simulation, 1, "" if setting.method else describe(plan.rows))


def _wishes(setting: Setting) -> dict[str, object]:
    """What the planner is told; of its own choice nothing."""
    if setting.method is None:
        return {}
    return {
        "method": setting.method,
        "oversampling": setting.oversampling,
        "precision": setting.precision,
    }


def describe(rows: list[dict[str, Any]]) -> str:
    """A plan in a line: `bell modal ×1, action ca ×4`."""
    return ", ".join(f"{row['part']} {row['method']} ×{row['oversampling']}" for row in rows)
