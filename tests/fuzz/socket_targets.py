"""What comes over sockets and from a keyboard: requests, OSC, MIDI, typed lines."""

from __future__ import annotations

import json
import random
import struct
from collections.abc import Iterator
from pathlib import Path

from corrupted import corrupted
from one_bell import SCORE as BELL
from sessions import Stepped

from ergon.live.datagrams import MalformedDatagramError, encode_message, parse_messages
from ergon.live.osc_in import (
    OscRequestError,
    button_handler,
    gain_handler,
    number_handler,
    text_handler,
)
from ergon.repl.wire.protocol import (
    ProtocolError,
    decode_message,
    decode_reply,
    decode_state,
    encode,
    parse_request,
    read_request_id,
)
from tests.fuzz.harness import Target
from tests.fuzz.texts import damaged, soup

REQUESTS = tuple(
    json.dumps(fields)
    for fields in (
        {"id": 1, "do": "submit", "text": "tempo 72", "releases": False},
        {"id": "a", "do": "complete", "line": "set be", "cursor": 4},
        {"id": 2, "is": dict(taken=True, text="ok", lines=[], leaves=False, **{"try": None})},
        {
            "id": 3,
            "is": dict(
                bar=1, beat=1.5, tempo=60.0, playing=[["ada", "knock"]], load=0.1, late=0,
                level=None, quant="1bar", recording=None, panicked=False,
            ),
        },
    )
)  # fmt: skip
WIRE_WORDS = (
    '"id":',
    '"do":',
    '"is":',
    '"cancel"',
    "{",
    "}",
    "[",
    "]",
    "NaN",
    "1e999",
    "true",
    ",",
)


def _wire(chance: random.Random) -> bytes:
    if chance.random() < 0.01:
        return chance.choice((b"[", b'{"a":')) * 100_000
    if chance.random() < 0.3:
        return soup(chance, WIRE_WORDS).encode()
    return damaged(chance.choice(REQUESTS), chance, WIRE_WORDS).encode(errors="surrogatepass")


def _read_wire(line: bytes, _: Path) -> None:
    fields = decode_message(line)
    for read in (decode_reply, decode_state):
        try:
            read(fields.get("is"))
        except ProtocolError:
            continue
    encode(id=read_request_id(fields))
    _, arguments = parse_request(fields)
    encode(**{"id": 1, "is": arguments})


def _osc(chance: random.Random) -> bytes:
    def message() -> bytes:
        arguments = [
            chance.choice((1, -1, 1e30, "a", b"xyz", True)) for _ in range(chance.randrange(3))
        ]
        return encode_message(
            chance.choice(("/ergon/gain", "/ergon/cmd", "/", "/ergon/stop")), arguments
        )

    data = message()
    for _ in range(chance.choice((0, 0, 1, 3, 10))):
        parts = [data, message()]
        data = b"#bundle\0" + bytes(8) + b"".join(struct.pack(">I", len(p)) + p for p in parts)
    if chance.random() < 0.9:
        data = next(corrupted(data, 1, chance.randrange(1 << 30), message()))
    return data


def _read_osc(datagram: bytes, _: Path) -> list[str]:
    messages = []
    asks = (
        gain_handler(lambda ratio: None),
        number_handler(lambda value: None),
        button_handler(lambda: None),
        text_handler(lambda line: None),
    )
    for _address, arguments in parse_messages(datagram):
        for ask in asks:
            try:
                ask(arguments)
            except OscRequestError as error:
                messages.append(str(error))
    return messages


def _midi(chance: random.Random) -> list[bytes]:
    """Packets of a MIDI port, most of them nearly right."""

    def packet() -> bytes:
        status = chance.choice(
            (0x90, 0x80, 0xB0, 0xF2, 0xF8, 0xFA, 0xFB, 0xFC, chance.randrange(256))
        )
        data = bytes([status, chance.randrange(256), chance.choice((0, 1, 64, 127, 200))])
        return data[: chance.choice((0, 1, 1, 2, 3, 3, 3, 3))] + chance.choice((b"", b"", b"\0"))

    return [packet() for _ in range(chance.randrange(1, 40))]


def _read_midi(packets: list[bytes], folder: Path) -> Iterator[str]:
    """Send them to a session in which much is mapped."""
    stepped = Stepped(BELL, folder, journal=False, keeps=False)
    try:
        for line in MAPS:
            assert stepped.type(line).taken, line
        stepped.run(0.01)
        for packet in packets:
            stepped.session.midi.receive(packet, 0.0)
            stepped.run(0.004)
        yield from stepped.session.messages()
    finally:
        stepped.session.close()


MAPS = (
    "map cc 1 bell.m.f 10Hz..30000Hz now",
    "map cc 64 gain bell -400dB..24dB now",
    "map cc 127 k1.M 1mg..1kg now",
    "map note 0..127 bell.m -1Ns..1Ns now",
    "map note 60 bell.m 1mNs now",
)


def _typed(chance: random.Random) -> str:
    from tests.repl.test_repl_hostile import hostile

    return hostile(chance)


def _read_typed(line: str, _: Path) -> None:
    from tests.repl.test_repl_hostile import holds

    holds(line)


TARGETS = (
    Target("socket lines", _wire, _read_wire, (ProtocolError,), 3000),
    Target("OSC packets", _osc, _read_osc, (MalformedDatagramError,), 2000, is_silent=True),
    Target("MIDI packets", _midi, _read_midi, (), 30, 20_000),
    Target("typed lines", _typed, _read_typed, (), 500),
)
