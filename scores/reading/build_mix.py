"""Makes the mix of a piece, its loudspeakers, its file and the limits of its planner."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from ergon.common.sound_files import with_ending, wrong_ending
from ergon.instruments.model import Layout
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import MISSING, Context
from ergon.notation.text.files import Files
from ergon.notation.text.values import Place
from ergon.scores.reading import mixing, tones
from ergon.scores.reading.build import has_single
from ergon.scores.reading.measured_tables import LAYOUT
from ergon.scores.reading.outputs import Accuracy, Master, Mix, RenderSpec, Route
from ergon.space import directions

_BITS: dict[str, Literal[16, 24, "float"]] = {"16": 16, "24": 24, "float": "float"}


def layout(name: str, folder: Path, asked_place: Place, files: Files) -> Layout | None:
    """The loudspeakers of a layout file; None if an error was reported."""
    document = files.required(name, folder, asked_place)
    if document is None or document.root is None:
        return None
    values = LAYOUT.read(document.root, "", Context(files.collector, "a layout"))
    if values is MISSING:
        return None
    speakers = tuple(_speaker(speaker) for speaker in values["speakers"] if speaker is not MISSING)
    is_equidistant = values["project"] == "equidistant"
    outputs = _outputs(values, len(values["speakers"]))
    return Layout(Path(document.file), speakers, is_equidistant, values["title"] or "", outputs)


def _outputs(values: Values, n_speakers: int) -> tuple[int, ...]:
    """The output of each loudspeaker; empty where they follow one another."""
    outputs = tuple(output for output in values["outputs"] or () if output is not MISSING)
    doubled = sorted({output for output in outputs if outputs.count(output) > 1})
    if outputs and len(outputs) != n_speakers:
        message = f"there are {len(outputs)} outputs for {n_speakers} loudspeakers"
        values.error("E104", message, "outputs")
        return ()
    if doubled:
        values.error("E111", f"two loudspeakers are at the output {doubled[0]}", "outputs")
        return ()
    return () if outputs == tuple(range(1, n_speakers + 1)) else outputs


def _speaker(speaker_values: Values | tuple[float, ...]) -> tuple[float, float, float]:
    if isinstance(speaker_values, Values):
        return directions.point(speaker_values["az"], speaker_values["el"], speaker_values["r"])
    x, y, *z = speaker_values
    return x, y, z[0] if z else 0.0


def mix(values: Values | None, files: Files) -> Mix:
    """The mix; without a `mix` section every output has a channel of its own."""
    if values is None:
        return Mix(0, None, (), None, None)
    folder = values.node.document.folder
    room = None
    if values["layout"] is not None:
        room = layout(values["layout"], folder, values.place_of("layout"), files)
    routes = tuple(_route(route) for route in values["route"] or ())
    rooms = mixing.rooms(values["rooms"])
    refused = {*(values["rooms"] or {})} - {mix_room.name for mix_room in rooms}
    routes = tuple(_without_sends(route, refused) for route in routes)
    route_channels = [*(r.to for r in routes if r.to != "nearest"), *(r.to for r in rooms if r.to)]
    highest = max(map(max, route_channels), default=0)
    outputs = room.n_channels if room else 0
    channels = values["channels"] or max(highest, outputs)
    for route in routes:
        if route.to == "nearest":
            if room is None:
                message = f"{route.part}: `nearest` needs a layout in the mix"
                values.context.error("E103", message, route.place)
        elif max(route.to) > channels:
            message = f"channel {max(route.to)} does not exist; the mix has {channels}"
            values.context.error("E202", message, route.place)
        if route.is_panned and (route.to == "nearest" or len(set(route.to)) != 2):
            message = f"{route.part}: `pan` lies between two channels, such as `to: [1, 2]`"
            values.context.error("E103", message, route.place)
    for room_entry in rooms:
        last_channel = max(room_entry.to, default=0)
        if last_channel > channels:
            message = f"channel {last_channel} does not exist; the mix has {channels}"
            values.context.error("E202", message, room_entry.place)
    if room is not None and values.written("channels") and outputs > channels:
        message = f"the layout has {outputs} loudspeakers, but the mix has {channels} channels"
        if room.outputs:
            message = f"the layout has output {outputs}, but the mix has {channels} channels"
        values.error("E202", message, "channels")
    master = values["master"]
    master_of_mix = None
    if isinstance(master, Values):
        m = master
        fade = mixing.fade(m["fade"])
        master_of_mix = Master(
            m["normalise"],
            m["limit"],
            m["gain"],
            m.node.place,
            fade,
            m["reference"],
            m["loudness"],
        )
        if m["loudness"] is not None and m["normalise"] is not None:
            message = f"{m.context.label('loudness')}: the level of the sum is said twice; "
            m.error("E111", message + "remove `normalise` or `loudness`", "loudness")
    return Mix(channels, room, routes, master_of_mix, values.place, rooms)


def _without_sends(route: Route, refused: set[str]) -> Route:
    """A route without what it sends to rooms that were refused: they are not missing too."""
    return replace(route, sends=tuple(send for send in route.sends if send[0] not in refused))


def _route(values: Values) -> Route:
    name = values["from"]
    v = values
    return Route(
        name,
        None,
        v["to"],
        v["gain"],
        v["highpass"],
        name.place,
        mixing.pan(v["pan"]),
        mixing.sends(v["send"], v.nodes.get("send")),
        mixing.fade(v["fade"]),
        v["radiate"],
        v["level"],
        None,
        mixing.pan_path(v["pan"]),
        tones.tones(v),
        tones.echo(v),
    )


def accuracy(values: Values | None) -> Accuracy:
    """The limits of the planner: one measure of exactness, and work."""
    if values is None:
        return Accuracy()
    if values.written("method") or values.written("error") or values.written("cents"):
        has_single(values, ("method",), ("error",), ("cents",))
    if values.written("upto") and not values.written("cents"):
        values.error("E103", f"{values.context.label('upto')} needs `cents`", "upto")
    if values["guard"] == "off" and values["method"] != "ca":
        message = f"{values.context.label('guard')}: only `method: ca` steps without a guard"
        values.error("E111", message, "guard")
    asked_accuracy = Accuracy(
        *(values[name] for name in ("method", "error", "cents", "upto", "cpu"))
    )
    return replace(asked_accuracy, is_unguarded=values["guard"] == "off")


def render(values: Values | None, files: Files) -> RenderSpec:
    """The file to write; a file outside the folder of the score is reported."""
    if values is None:
        return RenderSpec(None, 24, "auto", None, None)
    if values["file"] is not None:
        folder, place = values.nodes["file"].document.folder, values.place_of("file")
        label = f"{values.context.label('file')}: "
        files.target(values["file"], folder, place, label)
        if (ending_mistake := wrong_ending(values["file"])) is not None:
            values.error(
                "E201", f"{label}{ending_mistake}", "file", suggestion=with_ending(values["file"])
            )
    bits = _BITS[values["bits"]]
    return RenderSpec(values["file"], bits, values["tail"], values["channels"], values.place)
