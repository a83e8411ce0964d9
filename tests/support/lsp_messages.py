"""Messages of an editor to the language server."""

from __future__ import annotations

import json
from typing import Any

URI = "file:///tmp/ergon-lsp-tests/score.yaml"
INITIALIZE = {
    "jsonrpc": "2.0",
    "id": 1,
    "method": "initialize",
    "params": {"processId": None, "rootUri": None, "capabilities": {}},
}


def requested(id: int, method: str, uri: str = URI, **more: object) -> dict[str, Any]:
    """A request about a document."""
    return {"id": id, **notified(method, uri, **more)}


def notified(method: str, uri: str = URI, **more: object) -> dict[str, Any]:
    """A notification about a document."""
    params = {"textDocument": {"uri": uri, "version": 2}, **more}
    return {"jsonrpc": "2.0", "method": method, "params": params}


def opened(text: str, uri: str = URI) -> dict[str, Any]:
    """The notification that a document is open."""
    document = {"uri": uri, "languageId": "ergon", "version": 1, "text": text}
    params = {"textDocument": document}
    return {"jsonrpc": "2.0", "method": "textDocument/didOpen", "params": params}


def framed(message: object) -> bytes:
    """A message with its header; bytes are a body as they stand."""
    body = message if isinstance(message, bytes) else json.dumps(message).encode()
    return f"Content-Length: {len(body)}\r\n\r\n".encode() + body


END = ({"jsonrpc": "2.0", "id": 99, "method": "shutdown"}, {"jsonrpc": "2.0", "method": "exit"})
