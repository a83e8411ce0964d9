"""OSC servers by command-line options."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from ergon.common.report import Report

from .errors import OptionError

if TYPE_CHECKING:
    from ergon.live.osc import OscServer


def osc_of(receive_from: str | None, send_to: str | None, report: Report) -> OscServer | None:
    """The OSC server of the options, with open sockets; None without these options. Raises
    OptionError.
    """
    if receive_from is None and send_to is None:
        return None
    from ergon.live.datagrams import PythonOscMissingError
    from ergon.live.osc import KEY_VARIABLE, OscError, OscServer, parse_address

    try:
        receive_address = None if receive_from is None else parse_address(receive_from)
        send_address = None if send_to is None else parse_address(send_to)
        osc = OscServer(receive_address, send_address, key=os.environ.get(KEY_VARIABLE, ""))
    except (PythonOscMissingError, OscError) as error:
        raise OptionError("osc" if receive_from is not None else "osc_to", str(error)) from None
    if osc.address is not None:
        host, port = osc.address
        report.event("osc", host=host, port=port)
        report.say(f"OSC is heard at {host}:{port}")
    return osc
