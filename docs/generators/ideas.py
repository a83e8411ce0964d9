"""The page of twelve ideas in four languages, from `ideas.yaml`, with the characters of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from ergon.common.module_arguments import module_arguments

_HEAD = """\
# Twelve ideas in four languages

Made by `make docs` from `docs/generators/ideas.yaml`.

Here are twelve ideas of live coding, in Tidal (Haskell), Sonic Pi (Ruby), Strudel (JavaScript) and
ergon. Each text is complete: entered in its program, it sounds. Each is as short as the pages of
its language write it. Tests type the lines of ergon and check what is played. They run no other
program.

What sounds is not the same. The others play samples and synthesizers. ergon computes drums and bars
that are struck, and a piece begins without any. These lines bring them in. They are typed once, and
are not counted:

"""
_COUNTS = """
## How many characters

All characters are counted but the spaces that begin a line. Where another line follows, the end of
a line is a character.

"""


@dataclass(frozen=True)
class Idea:
    """An idea: its text in each language, or None, and remarks by language."""

    name: str
    texts: dict[str, str | None]
    remarks: dict[str, str]


@dataclass(frozen=True)
class Comparison:
    """Lines that prepare ergon, the languages' names by their keys, and the ideas."""

    preparation: str
    languages: dict[str, str]
    ideas: tuple[Idea, ...]


def read() -> Comparison:
    """`ideas.yaml`.

    Raises ValueError if a language says neither an idea nor why it cannot.
    """
    text = Path(__file__).with_name("ideas.yaml").read_text(encoding="utf-8")
    content: dict[str, Any] = yaml.safe_load(text)
    ideas = []
    for entry in content["ideas"]:
        texts = {key: entry[key] for key in content["languages"]}
        idea = Idea(entry["name"], texts, entry.get("remarks", {}))
        for key, words in texts.items():
            if words is None and key not in idea.remarks:
                raise ValueError(f"{idea.name}: nothing says why {key} cannot")
        ideas.append(idea)
    return Comparison(content["preparation"], content["languages"], tuple(ideas))


def count(text: str) -> int:
    """The characters of a text but the spaces that begin its lines."""
    return len("\n".join(line.lstrip(" ") for line in text.strip().split("\n")))


def ratio(idea: Idea) -> float | None:
    """ergon's characters over Tidal's, or None if one of them cannot say the idea."""
    ours, theirs = idea.texts["ergon"], idea.texts["tidal"]
    return None if ours is None or theirs is None else count(ours) / count(theirs)


def _table(comparison: Comparison) -> Iterator[str]:
    names = comparison.languages.values()
    yield f"| idea | {' | '.join(names)} | ergon / Tidal |"
    yield f"|---|{'---:|' * (len(names) + 1)}"
    for number, idea in enumerate(comparison.ideas, 1):
        counts = ["–" if text is None else str(count(text)) for text in idea.texts.values()]
        share = ratio(idea)
        last = "–" if share is None else f"{share:.2f}"
        yield f"| {number}. {idea.name} | {' | '.join(counts)} | {last} |"


def _section(number: int, idea: Idea, languages: dict[str, str]) -> Iterator[str]:
    yield f"\n## {number}. {idea.name}"
    for key, name in languages.items():
        remark = f": {idea.remarks[key]}" if key in idea.remarks else ""
        text = idea.texts[key]
        if text is None:
            yield f"\n{name} does not say it{remark}"
        else:
            yield f"\n{name}{remark}\n\n```text\n{text}\n```"


def page() -> str:
    """The page, as Markdown."""
    comparison = read()
    lines = list(_table(comparison))
    for number, idea in enumerate(comparison.ideas, 1):
        lines += _section(number, idea, comparison.languages)
    first = f"```text\n{comparison.preparation}\n```\n"
    return _HEAD + first + _COUNTS + "\n".join(lines) + "\n"


def main() -> None:
    """Write the page to the path that stands on the command line."""
    Path(module_arguments("PAGE")[0]).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
