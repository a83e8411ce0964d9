"""Motion files with bundles in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import browser
import pytest
from motions import BUNDLE, LEVELS, Piece, bundle, bundled, chunk, group
from patience import until

from ergon import _core

DATA = Piece().bytes()
# What the page knows, and what it draws, at an instant.
KNOWN = """(() => {
  const {story, motion} = ergon.page;
  motion.at(1.7, 1);
  return [Array.from(motion.z), Array.from(motion.sweep), Array.from(story.levels.at(1.7)),
    story.ergons.count, story.contacts.count, story.model.names, story.end, [...story.peaks]];
})()"""
TEXT = "document.getElementById('told').textContent"


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running() as found:
        yield found


def shown(chromium: browser.Browser, path: Path, data: bytes, wanted: str) -> object:
    """What the page says of a file."""
    path.write_bytes(data)
    server = _core.ViewServer(path, key=browser.KEY)
    try:
        with chromium.page(320, 180) as page:
            page.call("Page.navigate", url=f"{server.url}?t=1.7")
            until(lambda: page.run("!!(window.ergon && ergon.ready)"), "the page")
            page.run("ergon.ready.catch(() => 0)")
            return page.run(wanted)
    finally:
        server.close()


def test_page_of_bundles_equals_page_of_chunks(chromium: browser.Browser, tmp_path: Path) -> None:
    plain = shown(chromium, tmp_path / "a.motion", DATA, KNOWN)
    assert plain == shown(chromium, tmp_path / "b.motion", bundled(DATA), KNOWN)


def test_page_of_damaged_and_too_long_bundles(chromium: browser.Browser, tmp_path: Path) -> None:
    silence = group(LEVELS, 4, [(3.0, bytes(15 << 20))])
    complete = bundled(DATA)
    ends = {
        "is damaged": (bundle(silence[:200])[:-1],),
        "would unpack to 2147483648 bytes": ((1 << 31).to_bytes(4, "little"),),
        f"would unpack to {len(silence)} bytes": 4 * (bundle(silence),),
        "": (bundle(group(99, 4, [(3.0, bytes(400))])),),
    }
    for words, payloads in ends.items():
        data = complete + b"".join(chunk(BUNDLE, 4.0, payload) for payload in payloads)
        printed = shown(chromium, tmp_path / "a.motion", data, TEXT)
        assert isinstance(printed, str)
        assert words in printed if words else printed == "", printed
        if words:
            assert "the bundle that ends at byte" in printed
