"""Edits at the end of a long list read that end alone, and write what an edit of the whole does."""

from __future__ import annotations

import random

import pytest

from ergon.notation.text import edit
from ergon.notation.text.document import Document
from ergon.scores.edits.texts import ListEdit, Texts

HEADS = ("", "ergon: 1\n", "# a remark\nergon: 1\r\n")
TAILS = ("", "mix: {channels: 2}\n", "\n# the end\n")


def listed(chance: random.Random, n_items: int) -> str:
    """A section `parts` with lists of several styles, or all in braces."""
    if chance.random() < 0.25:
        lists = (
            f"{name}: [" + ", ".join(f"{{at: {n}|1, play: p{n}}}" for n in range(n_items)) + "]"
            for name in ("ada", "leo", "'mia'")
        )
        return f"parts: {{{', '.join(lists)}}}" + chance.choice(["", "   # who plays"]) + "\n"
    message = ["parts:" + chance.choice(["", "   # who plays"])]
    for name in ("ada", "leo", "'mia'"):
        style = chance.choice(["block", "flow", "spread", "lines"])
        items = [f"{{at: {n}|1, play: p{n}}}" for n in range(n_items)]
        if style == "flow":
            message.append(f"  {name}: [{', '.join(items)}]")
        elif style == "spread":
            message.append(f"  {name}: [" + ",\n    ".join(items) + "]  # spread")
        elif style == "block":
            message.append(f"  {name}:")
            for item in items:
                message += ["    # a remark of its own"] * chance.choice([0, 0, 1])
                message.append(f"    - {item}" + chance.choice(["", "   # said", " "]))
        else:
            message.append(f"  {name}:  # by lines")
            message += [f"  - at: {n}|1\n    play: p{n}\n" for n in range(n_items)]
    return "\n".join(message) + "\n"


@pytest.mark.parametrize("seed", range(120))
def test_windowed_edit_of_list_end_equals_complete_edit(seed: int):
    chance = random.Random(seed)
    text = chance.choice(HEADS) + listed(chance, chance.randrange(1, 9)) + chance.choice(TAILS)
    if seed % 3 == 0:
        text = text.replace("\r\n", "\n").replace("\n", "\r\n")
    for _ in range(6):
        texts = Texts("s.yaml", text)
        player = chance.choice(["ada", "leo", "mia"])
        path = ("parts", player)
        n_items = len(edit.tree(edit.read(text, "").root)["parts"][player])
        number = chance.randrange(n_items)
        verb = chance.choice(["put", "append", "remove"] if n_items > 1 else ["put", "append"])
        single = edit.read(text, "s.yaml")
        if verb == "put":
            complete = edit.put(single, (*path, number, "until"), "9|1")
            built = texts.put((*path, number, "until"), "9|1")
        elif verb == "append":
            complete = edit.append(single, path, "{at: 99|1, play: last}")
            built = texts.append(path, "{at: 99|1, play: last}")
        else:
            gone = [(*path, n) for n in sorted({number, chance.randrange(n_items)})][: n_items - 1]
            complete = edit.remove(single, *gone)
            built = texts.remove(*gone)
        assert built.text == complete, verb
        text = complete


def test_edit_of_list_with_aliases():
    text = "parts:\n  ada:\n    - &a {at: 1|1, play: x}\n    - *a\n    - {at: 2|1, play: y}\n"
    built = Texts("s.yaml", text).append(("parts", "ada"), "{at: 3|1, play: z}")
    assert built.text == text + "    - {at: 3|1, play: z}\n"


def test_edit_of_long_list_reads_it_once(monkeypatch: pytest.MonkeyPatch):
    rows = "".join(f"    - {{at: {n}|1, play: x}}\n" for n in range(1, 400))
    texts = Texts("s.yaml", f"ergon: 1\nparts:\n  ada:\n{rows}")
    texts.section("parts")
    read, begun = [], edit.compose

    def counted(text: str, *rest: object):
        read.append(len(text))
        return begun(text, *rest)

    monkeypatch.setattr(edit, "compose", counted)
    built = texts.append(("parts", "ada"), "{at: 400|1, play: y}")
    assert built.text.endswith("    - {at: 400|1, play: y}\n")
    assert sum(read) < 400


