"""Makes the mix of a piece, its loudspeakers, its file and the limits of its planner."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from ergon.common.sound_files import find_ending_mistake, with_wave_suffix
from ergon.instruments.model import Layout
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import MISSING, Context
from ergon.notation.text.files import Files
from ergon.notation.text.values import Place
from ergon.scores.reading import mixing, tones
from ergon.scores.reading.build import has_single
from ergon.scores.reading.measured_tables import LAYOUT_RECORD
from ergon.scores.reading.mix_tables import MAX_CHANNELS
from ergon.scores.reading.outputs import Accuracy, Master, Mix, RenderSpec, Route
from ergon.space import directions

_BITS_BY_WORD: dict[str, Literal[16, 24, "float"]] = {"16": 16, "24": 24, "float": "float"}


def layout(name: str, folder: Path, asked_place: Place, files: Files) -> Layout | None:
    """The loudspeakers of a layout file; None if an error was reported."""
    document = files.required(name, folder, asked_place)
    if document is None or document.root is None:
        return None
    layout_values = LAYOUT_RECORD.read(document.root, "", Context(files.collector, "a layout"))
    if layout_values is MISSING:
        return None
    speakers = tuple(
        _speaker(speaker) for speaker in layout_values["speakers"] if speaker is not MISSING
    )
    is_equidistant = layout_values["project"] == "equidistant"
    outputs = _loudspeaker_outputs(layout_values, len(layout_values["speakers"]))
    return Layout(
        Path(document.file), speakers, is_equidistant, layout_values["title"] or "", outputs
    )


def _loudspeaker_outputs(layout_values: Values, n_speakers: int) -> tuple[int, ...]:
    """The output of each loudspeaker; empty where they follow one another."""
    output_numbers = tuple(
        output for output in layout_values["outputs"] or () if output is not MISSING
    )
    repeated_outputs = sorted(
        {output for output in output_numbers if output_numbers.count(output) > 1}
    )
    if output_numbers and len(output_numbers) != n_speakers:
        message = f"there are {len(output_numbers)} outputs for {n_speakers} loudspeakers"
        layout_values.error("E104", message, "outputs")
        return ()
    if repeated_outputs:
        layout_values.error(
            "E111", f"two loudspeakers are at the output {repeated_outputs[0]}", "outputs"
        )
        return ()
    return () if output_numbers == tuple(range(1, n_speakers + 1)) else output_numbers


def _speaker(speaker_values: Values | tuple[float, ...]) -> tuple[float, float, float]:
    if isinstance(speaker_values, Values):
        return directions.point(speaker_values["az"], speaker_values["el"], speaker_values["r"])
    x, y, *z = speaker_values
    return x, y, z[0] if z else 0.0


def mix(section_values: Values | None, files: Files) -> Mix:
    """The mix; without a `mix` section every output has a channel of its own."""
    if section_values is None:
        return Mix(0, None, (), None, None)
    folder = section_values.node.document.folder
    speaker_layout = None
    if section_values["layout"] is not None:
        speaker_layout = layout(
            section_values["layout"], folder, section_values.place_of("layout"), files
        )
    routes = tuple(_route(route) for route in section_values["route"] or ())
    rooms = mixing.rooms(section_values["rooms"])
    refused_rooms = {*(section_values["rooms"] or {})} - {mix_room.name for mix_room in rooms}
    routes = tuple(_without_sends(route, refused_rooms) for route in routes)
    route_channels = [*(r.to for r in routes if r.to != "nearest"), *(r.to for r in rooms if r.to)]
    highest_channel = max(map(max, route_channels), default=0)
    n_outputs = speaker_layout.n_channels if speaker_layout else 0
    n_channels = section_values["channels"] or max(highest_channel, n_outputs)
    if n_outputs > MAX_CHANNELS:
        message = f"the layout has output {n_outputs}; a mix has at most {MAX_CHANNELS} channels"
        section_values.error("E202", message, "layout")
    for route in routes:
        if route.to == "nearest":
            if speaker_layout is None:
                message = f"{route.part}: `nearest` needs a layout in the mix"
                section_values.context.error("E103", message, route.place)
        elif max(route.to) > n_channels:
            message = f"channel {max(route.to)} does not exist; the mix has {n_channels}"
            section_values.context.error("E202", message, route.place)
        if route.is_panned and (route.to == "nearest" or len(set(route.to)) != 2):
            message = f"{route.part}: `pan` lies between two channels, such as `to: [1, 2]`"
            section_values.context.error("E103", message, route.place)
    for room_entry in rooms:
        last_channel = max(room_entry.to, default=0)
        if last_channel > n_channels:
            message = f"channel {last_channel} does not exist; the mix has {n_channels}"
            section_values.context.error("E202", message, room_entry.place)
    if speaker_layout is not None and section_values.written("channels") and n_outputs > n_channels:
        message = f"the layout has {n_outputs} loudspeakers, but the mix has {n_channels} channels"
        if speaker_layout.outputs:
            message = f"the layout has output {n_outputs}, but the mix has {n_channels} channels"
        section_values.error("E202", message, "channels")
    master = section_values["master"]
    master_of_mix = None
    if isinstance(master, Values):
        master_values = master
        fade = mixing.fade_points(master_values["fade"])
        master_of_mix = Master(
            master_values["normalise"],
            master_values["limit"],
            master_values["gain"],
            master_values.node.place,
            fade,
            master_values["reference"],
            master_values["loudness"],
        )
        if master_values["loudness"] is not None and master_values["normalise"] is not None:
            message = (
                f"{master_values.context.label('loudness')}: the level of the sum is said twice; "
            )
            master_values.error("E111", message + "remove `normalise` or `loudness`", "loudness")
    return Mix(n_channels, speaker_layout, routes, master_of_mix, section_values.place, rooms)


def _without_sends(route: Route, refused_rooms: set[str]) -> Route:
    """A route without what it sends to rooms that were refused: they are not missing too."""
    return replace(route, sends=tuple(send for send in route.sends if send[0] not in refused_rooms))


def _route(values: Values) -> Route:
    route_source = values["from"]
    route_values = values
    return Route(
        route_source,
        None,
        route_values["to"],
        route_values["gain"],
        route_values["highpass"],
        route_source.place,
        mixing.pan_gains(route_values["pan"]),
        mixing.sends(route_values["send"], route_values.nodes.get("send")),
        mixing.fade_points(route_values["fade"]),
        route_values["radiate"],
        route_values["level"],
        None,
        mixing.pan_path(route_values["pan"]),
        tones.tones(route_values),
        tones.echo(route_values),
    )


def accuracy(accuracy_values: Values | None) -> Accuracy:
    """The limits of the planner: one measure of exactness, and work."""
    if accuracy_values is None:
        return Accuracy()
    if (
        accuracy_values.written("method")
        or accuracy_values.written("error")
        or accuracy_values.written("cents")
    ):
        has_single(accuracy_values, ("method",), ("error",), ("cents",))
    if accuracy_values.written("upto") and not accuracy_values.written("cents"):
        accuracy_values.error(
            "E103", f"{accuracy_values.context.label('upto')} needs `cents`", "upto"
        )
    if accuracy_values["guard"] == "off" and accuracy_values["method"] != "ca":
        message = (
            f"{accuracy_values.context.label('guard')}: only `method: ca` steps without a guard"
        )
        accuracy_values.error("E111", message, "guard")
    asked_accuracy = Accuracy(
        *(accuracy_values[name] for name in ("method", "error", "cents", "upto", "cpu"))
    )
    return replace(asked_accuracy, is_unguarded=accuracy_values["guard"] == "off")


def render(render_values: Values | None, files: Files) -> RenderSpec:
    """The file to write; a file outside the folder of the score is reported."""
    if render_values is None:
        return RenderSpec(None, 24, "auto", None, None)
    if render_values["file"] is not None:
        folder, place = render_values.nodes["file"].document.folder, render_values.place_of("file")
        error_label = f"{render_values.context.label('file')}: "
        files.target(render_values["file"], folder, place, error_label)
        if (ending_mistake := find_ending_mistake(render_values["file"])) is not None:
            render_values.error(
                "E201",
                f"{error_label}{ending_mistake}",
                "file",
                suggestion=with_wave_suffix(render_values["file"]),
            )
    bits = _BITS_BY_WORD[render_values["bits"]]
    return RenderSpec(
        render_values["file"],
        bits,
        render_values["tail"],
        render_values["channels"],
        render_values.place,
    )
