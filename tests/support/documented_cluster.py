"""The commands of docs/cluster.md, run as a user runs them, with a port of the test."""

import os
import re
import socket
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from patience import PATIENCE, until

PAGE = Path(__file__).parents[2] / "docs" / "cluster.md"


def commands(heading: str) -> list[tuple[str, str]]:
    """Machine and command of each line in the blocks below a heading."""
    section = PAGE.read_text(encoding="utf-8").partition(f"\n## {heading}\n")[2]
    section = section.partition("\n## ")[0]
    blocks = re.findall(r"```text\n(.*?)```", section, flags=re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    assert lines, heading
    return [(at, what) for at, _, what in (line.partition("$ ") for line in lines)]


class DocumentedCluster:
    """The processes that a section starts; `you` are the commands of the user who renders."""

    def __init__(self, heading: str, environment: Mapping[str, str]) -> None:
        with socket.socket() as first:
            first.bind(("127.0.0.1", 0))
            self.port = first.getsockname()[1]
        self.environment = {**os.environ, **environment}
        self.you: list[str] = []
        self.processes: list[subprocess.Popen[bytes]] = []
        for position, line in commands(heading):
            what = line.replace("one:", "127.0.0.1:").replace("8786", str(self.port))
            what = what.replace("--nworkers 8", "--nworkers 1")
            if position == "you":
                self.you.append(what)
            elif what.startswith("dask "):
                self._begin(what)
            else:
                subprocess.run(what, shell=True, check=True, capture_output=True)
        until(lambda: self.n_registered() == len(self.processes) - 1, "workers")

    def _begin(self, what: str) -> None:
        with Path(f"dask-{len(self.processes)}.log").open("wb") as log:
            # In its own process group, because a worker has a supervisor that restarts it.
            self.processes.append(
                subprocess.Popen(
                    what,
                    shell=True,
                    stdout=log,
                    stderr=log,
                    env=self.environment,
                    start_new_session=True,
                )
            )
        if len(self.processes) == 1:
            until(lambda: "Scheduler at" in self.log(0), "a scheduler")

    def log(self, number: int) -> str:
        return Path(f"dask-{number}.log").read_text(errors="replace")

    def n_registered(self) -> int:
        return sum("Registered to" in self.log(i) for i in range(1, len(self.processes)))

    def end(self) -> None:
        for process in self.processes:
            os.killpg(process.pid, 15)
        end = time.monotonic() + PATIENCE
        for process in self.processes:
            try:
                process.wait(max(0.0, end - time.monotonic()))
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, 9)
                process.wait()


@contextmanager
def documented_cluster(heading: str, environment: Mapping[str, str]) -> Iterator[DocumentedCluster]:
    single = DocumentedCluster(heading, environment)
    try:
        yield single
    finally:
        single.end()
