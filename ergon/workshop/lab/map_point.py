"""A point of a map: the engine's certificate, and what happens when it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ergon import _core
from ergon.workshop.lab import runs
from ergon.workshop.lab.energy import energy_ratio_db, production_db
from ergon.workshop.lab.metrics import Floats
from ergon.workshop.lab.runs import Setting
from ergon.workshop.lab.scene import Scene
from ergon.workshop.lab.truth import Truth

RUNAWAY_DB = 10.0  # ten times the energy that went in, made by the scheme alone


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a run: whether it stayed finite (None: the engine refused it), its outputs, the
    reason, and the energy that its steps made over the energy that was there [dB].
    """

    is_stable: bool | None
    frames: Floats | None = None
    reason: str = ""
    energy_db: float | None = None


class MapPoint(Protocol):
    """A scene with a method of computing it."""

    @property
    def scene(self) -> Scene:
        """The scene."""

    def refusal(self) -> str:
        """Why the engine would refuse to run it; empty if it would not."""

    def run(self, n_frames: int) -> Outcome:
        """Run it, refused or not."""

    def truth(self, n_frames: int) -> Truth:
        """The true motion (outputs)."""


@dataclass(frozen=True, slots=True)
class SteppedPoint:
    """A scene by one method, oversampled."""

    scene: Scene
    setting: Setting
    reference: Callable[[int], Truth]
    created_energy_ratio: Callable[[Floats], float] | None = (
        None  # share of energy made, where outputs tell it
    )

    def refusal(self) -> str:
        """The objection of the certificate; empty if there is none."""
        try:
            if self.setting.method == "ca":
                rate = self.scene.rate * self.setting.oversampling
                self.scene.build_at(rate).network.certify(rate)
            else:
                runs.start(self.scene, self.setting)
        except _core.UnstableError as error:
            return str(error)
        return ""

    def run(self, n_frames: int) -> Outcome:
        """Run it unchecked; CA keeps a ledger, so that a run whose scheme makes energy counts as
        unstable too.
        """
        keeps_ledger = self.setting.method == "ca"
        try:
            run = runs.start(self.scene, self.setting, ledger=keeps_ledger, unchecked=True)
        except _core.UnstableError as error:
            return Outcome(None, reason=str(error))
        try:
            frames = run.frames(n_frames)
        except _core.DivergedError as error:
            return Outcome(False, reason=str(error))
        if not np.all(np.isfinite(frames)):
            return Outcome(False, reason="an output is not finite")
        produced_db = production_db(run.energy()) if keeps_ledger else run.created_db()
        energy_db = (
            produced_db
            if self.created_energy_ratio is None
            else energy_ratio_db(self.created_energy_ratio(frames))
        )
        if produced_db > RUNAWAY_DB:
            energy_ratio = f"{10 ** (produced_db / 10):.3g} times the energy given"
            return Outcome(False, frames, f"the scheme made {energy_ratio}", energy_db)
        return Outcome(True, frames, energy_db=energy_db)

    def truth(self, n_frames: int) -> Truth:
        """The truth from `reference`."""
        return self.reference(n_frames)
