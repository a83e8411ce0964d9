"""What an entry of automation changes: a parameter of a part, or of all notes of an instrument."""

from __future__ import annotations

from dataclasses import replace

from ergon.instruments.model import Target
from ergon.instruments.module_kinds import KINDS
from ergon.instruments.names import PartNames
from ergon.notation.tables import tuning
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import Name
from ergon.notation.text.errors import quote
from ergon.scores.reading import automatable, automation
from ergon.scores.reading.automatable import Automatable
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.matter import PartsReader
from ergon.scores.reading.midi_uses import MidiUses
from ergon.scores.reading.piece import Strikes

ModuleKey = tuple[str, str]  # a part and a module in it; "": the part as a whole


class AutomationTargets:
    """Reads entries of automation for the parts of a score."""

    def __init__(self, parts: PartsReader, part_names: PartNames, midi_uses: MidiUses) -> None:
        """Take the parts, and the MIDI files of the score."""
        self.parts = parts
        self.midi_uses = midi_uses
        self.part_names = part_names
        self.collector = part_names.collector

    def read(self, values: object) -> Automation | None:
        """What an entry means; None if an error was reported."""
        if not isinstance(values, Values) or not automation.has_required_fields(values):
            return None
        target_name = values["set"] or values["lfo"]
        module_path, _, parameter_name = str(target_name).rpartition(".")
        is_family = (
            parameter_name in automatable.ALL_PARAMETERS
            and self.part_names.family_and_rest(module_path) is not None
        )
        if is_family:
            target_modules = self._played_notes(Name(module_path, target_name.place))
        else:
            changed_module = self._changed_module(target_name, module_path, parameter_name)
            target_modules = [] if changed_module is None else [changed_module]
        if not target_modules or not self._may_change(
            target_modules[0], target_name, module_path, parameter_name
        ):
            return None
        read_amount = automatable.reader(
            target_modules[0].module, parameter_name, is_one_of_many=is_family
        )
        first_target, *other_targets = (
            Target(note_module.part, note_module.module.name, 0, 1, module_path, target_name.place)
            for note_module in target_modules
        )
        with tuning.used(self.part_names.tuning_of(first_target.part)):
            automation_entry = automation.build_automation(
                values, first_target, parameter_name, read_amount, self.midi_uses
            )
        return automation_entry and replace(automation_entry, other_notes=tuple(other_targets))

    def modules(self, automation_entry: Automation, _: Values) -> tuple[ModuleKey, ...] | None:
        """The modules on which the meaning of an entry depends; None if it depends on which notes
        of an instrument a piece plays, or on a file.
        """
        if (
            automation_entry.moves
            or self.part_names.family_and_rest(automation_entry.target.text) is not None
        ):
            return None
        return automation_entry.modules

    def check_glides(self, glided_strikes: Strikes) -> None:
        """Report an instrument whose pitch a wheel cannot move."""
        for glide in glided_strikes.glides:
            glided_part = glide.target.part
            automatable_module = automatable.named_module(glided_part, {}, self.parts.instruments)
            refusal_text = "has no pitch of its own; write its `f`"
            if automatable_module is not None:
                refusal_text = (
                    automatable.refusal(
                        automatable_module.module, "f", is_ca=automatable_module.is_ca
                    )
                    or ""
                )
            if refusal_text:
                message = (
                    f"strikes {quote(glided_strikes.name)}: the pitch wheel cannot move "
                    f"{glided_part}: it "
                )
                message += f"{refusal_text}; or remove `bend` of the take"
                self.collector.error("E304", message, glide.target.place)
                return

    def _played_notes(self, module_path: Name) -> list[Automatable]:
        """The notes of an instrument that the piece plays, or a module of each; reports an
        instrument of which it plays none.
        """
        names, instruments = self.part_names.member_names(module_path), self.parts.instruments
        candidates = (automatable.named_module(str(name), {}, instruments) for name in names)
        played_modules = [
            automatable_module
            for automatable_module in candidates
            if automatable_module is not None
        ]
        if not played_modules:
            problem = (
                f"automation: the piece plays no note of {quote(module_path)}, or the notes "
                "have no "
            )
            message = f"{problem}such module; write an instrument that is struck, or a module of it"
            self.collector.error("E304", message, module_path.place)
        return played_modules

    def _changed_module(self, name: Name, module_path: str, parameter: str) -> Automatable | None:
        """The module of a name; reports a name without one."""
        keys_by_name, instruments = self.parts.keys, self.parts.instruments
        automatable_module = automatable.named_module(module_path, keys_by_name, instruments)
        if automatable_module is None and module_path and parameter in automatable.ALL_PARAMETERS:
            # Find the target of `module_path`, or report what is wrong with it.
            module_target = self.part_names.target(
                Name(module_path, name.place), "mat", "automation"
            )
            if module_target is None:
                return None
            path = f"{module_target.part}.{module_target.module}".rstrip(".")
            automatable_module = automatable.named_module(path, keys_by_name, instruments)
            if (
                automatable_module is not None
                and KINDS[automatable_module.module.kind].family == "generator"
            ):
                message = (
                    f"automation: {quote(module_path)} is a member; its body changes as a whole"
                )
                self.collector.error("E304", message, name.place)
                return None
        if automatable_module is None:
            words = ", ".join(automatable.ALL_PARAMETERS)
            message = f"automation: {quote(name)} is not a parameter that changes ({words})"
            self.collector.error("E301", message, name.place, help=_level_help(name))
        return automatable_module

    def _may_change(
        self, automatable_module: Automatable, target_name: Name, module_path: str, parameter: str
    ) -> bool:
        """Whether a parameter of a module may change; reports why not."""
        refusal_text = automatable.refusal(
            automatable_module.module, parameter, is_ca=automatable_module.is_ca
        )
        if refusal_text:
            message = f"automation: {quote(module_path)} {refusal_text}"
            self.collector.error("E304", message, target_name.place, help=_level_help(target_name))
        return not refusal_text


def _level_help(name: str) -> str | None:
    """Help for automation that was asked to change a level; None for other names."""
    if "gain" not in str(name).replace(".", " ").split():
        return None
    return "to change a level over time, use `fade` of its route: fade: [{at: 1|1, gain: 0dB}, …]"
