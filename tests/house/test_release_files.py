"""What is made for a release: addresses, manual pages, the citation, the extension of VS Code."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import click
import pytest
import yaml

from docs.generators.man import commands, pages
from docs.generators.release_links import with_absolute_links, with_urls
from ergon.cli.app import group

ROOT = Path(__file__).parents[2]
ADDRESS = "https://example.org/a/ergon"


def version() -> str:
    manifest = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))
    return str(manifest["workspace"]["package"]["version"])


def test_release_writes_urls_of_its_repository():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    before, after = tomllib.loads(text), tomllib.loads(with_urls(text, ADDRESS))
    urls = after["project"].pop("urls")
    assert urls["Source"] == ADDRESS
    assert set(urls) == {"Source", "Issues", "Changelog", "Documentation"}
    assert after == before
    with pytest.raises(ValueError, match="already"):
        with_urls(with_urls(text, ADDRESS), ADDRESS)


def test_readme_of_a_release_has_no_relative_link():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    relative = re.findall(r"\]\((?!https?:|#)([^)]+)\)", text)
    assert len(relative) > 20
    absolute = with_absolute_links(text, ADDRESS, "v1.2.3")
    assert re.findall(r"\]\((?!https?:|#)([^)]+)\)", absolute) == []
    assert f"]({ADDRESS}/raw/v1.2.3/docs/pictures/galaxy.webp)" in absolute
    assert f"]({ADDRESS}/blob/v1.2.3/docs/install.md)" in absolute
    for path in relative:
        assert (ROOT / path.partition("#")[0]).exists(), path


def test_citation_names_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert citation["version"] == version()
    assert citation["authors"]
    assert {"title", "message", "type", "license"} <= set(citation)


def test_manual_pages_have_every_command_and_option():
    written = pages()
    listed = list(commands(("ergon",), group))
    assert len(written) == len(listed) > 50
    for words, command in listed:
        text = written[f"{'-'.join(words)}.1"].replace("\\-", "-").replace("\\e", "\\")
        assert text.startswith(".TH ")
        for param in command.get_params(click.Context(command, **group.context_settings)):
            if isinstance(param, click.Option) and not param.hidden:
                assert all(option in text for option in param.opts), (words, param.opts)


def test_vscode_extension_package_fields_and_icon():
    folder = ROOT / "editors" / "vscode"
    package = json.loads((folder / "package.json").read_text(encoding="utf-8"))
    lock = json.loads((folder / "package-lock.json").read_text(encoding="utf-8"))
    assert package["version"] == lock["version"] == version()
    assert lock["packages"][""]["dependencies"] == package["dependencies"]
    icon = (folder / package["icon"]).read_bytes()
    assert icon[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(icon[16:20]) == int.from_bytes(icon[20:24]) == 256
    assert (folder / "README.md").exists()
    job = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"]["extension"]
    assert {"run": "make vsix"} in job["steps"]
