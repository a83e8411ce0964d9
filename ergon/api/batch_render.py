"""Several scores rendered by one call; if there is a cluster, they share it.

    read, look at files      all scores, before the first is computed
    stage ─ render ─┐
    stage ─ render ─┼─ one queue of stretches at the workers
    stage ─ render ─┘

This process stages scores one after the other, as long as workers may be idle. Each is rendered
by a thread of its own, which waits most of the time.
"""

from __future__ import annotations

import concurrent.futures as cf
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ergon import _core
from ergon.common.errors import ErgonError
from ergon.common.report import Report
from ergon.exchange.safe import check_target
from ergon.exchange.sound import check_ending
from ergon.rendering.remote import ClusterError, chain_count

from . import score as scores
from .cluster_worker import MODULES_MAX
from .errors import OptionError, ScoreError
from .options import FileOptions
from .render import Completed, PreparedRender, check_shared, prepare, target, write

if TYPE_CHECKING:
    from ergon.notation.text.errors import Diagnostic, Severity, Source
    from ergon.scores.reading.load import Loaded

    from .cluster import Cluster

_POLL_SECONDS = 0.2  # [s] between looks for Ctrl-C, while threads render
_CONCURRENT_SCORES_MAX = 64  # scores that are rendered at the same time


@dataclass(frozen=True, slots=True)
class Rendered:
    """The result of one of several scores: the written files, or the error."""

    score: str
    completed: Completed | None
    error: Exception | None = None


@dataclass(frozen=True, slots=True)
class _RenderRequest:
    """A score that was read, the file to write, and its own options."""

    score: str
    loaded: Loaded
    target: str
    options: FileOptions


def render_several(
    paths: Sequence[str | Path], folder: str | Path | None, options: FileOptions, report: Report
) -> Iterator[Rendered]:
    """Render scores into the files that separate renders would write, or into files in `folder`.

    A score is yielded when it is done. All are read, and their files checked, before the first
    is rendered: a ScoreError, OptionError or FileRefusedError concerns all of them. A score that
    the engine refuses, or that diverges, is yielded with its error, and the others go on. Raises
    ClusterError.
    """
    requests = _render_requests(paths, folder, options, report)
    if options.on is None:
        for request in requests:
            yield _render_one(request, report)
        return
    from .cluster import open_cluster

    with open_cluster(options.on, report) as cluster:
        yield from _render_concurrently(requests, cluster, report)


def staged_scores(
    paths: Sequence[str | Path], folder: str | Path | None, options: FileOptions, report: Report
) -> Iterator[PreparedRender]:
    """Plan and stage these scores one after the other. Raises the errors of `prepare`."""
    for request in _render_requests(paths, folder, options, report):
        yield prepare(request.loaded, request.target, request.options, report)


def _render_requests(
    paths: Sequence[str | Path],
    folder: str | Path | None,
    file_options: FileOptions,
    report: Report,
) -> list[_RenderRequest]:
    """The scores to render, each into a file of its own. Raises ErgonError."""
    for option_name in ("text", "plan", "hands"):
        if getattr(file_options, option_name) is not None:
            raise OptionError(option_name, "this option is for one score; render the score alone")
    if folder is not None and Path(folder).exists() and not Path(folder).is_dir():
        raise OptionError("output", f"{folder} is a file; several scores need a folder here")
    if file_options.on is not None:
        check_shared(file_options)
    for path in paths:
        if Path(path).suffix == scores.JOURNAL_SUFFIX or str(path) == scores.STDIN:
            raise ErgonError(
                f"{path} cannot be rendered together with other scores; render it alone"
            )
    read_scores = [(str(path), scores.read(path, file_options, report)) for path in paths]
    _refuse_mistakes([loaded for _, loaded in read_scores])
    request_by_path: dict[Path, _RenderRequest] = {}
    for path, loaded in read_scores:
        target_file = target(path, loaded, None)
        if folder is not None:
            target_file = str(Path(folder, Path(target_file).name))
        resolved_file = Path(target_file).resolve()
        if resolved_file in request_by_path:
            raise OptionError(
                "output",
                f"{request_by_path[resolved_file].score} and {path} would both be written to "
                f"{target_file}; render one alone",
            )
        stems = file_options.stems
        score_options = replace(
            file_options, stems=None if stems is None else Path(stems, Path(target_file).stem)
        )
        request_by_path[resolved_file] = _RenderRequest(path, loaded, target_file, score_options)
    input_paths = [
        Path(input_path)
        for request in request_by_path.values()
        for input_path in request.loaded.inputs
    ]
    for request in request_by_path.values():
        check_ending(request.target)
        check_target(Path(request.target), force=file_options.force, inputs=input_paths)
    return list(request_by_path.values())


