"""Building long-lived objects: a large score is a million objects, and hardly any cycle to
collect.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def without_gc(build: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Make a function run with the cyclic garbage collector off; a collection takes as long as the
    building.
    """

    @wraps(build)
    def built(*args: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        collecting = gc.isenabled()
        gc.disable()
        try:
            return build(*args, **named)
        finally:
            if collecting:
                gc.enable()

    return built
