"""Keys in the addresses of pages."""

import re
import stat
from pathlib import Path

import pytest

from ergon.api import pages
from ergon.api.pages import serve
from ergon.common.report import Report

KEY = re.compile(r"http://127\.0\.0\.1:\d+/([0-9a-f]{32})/")


@pytest.fixture(autouse=True)
def runtime(short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    return short_folder


def key(host: str) -> str:
    """The key of a server that is begun and ended."""
    server = serve(host, "at", Report())
    match = KEY.fullmatch(server.url)
    server.close()
    assert match is not None
    return match[1]


def test_page_key_of_fixed_port_persists_per_user(runtime: Path) -> None:
    first = pages._local_key("127.0.0.1:8080")
    assert first == pages._local_key("127.0.0.1:8080")
    assert first != pages._local_key("127.0.0.1:8081")
    secret = runtime / "ergon" / "view.key"
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    assert stat.S_IMODE(secret.parent.stat().st_mode) == 0o700
    secret.chmod(0o622)  # somebody else may know what is in it
    assert first != pages._local_key("127.0.0.1:8080") != pages._local_key("127.0.0.1:8080")


@pytest.mark.parametrize("at", [pages.ANY_LOCAL_PORT, "localhost:0", "0.0.0.0:0"])
def test_page_key_new_on_each_call(at: str) -> None:
    assert key(at) != key(at)
