"""Scores that play voices of an instrument that ships: struck twice a second, rubbed, or blown.

Each instrument is played as its card in docs/instruments says, in the middle strength.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from docs.generators.cards import described

# Files without cards. `sheet` of gong.yaml is left out: nothing says where it is struck.
_WITHOUT_CARDS: dict[str, dict[str, dict[str, str]]] = {
    "bell": {"bell": {"strike": "hammer", "impulse": "10mNs"}},
    "string": {"string": {"strike": "hammer", "impulse": "3mNs"}},
    "bowed": {
        "bowed": {"bow": "string.3", "law": "damping: bow, F: 0.8N, a: 50", "speed": "200"},
        "drone": {},  # a bow whose law moves: it needs no player
        "drawn": {},  # a bow that a take moves
    },
    "gong": {
        "plate": {"strike": "centre", "impulse": "10mNs"},
        "tamtam": {"strike": "mallet", "impulse": "20mNs"},
    },
    "bank": {
        "sky": {"strike": "all", "impulse": "1mNs"},
        "grove": {"strike": "all", "impulse": "0.1mNs"},
        "scale": {"strike": "all", "impulse": "1mNs"},
    },
}


@dataclass(frozen=True, slots=True)
class Instrument:
    """An instrument, the file that has it, and how it is played (fields of a card)."""

    file: str
    name: str
    played: Mapping[str, str]

    @property
    def has_hammer(self) -> bool:
        """Whether a mass of its own strikes it, and rings with nobody."""
        return self.played.get("strike") in ("hammer", "mallet", "drop")


def instruments() -> Iterator[Instrument]:
    """Every instrument that ships and says how it is played."""
    for file, family in described().items():
        for name, card in family["cards"].items():
            yield Instrument(file, name, card)
    for file, cards in _WITHOUT_CARDS.items():
        for name, card in cards.items():
            yield Instrument(file, name, card)


def score(instrument: Instrument, voices: int, seconds: int) -> str:
    """A score in which voices of an instrument, v0 and so on, sound for some seconds."""
    played, names = instrument.played, [f"v{i}" for i in range(voices)]
    lines = ["ergon: 1", f"use: [instruments/{instrument.file}.yaml]", "instruments:"]
    if "bow" in played:
        lines += [f"  {name}: {{like: {instrument.name}, {_hair(played, name)}}}" for name in names]
        lines += _bows(played, names, seconds)
    else:
        lines += [f"  {name}: {{like: {instrument.name}}}" for name in names]
    if "play" in played:
        middle = f"at: 50ms, every: 1, times: {seconds}, impulse: {_middle(played['play'])}"
        lines += ["strikes:", *(f"  s-{name}: {{to: {name}, {middle}}}" for name in names)]
    if "strike" in played:
        lines += ["strikes:", *(_strikes(played, name, seconds) for name in names)]
    tail = 0.5 if played else seconds
    routes = ", ".join(f"{{from: {name}, to: 1}}" for name in names)
    lines += [f"mix: {{channels: 1, route: [{routes}]}}", f"render: {{tail: {tail}s}}"]
    return "\n".join(lines) + "\n"


def _hair(played: Mapping[str, str], name: str) -> str:
    law = f"{{LNL: {{between: [k-{name}, {played['bow']}], {played['law']}}}}}"
    return f"modules: {{hair: {law}}}"


def _bows(played: Mapping[str, str], names: list[str], seconds: int) -> list[str]:
    speed = float(_middle(played["speed"]))
    lines = ["keys:", *(f"  k-{name}: {{M: 200g, K: 0.5N/m, Z: 0.2Ns/m}}" for name in names)]
    lines += ["players:", *(f"  p-{name}: {{key: k-{name}}}" for name in names)]
    lines += ["gestures:", f"  draw: 0mm@0 line {speed * seconds:g}mm@{seconds}s", "parts:"]
    return lines + [f"  p-{name}: [{{at: 0, play: draw, touch: tracked}}]" for name in names]


def _strikes(played: Mapping[str, str], name: str, seconds: int) -> str:
    # Without a tempo a beat lasts a second.
    to = ", ".join(f"{name}.{target}" for target in played["strike"].split())
    when = f"at: 50ms, every: 1/2, times: {2 * seconds}"
    return f"  s-{name}: {{to: [{to}], {when}, impulse: {_middle(played['impulse'])}}}"


def _middle(strengths: str) -> str:
    each = strengths.split()
    return each[len(each) // 2]
