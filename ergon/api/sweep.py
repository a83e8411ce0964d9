"""Variants of a score, rendered: a folder of sounds and a table of their figures."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon.common.option import Integer, Number, Switch, documented, option
from ergon.common.report import Report
from ergon.exchange.safe import check_target, open_for_writing
from ergon.exchange.wave_header import Bits

from . import score as scores
from .errors import OptionError, ScoreError
from .options import AccuracyOptions, ReadOptions, check_seed
from .parallel_results import results_as_completed
from .score_bundle import ScoreBundle, bundle_score, digest
from .sweep_table import FIGURES, SweepRow, Table
from .sweep_variant import Outcome, compute_on_worker, compute_variant

if TYPE_CHECKING:
    from ergon.scores.edits.texts import Texts
    from ergon.scores.edits.varying import Variant, VariedTarget
    from ergon.scores.reading.load import Loaded

_FILE_NAME_CHARACTERS_MAX = 150  # characters of a file's name without its number


@documented
@dataclass(frozen=True, slots=True, kw_only=True)
class SweepOptions(AccuracyOptions):
    """What is varied, and what is made of it.

    `out` is the folder, by default SCORE.sweep. `on` names processes, as for a render; `bits` are
    those of every render; with `force`, files that ergon did not write are overwritten.
    """

    vary: Sequence[str] = option(
        (),
        "What varies: bell.m.K=1kN/m..9kN/m:32 (`..:32 log` by equal ratios), seed=1..16, "
        "bell.m.f=A3,C4; repeatable, then all are combined.",
        metavar="TARGET=VALUES",
        is_required=True,
    )
    zip: bool = option(False, "Take the values in pairs, not all combined.")
    out: Path | str | None = None
    sound: bool = option(True, "Whether sounds are written.", Switch())
    jobs: int = option(
        1,
        "Number of processes; the sounds are the same for any number.",
        Integer(1, 1024),
        shown=True,
    )
    on: str | None = None
    rate: float | None = option(
        None,
        "Frames a second of all sounds [Hz], instead of the score's.",
        Number(1_000, 768_000, "RATE"),
    )
    bits: Bits | None = None
    force: bool = False


@dataclass(frozen=True, slots=True)
class Sweep:
    """The results of a sweep: a row for each variant, and the files of the table and the picture.

    `n_known` rows came from an earlier run.
    """

    targets: tuple[str, ...]
    rows: tuple[SweepRow, ...]
    table: Path
    picture: Path
    n_known: int

    @property
    def n_failed(self) -> int:
        """How many variants were refused, or diverged."""
        return sum(row.status != "ok" for row in self.rows)


@dataclass(frozen=True, slots=True)
class _NamedVariant:
    """A variant to compute: its number, the file of its sound ("" for none) and its hash."""

    number: int
    values: tuple[str, ...]
    texts: Texts
    file: str
    digest: str


def sweep(
    score: str | Path, options: SweepOptions | None = None, *, report: Report | None = None
) -> Sweep:
    """Render the variants of a score into a folder, with a table (CSV) and a picture (SVG).

    Every variant is checked before any is rendered. A variant that the engine refuses or that
    diverges gets a row with the reason. Results of an earlier run in the folder are reused.
    Raises ScoreError, OptionError and FileRefusedError.
    """
    options, report = options or SweepOptions(), report or Report()
    variations, combinations = _varied_values(options)
    loaded = scores.read(score, ReadOptions(text=options.text, trust=options.trust), report)
    scores.piece_of(loaded)
    folder = _sweep_folder(score, options)
    sweep_table = Table(folder / "sweep.csv", tuple(variation.target for variation in variations))
    check_target(sweep_table.path, force=options.force, inputs=loaded.inputs)
    picture = folder / "sweep.svg"
    check_target(picture, force=options.force, inputs=loaded.inputs)
    variants = _valid_variants(score, options, loaded, variations, combinations, report)
    named_variants = _named_variants(str(score), options, variants)
    known_rows = _rows_by_variant(sweep_table, named_variants, folder)
    for variant in named_variants:
        if variant.file and variant.number not in known_rows:
            check_target(folder / variant.file, force=options.force, inputs=loaded.inputs)
    rows_by_number = dict(known_rows)
    missing_variants = [variant for variant in named_variants if variant.number not in known_rows]
    picture_title = scores.piece_of(loaded).title or Path(score).stem
    try:
        _compute_missing(
            str(score), options, missing_variants, folder, rows_by_number, sweep_table, report
        )
    finally:  # keep the variants that were computed before Ctrl-C
        ordered_rows = [rows_by_number[number] for number in sorted(rows_by_number)]
        if ordered_rows:
            sweep_table.write(ordered_rows, picture_title, force=options.force)
            _draw_sweep(
                picture,
                picture_title,
                [variation.target for variation in variations],
                ordered_rows,
                options.force,
            )
    return Sweep(
        sweep_table.targets, tuple(ordered_rows), sweep_table.path, picture, len(known_rows)
    )


def _varied_values(sweep_options: SweepOptions) -> tuple[list[VariedTarget], list[tuple[str, ...]]]:
    """The targets that vary, and the values of each variant. Raises OptionError."""
    from ergon.notation.text.edit import EditError
    from ergon.scores.edits.varying import SEED, parse, value_combinations

    if not sweep_options.vary:
        raise OptionError(
            "vary", "no values are given; write for instance bell.m.K=1kN/m..9kN/m:32"
        )
    try:
        variations = [parse(text) for text in sweep_options.vary]
        combinations = value_combinations(variations, is_zipped=sweep_options.zip)
    except EditError as error:
        raise OptionError("vary", str(error)) from None
    check_seed(sweep_options.seed)
    if sweep_options.seed is not None and any(variation.target == SEED for variation in variations):
        raise OptionError("seed", "; the sweep varies it", excludes="vary")
    if sweep_options.on is not None and (
        sweep_options.jobs > 1 or sweep_options.plan or sweep_options.trust
    ):
        contrary_option = (
            "jobs" if sweep_options.jobs > 1 else "plan" if sweep_options.plan else "trust"
        )
        raise OptionError("on", "; leave one of the two out", excludes=contrary_option)
    if sweep_options.jobs < 1:
        raise OptionError("jobs", f"is {sweep_options.jobs}; it must be 1 or more")
    return variations, combinations


def _sweep_folder(score: str | Path, options: SweepOptions) -> Path:
    if options.out is not None:
        return Path(options.out)
    if str(score) == scores.STDIN:
        raise OptionError("out", "a score from stdin has no name for the folder; name one")
    return Path(f"{Path(score).stem}.sweep")


def _valid_variants(
    score: str | Path,
    sweep_options: SweepOptions,
    loaded: Loaded,
    variations: Sequence[VariedTarget],
    combinations: Sequence[tuple[str, ...]],
    report: Report,
) -> Iterator[Variant]:
    """All variants, read and without mistakes. Raises ScoreError and OptionError."""
    from ergon.notation.text.edit import EditError
    from ergon.scores.edits.varying import variants

    targets = [variation.target for variation in variations]
    try:
        for variant in variants(_score_texts(score, sweep_options, loaded), targets, combinations):
            if variant.loaded.piece is None:
                variant_text = ", ".join(map("=".join, zip(targets, variant.values, strict=True)))
                report.say(f"the variant {variant_text} has mistakes; nothing is rendered")
                variant_loaded = variant.loaded
                report.diagnostics(
                    variant_loaded.diagnostics, variant_loaded.files, variant_loaded.left_out
                )
                raise ScoreError(variant_loaded.diagnostics, variant_loaded.files)
            yield variant
    except EditError as error:
        raise OptionError("vary", str(error)) from None


def _score_texts(score: str | Path, sweep_options: SweepOptions, loaded: Loaded) -> Texts:
    from ergon.scores.edits.texts import Texts

    path = str(Path(score))  # the form in which the loader writes it
    text = next(iter(loaded.files.values())).text if path == scores.STDIN else None
    text = loaded.files[path].text if text is None else text
    return Texts(path, text, bounds=scores.bounds(path, sweep_options.trust)).complete()


def _named_variants(
    score: str, sweep_options: SweepOptions, variants: Iterator[Variant]
) -> list[_NamedVariant]:
    """The variants with the names of their files and their hashes."""
    targets = [text.partition("=")[0].strip() for text in sweep_options.vary]
    render_options = _render_options(sweep_options)
    named_variants, file_names = [], set[str]()
    for index, variant in enumerate(variants):
        values = zip(targets, variant.values, strict=True)
        variant_name = stem = _file_name(", ".join(map("=".join, values)))
        suffix = 1
        while variant_name.lower() in file_names:
            suffix += 1
            variant_name = f"{stem}-{suffix}"
        file_names.add(variant_name.lower())
        file = f"{variant_name}.wav" if sweep_options.sound else ""
        variant_digest = digest(
            bundle_score(score, variant.loaded), sorted(render_options.items()), _program_version()
        )
        named_variants.append(
            _NamedVariant(index, variant.values, variant.texts, file, variant_digest)
        )
    return named_variants


def _file_name(variant_text: str) -> str:
    """Values as the name of a file: `bell.m.K=1kN_m,seed=3`."""
    variant_name = re.sub(r"[^\w.=+,-]", "_", variant_text.replace(", ", ","))
    if len(variant_name.encode()) <= _FILE_NAME_CHARACTERS_MAX:
        return variant_name
    variant_hash = sha256(variant_text.encode()).hexdigest()[:16]
    return f"{variant_name[: _FILE_NAME_CHARACTERS_MAX // 2]}-{variant_hash}"


def _render_options(sweep_options: SweepOptions) -> dict[str, Any]:
    """The RenderOptions of each variant; the file of a plan is made absolute."""
    names = ("method", "error", "cents", "draft", "seed", "rate", "bits")
    options_by_name = {name: getattr(sweep_options, name) for name in names}
    plan = None if sweep_options.plan is None else os.path.abspath(sweep_options.plan)
    return {**options_by_name, "plan": plan, "threads": 1}


def _program_version() -> str:
    from ergon.exchange.cache_folder import versioned_key

    return versioned_key("sweep")


def _rows_by_variant(
    sweep_table: Table, named_variants: Sequence[_NamedVariant], folder: Path
) -> dict[int, SweepRow]:
    """Rows of an earlier run that are still valid: a sound file that is wanted is there,
    unchanged.
    """
    rows_by_digest = sweep_table.read()
    valid_rows = {}
    for variant in named_variants:
        earlier_row = rows_by_digest.get(variant.digest)
        if earlier_row is None or (
            variant.file
            and earlier_row.status == "ok"
            and not _is_file_unchanged(folder, earlier_row)
        ):
            continue
        if variant.file and earlier_row.status == "ok" and earlier_row.file != variant.file:
            continue
        valid_rows[variant.number] = replace(earlier_row, values=variant.values)
    return valid_rows


def _is_file_unchanged(folder: Path, table_row: SweepRow) -> bool:
    if not table_row.file:
        return False
    file_hash = sha256()
    try:
        with (folder / table_row.file).open("rb") as file:
            while block := file.read(1 << 20):
                file_hash.update(block)
    except OSError:
        return False
    return file_hash.hexdigest() == table_row.sha256


def _compute_missing(
    score: str,
    sweep_options: SweepOptions,
    missing_variants: Sequence[_NamedVariant],
    folder: Path,
    rows_by_number: dict[int, SweepRow],
    sweep_table: Table,
    report: Report,
) -> None:
    """Compute what is missing; each row and its sound are written when they are known."""
    if not missing_variants:
        return
    render_options = _render_options(sweep_options)
    outcomes: Iterator[tuple[_NamedVariant, Outcome]]

    def content(variant: _NamedVariant) -> ScoreBundle:
        return bundle_score(score, variant.texts.load())

    jobs = min(sweep_options.jobs, len(missing_variants))
    if sweep_options.on is not None:
        from .cluster import open_cluster
        from .cluster_worker import version

        with open_cluster(sweep_options.on, report) as cluster:
            engine_version = version()
            outcomes = cluster.compute_items(
                missing_variants,
                lambda pool, variant: pool.submit(
                    compute_on_worker,
                    engine_version,
                    content(variant),
                    render_options,
                    variant.file,
                ),
            )
            _keep_results(
                outcomes,
                len(missing_variants),
                folder,
                sweep_options,
                rows_by_number,
                sweep_table,
                report,
            )
        return
    if jobs == 1:
        outcomes = (
            (variant, compute_variant(content(variant), render_options, variant.file))
            for variant in missing_variants
        )
        _keep_results(
            outcomes,
            len(missing_variants),
            folder,
            sweep_options,
            rows_by_number,
            sweep_table,
            report,
        )
        return
    with _process_pool(jobs) as pool:
        outcomes = results_as_completed(
            missing_variants,
            lambda variant: pool.submit(
                compute_variant, content(variant), render_options, variant.file
            ),
            _wait_for_first,
            Future.result,
            2 * jobs,
        )
        _keep_results(
            outcomes,
            len(missing_variants),
            folder,
            sweep_options,
            rows_by_number,
            sweep_table,
            report,
        )


def _wait_for_first(futures: Sequence[Future[Outcome]]) -> None:
    wait(futures, return_when=FIRST_COMPLETED)


def _keep_results(
    outcomes: Iterator[tuple[_NamedVariant, Outcome]],
    n_variants: int,
    folder: Path,
    sweep_options: SweepOptions,
    rows_by_number: dict[int, SweepRow],
    sweep_table: Table,
    report: Report,
) -> None:
    n_finished, finished_seconds = 0, 0.0
    with report.progress("sweeping", n_variants, 0.0) as progress:
        for variant, outcome in outcomes:
            figures = {name: outcome["figures"].get(name) for name in FIGURES}
            variant_sound, variant_file = (
                outcome["sound"],
                variant.file if outcome["status"] == "ok" else "",
            )
            if variant_file:
                path = folder / variant_file
                with open_for_writing(path, binary=True, force=sweep_options.force) as sound_file:
                    sound_file.write(variant_sound)
            rows_by_number[variant.number] = SweepRow(
                variant.values,
                outcome["status"],
                variant_file,
                figures,
                variant.digest,
                sha256(variant_sound).hexdigest() if variant_file else "",
                outcome["reason"],
            )
            finished_seconds += outcome["figures"].get("cpu_s") or 0.0
            n_finished += 1
            sweep_table.write_unfinished(
                [rows_by_number[number] for number in sorted(rows_by_number)],
                force=sweep_options.force,
            )
            progress.update(n_finished)
            report.event("variant", **asdict(rows_by_number[variant.number]))


@contextmanager
def _process_pool(jobs: int) -> Iterator[Executor]:
    """Processes that end with this one, or at once at Ctrl-C."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, context, initializer=_begin_process)
    try:
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _begin_process() -> None:
    """Prepare a process of a sweep: one thread for BLAS, and Ctrl-C is left to the parent."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _draw_sweep(
    path: Path,
    picture_title: str,
    targets: Sequence[str],
    sweep_rows: Sequence[SweepRow],
    force: bool,
) -> None:
    from ergon.exchange.safe import write_text
    from ergon.view.sweep import Point, picture

    drawn_points = [
        Point(row.values, {n: x for n, x in row.figures.items() if x is not None and isfinite(x)})
        for row in sweep_rows
    ]
    write_text(path, picture(picture_title, targets, drawn_points), force=force)
