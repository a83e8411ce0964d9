"""Untrusted XML: bounded in size, and without document types or entities."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree

from ergon.common.errors import ErgonError

BYTES_MAX = 4 << 20  # bytes
ELEMENTS_MAX = 100_000
_DOCTYPE_PATTERN = re.compile(rb"<!DOCTYPE[^\[\]<>]*>")  # a DOCTYPE without definitions of its own
_DEFINITION_PATTERN = re.compile(rb"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)
# Encodings by the first bytes of a document, with a mark of the order of bytes or without.
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb": "utf-8-sig"}
_MARKS |= {b"<\0": "utf-16-le", b"\0<": "utf-16-be"}
# Some programs declare UTF-16 in UTF-8 files; the declaration is dropped.
_WIDE_DECLARATION_PATTERN = re.compile(rb"<\?xml[^>]*encoding=[\"']utf-?16[^>]*\?>", re.IGNORECASE)


class XmlError(ErgonError, ValueError):
    """The text is not XML, or not XML that is read here."""


def parse_xml(
    xml_bytes: bytes,
    *,
    bytes_max: int = BYTES_MAX,
    elements_max: int = ELEMENTS_MAX,
    has_type: bool = False,
) -> ElementTree.Element:
    """The root of a document; its names are without namespaces. Raises XmlError.

    Only a document type can define entities, so a text without one can neither expand nor load
    files. With `has_type` it may name a type, of which nothing is read, and define nothing.
    """
    if len(xml_bytes) > bytes_max:
        raise XmlError(f"the XML is larger than {bytes_max >> 20} MB")
    xml_bytes = narrow(xml_bytes)
    # A zero byte means UTF-32, in which the search below would miss a document type.
    if b"\0" in xml_bytes.rstrip(b"\0"):
        raise XmlError("the XML is neither in UTF-8 nor in UTF-16")
    if has_type:
        xml_bytes = _DOCTYPE_PATTERN.sub(b"", xml_bytes, count=1)
    if _DEFINITION_PATTERN.search(xml_bytes):
        raise XmlError("the XML has a document type, which is not read")
    parser: Any = ElementTree.XMLPullParser(("end",))
    try:
        parser.feed(xml_bytes.rstrip(b"\0"))
        root_element: ElementTree.Element | None = None
        for count, event in enumerate(parser.read_events()):
            root_element = event[1]
            if count >= elements_max:
                raise XmlError(f"the XML has more than {elements_max:,} elements")
            assert root_element is not None
            root_element.tag = root_element.tag.rpartition("}")[2]
        parser.close()
    except ElementTree.ParseError as error:
        raise XmlError(f"the XML is not well formed: {error}") from None
    except (LookupError, ValueError) as error:
        raise XmlError(f"the XML cannot be read: {error}") from None
    if root_element is None:
        raise XmlError("the XML is empty")
    return root_element


def narrow(xml_bytes: bytes) -> bytes:
    """A document in UTF-16 as one in UTF-8, without what it says of its encoding; others as they
    are. Raises XmlError.
    """
    encoding = _MARKS.get(xml_bytes[:2])
    if encoding is None:
        wide_declaration = _WIDE_DECLARATION_PATTERN.match(xml_bytes)
        return xml_bytes[wide_declaration.end() :] if wide_declaration else xml_bytes
    try:
        xml_text = xml_bytes.decode(encoding)
    except UnicodeDecodeError:
        name = "UTF-8" if encoding == "utf-8-sig" else "UTF-16"
        raise XmlError(f"the XML begins as {name} does, but is no valid {name}") from None
    if xml_text.startswith("<?xml"):
        xml_text = xml_text.partition("?>")[2]
    return xml_text.encode()
