"""Files of MusicXML 4.0: plain XML, or compressed (.mxl: a ZIP whose container names the score)."""

from __future__ import annotations

import io
import zipfile
import zlib
from pathlib import Path
from xml.etree.ElementTree import Element

from ergon.common.regular import read_bounded
from ergon.common.xml_text import XmlError, parse_xml
from ergon.scores.gesture.take_file import TakeError

SUFFIXES = (".musicxml", ".mxl", ".xml")
MAX_BYTES = 16 << 20  # largest file, packed and unpacked
MAX_ELEMENTS = 1_000_000
MAX_ENTRIES = 1_000  # entries of a ZIP
_CONTAINER = "META-INF/container.xml"
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}


def read_root(path: Path) -> Element:
    """The score of a file, by parts: `score-partwise`. Raises TakeError and OSError."""
    score_bytes = read_bounded(path, MAX_BYTES)
    if len(score_bytes) > MAX_BYTES:
        raise TakeError(f"the file has more than {MAX_BYTES >> 20} MB", path)
    try:
        if score_bytes[:2] == b"PK":
            score_bytes = _unpacked(score_bytes)
        score_root = _parsed(score_bytes)
    except (XmlError, zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise TakeError(str(error), path) from None
    except (NotImplementedError, RuntimeError, OSError) as error:  # a ZIP of a kind of its own
        raise TakeError(f"it cannot be unpacked: {error}", path) from None
    if score_root.tag == "score-timewise":
        return _by_parts(score_root)
    if score_root.tag != "score-partwise":
        raise TakeError(f"it is not a score of MusicXML: its root is {score_root.tag[:40]}", path)
    return score_root


def _parsed(xml_bytes: bytes) -> Element:
    for mark, encoding in _MARKS.items():
        if xml_bytes.startswith(mark):
            try:
                xml_text = xml_bytes.decode(encoding)
            except UnicodeDecodeError:
                raise XmlError(f"the XML is not in {encoding.upper()}, as it begins") from None
            if xml_text.startswith("<?xml"):  # which names an encoding
                xml_text = xml_text.partition("?>")[2]
            xml_bytes = xml_text.encode()
    return parse_xml(xml_bytes, bytes_max=2 * MAX_BYTES, elements_max=MAX_ELEMENTS, has_type=True)


def _unpacked(data: bytes) -> bytes:
    """The score in a compressed file."""
    with zipfile.ZipFile(io.BytesIO(data)) as zip_file:
        member_names = zip_file.namelist()
        if len(member_names) > MAX_ENTRIES:
            raise XmlError(f"it holds more than {MAX_ENTRIES:,} files")
        member_name = _named(_entry(zip_file, _CONTAINER)) if _CONTAINER in member_names else None
        if member_name is None:
            scores = (
                entry_name for entry_name in member_names if not entry_name.startswith("META-INF/")
            )
            member_name = next(
                (entry_name for entry_name in scores if entry_name.endswith((".xml", ".musicxml"))),
                None,
            )
        if member_name is None or member_name not in member_names:
            raise XmlError(
                "it holds no score" if member_name is None else f"it holds no {member_name[:80]}"
            )
        return _entry(zip_file, member_name)


def _named(container: bytes) -> str | None:
    """The file that a container names first."""
    rootfile = parse_xml(container, has_type=True).find("rootfiles/rootfile")
    return None if rootfile is None else rootfile.get("full-path")


def _entry(file: zipfile.ZipFile, entry_name: str) -> bytes:
    with file.open(entry_name) as entry:
        file_bytes = entry.read(MAX_BYTES + 1)
    if len(file_bytes) > MAX_BYTES:
        raise XmlError(f"its {entry_name[:80]} has more than {MAX_BYTES >> 20} MB")
    return file_bytes


def _by_parts(root: Element) -> Element:
    """A score by measures as one by parts."""
    score = Element("score-partwise")
    parts_by_id: dict[str, Element] = {}
    for root_child in root:
        if root_child.tag != "measure":
            score.append(root_child)
            continue
        for part_element in root_child.findall("part"):
            part_id = part_element.get("id", "")
            if part_id not in parts_by_id:
                parts_by_id[part_id] = Element("part", {"id": part_id})
            measure = Element("measure", root_child.attrib)
            measure.extend(part_element)
            parts_by_id[part_id].append(measure)
    score.extend(parts_by_id.values())
    return score
