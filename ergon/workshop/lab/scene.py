"""Scenes that can run at any rate: a network, its timeline, and its outputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ergon import _core
from ergon.rendering.level import HIGHPASS_HZ
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.preparing import prepare
from ergon.workshop.lab.metrics import Floats


@dataclass(frozen=True, slots=True)
class NetworkAndTimeline:
    """A scene set up at one rate."""

    network: _core.Network
    timeline: _core.Timeline


class Scene(Protocol):
    """A scene to run. Its parameters are physical, so it is the same instrument at any rate."""

    @property
    def rate(self) -> float:
        """Frames a second at which it is heard [Hz]."""

    def build_at(self, rate: float) -> NetworkAndTimeline:
        """The scene at a rate. Raises EngineError or StageError."""

    def to_sound(self, frames: Floats) -> Floats:
        """Outputs (n_frames, n_out) at the scene's own rate as a sound (n_frames, n_channels)."""


@dataclass(frozen=True, slots=True)
class Score:
    """A piece, heard as in a rendered file: mixed, without the constant part that displaces
    loudspeaker cones.
    """

    piece: Piece

    @property
    def rate(self) -> float:
        """The piece's own rate."""
        return self.piece.rate

    def build_at(self, rate: float) -> NetworkAndTimeline:
        """The piece at another rate."""
        prepared = prepare(replace(self.piece, rate=rate))
        return NetworkAndTimeline(prepared.network, prepared.timeline)

    def to_sound(self, frames: Floats) -> Floats:
        """Mix by the piece's own routes."""
        listening = prepare(self.piece).built_network.listening
        mixed = np.zeros((len(frames), listening.n_channels))
        mixer = listening.mixer(self.rate, frames.shape[1], highpass=HIGHPASS_HZ)
        mixer.process(np.ascontiguousarray(frames), mixed)
        return mixed


@dataclass(frozen=True, slots=True)
class UndifferentiatedScene:
    """A scene whose outputs of speed and acceleration are heard as positions."""

    scene: Scene

    @property
    def rate(self) -> float:
        """The scene's own rate."""
        return self.scene.rate

    def build_at(self, rate: float) -> NetworkAndTimeline:
        """The scene at a rate, with positions alone."""
        scene_at_rate = self.scene.build_at(rate)
        return NetworkAndTimeline(scene_at_rate.network.undifferentiated(), scene_at_rate.timeline)

    def to_sound(self, frames: Floats) -> Floats:
        """As the scene hears them."""
        return self.scene.to_sound(frames)


@dataclass(frozen=True, slots=True)
class BareNetwork:
    """A network of the laboratory, started by its X0 and V0; its outputs are heard directly."""

    build: Callable[[_core.Network], None]
    rate: float = 44_100.0

    def build_at(self, rate: float) -> NetworkAndTimeline:
        """Build the network anew."""
        network = _core.Network()
        self.build(network)
        return NetworkAndTimeline(network, _core.Timeline(network, rate))

    def to_sound(self, frames: Floats) -> Floats:
        """Every output is a channel."""
        return frames
