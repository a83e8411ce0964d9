"""`ergon metrology`: what a real key is made of."""

from __future__ import annotations

import click

from .lazy import LazyGroup, Table

COMMANDS: Table = {
    "measure": ("metrology_measure", "measure", "Measure a key of a device by pushing it."),
    "fit": ("metrology_fit", "fit", "Measure a key by takes of the forces that it was given."),
    "replay": ("metrology_replay", "replay", "Give a key and its model the same gesture."),
    "compare": ("metrology_compare", "compare", "Compare two calibrations of keys."),
    "log": ("metrology_compare", "log", "List calibrations of a key, and how far it drifted."),
    "weigh": ("metrology_compare", "weigh", "Find a device's gains by a weighed mass."),
}


class _MetrologyGroup(LazyGroup):
    """A group whose first word may be a device; the command is `measure` then."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Resolve a command; a URL, or a name in the user's list of devices, means `measure`."""
        if args[0] not in self.table and (":" in args[0] or _is_named(args[0])):
            args = ["measure", *args]
        return super().resolve_command(ctx, args)


def _is_named(device_word: str) -> bool:
    """Whether a word names a device of the user's list, also with an axis: tgr0.3."""
    from ergon.live.boards import BoardError, device_urls

    try:
        return device_word.partition(".")[0] in device_urls()
    except BoardError:
        return False


@click.group(cls=_MetrologyGroup, table=COMMANDS)
def metrology() -> None:
    """Measure what a real key is made of.

    `ergon metrology DEVICE -o FILE` measures a key of a device.
    """
