"""What an editor sends to the language server: whole messages with other values, and bytes."""

from __future__ import annotations

import io
import logging
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from corrupted import corrupted
from lsp_messages import END, INITIALIZE, URI, framed, notified, opened, requested
from one_bell import SCORE as BELL

from ergon.workshop.lsp.guard import GuardedInput
from ergon.workshop.lsp.server import _HANDLERS, server
from tests.fuzz.harness import Target
from tests.fuzz.texts import damaged

EDGES: tuple[object, ...] = (
    *(-1, 0, 1, 2**31 - 1, 2**31, 2**60, 1.5, True, None, "", "x", [], {}, [[]], "9" * 400),
    *("\ud800", "file:///dev/zero", "file:///", URI, "untitled:a", "\0", "file:///a%00b"),
)
METHODS = (
    *("completion", "hover", "definition", "codeAction", "documentSymbol", "formatting"),
    *("didChange", "didSave", "didClose", "didOpen", "rename"),
)


def _position(chance: random.Random) -> dict[str, int]:
    return {"line": chance.randrange(30), "character": chance.choice((0, 1, 5, 20, 400))}


def _message(chance: random.Random) -> dict[str, Any]:
    method = f"textDocument/{chance.choice(METHODS)}"
    single = {"start": _position(chance), "end": _position(chance)}
    more: dict[str, object] = {
        "position": _position(chance),
        "range": single,
        "context": {
            "diagnostics": [{"range": single, "message": "m", "source": "ergon", "data": "k"}]
        },
        "options": {"tabSize": 2, "insertSpaces": True},
        "contentChanges": [{"range": single, "text": chance.choice(("", "x", ": {", "\n  "))}],
    }
    if method.startswith("textDocument/did"):
        return notified(method, **more)
    return requested(chance.randrange(5), method, **more)


def _changed(value: Any, chance: random.Random) -> Any:
    """The value with another one somewhere in it."""
    if isinstance(value, dict) and value and chance.random() < 0.8:
        name = chance.choice(list(value))
        if chance.random() < 0.1:
            return {other: inner for other, inner in value.items() if other != name}
        return {**value, name: _changed(value[name], chance)}
    if isinstance(value, list) and value and chance.random() < 0.8:
        return [_changed(value[0], chance), *value[1:]]
    return chance.choice(EDGES)


def case(chance: random.Random) -> bytes:
    text = chance.choice((BELL, "", "ergon: 1", "ergon: 1\n", damaged(BELL, chance)))
    messages: list[Any] = [INITIALIZE, opened(text)]
    for _ in range(chance.randrange(1, 5)):
        message = _message(chance)
        messages.append(message if chance.random() < 0.3 else _changed(message, chance))
    if chance.random() < 0.1:
        messages[0] = _changed(INITIALIZE, chance)
    if chance.random() < 0.1:
        messages.append(chance.choice((b"[", b'{"a":')) * chance.choice((100, 100_000)))
    data = b"".join(map(framed, [*messages, *END]))
    if chance.random() < 0.3:
        data = next(corrupted(data, 1, chance.randrange(1 << 30)))
    return data


class _Errors(logging.Handler):
    """Keeps what is logged of exceptions, which is printed as tracebacks."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.found: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.found.append(self.format(record))


def read(data: bytes, _: Path) -> Iterator[str]:
    """Serve an editor that sends these bytes."""
    output, errors = io.BytesIO(), _Errors()
    logs = [logging.getLogger(name) for name in ("pygls", "asyncio")]
    guard = GuardedInput(io.BytesIO(data), output, _HANDLERS.keys())
    for log in logs:
        log.setLevel(logging.ERROR)
        log.addHandler(errors)
    try:
        server().start_io(guard, output)  # type: ignore[arg-type]
    finally:
        for log in logs:
            log.removeHandler(errors)
    assert not errors.found, errors.found[0][-1500:]
    if not output.closed:
        yield output.getvalue().decode()
    if guard.failure is not None:
        yield str(guard.failure)


TARGETS = (Target("language server", case, read, (), 20, 3_000, limit=30.0),)
