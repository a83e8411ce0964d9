"""Building what lasts: a large score is a million objects, with no cycle worth a search."""

from __future__ import annotations

import gc
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

_Arguments = ParamSpec("_Arguments")
_Made = TypeVar("_Made")


def lasting(build: Callable[_Arguments, _Made]) -> Callable[_Arguments, _Made]:
    """Make a function run without the search for cycles, which takes as long as the building."""

    @wraps(build)
    def built(*args: _Arguments.args, **named: _Arguments.kwargs) -> _Made:
        collecting = gc.isenabled()
        gc.disable()
        try:
            return build(*args, **named)
        finally:
            if collecting:
                gc.enable()

    return built
