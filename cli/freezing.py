"""`ergon render --freeze`: parts of a score into a folder, for `ergon play --frozen`."""

from __future__ import annotations

from dataclasses import fields

from ergon.api.freeze import FreezeOptions, PreparedFreeze, prepare, write
from ergon.api.options import FileOptions

from .console import Console, plural
from .outcome import Refused
from .summary import print_finer_steps
from .units import octets_text, seconds_text

_EXCLUDED_OPTIONS = ("from_", "until", "stems", "channels", "bits", "hands")


def freeze_parts(
    console: Console,
    path: str,
    parts_text: str,
    output_path: str | None,
    file_options: FileOptions,
    *,
    is_dry_run: bool,
) -> None:
    """Compute `parts_text`, names with commas or spaces between them, into a folder."""
    for name in _EXCLUDED_OPTIONS:
        if getattr(file_options, name) is not None:
            option = f"--{name.strip('_')}"
            raise Refused(f"--freeze writes whole parts as they are, and excludes {option}")
    if output_path == "-":
        raise Refused("--freeze writes a folder; -o - is stdout")
    part_names = list(dict.fromkeys(filter(None, parts_text.replace(",", " ").split())))
    if not part_names:
        raise Refused("--freeze: name an instrument, or several with commas between them")
    shared_fields = {
        field.name: getattr(file_options, field.name) for field in fields(FreezeOptions)
    }
    freeze_options = FreezeOptions(**shared_fields)
    prepared = prepare(path, part_names, output_path, freeze_options, console)
    if not is_dry_run:
        write(prepared, freeze_options, console)
    _print_summary(console, prepared, is_dry_run=is_dry_run)
    if not is_dry_run:
        print_finer_steps(console, prepared.stage.simulation)


def _print_summary(console: Console, prepared: PreparedFreeze, *, is_dry_run: bool) -> None:
    taps, n_frames = prepared.taps, prepared.n_frames
    n_taps = sum(map(len, taps.values()))
    n_bytes = n_frames * n_taps * 8
    if console.json:
        console.record(
            "would_freeze" if is_dry_run else "frozen",
            folder=str(prepared.folder),
            parts=list(taps),
            frames=n_frames,
            outputs=n_taps,
            disk_bytes=n_bytes,
        )
        return
    holds_word = "would hold" if is_dry_run else "holds"
    length_text, outputs_text = (
        seconds_text(n_frames / prepared.stage.rate),
        plural(n_taps, "output"),
    )
    console.say(
        f"{prepared.folder} {holds_word} {', '.join(taps)}: {length_text}, {outputs_text}, "
        f"{octets_text(n_bytes)}"
    )
    if prepared.stage.fade_start is not None:
        tail_text = seconds_text((n_frames - prepared.stage.fade_start) / prepared.stage.rate)
        console.say(
            f"of this, {tail_text} come after the last event, for the tail of the score is `auto` "
            "and "
            "frozen parts have to last until everything has faded; `render: {tail: 10s}` in the "
            "score makes them shorter"
        )
