"""The pages as a site: built without a warning, searched, and asking no other server."""

from __future__ import annotations

import functools
import http.server
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import browser
import pytest
from patience import until
from sweep import few

from docs.generators import shared_pieces, site_hooks

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
# What is asked, and the page that answers it.
QUESTIONS = [
    ("rhythm transformations", "rhythm"),
    ("stereo headphones", "dome"),
    ("midi controller", "midi"),
    ("why silent", "howto/silent"),
    ("E204", "errors/E204"),
    ("vibraphone", "instruments/bars"),
    ("undo", "repl"),
    ("overwritten", "files"),
    ("send piece one file", "view"),
    ("extras pygls", "install"),
]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-d", str(folder)]
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=quiet)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stderr
    return folder


@pytest.fixture(scope="module")
def url(site: Path) -> Iterator[str]:
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    handler = functools.partial(Quiet, directory=str(site))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running() as started:
        yield started


def test_gallery_links_built_pieces(tmp_path: Path):
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert site_hooks.with_pieces(text, tmp_path) == text
    assert all(f"(gallery/{name}.svg)" in text for name in shared_pieces.QUICK)
    (tmp_path / "tempo.html").write_text("")
    linked = site_hooks.with_pieces(text, tmp_path)
    [link] = set(linked.splitlines()) - set(text.splitlines())
    assert link == '<a href="../pieces/tempo.html">See and hear it move</a>'
    lines = linked.splitlines()
    assert "gallery/tempo.svg" in lines[lines.index(link) - 2]


def test_pages_each_in_one_group():
    groups = site_hooks.pages_in_groups(DOCS)
    listed = [name for names in groups.values() for name in names]
    assert sorted(listed) == sorted(
        path.relative_to(DOCS).as_posix() for path in DOCS.glob("**/*.md")
    )
    assert all(groups.values())


@pytest.mark.parametrize(
    ("text", "page", "shown"),
    [
        ("[the design](../DESIGN.md) here", "stability.md", "the design here"),
        ("[x](../../DESIGN.md#rooms)", "design/README.md", "x"),
        ("[x](../live.md#hands)", "howto/bow.md", "[x](../live.md#hands)"),
        ("[x](https://example.org/a)", "a.md", "[x](https://example.org/a)"),
        ("![x](pictures/a.png)", "a.md", "![x](pictures/a.png)"),
    ],
)
def test_external_links_replaced_by_words(text: str, page: str, shown: str):
    assert site_hooks.without_links_outside(text, page) == shown


def test_site_table_code_with_bars(site: Path):
    text = (site / "rhythm/index.html").read_text(encoding="utf-8")
    assert "[kick | snare]" in text
    assert r"\|" not in text


def test_site_contains_all_pages(site: Path):
    for path in DOCS.glob("**/*.md"):
        name = path.relative_to(DOCS).with_suffix("")
        built = name.parent if name.name == "README" else name
        assert (site / built / "index.html").is_file(), name


def test_site_pages_without_external_requests(site: Path):
    asking = re.compile(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=\"?(?:https?:)?//")
    pages = list(site.glob("**/*.html"))
    assert len(pages) > 100
    assert [page for page in pages if asking.search(page.read_text(encoding="utf-8"))] == []


@pytest.mark.parametrize(
    ("question", "answer"), few(QUESTIONS, 4), ids=[asked for asked, _ in QUESTIONS]
)
def test_site_search_lists_expected_page(
    question: str, answer: str, url: str, chromium: browser.Browser
):
    links = "Array.from(document.querySelectorAll('.md-search-result__link'), (a) => a.pathname)"
    with chromium.page(1200, 800) as page:
        page.call("Page.navigate", url=f"{url}?q={question.replace(' ', '+')}")
        until(lambda: page.run(f"{links}.length") > 0, "results")
        pages = list(dict.fromkeys(page.run(links)))  # each with its sections
        assert f"/{answer}/" in pages[:5]
        asked = [address for address in page.requests if address.startswith("http")]
    assert {address.split("/")[2] for address in asked} == {url.split("/")[2]}
