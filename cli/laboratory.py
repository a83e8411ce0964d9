"""What the commands of the laboratory share: names of files, lists of words, pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.api.score import STDIN

from .console import Console
from .outcome import Refused

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ergon.scores.reading.load import Loaded
    from ergon.workshop.lab.cluster_workers import Workers

FORMS = ("csv", "svg", "png")


def output_stem(
    output_text: str | None,
    source_name: str,
    noun: str,
    force: bool,
    input_files: Sequence[Path] = (),
) -> Path:
    """NAME for the files NAME.csv, NAME.svg and NAME.png, after checking that all may be written.

    Raises FileRefusedError.
    """
    from ergon.exchange.safe import check_target
    from ergon.workshop.lab.pictures import targets

    if output_text is None:
        base = "score" if source_name == STDIN else Path(source_name).stem
        checked_stem = Path(f"{base}-{noun}")
    else:
        checked_stem = Path(output_text)
        if checked_stem.suffix[1:] in FORMS:  # one of the three was named: all of them are meant
            checked_stem = checked_stem.with_suffix("")
    for path in targets(checked_stem):
        check_target(path, force=force, inputs=input_files)
    return checked_stem


def parse_choice_list(
    list_text: str | None, allowed_words: Sequence[str], option: str
) -> tuple[str, ...]:
    """The words of a list `a,b`, each of which must be known; without a text, all known words."""
    if list_text is None:
        return tuple(allowed_words)
    from ergon.notation.text.spelling import nearest

    chosen_words = tuple(dict.fromkeys(word.strip() for word in list_text.split(",")))
    for chosen_word in chosen_words:
        if chosen_word not in allowed_words:
            nearest_word = nearest(chosen_word, allowed_words)
            hint = f"; did you mean '{nearest_word}'?" if nearest_word else ""
            raise Refused(
                f"{option}: there is no '{chosen_word}' ({', '.join(allowed_words)}){hint}"
            )
    return chosen_words


@contextmanager
def workers(
    cluster_address: str | None,
    path: str | None,
    loaded: Loaded | None,
    trust: bool,
    console: Console,
) -> Iterator[Workers | None]:
    """Other processes that compute points of a chart or map of the score; None without --on.

    Raises OptionError and ClusterError.
    """
    if cluster_address is None:
        yield None
        return
    from ergon.api.cluster import open_cluster
    from ergon.api.score_bundle import bundle_score
    from ergon.workshop.lab.cluster_workers import Workers

    if trust:
        raise Refused("--on excludes --trust; leave one of the two out")
    score_bundle = None if path is None or loaded is None else bundle_score(path, loaded)
    with open_cluster(cluster_address, console) as cluster:
        yield Workers(cluster, score_bundle)


def write_table_and_pictures(
    console: Console, output_stem: Path, table_text: str, draw: Callable[[], Figure], force: bool
) -> None:
    """Write the table and the pictures; without matplotlib, the table alone, then raise Refused."""
    from ergon.exchange.safe import file_group
    from ergon.workshop.lab.pictures import MatplotlibMissingError, pictures, targets

    csv_path, matplotlib_error = targets(output_stem)[0], None
    content_by_path = {csv_path: table_text.encode()}
    try:
        content_by_path |= pictures(draw, output_stem)
    except MatplotlibMissingError as error:
        matplotlib_error = error
    with file_group(force=force) as files:
        for path, content in content_by_path.items():
            files.write(path, content)
    for path in content_by_path:
        console.say(f"wrote {path}")
    if matplotlib_error is not None:
        raise Refused(f"{matplotlib_error}; {csv_path} is written")
