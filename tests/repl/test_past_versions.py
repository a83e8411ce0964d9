"""Earlier versions keep their texts as differences, and give them back as they were."""

import random

import pytest

from ergon.repl.session.past_versions import PastVersionStore, difference
from ergon.repl.session.version import Faders, PastVersion
from ergon.scores.edits.texts import Texts


def drawn_texts(seed: int, n_texts: int) -> list[str]:
    """Texts of a score that grows and changes, some of them several times in a row."""
    chance, texts = random.Random(seed), ["ergon: 1\n"]
    for _ in range(n_texts - 1):
        text = texts[-1]
        first = chance.randint(0, len(text))
        last = min(len(text), first + chance.choice([0, 0, 0, 3, 20]))
        new = "".join(chance.choice("ab é|\r\n") for _ in range(chance.choice([0, 1, 9, 40])))
        texts.append(text[:first] + new + text[last:])
    return texts


@pytest.mark.parametrize("seed", range(20))
def test_past_version_texts_in_random_order(seed):
    texts, store = drawn_texts(seed, 120), PastVersionStore()
    for number, text in enumerate(texts):
        store[number] = PastVersion(number, f"line {number}", Texts("s.yaml", text), Faders(), {})
    del store[3]
    numbers = [number for number in range(120) if number != 3]
    random.Random(seed).shuffle(numbers)
    assert all(store[number].texts.text == texts[number] for number in numbers)
    assert [*store] == sorted(numbers)


def test_past_version_replaced_by_another():
    store = PastVersionStore()
    for text in ("one", "other"):
        store[7] = PastVersion(7, text, Texts("s.yaml", text), Faders(), {})
    assert (store[7].line, store[7].texts.text) == ("other", "other")


def test_rebase_keeps_texts():
    store = PastVersionStore()
    store[0] = PastVersion(0, "", Texts("s.yaml", "ergon: 1"), Faders(), {}, renames=(("a", "b"),))
    base = Texts("s.yaml", "saved")
    store.rebase(base)
    assert (store[0].texts.text, store[0].file_texts, store[0].renames) == ("ergon: 1", base, ())


@pytest.mark.parametrize(
    ("before", "now", "expected"),
    [
        ("", "", (0, 0, "")),
        ("abc", "abc", (3, 3, "")),
        ("abc", "abxc", (2, 2, "x")),
        ("aaa", "aa", (2, 3, "")),
        ("", "new", (0, 0, "new")),
        ("old", "", (0, 3, "")),
        ("same head, tail", "same head! tail", (9, 10, "!")),
    ],
)
def test_difference_between_two_texts(before, now, expected):
    assert difference(before, now) == expected


def test_past_version_memory_with_growing_text():
    store, text = PastVersionStore(), "x" * 100_000
    for number in range(640):
        text += f"{number} "
        store[number] = PastVersion(number, "", Texts("s.yaml", text), Faders(), {})
    packed = {id(text): text for _, text in store._versions.values()}.values()
    assert sum(len(text.compressed) + len(text.replacement) for text in packed) < 50_000
