"""Descriptions of ADM from strangers: what refers to what, gains, and what is not read.

As ITU-R BS.2076-2 has it; the files are written here by bytes.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from commands import forked

from ergon.common.xml_text import XmlError
from ergon.exchange import adm
from ergon.exchange.wave_header import WaveFormat, WaveInfo

PLACES = ((30.0, 0.0), (-30.0, 0.0), (0.0, 0.0))
IDS = ("00011001", "00011002", "00011003")
UIDS = ("ATU_00000001", "ATU_00000002", "ATU_00000003")


def channel(number: str, azimuth: float, more: str = "", later_blocks: str = "") -> str:
    return (
        f'<audioChannelFormat audioChannelFormatID="AC_{number}" typeDefinition="DirectSpeakers">'
        f'<audioBlockFormat><position coordinate="azimuth">{azimuth}</position>'
        f'<position coordinate="elevation">0</position>{more}</audioBlockFormat>{later_blocks}'
        "</audioChannelFormat>"
    )


CHANNELS = "".join(channel(number, az) for number, (az, _) in zip(IDS, PLACES, strict=True))


def chna(names: list[str], packs: tuple[str, ...] = ("AP_00011001",) * 8) -> bytes:
    rows = [
        struct.pack("<H12s14s11sx", i, f"ATU_{i:08X}".encode(), name.encode(), pack.encode())
        for i, (name, pack) in enumerate(zip(names, packs, strict=False), 1)
    ]
    return struct.pack("<HH", len(rows), len(rows)) + b"".join(rows)


def layout(body: str, names: list[str] | None = None, packs: tuple[str, ...] = ()):
    names = names or [f"AT_{number}_01" for number in IDS]
    description = chna(names, packs or ("AP_00011001",) * len(names))
    form = WaveFormat(48_000, len(names), 16)
    text = f"<audioFormatExtended>{body}</audioFormatExtended>".encode()
    return adm.read(WaveInfo("BW64", form, 1, 0, 6, axml=text, chna=description))


def azimuths(result) -> list[float]:
    return [azimuth for azimuth, *_ in result.speakers]


def test_adm_ids_compare_without_case():
    """Capitals in `chna`, small letters in the description; and the reverse."""
    body = channel("0001100a", 30) + channel("0001100B", -30)
    assert azimuths(layout(body, ["AT_0001100A_01", "AT_0001100b_01"])) == [30.0, -30.0]


def stream(track: str, played: str, is_named_by_track: bool) -> str:
    track_id = f"<audioTrackFormatIDRef>AT_{track}_01</audioTrackFormatIDRef>"
    stream_id = f"<audioStreamFormatIDRef>AS_{track}</audioStreamFormatIDRef>"
    return (
        f'<audioStreamFormat audioStreamFormatID="AS_{track}"><audioChannelFormatIDRef>AC_{played}'
        f"</audioChannelFormatIDRef>{'' if is_named_by_track else track_id}</audioStreamFormat>"
        f'<audioTrackFormat audioTrackFormatID="AT_{track}_01">'
        f"{stream_id if is_named_by_track else ''}</audioTrackFormat>"
    )


@pytest.mark.parametrize("is_named_by_track", [True, False])
def test_adm_channel_by_references(is_named_by_track: bool):
    """Not that of the digits of the track's ID."""
    played = (IDS[1], IDS[0], IDS[2])
    streams = (stream(a, b, is_named_by_track) for a, b in zip(IDS, played, strict=True))
    assert azimuths(layout(CHANNELS + "".join(streams))) == [-30.0, 30.0, 0.0]


def test_adm_track_uid_without_a_track_names_its_channel():
    """As BS.2076-2 allows: the row of `chna` has a UID alone."""
    uids = "".join(
        f'<audioTrackUID UID="{uid}"><audioChannelFormatIDRef>AC_{number}</audioChannelFormatIDRef>'
        "</audioTrackUID>"
        for uid, number in zip(UIDS, reversed(IDS), strict=True)
    )
    assert azimuths(layout(CHANNELS + uids, ["", "", ""])) == [0.0, -30.0, 30.0]


def test_adm_distances_are_those_of_each_pack():
    packs = "".join(
        f'<audioPackFormat audioPackFormatID="AP_0001100{i}" absoluteDistance="{2 * i}"/>'
        for i in (1, 2)
    )
    result = layout(packs + CHANNELS, packs=("AP_00011001", "AP_00011001", "AP_00011002"))
    assert [distance for *_, distance in result.speakers] == [2.0, 2.0, 4.0]


def objects(inside: str, refs: str = "", number: int = 1001) -> str:
    refs = refs or "".join(f"<audioTrackUIDRef>{uid}</audioTrackUIDRef>" for uid in UIDS)
    return f'<audioObject audioObjectID="AO_{number}">{inside}{refs}</audioObject>'


INNER = "<audioObjectIDRef>AO_1001</audioObjectIDRef>"
PACK = "<audioPackFormatIDRef>AP_00011001</audioPackFormatIDRef>"
QUIET_LEFT = channel(IDS[0], 30, "<gain>0.5</gain>") + "".join(
    channel(number, az) for number, (az, _) in zip(IDS[1:], PLACES[1:], strict=True)
)


