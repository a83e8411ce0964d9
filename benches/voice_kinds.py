"""Which models of other programs are of the same kind as an instrument."""

from __future__ import annotations

from benches.voice_scores import Instrument

# Csound's opcodes and models of Faust's pm.lib, by file, or by file and name where others of the
# file differ. `mode` stands for as many oscillators as the instrument has. What is not named here
# has nothing of its kind: plates that bend, doors, coils.
_KINDS: dict[str, tuple[list[str], list[str]]] = {
    "bells": (["mode"], ["churchBell"]),
    "bells/bowl": (["mode"], []),
    "bells/glass": (["mode"], []),
    "bell": (["mode"], ["churchBell"]),
    "bars": (["mode", "barmodel"], ["marimba"]),
    "strings": (["prepiano"], []),
    "string": (["prepiano"], []),
    "plucked": (["pluck"], ["ks", "guitar"]),
    "skins/timpani": (["mode"], ["djembe"]),
    "skins/tabla": (["mode"], ["djembe"]),
    "skins": ([], ["djembe"]),
    "friction/viol": (["wgbow"], ["violinModel"]),
    "friction/reed": (["wgclar"], ["clarinetModel"]),
    "winds/clarinet": (["wgclar"], ["clarinetModel"]),
    "bowed": (["wgbow"], ["violinModel"]),
    "found": (["mode"], []),
    "found/spring": ([], []),
    "banks": (["mode"], []),
    "bank": (["mode"], []),
    "bank/sky": ([], []),  # the scene `bank` has its ten thousand
}


def kinds(instrument: Instrument, oscillators: int) -> dict[str, list[str]]:
    """The models of each program that are of the instrument's kind."""
    file, name = instrument.file, instrument.name
    opcodes, models = _KINDS.get(f"{file}/{name}", _KINDS.get(file, ([], [])))
    counted = [f"mode × {oscillators}" if opcode == "mode" else opcode for opcode in opcodes]
    return {"Csound": counted, "Faust": [f"pm.{model}" for model in models]}
