"""Keys whose motors are late: whether a link on such a key can make it swing up by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ergon.notation.text.errors import quote

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ergon.instruments.model import Module, Target
    from ergon.notation.text.errors import Collector
    from ergon.scores.reading.piece import Piece
    from ergon.scores.reading.playing import Key


def links_on_keys(piece: Piece) -> Iterator[tuple[str, Target, Module]]:
    """The links of instruments and couplings that end on keys: the link's part, its end, itself."""
    for instrument_name, instrument in piece.instruments.items():
        for part_module in instrument.modules:
            for link_end in part_module.ends:
                if link_end.part in piece.keys:
                    yield instrument_name, link_end, part_module
    for coupling in piece.duet:
        for link_end in (coupling.a, coupling.b):
            yield "duet", link_end, coupling.link


def check_delays(piece: Piece, collector: Collector) -> None:
    """Warn of keys that a spring K on them can make swing (W336): by a delay it takes K·delay of
    their damping (J. E. Colgate and J. M. Brown, ICRA 1994).
    """
    stiffest_by_key: dict[str, tuple[float, str]] = {}
    for part_name, end, part_module in links_on_keys(piece):
        key, stiffness = piece.keys[end.part], part_module.fields.get("K")
        if key.delay and end.module == key.struck and isinstance(stiffness, float):
            stiffness_and_name = stiffness * key.reach**2, f"{part_name}.{part_module.name}"
            stiffest_by_key[key.name] = max(
                stiffness_and_name, stiffest_by_key.get(key.name, stiffness_and_name)
            )
    for key_name, (stiffness, stiffest_link) in stiffest_by_key.items():
        delayed_key = piece.keys[key_name]
        damping = _ground_damping(delayed_key)
        if damping is None or stiffness * delayed_key.delay <= damping:
            continue
        delay_text = f"{1e3 * delayed_key.delay:g} ms"
        message = (
            f"{quote(key_name)}: the forces of the piece reach this key {delay_text} late; so the "
            f"spring of {stiffness:,.0f} N/m of {quote(stiffest_link)} removes "
            f"{stiffness * delayed_key.delay:.2g} Ns/m of the damping of the key, {damping:.2g} "
            "Ns/m, and the key may begin to swing by itself"
        )
        stiffness_bound = damping / delayed_key.delay
        help_text = (
            f"keep K below {stiffness_bound:,.0f} N/m, raise Z of the key, or write `delay: "
            "0s` there"
        )
        collector.error("W336", message, delayed_key.place, help=help_text)


def _ground_damping(key: Key) -> float | None:
    """The damping of the struck mass to the ground [N·s/m], if it is written."""
    struck_module = next(module for module in key.modules if module.name == key.struck)
    damping = struck_module.fields.get("Z")
    return damping if isinstance(damping, float) else None
