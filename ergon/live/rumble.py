"""Rumble of a gamepad: the force on a finger as a hum, and its contacts as a buzz (Linux, evdev).

It is no force feedback: nothing pushes the hand. Two motors that turn off balance tell how strong a
force is and when it begins.
"""

from __future__ import annotations

import contextlib
import os
import struct

FULL_FORCE = (
    5.0  # [N] at which the motors turn fastest; the page draws its spring in full colour there
)
_SMOOTHING_SHARE = 0.3  # step of the smoothed force towards a new one, as a share
_CHANGE_FACTOR = 2.0  # how much more a change counts than a force that lasts
_MOTOR_MAX = 0xFFFF
_EFFECT_MS = 200  # duration of an effect, which is renewed before its end
_RUMBLE_TYPE, _EVENT_TYPE = 0x50, 0x15  # FF_RUMBLE and EV_FF of linux/input-event-codes.h
_UPLOAD_REQUEST = 0x40304580  # EVIOCSFF
# struct ff_effect of linux/input.h, for a rumble: type, id, direction, two of a trigger, length,
# delay, padding, strong and weak motor, and the rest of the union.
_EFFECT = struct.Struct("HhHHHHH2xHH28x")
_EVENT = struct.Struct("llHHi")


class RumbleEnvelope:
    """The two motors for a force that is asked for step by step."""

    def __init__(self) -> None:
        """Begin without a force."""
        self._smoothed_force = 0.0

    def step(self, force: float) -> tuple[float, float]:
        """Strong and weak motor, 0 to 1: the force [N], and how much it differs from before."""
        magnitude = abs(force)
        change = abs(magnitude - self._smoothed_force)
        self._smoothed_force += _SMOOTHING_SHARE * (magnitude - self._smoothed_force)
        return min(1.0, magnitude / FULL_FORCE), min(1.0, _CHANGE_FACTOR * change / FULL_FORCE)


class Rumble:
    """The rumble of an open gamepad; where it has none, nothing happens."""

    def __init__(self, descriptor: int) -> None:
        """`descriptor` is that of the gamepad, open for writing."""
        self._descriptor, self._effect_id, self._last_motors = descriptor, -1, (0, 0)
        self._envelope = RumbleEnvelope()
        self.is_available = self._upload_effect(0, 0)

    def set_force(self, key_force: float) -> None:
        """Let the motors tell of a force [N]; to be called some 20 times a second."""
        if not self.is_available:
            return
        strong, weak = (
            round(_MOTOR_MAX * motor_ratio) for motor_ratio in self._envelope.step(key_force)
        )
        if (strong, weak) == (0, 0) == self._last_motors:
            return
        self._last_motors = (strong, weak)
        if self._upload_effect(strong, weak):
            with contextlib.suppress(OSError):
                os.write(self._descriptor, _EVENT.pack(0, 0, _EVENT_TYPE, self._effect_id, 1))

    def _upload_effect(self, strong: int, weak: int) -> bool:
        import fcntl

        effect = _EFFECT.pack(_RUMBLE_TYPE, self._effect_id, 0, 0, 0, _EFFECT_MS, 0, strong, weak)
        try:
            upload_answer = fcntl.ioctl(self._descriptor, _UPLOAD_REQUEST, effect)
        except OSError:  # no motors, or opened for reading alone
            return False
        self._effect_id = _EFFECT.unpack(upload_answer)[1]
        return True
