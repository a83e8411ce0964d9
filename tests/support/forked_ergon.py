"""A process that has imported ergon, and forks itself for each requested command.

A short command spends most of its time on starting Python and importing packages. Here that is
done once for all commands of a test worker. Each command is still its own process, with its
folder, environment, streams and limits, and ends as Python ends. Tests of the start itself
(closed streams, encodings, imports) start `ERGON` of `commands.py` instead.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import resource
import socket
import sys
from pathlib import Path
from typing import Any

from written_files import kill_at

from ergon.cli.app import main

# Packages that most commands import when they are called.
_ROOMS = (
    "api.check",
    "api.plan",
    "api.render",
    "api.render_journal",
    "api.score",
    "cli.check",
    "cli.info",
    "cli.plan",
    "cli.render",
    "cli.signals",
    "exchange.plan_store",
    "rendering.render",
    "scores.reading.load",
    "scores.staging.stage",
)
_FLAGS = (os.O_RDONLY, os.O_WRONLY | os.O_APPEND, os.O_WRONLY | os.O_APPEND)


def become(asked: dict[str, Any], channel: socket.socket) -> None:
    """Turn this process into that of the command."""
    channel.close()
    for number, (name, flags) in enumerate(zip(asked["streams"], _FLAGS, strict=True)):
        file = os.open(name, flags, 0o600)
        os.dup2(file, number)
        os.close(file)
    os.chdir(asked["folder"])
    os.environ.clear()
    os.environ.update(asked["environment"])
    for kind, limit in asked["limits"]:
        resource.setrlimit(kind, (limit, limit))
    sys.argv = ["ergon", *asked["words"]]
    if asked["killed_at"]:
        kill_at(asked["killed_at"], Path.cwd())


def serve(channel: socket.socket) -> bool:
    """Fork for each line of JSON received, and answer with its exit code; returns true in the
    fork.
    """
    with channel.makefile("r") as lines:
        for line in lines:
            child = os.fork()
            if child == 0:
                become(json.loads(line), channel)
                return True
            _, status = os.waitpid(child, 0)
            channel.sendall(f"{os.waitstatus_to_exitcode(status)}\n".encode())
    return False


if __name__ == "__main__":
    for room in _ROOMS:
        importlib.import_module(f"ergon.{room}")
    gc.freeze()  # what is imported stays shared with the forks
    if serve(socket.socket(fileno=int(sys.argv[1]))):
        main()
