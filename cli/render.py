"""`ergon render`: the sound of a score as a WAV file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ergon.api import score
from ergon.api.options import FileOptions
from ergon.api.render import prepare, target, write
from ergon.common.report import Progress

from . import options
from .bundled import ScorePath
from .console import Console, plural
from .outcome import Findings, Outcome, Refused, check_stdout
from .summary import dry_run, print_finer_steps, print_rendered

if TYPE_CHECKING:
    from ergon.api.render import Completed
    from ergon.scores.reading.load import Loaded


@click.command()
@click.argument("score_paths", metavar="SCORE...", nargs=-1, required=True, type=ScorePath())
@options.target(
    "The WAV file to write; - is stdout. Default: the file that the score names, or SCORE.wav. Of "
    "several scores: the folder of their files."
)
@options.from_dataclass(
    FileOptions,
    "from_ until stems wet only except_ channels bits seed rate threads block hands input",
)
@click.option(
    "--freeze",
    metavar="PART[,PART]",
    help="Write these instruments for `play --frozen`, into the folder -o or SCORE.frozen.",
)
@options.from_dataclass(FileOptions, "motion see on method error cents plan draft")
@options.dry_run
@options.force
@options.strict("when the file is silent")
@click.option("--watch", is_flag=True, help="Render again whenever the score or its files change.")
@options.trust
@options.with_console
def render(
    console: Console,
    score_paths: tuple[str, ...],
    output: str | None,
    dry: bool,
    watch: bool,
    strict: bool,
    freeze: str | None,
    **arguments: Any,
) -> None:
    """Compute the sound of a score, or of a session's journal, into a WAV file.

    The same score gives the same bytes, whatever the machine is doing. A render that is stopped
    leaves no file; only earlier renders are overwritten without -f. Several scores are all read
    before the first is rendered, and share the processes of --on; one that is refused or diverges
    does not stop the others.
    """
    file_options = FileOptions(**arguments)
    if len(score_paths) > 1:
        if watch or freeze is not None or output == "-":
            conflicting_option = (
                "--watch" if watch else "--freeze" if freeze is not None else "-o -"
            )
            raise Refused(f"{conflicting_option} is for one score")
        _render_several(console, score_paths, output, file_options, dry, strict)
        return
    (score_path,) = score_paths
    check_stdout(output, is_json=console.json)
    from ergon.api.render_journal import render_journal
    from ergon.api.score import JOURNAL_SUFFIX

    if file_options.on is not None and (
        freeze is not None or Path(score_path).suffix == JOURNAL_SUFFIX
    ):
        raise Refused("--on renders scores; a journal and --freeze are computed here")
    if Path(score_path).suffix == JOURNAL_SUFFIX:
        if dry or watch or freeze:
            raise Refused("a journal is rendered as it was played: no -n, --watch or --freeze")
        completed = render_journal(Path(score_path), output, file_options, console)
        _print_completed(console, completed)
        _refuse_silence(strict, completed)
    elif freeze is not None:
        from .freezing import freeze_parts

        if watch or file_options.motion:
            raise Refused(f"--freeze excludes {'--watch' if watch else '--motion'}")
        freeze_parts(console, score_path, freeze, output, file_options, is_dry_run=dry)
    elif watch:
        _watch(console, score_path, output, file_options)
    else:
        _refuse_silence(strict, render_file(console, score_path, output, file_options, dry))


def _render_several(
    console: Console,
    paths: tuple[str, ...],
    folder: str | None,
    file_options: FileOptions,
    dry: bool,
    strict: bool,
) -> None:
    from ergon.api.batch_render import render_several, staged_scores

    from .app import explain

    if dry:
        for prepared in staged_scores(paths, folder, file_options, console):
            dry_run(console, prepared.stage, prepared.job)
        return
    outcome_by_score: dict[str, Outcome] = {}
    task, count = f"rendering {len(paths)} scores", len(paths)
    # Without --on, scores are rendered one after the other, each with a bar of its own.
    with console.progress(task, count, 0.0) if file_options.on else Progress() as progress:
        for render_number, rendered in enumerate(
            render_several(paths, folder, file_options, console), 1
        ):
            if rendered.error is not None:
                outcome_by_score[rendered.score] = explain(rendered.error)
                console.outcome(outcome_by_score[rendered.score])
            elif rendered.completed is not None:
                _print_completed(console, rendered.completed)
                if strict and _is_silent(rendered.completed):
                    outcome_by_score[rendered.score] = Findings()
            progress.update(render_number)
    if outcome_by_score:
        message = (
            f"{len(outcome_by_score)} of {plural(len(paths), 'score')} failed: "
            f"{', '.join(outcome_by_score)}"
        )
        outcome_classes = {type(outcome) for outcome in outcome_by_score.values()}
        raise (outcome_classes.pop() if len(outcome_classes) == 1 else Findings)(message)


def render_file(
    console: Console,
    path: str,
    output_path: str | None,
    file_options: FileOptions,
    dry: bool = False,
) -> Completed | None:
    """Render one score, and print what was written. None after a dry run."""
    return _render(
        console, path, score.read(path, file_options, console), output_path, file_options, dry
    )


def _render(
    console: Console,
    path: str,
    loaded: Loaded,
    output_path: str | None,
    file_options: FileOptions,
    dry: bool,
) -> Completed | None:
    prepared = prepare(loaded, target(path, loaded, output_path), file_options, console)
    if dry:
        dry_run(console, prepared.stage, prepared.job)
        return None
    completed = write(prepared, console)
    _print_completed(console, completed)
    return completed


def _refuse_silence(strict: bool, completed: Completed | None) -> None:
    if strict and completed is not None and _is_silent(completed):
        raise Findings  # the warning is printed already


def _is_silent(completed: Completed) -> bool:
    return any(diagnostic.code == "W324" for diagnostic in completed.faint)


def _print_completed(console: Console, completed: Completed) -> None:
    print_rendered(console, completed)
    print_finer_steps(console, completed.reports)


def _watch(console: Console, path: str, output_path: str | None, file_options: FileOptions) -> None:
    from .app import explain
    from .watch import changes

    if path == score.STDIN or output_path == "-":
        raise Refused("--watch needs files: neither the score nor the WAV file can be -")
    watched_files = {Path(path)}
    is_first = True
    for _ in changes(watched_files):
        try:
            loaded = score.read(path, file_options, console)
            watched_files |= {Path(name) for name in loaded.files}
            _render(console, path, loaded, output_path, file_options, dry=False)
        except Exception as error:
            outcome: Outcome = explain(error)
            if (
                isinstance(outcome, Refused) and is_first
            ):  # wrong usage does not get better by waiting
                raise
            console.outcome(outcome)
            console.say(f"{path}: the render before is kept")
        is_first = False
        console.say(f"watching {path}; Ctrl-C ends")
