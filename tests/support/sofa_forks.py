"""A process that forks a bounded reader of SOFA files for each pair of paths on stdin.

A line is SOURCE, a tab, TARGET; the answer is the status of the reader, its seconds of CPU time and
the most memory it held [bytes]. To start a reader anew for each of 100,000 files takes hours.
"""

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

ANSWER_MAX = 1 << 28  # bytes


def loaded(path: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location("sofa_reader", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main() -> None:
    reader = loaded(sys.argv[1])
    reader.rehearse()
    for line in sys.stdin:
        source, target = (Path(word) for word in line.rstrip("\n").split("\t"))
        output, single = os.pipe()  # a file would be one that the reader may not write
        pid = os.fork()
        if not pid:
            # An error of the reader ends the fork alone, with a status that is not 0.
            with source.open("rb") as file, os.fdopen(single, "wb") as answer:
                reader.limit_process()
                reader.answer(file, answer)
            os._exit(0)
        os.close(single)
        with os.fdopen(output, "rb") as answer:
            target.write_bytes(answer.read(ANSWER_MAX))
        _, status, used = os.wait4(pid, 0)
        print(status, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024, flush=True)


main()