def _refuse_mistakes(loaded_scores: Sequence[Loaded]) -> None:
    """Raise a ScoreError about all scores that have mistakes, if any has."""
    loaded_with_mistakes = [loaded for loaded in loaded_scores if loaded.piece is None]
    if loaded_with_mistakes:
        sources: dict[str, Source] = {}
        for loaded in loaded_with_mistakes:
            sources |= loaded.files
        raise ScoreError(
            [diagnostic for loaded in loaded_with_mistakes for diagnostic in loaded.diagnostics],
            sources,
        )


def _render_one(request: _RenderRequest, report: Report) -> Rendered:
    try:
        prepared = prepare(request.loaded, request.target, request.options, report)
        return Rendered(request.score, write(prepared, report))
    except (ErgonError, _core.EngineError) as error:
        return Rendered(request.score, None, error)


# --- together -----------------------------------------------------------------------------------


@dataclass(slots=True)
class _SharedRender:
    """A score that a thread renders, and how many chains of stretches and modules it has."""

    score: str
    n_chains: int
    n_modules: int
    work: _core.Work


def _render_concurrently(
    requests: Sequence[_RenderRequest], cluster: Cluster, report: Report
) -> Iterator[Rendered]:
    """Render scores at the same time, as many as keep all workers busy."""
    locked_report = _LockedReport(report)
    waiting_renders = list(reversed(requests))
    render_by_future: dict[cf.Future[Completed], _SharedRender] = {}
    n_renders_max = min(_CONCURRENT_SCORES_MAX, 2 * cluster.count + 1)
    with cf.ThreadPoolExecutor(n_renders_max, "ergon-render") as pool:
        try:
            while waiting_renders or render_by_future:
                if waiting_renders and _has_room(
                    render_by_future.values(), cluster.count, n_renders_max
                ):
                    request = waiting_renders.pop()
                    try:
                        prepared = prepare(
                            request.loaded, request.target, request.options, locked_report
                        )
                    except (ErgonError, _core.EngineError) as error:
                        yield Rendered(request.score, None, error)
                        continue
                    shared_render = _shared_render(request.score, prepared, cluster.count)
                    render_by_future[
                        pool.submit(
                            partial(
                                _write_score, shared_render.work, prepared, locked_report, cluster
                            )
                        )
                    ] = shared_render
                # If there is room for another score, do not wait: yield only what has ended by now.
                has_more = bool(waiting_renders) and _has_room(
                    render_by_future.values(), cluster.count, n_renders_max
                )
                wait_seconds = 0.0 if has_more else _POLL_SECONDS
                for future in cf.wait(render_by_future, wait_seconds, cf.FIRST_COMPLETED).done:
                    yield _rendered_from(render_by_future.pop(future).score, future)
        finally:
            for (
                shared_render
            ) in render_by_future.values():  # renders still running after an error or Ctrl-C
                shared_render.work.cancel()


def _has_room(shared_renders: Iterable[_SharedRender], n_workers: int, n_renders_max: int) -> bool:
    """Whether workers may be idle, and memory is left for another score."""
    running_renders = list(shared_renders)
    return len(running_renders) < n_renders_max and (
        not running_renders
        or (
            sum(running_render.n_chains for running_render in running_renders)
            < chain_count(n_workers)
            and sum(running_render.n_modules for running_render in running_renders) < MODULES_MAX
        )
    )


def _shared_render(score: str, prepared: PreparedRender, n_workers: int) -> _SharedRender:
    stage = prepared.stage
    n_chains = chain_count(n_workers, stage.simulation)
    return _SharedRender(score, n_chains, stage.network.n_mat + stage.network.n_lia, _core.Work())


def _write_score(
    work: _core.Work, prepared: PreparedRender, report: Report, cluster: Cluster
) -> Completed:
    with work:
        return write(prepared, report, cluster)


def _rendered_from(score: str, future: cf.Future[Completed]) -> Rendered:
    """The result of a score. Raises ClusterError, and any other error that concerns all scores."""
    error = future.exception()
    if error is None:
        return Rendered(score, future.result())
    if isinstance(error, ClusterError) or not isinstance(error, (ErgonError, _core.EngineError)):
        raise error
    return Rendered(score, None, error)


class _LockedReport(Report):
    """Passes messages on, one at a time; the progress of single scores is dropped."""

    __slots__ = ("_lock", "_report")

    def __init__(self, report: Report) -> None:
        """Pass messages to `report`, from any thread."""
        self._report, self._lock = report, threading.Lock()

    def say(self, message: str) -> None:
        """Pass on."""
        with self._lock:
            self._report.say(message)

    def warn(self, message: str) -> None:
        """Pass on."""
        with self._lock:
            self._report.warn(message)

    def event(self, name: str, **fields: object) -> None:
        """Pass on."""
        with self._lock:
            self._report.event(name, **fields)

    def diagnostics(
        self,
        diagnostics: Iterable[Diagnostic],
        sources: Mapping[str, Source],
        left_out: Mapping[Severity, int],
    ) -> None:
        """Pass on."""
        with self._lock:
            self._report.diagnostics(diagnostics, sources, left_out)