@pytest.mark.parametrize(
    ("body", "gains"),
    [
        (CHANNELS + objects(""), ()),
        (CHANNELS + objects("<gain>0.25</gain>"), (0.25, 0.25, 0.25)),
        (CHANNELS + objects('<gain gainUnit="dB">-20</gain>'), (0.1, 0.1, 0.1)),
        (CHANNELS + objects("<mute>1</mute>"), (0.0, 0.0, 0.0)),
        (CHANNELS + objects("<mute>true</mute>", PACK), (0.0, 0.0, 0.0)),
        (CHANNELS + objects("<mute>0</mute>"), ()),
        (QUIET_LEFT, (0.5, 1.0, 1.0)),
        (QUIET_LEFT + objects("<gain>0.5</gain>"), (0.25, 0.5, 0.5)),
        (
            CHANNELS + objects("<gain>0.5</gain>") + objects("<gain>0.5</gain>", INNER, 1002),
            (0.25, 0.25, 0.25),
        ),
        (CHANNELS + objects("<gain>2</gain>", f"<audioTrackUIDRef>{UIDS[1]}</audioTrackUIDRef>"),
         (1.0, 2.0, 1.0)),
    ],
)  # fmt: skip
def test_adm_gains_of_objects_and_blocks(body: str, gains: tuple[float, ...]):
    result = layout(body)
    assert result.gains == pytest.approx(gains)
    assert len(result.notes) == sum(gain != 1.0 for gain in gains)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (CHANNELS + objects("<gain>nan</gain>"), "out of range"),
        (CHANNELS + objects("<gain>loud</gain>"), "not a number"),
    ],
)
def test_adm_wrong_gains_are_refused(body: str, words: str):
    with pytest.raises(XmlError, match=words):
        layout(body)


def test_adm_objects_in_a_circle_are_read_in_bounded_time():
    circle = objects("", INNER.replace("1001", "1002")) + objects("", INNER, 1002)
    assert layout(CHANNELS + circle).gains == ()


def test_adm_moving_channel_is_named():
    later = '<audioBlockFormat><position coordinate="azimuth">110</position></audioBlockFormat>'
    body = channel(IDS[0], 30, "", later) + channel(IDS[1], -30) + channel(IDS[2], 0)
    result = layout(body)
    assert azimuths(result) == [30.0, -30.0, 0.0]
    assert result.notes == ("channel 1 moves (2 blocks); only the first counts",)


@pytest.mark.parametrize("is_in_pack", [True, False])
@pytest.mark.parametrize("name", ["N3D", "FuMa", "SN3D"])
def test_adm_normalization_of_pack_or_block(name: str, is_in_pack: bool):
    numbers = [f"0004100{i}" for i in range(1, 5)]
    text = f"<normalization>{name}</normalization>"
    degrees = [(0, 0), (1, -1), (1, 0), (1, 1)]
    body = f'<audioPackFormat audioPackFormatID="AP_00041001">{text * is_in_pack}</audioPackFormat>'
    for number, (order, degree) in zip(numbers, degrees, strict=True):
        body += (
            f'<audioChannelFormat audioChannelFormatID="AC_{number}" typeDefinition="HOA">'
            f"<audioBlockFormat><order>{order}</order><degree>{degree}</degree>"
            f"{text * (not is_in_pack)}</audioBlockFormat></audioChannelFormat>"
        )
    names = [f"AT_{number}_01" for number in numbers]
    if name == "SN3D":
        assert layout(body, names, ("AP_00041001",) * 4).order == 1
        return
    with pytest.raises(XmlError, match=f"normalised as {name}, and SN3D is read"):
        layout(body, names, ("AP_00041001",) * 4)


def written(path: Path, body: str) -> None:
    """A WAVE file of three channels with the value 8192."""
    text = f"<audioFormatExtended>{body}</audioFormatExtended>".encode()
    chunks = b""
    for name, content in (
        (b"fmt ", struct.pack("<HHIIHH", 1, 3, 48_000, 288_000, 6, 16)),
        (b"chna", chna([f"AT_{number}_01" for number in IDS])),
        (b"axml", text + b" " * (len(text) % 2)),
        (b"data", np.full(3 * 480, 8192, "<i2").tobytes()),
    ):
        chunks += name + struct.pack("<I", len(content)) + content
    path.write_bytes(b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WAVE" + chunks)


def test_fold_applies_gains_of_the_description(tmp_path: Path):
    bodies = {"plain": CHANNELS, "quiet": CHANNELS + objects("<gain>0.5</gain>"),
              "mute": CHANNELS + objects("<mute>1</mute>")}  # fmt: skip
    peaks = {}
    for name, body in bodies.items():
        written(tmp_path / f"{name}.wav", body)
        words = ["fold", f"{name}.wav", "--to", "stereo", "--bits", "float", "-o", f"{name}-2.wav"]
        done = forked(words, tmp_path)
        assert done.returncode == 0, done.stderr
        assert ("by its description" in done.stderr) == (name != "plain"), done.stderr
        from ergon.exchange import sound

        blocks = np.concatenate([*sound.read_blocks(tmp_path / f"{name}-2.wav")])
        peaks[name] = float(np.abs(blocks).max())
    assert peaks["quiet"] == pytest.approx(0.5 * peaks["plain"], rel=1e-6)
    assert peaks["mute"] == 0.0


def test_info_names_gains_of_the_description(tmp_path: Path):
    written(tmp_path / "a.wav", QUIET_LEFT)
    done = forked(["info", "a.wav"], tmp_path)
    assert "channels: channel 1 has the gain 0.5 by its description" in done.stdout, done.stderr
