"""`signalled_start.py SIGNAL EVERY WORDS…`: run `ergon WORDS` with a signal at its imports.

At one in EVERY of them a process is forked to which the signal comes there. Prints a JSON line for
each: module, exit code, stderr.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
import threading
from typing import Any

from ergon.cli.start import main

_PATIENCE = 60  # [s] until a process that has lost the signal is ended
_RESULTS = os.dup(1)
_number, _every = int(sys.argv[1]), int(sys.argv[2])
_count = 0
_is_here = False  # in a fork, or while forking


def _audit_import(event: str, arguments: tuple[Any, ...]) -> None:
    global _count, _is_here
    if event != "import" or _is_here or threading.current_thread() is not threading.main_thread():
        return
    _count += 1
    if _count % _every:
        return
    _is_here = True
    with tempfile.TemporaryFile() as output:
        child = os.fork()
        if not child:
            os.dup2(output.fileno(), 1)
            os.dup2(output.fileno(), 2)
            signal.alarm(_PATIENCE)
            os.kill(os.getpid(), _number)
            return
        _, status = os.waitpid(child, 0)
        output.seek(0)
        text = output.read().decode(errors="replace")
    record = [str(arguments[0]), os.waitstatus_to_exitcode(status), text]
    os.write(_RESULTS, f"{json.dumps(record)}\n".encode())
    _is_here = False


sys.argv = ["ergon", *sys.argv[3:]]
sys.addaudithook(_audit_import)
main()
