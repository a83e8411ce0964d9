"""Addresses of a release: what the checkout cannot know before it is published somewhere.

python -m docs.generators.release_links https://github.com/OWNER/NAME v0.2.0

writes [project.urls] into pyproject.toml, and makes the links and pictures of README.md lead to the
files of that version, so that they open on the package index. The release workflow calls it.
"""

from __future__ import annotations

import re
from pathlib import Path

from ergon.common.module_arguments import module_arguments

ROOT = Path(__file__).resolve().parents[2]
_LINK = re.compile(r"(!?)(\[[^\]]*\])\((?!https?:|#)([^)\s]+)\)")
_BEFORE = "[project.scripts]\n"


def with_urls(pyproject: str, repository: str) -> str:
    """The text of pyproject.toml with the addresses of a project. Raises ValueError."""
    if "[project.urls]" in pyproject or pyproject.count(_BEFORE) != 1:
        raise ValueError("pyproject.toml has [project.urls] already, or no [project.scripts]")
    rows = {
        "Source": repository,
        "Issues": f"{repository}/issues",
        "Changelog": f"{repository}/blob/main/CHANGELOG.md",
        "Documentation": f"{repository}/blob/main/docs/README.md",
    }
    table = "".join(f'{name} = "{url}"\n' for name, url in rows.items())
    return pyproject.replace(_BEFORE, f"[project.urls]\n{table}\n{_BEFORE}")


def with_absolute_links(readme: str, repository: str, tag: str) -> str:
    """The text of README.md whose links lead to a version: pages to be read, pictures raw."""

    def absolute(match: re.Match[str]) -> str:
        kind = "raw" if match[1] else "blob"
        return f"{match[1]}{match[2]}({repository}/{kind}/{tag}/{match[3]})"

    return _LINK.sub(absolute, readme)


def main(repository: str, tag: str) -> None:
    """Write both files."""
    pyproject, readme = ROOT / "pyproject.toml", ROOT / "README.md"
    pyproject.write_text(with_urls(pyproject.read_text("utf-8"), repository), "utf-8")
    readme.write_text(with_absolute_links(readme.read_text("utf-8"), repository, tag), "utf-8")


if __name__ == "__main__":
    repository, tag = module_arguments("REPOSITORY", "TAG")
    main(repository.rstrip("/"), tag)
