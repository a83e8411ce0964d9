"""Files of other programs that ergon cannot read: the name of each form, and advice.

A file is known by its first bytes where its form has such, else by the ending of its name.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ergon.common.regular import open_regular

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path, PurePath

_HEAD_BYTES = 1024  # bytes in which a file says what it is

_SOUND = "save it as WAV or FLAC"
_FILM = "save its sound as WAV or FLAC"
_PATCH = (
    "record what it plays, sound as WAV or FLAC and curves as CSV, or write its model as a score "
    "(`ergon new`)"
)
_MAX_PATCH = (
    "`ergon import` reads a MIMS or mi-gen model from its .mdl file, not from the patch around it; "
    f"else {_PATCH}"
)
_PATTERNS = "write its rhythm in a score (`ergon help patterns`), or save its notes as MIDI"
_NOTES = "save it there as MusicXML or MIDI, which a score reads"
_SESSION = "export its tracks there, sound as WAV or FLAC and notes as MIDI"
_SHAPE = "save it there as OBJ or glTF (.glb)"
_ROWS = "save it there as CSV whose first line names columns and units, such as t [s],x [mm]"
_CAPTURE = "save it there as C3D, BVH or TRC"
_SAMPLES = "give a recording of one of its notes to `ergon bell`, as WAV or FLAC"
_CURVES = "save what it holds as CSV whose first line names columns and units, such as t [s],x [mm]"
_ADVICE = "give the sound, notes, motion or score that is meant"
_ARCHIVE = "unpack it, and name the file that is meant"


@dataclass(frozen=True, slots=True)
class _Kind:
    """A form of files: its name, advice to the user, endings of names, and how such a file begins.

    `inner_pattern`: the bytes may stand anywhere in the head.
    """

    name: str
    advice: str
    endings: tuple[str, ...] = ()
    start_pattern: bytes | None = None
    inner_pattern: bytes | None = None

    def matches(self, head: bytes) -> bool:
        """Whether a file that begins so has this form."""
        if self.start_pattern is not None and re.match(self.start_pattern, head, re.DOTALL):
            return True
        return self.inner_pattern is not None and re.search(self.inner_pattern, head) is not None


# Bytes count before endings, and the first form before the next.
_KINDS = (
    _Kind("sound in the form Wave64", _SOUND, (".w64",), rb"riff\x2e\x91\xcf\x11"),
    _Kind("sound in the form Ogg", _SOUND, (".ogg", ".oga", ".opus"), rb"OggS"),
    _Kind("sound in the form MP3", _SOUND, (".mp3",), rb"ID3|\xff[\xf2\xf3\xfa\xfb]"),
    _Kind("sound in the form Core Audio (CAF)", _SOUND, (".caf",), rb"caff"),
    _Kind("sound in the form AU", _SOUND, (".au", ".snd"), rb"\.snd|dns\."),
    _Kind("sound in the form WavPack", _SOUND, (".wv",), rb"wvpk"),
    _Kind("sound in the form Monkey's Audio", _SOUND, (".ape",), rb"MAC [\x00-\x1f\x80-\xff]"),
    _Kind("sound in the form VOC", _SOUND, (".voc",), rb"Creative Voice File"),
    _Kind("sound in the form NIST Sphere", _SOUND, (".nist", ".sph"), rb"NIST_1A"),
    _Kind("sound in the form 8SVX", _SOUND, (".8svx", ".svx"), rb"FORM.{4}(?:8SVX|16SV)"),
    _Kind("sound in the form IRCAM", _SOUND, (".ircam", ".sf"),
          rb"\x64\xa3[\x00-\x04]|[\x00-\x04]\xa3\x64"),
    _Kind("sound in the form PARIS", _SOUND, (".paf",), rb" paf|fap "),
    _Kind("sound in the form SD2", _SOUND, (".sd2",)),
    _Kind("sound or film in the form MPEG-4", _FILM,
          (".mp4", ".m4a", ".mov", ".aac"), rb".{4}ftyp"),
    _Kind("sound or film in the form Matroska", _FILM,
          (".mkv", ".webm", ".mka"), rb"\x1aE\xdf\xa3"),
    _Kind("sound or film in the form ASF", _FILM,
          (".wma", ".wmv"), rb"0&\xb2u\x8ef\xcf\x11"),
    # Programs that make sound.
    _Kind("a device of Max for Live", _MAX_PATCH, (".amxd",), rb"ampf"),
    _Kind("a patch of Max", _MAX_PATCH, (".maxpat", ".maxhelp", ".gendsp", ".genexpr", ".mxt"),
          rb'\s*\{\s*"patcher"\s*:|max v2;'),
    _Kind("a program of Csound", _PATCH, (".csd", ".orc", ".sco", ".udo"),
          inner_pattern=rb"<CsoundSynthesizer>"),
    _Kind("a program of SuperCollider", _PATCH, (".scd", ".sc")),
    _Kind("a definition of a synth of SuperCollider", _PATCH, (".scsyndef",), rb"SCgf"),
    _Kind("a program of ChucK", _PATCH, (".ck",)),
    _Kind("a program of Modalys", _PATCH, (".lisp", ".mlys", ".mdls")),
    _Kind("a program of Nyquist", _PATCH, (".ny",)),
    _Kind("patterns of TidalCycles", _PATTERNS, (".tidal",)),
    _Kind("a program of Ruby, as of Sonic Pi", _PATTERNS, (".rb",)),
    _Kind("a program of JavaScript, as of Strudel", _PATTERNS, (".js", ".mjs", ".ts")),
    _Kind("a program of Python", _ADVICE, (".py",)),
    _Kind("a notebook", _ADVICE, (".ipynb",)),
    # Notes.
    _Kind("a score of LilyPond", _NOTES, (".ly", ".ily"), rb'\s*\\version\s+"'),
    _Kind("a tune in ABC", _NOTES, (".abc",), rb"(?:%[^\n]*\n)*X:\s*\d+\s*\n"),
    _Kind("a score in Humdrum", _NOTES, (".krn",), rb"(?:!!![^\n]*\n)*\*\*kern"),
    _Kind("a score of MEI", _NOTES, (".mei",), inner_pattern=rb"<mei[\s>]"),
    _Kind("a score of MuseScore", _NOTES, (".mscz", ".mscx"), inner_pattern=rb"<museScore[\s>]"),
    _Kind("a score of Sibelius", _NOTES, (".sib",), rb"\x0fSIBELIUS"),
    _Kind("a score of Finale", _NOTES, (".musx", ".mus"), rb"ENIGMA BINARY FILE"),
    _Kind("a score of Dorico", _NOTES, (".dorico",)),
    _Kind("a tablature of Guitar Pro", _NOTES, (".gp", ".gp3", ".gp4", ".gp5", ".gpx"),
          rb".FICHIER GUITAR PRO"),
    _Kind("a song of a tracker", _NOTES, (".mod", ".xm", ".it", ".s3m"),
          rb"Extended Module: |IMPM"),
    _Kind("messages to a synthesizer (system exclusive)", _ADVICE, (".syx",), rb"\xf0[\x00-\x7f]"),
    # Sessions.
    _Kind("a set of Ableton Live", _SESSION, (".als", ".alc", ".adg")),
    _Kind("a project of REAPER", _SESSION, (".rpp",), rb"<REAPER_PROJECT"),
    _Kind("a project of Logic", _SESSION, (".logicx",)),
    _Kind("a project of GarageBand", _SESSION, (".band",)),
    _Kind("a project of FL Studio", _SESSION, (".flp",), rb"FLhd"),
    _Kind("a project of Cubase", _SESSION, (".cpr",)),
    _Kind("a project of Bitwig Studio", _SESSION, (".bwproject",), rb"BtWg"),
    _Kind("a session of Ardour", _SESSION, (".ardour",), inner_pattern=rb"<Session [^>]*version="),
    _Kind("a session of Pro Tools", _SESSION, (".ptx", ".pts")),
    _Kind("a project of Audacity", _SESSION, (".aup", ".aup3"), inner_pattern=rb"<audacityproject"),
    _Kind("a project of LMMS", _SESSION, (".mmp", ".mmpz"), inner_pattern=rb"<lmms-project"),
    # Samplers.
    _Kind("a SoundFont", _SAMPLES, (".sf2", ".sf3"), rb"RIFF.{4}sfbk"),
    _Kind("a map of samples (SFZ)", _SAMPLES, (".sfz",)),
    _Kind("an instrument of a sampler", _SAMPLES, (".nki", ".exs", ".dspreset", ".gig", ".dls"),
          rb"RIFF.{4}DLS "),
    # Shapes.
    _Kind("a shape in PLY", _SHAPE, (".ply",), rb"ply\r?\n"),
    _Kind("a shape in STL", _SHAPE, (".stl",), rb"solid [^\n]*\n\s*facet\s"),
    _Kind("a scene in FBX", _SHAPE, (".fbx",), rb"Kaydara FBX"),
    _Kind("a scene of Blender", _SHAPE, (".blend",), rb"BLENDER"),
    _Kind("a scene in COLLADA", _SHAPE, (".dae",), inner_pattern=rb"<COLLADA[\s>]"),
    _Kind("a scene in USD", _SHAPE, (".usd", ".usda", ".usdc", ".usdz"), rb"PXR-USDC|#usda "),
    _Kind("a shape in 3MF", _SHAPE, (".3mf",)),
    _Kind("a shape in OFF", _SHAPE, (".off",), rb"OFF\s"),
    _Kind("a drawing of CAD", _SHAPE, (".step", ".stp", ".iges", ".igs", ".dxf"),
          rb"ISO-10303-21;"),
    _Kind("a mesh of finite elements", _SHAPE, (".msh", ".vtk", ".vtu"),
          rb"\$MeshFormat|# vtk DataFile"),
    # Motion and tables.
    _Kind("motion of a skeleton (ASF and AMC)", _CAPTURE, (".amc", ".asf"), rb"#!OML:ASF"),
    _Kind("motion of OpenSim", _ROWS, (".mot", ".sto")),
    _Kind("a recording of Qualisys", _CAPTURE, (".qtm",)),
    _Kind("a recording of OptiTrack Motive", _CAPTURE, (".tak",)),
    _Kind("a file of GDIF", _ROWS, (".gdif",)),
    _Kind("a sheet of a spreadsheet", _ROWS, (".xlsx", ".xls", ".ods", ".numbers"),
          rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"),
    _Kind("a file of MATLAB", _ROWS, (".mat",), rb"MATLAB [57]\.\d"),
    _Kind("an array of NumPy", "put it into an .npz file, by `numpy.savez(FILE, t=…, x=…)`",
          (".npy",), rb"\x93NUMPY"),
    _Kind("a table in Parquet", _ROWS, (".parquet",), rb"PAR1"),
    _Kind("a file of HDF5", _CURVES, (".h5", ".hdf5", ".hdf")),
    _Kind("a file of SQLite", _ROWS, (".sqlite", ".db"), rb"SQLite format 3"),
    # What is none of these.
    _Kind("a picture", _ADVICE, (".png", ".jpg", ".jpeg", ".gif", ".svg", ".webp", ".tif", ".tiff"),
          rb"\x89PNG|\xff\xd8\xff|GIF8"),
    _Kind("a document", _ADVICE, (".pdf", ".doc", ".docx", ".odt", ".rtf"), rb"%PDF-|\{\\rtf"),
    _Kind("a page", _ADVICE, (".html", ".htm"), rb"\s*<(?:!doctype html|html)"),
    _Kind("a program of this machine", _ADVICE, (".exe", ".dll", ".so", ".dylib"),
          rb"\x7fELF|MZ\x90"),
    _Kind("an archive", _ARCHIVE, (".zip", ".tar", ".tgz", ".gz", ".bz2", ".xz", ".7z", ".rar"),
          rb"\x1f\x8b|BZh|\xfd7zXZ|7z\xbc\xaf|Rar!"),
)  # fmt: skip
_BY_ENDING = {ending: kind for kind in _KINDS for ending in kind.endings}


def foreign_form(head: bytes, path: PurePath | None = None) -> str | None:
    """A sentence on the form of a file of another program, with advice; None if the form is not
    known. The form is recognised by the first bytes and, if `path` is given, by the ending of
    its name.
    """
    kind = next(_kinds(head, path), None)
    return None if kind is None else f"it is {kind.name}, which is not read; {kind.advice}"


def _kinds(head: bytes, path: PurePath | None) -> Iterator[_Kind]:
    """Kinds of a file, the surest first: its ending where that is of a container of several."""
    by_ending = None if path is None else _BY_ENDING.get(path.suffix.lower())
    by_bytes = next((kind for kind in _KINDS if kind.matches(head)), None)
    if by_ending is not None and (by_bytes is None or by_bytes.name in _CONTAINERS):
        yield by_ending
    if by_bytes is not None:
        yield by_bytes


# Forms in which files of several programs lie.
_CONTAINERS = ("an archive", "a file of SQLite", "a page")


def foreign_file(path: Path) -> str | None:
    """The same for a file; None for one that is not regular or cannot be read."""
    try:
        with open_regular(path) as file:
            return foreign_form(file.read(_HEAD_BYTES), path)
    except OSError:
        return None
