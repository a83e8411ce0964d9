"""Files of MusicXML 4.0: plain XML, or compressed (.mxl: a ZIP whose container names the score)."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element

from ergon.common.regular import read_bounded
from ergon.common.xml_text import XmlError, parse_xml
from ergon.scores.gesture.take_file import TakeError

SUFFIXES = (".musicxml", ".mxl", ".xml")
MAX_BYTES = 16 << 20  # largest file, packed and unpacked
MAX_ELEMENTS = 1_000_000
MAX_ENTRIES = 1_000  # entries of a ZIP
_CONTAINER_PATH = "META-INF/container.xml"
_SCORE_SUFFIXES = (".musicxml", ".xml")


def read_root(path: Path) -> Element:
    """The score of a file, by parts: `score-partwise`. Raises TakeError and OSError."""
    score_bytes = read_bounded(path, MAX_BYTES)
    if len(score_bytes) > MAX_BYTES:
        raise TakeError(f"the file has more than {MAX_BYTES >> 20} MB", path)
    try:
        if score_bytes[:2] == b"PK":
            score_bytes = _archived_score(score_bytes)
        score_root = _parse_root(score_bytes)
        if score_root.tag == "score-timewise":
            return _partwise_root(score_root)
    except XmlError as error:
        raise TakeError(str(error), path) from None
    if score_root.tag != "score-partwise":
        raise TakeError(f"it is not a score of MusicXML: its root is {score_root.tag[:40]}", path)
    return score_root


def _parse_root(xml_bytes: bytes) -> Element:
    return parse_xml(xml_bytes, bytes_max=2 * MAX_BYTES, elements_max=MAX_ELEMENTS, has_type=True)


def _archived_score(data: bytes) -> bytes:
    """The score in a compressed file. Raises XmlError."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as zip_file:
            return _score_bytes(zip_file)
    except XmlError:
        raise
    # Damaged archives raise errors of many types: of each compression, of names, of numbers.
    except Exception as error:
        raise XmlError(f"this zip file cannot be unpacked: {error}") from None


def _score_bytes(zip_file: zipfile.ZipFile) -> bytes:
    member_names = zip_file.namelist()
    if len(member_names) > MAX_ENTRIES:
        raise XmlError(f"it holds more than {MAX_ENTRIES:,} files")
    score_name = (
        _named_score(_entry_bytes(zip_file, _CONTAINER_PATH))
        if _CONTAINER_PATH in member_names
        else None
    )
    if score_name is not None:
        known_names = (name for name in (score_name, unquote(score_name)) if name in member_names)
        if (member_name := next(known_names, None)) is None:
            raise XmlError(f"it holds no {score_name[:80]}")
        return _entry_bytes(zip_file, member_name)
    # Archives of macOS hold a hidden file beside each file, `__MACOSX/._score.xml`.
    score_names = [
        name
        for name in member_names
        if name.endswith(_SCORE_SUFFIXES)
        and not name.startswith(("META-INF/", "__MACOSX/"))
        and not name.rpartition("/")[2].startswith(".")
    ]
    if not score_names:
        raise XmlError("it holds no score")
    return _entry_bytes(zip_file, score_names[0])


def _named_score(container: bytes) -> str | None:
    """The first score that a container names; beside it may stand a PDF of the same score."""
    rootfiles = parse_xml(container, has_type=True).findall("rootfiles/rootfile")
    scores = [file for file in rootfiles if "xml" in file.get("media-type", "xml")]
    return next((file.get("full-path") for file in scores or rootfiles), None)


def _entry_bytes(archive: zipfile.ZipFile, entry_name: str) -> bytes:
    with archive.open(entry_name) as entry:
        file_bytes = entry.read(MAX_BYTES + 1)
    if len(file_bytes) > MAX_BYTES:
        raise XmlError(f"its {entry_name[:80]} has more than {MAX_BYTES >> 20} MB")
    return file_bytes


def _partwise_root(root: Element) -> Element:
    """A score by measures as one by parts."""
    score = Element("score-partwise")
    parts_by_id: dict[str, Element] = {}
    n_measures = 0
    for root_child in root:
        if root_child.tag != "measure":
            score.append(root_child)
            continue
        for part_element in root_child.findall("part"):
            part_id = part_element.get("id", "")
            if part_id not in parts_by_id:
                parts_by_id[part_id] = Element("part", {"id": part_id})
            part = parts_by_id[part_id]
            if len(part) > n_measures:
                raise XmlError(f"a measure has the part {part_id[:80]!r} twice")
            # A part that a measure lacks is silent there.
            part.extend(Element("measure") for _ in range(n_measures - len(part)))
            measure = Element("measure", root_child.attrib)
            measure.extend(part_element)
            part.append(measure)
        n_measures += 1
    score.extend(parts_by_id.values())
    return score
