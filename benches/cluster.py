"""The cost of computing islands in other processes: workers on this machine, compared with
threads.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from benches.measure import Row, interleaved

_ROUNDS = 2
_GONGS = 4
_SCORE = """\
ergon: 1
accuracy: {method: ca}
instruments:
"""
_GONG = (
    "  {name}: {{modules: {{p: {{PLATE: {{shape: hex, radius: 14, M: 50g, f: {f}Hz, t60: 4s, "
    "hardening: 1e9N/m3}}}}}}, out: {{x: {{SOX: p.3}}}}}}\n"
)


def cluster() -> list[Row]:
    """Gongs of 600 masses with hardening: one and two workers, compared with one and two
    threads.
    """
    from ergon.api import score as scores
    from ergon.api.cluster import Cluster, job_of, open_cluster, share_work
    from ergon.api.options import RenderOptions
    from ergon.api.render import prepare
    from ergon.common.report import Report
    from ergon.rendering.render import render_array

    names = [f"g{i}" for i in range(_GONGS)]
    gongs = "".join(_GONG.format(name=name, f=300 + 20 * i) for i, name in enumerate(names))
    struck = ", ".join(f"{name}.p.centre" for name in names)
    strikes = f"strikes: {{s: {{to: [{struck}], at: 0.1s, impulse: 1mNs, every: 1s, times: 14}}}}\n"
    with contextlib.ExitStack() as stack:
        path = Path(stack.enter_context(tempfile.TemporaryDirectory()), "gongs.yaml")
        path.write_text(_SCORE + gongs + strikes + "render: {tail: 2s}\n")
        begun = time.perf_counter()
        two = stack.enter_context(open_cluster("local:2", Report()))
        start = time.perf_counter() - begun
        first = stack.enter_context(open_cluster("local:1", Report()))
        sounds: dict[str, str] = {}
        seconds = 0.0

        def run(name: str, threads: int, on: Cluster | None) -> float:
            nonlocal seconds
            options = RenderOptions(threads=threads)
            prepared = prepare(scores.read(path, options), "-", options, Report())
            bits = replace(prepared.job.format, bits="double")
            job = replace(prepared.job, format=bits, stretches=None)
            seconds = job.n_frames / prepared.stage.rate
            begun = time.perf_counter()
            if on is not None:
                sent = job_of(prepared.loaded, prepared.stage, None, None)
                job = replace(job, workers=share_work(on, sent))
            _, done, _ = render_array(prepared.stage, job, lambda _: None)
            spent = time.perf_counter() - begun
            sounds[name] = done.sha256
            return spent

        taken = interleaved(
            _ROUNDS,
            {
                "1 thread": lambda: run("1 thread", 1, None),
                "1 worker": lambda: run("1 worker", 1, first),
                "2 threads": lambda: run("2 threads", 2, None),
                "2 workers": lambda: run("2 workers", 1, two),
            },
        )
    assert len(set(sounds.values())) == 1, sounds
    values = {name.replace(" ", "_") + "_s": spent for name, spent in taken.items()}
    values |= {"seconds": seconds, "start_s": start, "processors": os.cpu_count() or 1}
    return [
        Row(
            "cluster",
            f"{count} worker{'s' * (count > 1)}: {taken[ours]:.2f} s for {seconds:.0f} s of sound",
            f"{count} thread{'s' * (count > 1)}: {taken[theirs]:.2f} s",
            taken[ours] / taken[theirs],
            "time",
            values,
        )
        for count, ours, theirs in ((1, "1 worker", "1 thread"), (2, "2 workers", "2 threads"))
    ]
