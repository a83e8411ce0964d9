"""OSC datagrams: untrusted bytes to messages, and messages to bytes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from ergon.common.errors import ErgonError
from ergon.common.extras import install_command

DATAGRAM_BYTES_MAX = 4096  # bytes of a datagram; what is longer is not for us
_BUNDLE_DEPTH_MAX = 8  # bundles inside bundles
_BUNDLE_MARK = b"#bundle\0"
_BUNDLE_HEADER_BYTES = len(_BUNDLE_MARK) + 8  # includes the time tag
_TYPE_TAGS = re.compile(rb",[ifdhsbtTFN]*\Z")


class PythonOscMissingError(ErgonError):
    """python-osc is not installed; the message says how to install it."""


class MalformedDatagramError(ErgonError):
    """A datagram that is not valid OSC."""


def require_python_osc() -> None:
    """Raise PythonOscMissingError where python-osc is not installed."""
    try:
        import pythonosc.osc_message  # noqa: F401
    except ImportError:
        raise PythonOscMissingError(
            f"OSC needs python-osc; install it by: {install_command('osc')}"
        ) from None


def parse_messages(datagram: bytes) -> list[tuple[str, list[object]]]:
    """(address, arguments) of every message in a datagram; time tags are ignored.

    Raises MalformedDatagramError.
    """
    from pythonosc.osc_message import OscMessage

    messages = []
    for message_bytes in _bundle_messages(datagram, _BUNDLE_DEPTH_MAX):
        # python-osc writes to the terminal what it does not know; strangers must not cause that.
        if not message_bytes.startswith(b"/") or not _TYPE_TAGS.match(_type_tags(message_bytes)):
            raise MalformedDatagramError
        try:
            message = OscMessage(message_bytes)
            messages.append((message.address, list(message.params)))
        except Exception:  # whatever strange bytes make of a parser
            raise MalformedDatagramError from None
    return messages


def _bundle_messages(datagram: bytes, depth_left: int) -> Iterator[bytes]:
    """The messages of bundles; sizes are checked here, because python-osc does not."""
    if not datagram.startswith(_BUNDLE_MARK):
        yield datagram
        return
    if depth_left == 0 or len(datagram) < _BUNDLE_HEADER_BYTES:
        raise MalformedDatagramError
    message_offset = _BUNDLE_HEADER_BYTES
    while message_offset < len(datagram):
        message_size = int.from_bytes(datagram[message_offset : message_offset + 4], "big")
        message_offset += 4
        if message_size == 0 or message_size % 4 or message_offset + message_size > len(datagram):
            raise MalformedDatagramError
        yield from _bundle_messages(
            datagram[message_offset : message_offset + message_size], depth_left - 1
        )
        message_offset += message_size


def _type_tags(message: bytes) -> bytes:
    """The type tags of a message's arguments; `,` where it has none."""
    offset = (message.find(b"\0") // 4 + 1) * 4
    return message[offset:].partition(b"\0")[0] or b","


def encode_message(
    address: str, message_arguments: Sequence[object], time_tag: float | None = None
) -> bytes:
    """A message as bytes; with an instant [s since 1970], in a bundle with that time tag.

    An instant of 0 is OSC's `immediately`.
    """
    from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
    from pythonosc.osc_message_builder import OscMessageBuilder

    builder = OscMessageBuilder(address)
    for argument in message_arguments:
        builder.add_arg(argument)  # type: ignore[arg-type]
    message = builder.build()
    if time_tag is None:
        return message.dgram
    bundle = OscBundleBuilder(time_tag or IMMEDIATELY)  # type: ignore[arg-type]
    bundle.add_content(message)
    return bundle.build().dgram
