"""`ergon info`: what a file contains."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.api import score
from ergon.api.options import ReadOptions
from ergon.common.foreign_files import foreign_file
from ergon.common.sound_files import is_sound
from ergon.common.terminal import printable

from . import options
from .bundled import PackedPath, ScorePath, is_pack
from .console import Console, plural
from .file_info import is_score, print_content, unknown_form_message
from .outcome import Findings, Refused
from .tables import table
from .units import octets_text, seconds_text

if TYPE_CHECKING:
    from ergon.exchange.wave_header import WaveInfo


@click.command()
@click.argument("file", metavar="FILE", type=ScorePath(opens=False))
@click.option(
    "--score",
    "source",
    metavar="SCORE",
    type=PackedPath(),
    help="Check that a render comes from this score.",
)
@options.trust
@options.with_console
def info(console: Console, file: str, source: str | None, trust: bool) -> None:
    """Say what a render, a take, a MIDI file, a mesh, a layout, a pack or a score contains.

    A WAV, FLAC or AIFF file is sound: its format, title, marks, the hash of its samples and, of a
    render, of its score. A .take, table (CSV, TSV, npz) or motion capture (C3D, BVH, TRC, SDIF) is
    a take: its channels and what they span. Of a MIDI file and of a score of MusicXML it says what
    is played and what is passed over. A .motion file is what moved. Of a mesh (OBJ, glTF), a scale
    (.scl, .kbm), a head (SOFA), loudspeakers and a model of another program it says what is read
    and what is passed over. Of a pack it lists the files. The name of a score that ships, such as
    `duet`, is that score.
    """
    from ergon.scores.gesture.midi_file import SUFFIXES as MIDI
    from ergon.scores.gesture.take_file import SUFFIXES as TAKES

    path = Path(file)
    suffix = path.suffix.lower()
    is_heard = is_sound(path)
    if source is not None and not is_heard:
        raise Refused("--score verifies a rendered WAV or FLAC file")
    if is_heard:
        _print_sound(console, path, source, trust)
    elif suffix in TAKES:
        from .take_info import take

        take(console, path)
    elif suffix in MIDI:
        from .midi_info import midi

        midi(console, path)
    elif is_pack(file):
        _print_pack(console, path)
    elif suffix == ".motion":
        from .motion_info import motion

        motion(console, path)
    elif (foreign_kind := foreign_file(path)) is not None:
        raise Refused(f"{file}: {foreign_kind}")
    elif print_content(console, path):
        return
    elif file == score.STDIN or is_score(path):
        _print_score(console, file, trust)
    else:
        raise Refused(unknown_form_message(path))


def _print_pack(console: Console, path: Path) -> None:
    from hashlib import sha256

    from ergon.exchange.pack import read_pack

    pack = read_pack(path)
    files = [
        (name, len(data), sha256(data).hexdigest()) for name, data in sorted(pack.files.items())
    ]
    if console.json:
        file_records = [
            {"file": name, "bytes": n_bytes, "sha256": digest} for name, n_bytes, digest in files
        ]
        fields = {"ergon": pack.version, "score": pack.score, "files": file_records}
        console.record("pack", file=str(path), **fields)
        return
    console.data(f"{path}: {plural(len(files), 'file')}, packed by ergon {pack.version}\n")
    console.data(f"score: {pack.score}\n")
    console.data(
        table([(name, octets_text(n_bytes), f"sha256 {digest}") for name, n_bytes, digest in files])
    )


def _print_sound(console: Console, path: Path, source: str | None, trust: bool) -> None:
    from ergon.exchange.sound import digest_samples, read_info
    from ergon.exchange.wave_header import NotWaveError

    try:
        wav = read_info(path)
        samples_digest, first_nan_frame = digest_samples(path)
    except NotWaveError as error:
        raise Refused(f"{path}: {error}") from None
    if console.json:
        console.record("render", **_sound_fields(path, wav), samples_sha256=samples_digest)
    else:
        console.data(_sound_text(path, wav, samples_digest))
    if wav.damage is not None:
        console.warn(f"{path}: {wav.damage}")
    if first_nan_frame is not None:
        nan_seconds = first_nan_frame / wav.format.rate
        message = f"frame {first_nan_frame + 1:,} ({nan_seconds:.6g} s) is not a number"
        console.warn(f"{path}: {message}; no command plays, folds or measures such a sound")
    if source is None:
        return
    if wav.score is None:
        raise Findings(f"{path} does not say which score it comes from")
    piece = score.piece_of(score.read(source, ReadOptions(trust=trust), console))
    if score.digest(piece) != wav.score:
        raise Findings(f"{path} was rendered from another score than {source}, or an earlier state")
    console.say(f"{path} was rendered from {source} as it is now")


def _sound_fields(path: Path, wav: WaveInfo) -> dict[str, object]:
    return {
        "file": str(path),
        "container": wav.container,
        "rate_hz": wav.format.rate,
        "channels": wav.format.n_channels,
        "bits": wav.format.bits,
        "frames": wav.n_frames,
        "duration_s": wav.n_frames / wav.format.rate,
        "originator": wav.originator,
        "title": wav.title,
        "score_sha256": wav.score,
        "plan_sha256": wav.plan,
        "tracks": list(wav.tracks),
        "marks": [{"name": name, "frame": frame} for name, frame in wav.marks],
        "passed_over": [name for name, _ in wav.unread_chunks],
    }


def _sound_text(path: Path, wav: WaveInfo, samples_digest: str) -> str:
    bits = wav.format.bits
    bits_text = {"float": "32-bit float", "double": "64-bit float"}.get(str(bits), f"{bits} bits")
    lines = [
        f"{path}: {seconds_text(wav.n_frames / wav.format.rate)} ({wav.n_frames:,} frames), "
        f"{plural(wav.format.n_channels, 'channel')}, {wav.format.rate} Hz, {bits_text}, "
        f"{wav.container}, {octets_text(wav.samples_offset + wav.samples_size)}",
    ]
    if wav.title:
        lines.append(f"title:   {wav.title}")
    lines.append(f"made by: {wav.originator or 'not said'}")
    if wav.score:
        lines.append(f"score:   sha256 {wav.score}")
    if wav.plan:
        lines.append(f"plan:    sha256 {wav.plan}")
    lines += [f"channels: {channel_text}" for channel_text in _channel_texts(path, wav)]
    if wav.tracks:
        lines.append(f"tracks:  {', '.join(name or '–' for name in wav.tracks)}")
    lines += [
        f"mark:    {name or 'without a name'}, {frame / wav.format.rate:.3f} s (frame {frame:,})"
        for name, frame in wav.marks
    ]
    lines += [f"passed over: chunk {name}, {octets_text(size)}" for name, size in wav.unread_chunks]
    lines.append(f"samples: sha256 {samples_digest}")
    return "\n".join(map(printable, lines)) + "\n"


def _channel_texts(path: Path, wav: WaveInfo) -> list[str]:
    """What a file says of its channels."""
    from ergon.common.xml_text import XmlError
    from ergon.exchange import adm

    try:
        layout = adm.read(wav)
    except XmlError as error:
        return [f"their description is not read: {error}"]
    if layout is None:
        return []
    if layout.order is not None:
        return [f"Ambisonics of order {layout.order} (ACN, SN3D)", *layout.notes]
    words = [plural(len(layout.speakers), "loudspeaker")]
    if layout.effects:
        numbers = ", ".join(str(channel + 1) for channel in layout.effects)
        words.append(f"channel {numbers} for low-frequency effects")
    return ["; ".join(words), *layout.notes]


def _print_score(console: Console, path: str, trust: bool) -> None:
    staged_score = score.stage_piece(
        score.read(path, ReadOptions(trust=trust), console), None, console
    )
    piece, stage = staged_score.piece, staged_score.stage
    duration = stage.n_analysed_frames / stage.rate
    end_text = score.where(piece, duration)
    names_by_kind = {
        "players": list(piece.players),
        "keys": list(piece.keys),
        "instruments": list(piece.instruments),
        "gestures": list(piece.gestures),
        "takes": list(piece.takes),
        "marks": [name for name, _ in score.marks_of(piece)],
    }
    if console.json:
        console.record(
            "score",
            file=path,
            title=piece.title,
            score_sha256=score.digest(piece),
            duration_s=duration,
            end=end_text,
            rate_hz=stage.rate,
            channels=stage.n_channels,
            modules=stage.network.n_mat + stage.network.n_lia,
            **names_by_kind,
        )
        return
    lines = [
        f"{path}: {piece.title or 'without a title'}",
        f"  {seconds_text(duration)}, to {end_text}; {plural(stage.n_channels, 'channel')} at "
        f"{stage.rate:g} Hz; {plural(stage.network.n_mat, 'MAT')}, "
        f"{plural(stage.network.n_lia, 'LIA')}",
    ]
    lines += [f"  {kind}: {', '.join(names)}" for kind, names in names_by_kind.items() if names]
    lines.append(f"  sha256 {score.digest(piece)}")
    console.data("\n".join(lines) + "\n")
