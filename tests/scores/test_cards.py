"""Each instrument of the library sounds as its card in docs/instruments says."""

import csv
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import yaml
from sweep import few

from docs.generators.cards import centroid, counted, described, measured, play, score
from ergon.notation.tables.quantities import IMPULSE, quantity

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "instruments"
FAMILIES = described()
CARDS = [(family, name) for family, said in FAMILIES.items() for name in said["cards"]]
with (FOLDER / "cards.csv").open(encoding="utf-8") as file:
    ROWS: dict[str, dict[str, str]] = {row["name"]: row for row in csv.DictReader(file)}
HISSES = ("pebbles", "hat", "triangle", "tambourine")  # stones click, the others hiss


def test_cards_cover_every_instrument_of_families() -> None:
    for family, message in FAMILIES.items():
        text = (ROOT / "instruments" / "library" / f"{family}.yaml").read_text(encoding="utf-8")
        assert list(message["cards"]) == list(yaml.safe_load(text)["instruments"]), family
        page = (FOLDER / f"{family}.md").read_text(encoding="utf-8")
        assert all(f"## {name}\n" in page for name in message["cards"])
    assert list(ROWS) == [name for _, name in CARDS]


@pytest.mark.parametrize("page", [FOLDER / "README.md", ROOT / "README.md"], ids=["docs", "root"])
def test_count_of_instruments_in_pages(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert counted(text, len(ROWS)) == text
    assert counted(text, len(ROWS) + 1) != text


@pytest.mark.parametrize(
    ("family", "name"),
    [
        (family, name)
        for family, entry in FAMILIES.items()
        for name, card in entry["cards"].items()
        if card.get("strike") == "hammer"
    ],
)
def test_hammer_of_a_card_is_played_from_ppp_to_fff(family: str, name: str) -> None:
    text = (ROOT / "instruments" / "library" / f"{family}.yaml").read_text(encoding="utf-8")
    ends = yaml.safe_load(text)["instruments"][name]["play"]["strike"]["impulse"].split("..")
    soft, hard = (quantity(end, IMPULSE) for end in ends)
    written = FAMILIES[family]["cards"][name]["impulse"].split()
    middle = soft * (hard / soft) ** (4 / 7)
    assert [quantity(word, IMPULSE) for word in written] == pytest.approx(
        [soft, middle, hard], rel=0.005
    )


def test_hard_strokes_of_cards_begin_without_click() -> None:
    loud = {
        name: float(ROWS[name]["click"])
        for family, name in CARDS
        if "strike" in FAMILIES[family]["cards"][name]
    }
    assert {name: level for name, level in loud.items() if level > -60.0} == {}


def test_card_pictures_are_small() -> None:
    assert all((FOLDER / f"{name}.svg").stat().st_size < 40_000 for _, name in CARDS)


def test_jawari_centroid_rises_unlike_bare_string() -> None:
    """The centre of its spectrum rises for 0.2 s after the stroke."""
    family = "plucked"
    message = {**FAMILIES[family]["cards"]["jawari"], "impulse": "0.1mNs 0.1mNs 0.1mNs"}
    text = score(family, "jawari", message)
    bare = "{like: jawari, modules: {bridge: {BUT: {gap: 9mm}}}}"
    text = text.replace("  hard: {like: jawari}", f"  hard: {bare}")
    sounds, rate = play(text, 0.4)
    early, late = int(0.06 * rate), int(0.24 * rate)
    shift = [
        centroid(x[late : late + 4096], rate) / centroid(x[early : early + 4096], rate)
        for x in sounds
    ]
    assert shift[1] > 1.5
    assert shift[2] < 1.0


@pytest.mark.parametrize(("family", "name"), few(CARDS, {card[0]: card for card in CARDS}.values()))
def test_instrument_sounds_equal_figures_of_cards(family: str, name: str) -> None:
    text: dict[str, Any] = FAMILIES[family]["cards"][name]
    single = measured(family, name, text).figures
    for key, value in asdict(single).items():
        if isinstance(value, str):
            assert ROWS[name][key] == value
        elif key not in ("treble", "click", "mean_level"):  # those are about what is nearly nothing
            assert value == pytest.approx(float(ROWS[name][key]), rel=0.01, abs=0.5), key
    assert single.mean_level < -55.0  # nearly no mean: it does not push the loudspeaker aside
    assert single.treble < -20.0 or name in HISSES
    assert "strike" not in text or single.click < -60.0
    if "follows" in text:
        assert single.hard >= 2.0 ** text["follows"] * single.soft
    if "reaches" in text:
        assert single.partials >= 20
        assert single.highest >= text["reaches"]
