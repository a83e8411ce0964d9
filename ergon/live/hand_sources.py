"""What devices could be in a piece, and the sources of a hand that this machine has."""

from __future__ import annotations

from dataclasses import dataclass

from .boards import POINTER_KINDS
from .midi_ports import MidiError, input_names
from .pointer_address import OSC_PORT
from .pointer_gamepad import gamepads

# The meaning of each use.
USES = {
    "input": "its values set parameters and strike",
    "hand": "it moves a player's key, which a hand does not feel (--live)",
    "force": "a hand on it feels the key (--live), or a part drives it (--drive)",
}
_USES_BY_KIND = {"midi": ("input", "hand"), "osc": ("input", "hand")}


def uses_of(url: str) -> tuple[str, ...]:
    """What a device could be, by its URL: words of `USES`."""
    kind = url.partition(":")[0]
    return _USES_BY_KIND.get(kind, ("hand",) if kind in POINTER_KINDS else ("force",))


@dataclass(frozen=True, slots=True)
class HandSource:
    """A source of positions without a force: its kind, a URL that plays it, and what it is."""

    kind: str
    url: str
    name: str

    @property
    def uses(self) -> tuple[str, ...]:
        """What it could be: words of `USES`."""
        return uses_of(self.url)


def hand_sources() -> list[HandSource]:
    """Sources of a hand on this machine; opens none."""
    sources = [
        HandSource("page", "page:", "a pointer, pen or finger on the page of `--view`"),
        HandSource("keys", "keys:", "letters of this computer's keyboard, on that page"),
        HandSource("osc", "osc:/x", f"messages to port {OSC_PORT} of this machine"),
    ]
    for path in gamepads():
        name = f"{path.name}, which rumbles by the force"
        sources.append(HandSource("gamepad", f"gamepad:ly?in={path}", name))
    try:
        midi_names = input_names()
    except MidiError as error:
        return [*sources, HandSource("midi", "midi:cc2", str(error))]
    urls_and_names = [(f"midi:cc2?in={name}", name) for name in midi_names]
    return [*sources, *(HandSource("midi", url, name) for url, name in urls_and_names)]
