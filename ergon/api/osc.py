"""OSC as options ask for it."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from ergon.common.report import Report

from .errors import OptionError

if TYPE_CHECKING:
    from ergon.live.osc import OscServer


def osc_of(heard: str | None, told: str | None, report: Report) -> OscServer | None:
    """OSC as asked, its sockets open; None where nothing is asked. Raises OptionError."""
    if heard is None and told is None:
        return None
    from ergon.live.datagrams import PythonOscMissingError
    from ergon.live.osc import KEY_VARIABLE, OscError, OscServer, parse_address

    try:
        here = None if heard is None else parse_address(heard)
        there = None if told is None else parse_address(told)
        osc = OscServer(here, there, key=os.environ.get(KEY_VARIABLE, ""))
    except (PythonOscMissingError, OscError) as error:
        raise OptionError("osc" if heard is not None else "osc_to", str(error)) from None
    if osc.place is not None:
        host, port = osc.place
        report.event("osc", host=host, port=port)
        report.say(f"OSC is heard at {host}:{port}")
    return osc