def test_edit_of_flow_list_reads_it_only(monkeypatch: pytest.MonkeyPatch):
    items = ", ".join(f"{{at: {n}|1, play: x}}" for n in range(1, 400))
    texts = Texts("s.yaml", f"ergon: 1\nparts: {{ada: [{items}], leo: [{{at: 1|1, play: y}}]}}\n")
    texts.section("parts")
    read, begun = [], edit.compose

    def counted(text: str, *rest: object):
        read.append(len(text))
        return begun(text, *rest)

    monkeypatch.setattr(edit, "compose", counted)
    built = texts.put(("parts", "leo", 0, "until"), "9|1")
    assert built.text.endswith(", leo: [{at: 1|1, play: y, until: 9|1}]}\n")
    assert sum(read) < 200


def edited(player: str, number: int, text: str) -> ListEdit:
    path = ("parts", player)

    def change(own: Document, lacks: int) -> str:
        return edit.put(own, (*path, number - lacks, "until"), text)

    return ListEdit(path, number, change)


@pytest.mark.parametrize("seed", range(40))
def test_joint_edit_of_lists_equals_single_edits(seed: int):
    chance = random.Random(seed)
    n_items = chance.randrange(1, 9)
    together = Texts("s.yaml", listed(chance, n_items))
    each = together
    edits = [edited(name, chance.randrange(n_items), "9|1") for name in ("ada", "leo", "mia")]
    for item in chance.sample(edits, 3):
        each = each.edited_lists([item])
    assert together.edited_lists(edits).text == each.text


@pytest.mark.parametrize("n_gone", [1, 2, 3])
@pytest.mark.parametrize("tail", ["", ", "])
def test_removal_of_last_flow_items_with_commas(n_gone: int, tail: str):
    items = [f"{{at: {n}}}" for n in range(4)]
    text = f"parts:\n  ada: [{', '.join(items)}{tail}]\n"
    gone = [("parts", "ada", n) for n in range(4 - n_gone, 4)]
    built = edit.remove(edit.read(text, ""), *gone)
    assert built == f"parts:\n  ada: [{', '.join(items[: 4 - n_gone])}{tail}]\n"
    more = edit.append(edit.read(built, ""), ("parts", "ada"), "{at: 9}")
    assert edit.tree(edit.read(more, "").root)["parts"]["ada"][-1] == {"at": "9"}


MODULES = """\
instruments:   # all
  bell:
    modules:
      m: {CEL: {M: 2g, f: A3}}  # rings
      b:
        BUT: {between: [k1, m], K: 900N/m}
    out: {SOX: m}
  gong: {from: gong/plate, f: A1}
"""


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("bell", "modules", "m", "CEL", "M"), "3g"),
        (("bell", "modules", "m", "CEL", "t60"), "2s"),
        (("bell", "modules", "b", "BUT", "K"), "1kN/m"),
        (("bell", "modules", "b", "BUT"), "{between: [k2, m]}"),
        (("bell", "modules", "n"), "{MAS: {M: 1g}}"),
        (("bell", "out"), "{SOX: b}"),
        (("gong", "f"), None),
        (("bell", "modules", "m", "CEL", "f"), None),
        (("bell", "modules", "b"), None),
    ],
)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_line_edit_equals_complete_edit(path, value, newline):
    text = MODULES.replace("\n", newline)
    texts, single = Texts("s.yaml", text), edit.read(text, "s.yaml")
    place = ("instruments", *path)
    if value is None:
        assert texts.remove(place).text == edit.remove(single, place)
    else:
        assert texts.put(place, value).text == edit.put(single, place, value)
