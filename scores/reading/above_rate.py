"""Modes of transposed instruments that lie above half the rate: they are left out.

A mode there cannot be computed at this rate, nor heard. An instrument that is written at one pitch
has them at its higher notes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace

from ergon.instruments import following, proxies
from ergon.instruments.model import Instrument, Module, Target
from ergon.instruments.module_kinds import LINK_KINDS
from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.memory import Memory

ModuleKey = tuple[str, str]  # a part and a module


def without_modes_above(
    instruments: dict[str, Instrument],
    reported_name_by_part: Mapping[str, str],
    used_modules: Iterable[ModuleKey],
    rate: float,
    collector: Collector,
    memory: Memory | None,
) -> dict[str, Instrument]:
    """The instruments without CELs of `reported_name_by_part` ones that lie above half the `rate`,
    and without the links to them; reports N405 for what is left out.

    `reported_name_by_part` are instruments, each with the name under which it is reported. What is
    `used_modules` (struck, automated, joined by other instruments, written at its own pitch) stays,
    and is refused by the engine.
    """
    high_modes_by_name: dict[str, dict[str, float]] = {}
    for instrument_name in reported_name_by_part:
        transposed_instrument = instruments.get(instrument_name)
        if (
            transposed_instrument is not None
            and transposed_instrument.ca_rate is None
            and not transposed_instrument.space
        ):
            high_modes = {
                high_module.name: frequency
                for high_module in transposed_instrument.modules
                if (frequency := _cell_hertz(high_module)) > rate / 2.0
            }
            high_modes_by_name |= {instrument_name: high_modes} if high_modes else {}
    if not high_modes_by_name:
        return instruments
    joined_modules = {*used_modules, *_modules_joined_elsewhere(instruments)}
    thinned_instruments, removed_by_name = dict(instruments), dict[str, list[tuple[str, float]]]()
    for instrument_name, high_modes in high_modes_by_name.items():
        thinned_names = frozenset(
            module for module in high_modes if (instrument_name, module) not in joined_modules
        )
        if (
            thinned_names
            and (
                thinned_instrument := _without_modules(
                    instruments[instrument_name], thinned_names, memory
                )
            )
            is not None
        ):
            thinned_instruments[instrument_name] = thinned_instrument
            named_frequencies = (
                (f"{instrument_name}.{module}", high_modes[module])
                for module in high_modes
                if module in thinned_names
            )
            removed_by_name.setdefault(reported_name_by_part[instrument_name], []).extend(
                named_frequencies
            )
    for instrument_name, removed_modes in removed_by_name.items():
        _report(instrument_name, removed_modes, instruments, rate, collector)
    return thinned_instruments


def _cell_hertz(module: Module) -> float:
    """The frequency of a CEL [Hz]; 0 of what has none."""
    return float(module.fields.get("f") or 0.0) if module.kind == "CEL" else 0.0


def _modules_joined_elsewhere(instruments: Mapping[str, Instrument]) -> Iterator[ModuleKey]:
    """The modules that other instruments join, and those that something follows."""
    for entry_name, instrument in instruments.items():
        for module in instrument.modules:
            for target in _module_ends(module):
                if target.part != entry_name or module.kind not in LINK_KINDS:
                    yield target.part, target.module


def _module_ends(module: Module) -> list[Target]:
    end_targets = [end for end in module.fields.get("between", ()) if isinstance(end, Target)]
    end_targets += following.targets(module)
    return end_targets + (proxies.targets(module.fields) if module.kind == "PROXY" else [])


def _without_modules(
    instrument: Instrument, removed_names: Collection[str], memory: Memory | None
) -> Instrument | None:
    """An instrument without some modules; None if an output would have nothing left to hear."""
    memory_key = f"thinner {instrument.name}"
    old_entry = None if memory is None else memory.held(memory_key, removed_names)
    if old_entry is not None and old_entry[0] is instrument:
        return old_entry[1]  # type: ignore[no-any-return]

    def is_remaining(target: Target) -> bool:
        return target.part != instrument.name or target.module not in removed_names

    remaining_modules = tuple(
        module
        for module in instrument.modules
        if module.name not in removed_names and all(map(is_remaining, _module_ends(module)))
    )
    remaining_outputs = tuple(
        replace(output, targets=tuple(filter(is_remaining, output.targets)))
        for output in instrument.outputs
    )
    if not all(output.targets for output in remaining_outputs):
        return None
    thinned_instrument = replace(instrument, modules=remaining_modules, outputs=remaining_outputs)
    if memory is not None:
        memory.hold(memory_key, removed_names, (instrument, thinned_instrument))
    return thinned_instrument


def _report(
    instrument_name: str,
    removed_modes: list[tuple[str, float]],
    instruments: Mapping[str, Instrument],
    rate: float,
    collector: Collector,
) -> None:
    lowest_name, frequency = min(removed_modes, key=lambda mode: mode[1])
    part_name = lowest_name.rpartition(".")[0]
    count_text = "1 mode lies" if len(removed_modes) == 1 else f"{len(removed_modes)} modes lie"
    message = (
        f"instrument {quote(instrument_name)}: {count_text} above half the rate of {rate:g} Hz and "
        f"{'is' if len(removed_modes) == 1 else 'are'} left out, the lowest of them "
        f"{lowest_name} at "
        f"{frequency / 1e3:.3g} kHz"
    )
    collector.error("N405", message, instruments[part_name].place)
