"""Everything a reader can copy from the pages works: snippets are checked, commands are run.

What a block of a page is stands in `docs/generators/pages.py`. Every yaml block has to check
without error or warning, as part of its file. Console blocks are run in one folder in the order of
the page; what a command prints (errors and all) must match what is shown, where `…` stands for
anything.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import forked
from sweep import few

from docs.generators.pages import Block, blocks, commands, merged, put
from ergon.scores.reading.load import load
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import stage
from tests.scores import test_library

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    *(page for page in sorted((ROOT / "docs").glob("*.md")) if page.name != "reference.md"),
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
    *sorted((ROOT / "docs" / "instruments").glob("*.md")),
]
FOR_DEVELOPERS = [
    ROOT / "DESIGN.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs" / "design").glob("*.md")),
]
LONG = [ROOT / "docs" / "charts.md"]  # draws charts and maps
_IN_A_ROOM = """ergon: 1
instruments: {{b: {{BANK: {{count: 9, f: 1kHz, t60: 1s, M: 1g}}, out: {{SOX: b.all}}}}}}
mix: {{layout: {name}, route: {{from: b, to: nearest}}}}
"""


def check(block: Block, path: Path) -> None:
    is_layout = "\nspeakers:" in block.text
    room = path.with_name("room.yaml")  # a score that lays the layout out
    text = _IN_A_ROOM.format(name=path.name) if is_layout else None
    loaded = load(room if is_layout else path, text=text)
    result = list(loaded.diagnostics)
    if loaded.piece is not None:
        try:
            result += stage(loaded.piece).diagnostics
        except StageError:  # high notes of a body of modes: a plan leaves out what nobody hears
            result += stage(loaded.piece, planned=True).diagnostics
    wrong = [f for f in result if f.code[0] != "N"]
    if "mistake" in block.notes:
        assert wrong, f"{block.where}: nothing is wrong here"
    else:
        assert not wrong, f"{block.where}: {wrong}"


def run(block: Block, folder: Path) -> None:
    """Run the commands of a console block and compare what they print."""
    for words, shown in commands(block):
        done = forked(words, folder, merged=True, NO_COLOR="1", COLUMNS="80")
        pattern = re.escape(shown).replace("…", ".*")
        ok = re.fullmatch(pattern, done.stdout.strip(), re.DOTALL)
        assert ok, f"{block.where}: {words}\n{done.stdout}"


@pytest.mark.parametrize(
    "page", few(PAGES, [page for page in PAGES if page not in LONG]), ids=lambda page: page.name
)
def test_page_code_blocks_run_as_shown(page: Path, tmp_path: Path) -> None:
    for block in blocks(page):
        if block.language == "console":
            run(block, tmp_path)
        elif block.language in ("yaml", "csv", "obj"):
            path = put(block, tmp_path)
            if block.language == "yaml":
                check(block, path)


HISTORY = [ROOT / "CHANGELOG.md", *sorted((ROOT / "docs" / "history").glob("*.md"))]


@pytest.mark.parametrize("page", [*PAGES, *FOR_DEVELOPERS, *HISTORY], ids=lambda page: page.name)
def test_page_links_point_to_files(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if not target.startswith(("http://", "https://")):
            # Generated pages are made by `make docs`.
            built = target.startswith(
                ("errors/", "reference.md", "docs/reference.md", "docs/errors")
            )
            assert built or (page.parent / target).exists(), f"{page.name}: {target}"


# Where files lie that the pages for developers name without their beginning.
_HOMES = [ROOT, *(ROOT / f"core-rs/{one}/src" for one in ("engine", "view", "live", "bridge"))]
_HOMES += [ROOT / "core-rs", *(ROOT / f"core-rs/engine/src/{one}" for one in ("assembly", "plan"))]


@pytest.mark.parametrize(
    "page",
    # The recipes of CONTRIBUTING.md name files that the reader makes.
    [
        ROOT / "docs" / "glossary.md",
        *(page for page in FOR_DEVELOPERS if page.name != "CONTRIBUTING.md"),
    ],
    ids=lambda page: page.name,
)
def test_files_named_on_pages_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for name in sorted(set(re.findall(r"`([a-z_.-]+(?:/[a-z_-]+)+(?:\.\w+)?)/?`", text))):
        result = [home / f"{name}{end}" for home in _HOMES for end in ("", ".rs", ".py")]
        assert any(path.exists() for path in result), f"{page.name} names {name}"


def test_pages_reachable_from_readme() -> None:
    reached, todo = set(), [ROOT / "README.md"]
    while todo:
        page = todo.pop()
        if page in reached:
            continue
        reached.add(page)
        targets = re.findall(r"\]\(([^)#\s]+\.md)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
        todo += [(page.parent / target).resolve() for target in targets if "://" not in target]
    assert {page.resolve() for page in PAGES} <= reached


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda page: page.name)
def test_pages_without_merge_conflict_markers(page: Path) -> None:
    assert not re.search(r"^(<<<<<<<|>>>>>>>) ", page.read_text(encoding="utf-8"), re.MULTILINE)


def test_merged_section_leaves_other_sections() -> None:
    text = "ergon: 1\nkeys:\n  k: {M: 1g}\ngestures:\n  a: 0@0 1@1\n"
    changed = merged(text, "keys:\n  j: {M: 2g}\nmarks: {A: 1|1}\n")
    assert changed == "ergon: 1\nkeys:\n  j: {M: 2g}\ngestures:\n  a: 0@0 1@1\nmarks: {A: 1|1}\n"


def test_code_block_languages_known() -> None:
    """A block in another language would be looked at by nobody."""
    # A session is typed by test_repl_concert; Python is run by test_session_api and
    # test_library_face; JSON is a protocol.
    known = {"yaml", "console", "csv", "text", "sh", "repl", "python", "json", "obj"}
    for page in PAGES:
        assert {block.language for block in blocks(page)} <= known, page.name


def test_tutorial_with_nine_steps() -> None:
    text = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    steps = re.findall(r"^## (\d)\. ", text, re.MULTILINE)
    assert steps == [str(n) for n in range(1, 10)]


def test_first_picture_shows_readme_score() -> None:
    picture = (ROOT / "docs" / "pictures" / "first.svg").read_text(encoding="utf-8")
    text = next(block.text for block in blocks(ROOT / "README.md") if block.language == "yaml")
    assert len(text.splitlines()) == 15
    title = next(line for line in text.splitlines() if line.startswith("title: "))
    assert title.removeprefix("title: ") in picture
    assert len(picture) < 150_000


def test_bundled_pieces_and_instruments_listed_with_length() -> None:
    """docs/README.md: every piece and its seconds, every instrument that a file defines."""
    text = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    pieces = re.findall(r"^\| `([\w-]+)` \| (\d+) s \|", text, re.MULTILINE)
    assert {name: int(seconds) for name, seconds in pieces} == {
        name: int(seconds + 0.5) for name, seconds in test_library.SECONDS.items()
    }
    rows = re.findall(r"^\| `([\w-]+)\.yaml` \|([^|]*)\|", text, re.MULTILINE)
    files = {path.stem: path for path in (ROOT / "instruments" / "library").glob("*.yaml")}
    assert {name for name, _ in rows} == set(files)
    for name, instruments in rows:
        defined = yaml.safe_load(files[name].read_text(encoding="utf-8"))
        assert re.findall(r"`([\w-]+)`", instruments) == list(defined.get("instruments", {}))
    laws = yaml.safe_load(files["laws"].read_text(encoding="utf-8"))["laws"]
    assert len(laws) == 9  # "nine laws"


def test_smooth_gesture_overshoot_at_uneven_point() -> None:
    """As docs/language.md and gestures/common.yaml say."""
    text = (
        "ergon: 1\nkeys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}\nplayers: {a: {key: k}}\n"
        "gestures: {g: 0mm@0 smooth 6mm@60ms 0mm@300ms}\nparts: {a: [{at: 0.1s, play: g}]}\n"
    )
    loaded = load("here.yaml", text=text)
    assert loaded.piece is not None
    simulation = stage(loaded.piece).simulation
    highest = 0.0
    for _ in range(900):
        simulation.process(np.zeros((20, simulation.n_out)))
        asked = float(simulation.asked()[0])
        highest = max(highest, 0.0 if np.isnan(asked) else asked)
    assert highest == pytest.approx(14.1e-3, abs=0.1e-3)
