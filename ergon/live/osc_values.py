"""Values of inputs that come by OSC, at a bounded rate."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from .osc_in import number_handler

if TYPE_CHECKING:
    from .osc_in import Handler

_VALUES_PER_SECOND = 200.0  # values a second, of all inputs together: a journal holds hours of them
_VALUES_AT_ONCE = 20.0  # values of different inputs that act in one tick, after a pause


class InputValues:
    """Passes values to inputs; if they come too fast, only the latest of each input."""

    def __init__(
        self, set_input: Callable[[str, float], bool], clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Use `set_input` to give an input a value; it returns False if that must be tried
        again.
        """
        self._set_input, self._clock = set_input, clock
        self._waiting_values: dict[str, float] = {}
        self._n_tokens = _VALUES_AT_ONCE
        self._refill_instant = clock()

    def handler_of(self, name: str) -> Handler:
        """The handler of requests for an input."""
        return number_handler(partial(self._set_value, name))

    def _set_value(self, name: str, value: float) -> None:
        self._waiting_values[name] = value
        self.send_due_values()

    def send_due_values(self) -> None:
        """Pass on as many values as the rate allows, that of the input first that has waited
        longest.
        """
        instant_now = self._clock()
        self._n_tokens = min(
            _VALUES_AT_ONCE,
            self._n_tokens + (instant_now - self._refill_instant) * _VALUES_PER_SECOND,
        )
        self._refill_instant = instant_now
        while self._waiting_values and self._n_tokens >= 1.0:
            input_name = next(iter(self._waiting_values))
            if not self._set_input(input_name, self._waiting_values[input_name]):
                return
            del self._waiting_values[input_name]
            self._n_tokens -= 1.0
