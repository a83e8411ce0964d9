"""A client of `ergon lsp` as an editor is one: a process, and a session of the protocol."""

from __future__ import annotations

import asyncio
import atexit
from collections.abc import Awaitable, Callable
from functools import cache
from pathlib import Path

from commands import ERGON
from lsprotocol import types as t
from patience import PATIENCE
from pygls.lsp.client import LanguageClient


class Editor:
    """A client with one document."""

    def __init__(self, client: LanguageClient, path: Path) -> None:
        self.client = client
        self.uri = path.as_uri()
        self.text = path.read_text(encoding="utf-8")
        self.published: asyncio.Queue[t.PublishDiagnosticsParams] = asyncio.Queue()

    def open(self) -> None:
        item = t.TextDocumentItem(self.uri, "yaml", 1, self.text)
        self.client.text_document_did_open(t.DidOpenTextDocumentParams(item))

    def close(self) -> None:
        document = t.TextDocumentIdentifier(self.uri)
        self.client.text_document_did_close(t.DidCloseTextDocumentParams(document))

    def type(self, text: str) -> None:
        self.text = text
        document = t.VersionedTextDocumentIdentifier(2, self.uri)
        change = t.TextDocumentContentChangeWholeDocument(text)
        self.client.text_document_did_change(t.DidChangeTextDocumentParams(document, [change]))

    async def diagnostics(self, wanted: Callable[[list[t.Diagnostic]], bool]) -> list[t.Diagnostic]:
        """The next ones that are wanted."""
        while True:
            output = await asyncio.wait_for(self.published.get(), PATIENCE)
            if output.uri == self.uri and wanted(list(output.diagnostics)):
                return list(output.diagnostics)

    def position_after(self, before: str) -> t.Position:
        """Behind the first occurrence of some words."""
        index = self.text.index(before) + len(before)
        line = self.text.count("\n", 0, index)
        begin = self.text.rfind("\n", 0, index) + 1
        return t.Position(line, len(self.text[begin:index].encode("utf-16-le")) // 2)

    async def completed(self, before: str) -> dict[str, t.CompletionItem]:
        document = t.TextDocumentIdentifier(self.uri)
        params = t.CompletionParams(document, self.position_after(before))
        result = await self.client.text_document_completion_async(params)
        assert isinstance(result, t.CompletionList)
        return {item.label: item for item in result.items}

    async def hovered(self, before: str) -> str:
        params = t.HoverParams(t.TextDocumentIdentifier(self.uri), self.position_after(before))
        result = await self.client.text_document_hover_async(params)
        assert result is not None
        assert isinstance(result.contents, t.MarkupContent)
        return result.contents.value

    async def defined(self, before: str) -> t.Location:
        params = t.DefinitionParams(t.TextDocumentIdentifier(self.uri), self.position_after(before))
        result = await self.client.text_document_definition_async(params)
        assert isinstance(result, t.Location)
        return result

    async def renamed(self, before: str, new: str) -> str:
        """The text after the name behind some words is renamed."""
        params = t.RenameParams(
            t.TextDocumentIdentifier(self.uri), self.position_after(before), new
        )
        result = await self.client.text_document_rename_async(params)
        assert result is not None
        assert result.changes is not None
        assert list(result.changes) == [self.uri]
        lines = self.text.splitlines(keepends=True)
        for edit in sorted(result.changes[self.uri], key=lambda e: e.range.start, reverse=True):
            start, end = edit.range.start, edit.range.end
            assert start.line == end.line
            line = lines[start.line].encode("utf-16-le")
            pieces = line[: 2 * start.character], line[2 * end.character :]
            before_it, after_it = (piece.decode("utf-16-le") for piece in pieces)
            lines[start.line] = before_it + edit.new_text + after_it
        return "".join(lines)


class _Server:
    """`ergon lsp`, started once for all documents of a test worker, and its client."""

    def __init__(self) -> None:
        self.editor: Editor | None = None
        self.client = LanguageClient("test", "1")
        self.runner = asyncio.Runner()

        @self.client.feature(t.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def store_published(params: t.PublishDiagnosticsParams) -> None:
            if self.editor is not None:
                self.editor.published.put_nowait(params)

        self.runner.run(self._begin())
        atexit.register(self._end)

    async def _begin(self) -> None:
        await self.client.start_io(*ERGON, "lsp")
        await self.client.initialize_async(t.InitializeParams(t.ClientCapabilities()))
        self.client.initialized(t.InitializedParams())

    async def edit(self, path: Path, act: Callable[[Editor], Awaitable[None]]) -> None:
        self.editor = Editor(self.client, path)
        self.editor.open()
        try:
            await act(self.editor)
        finally:
            self.editor.close()
            self.editor = None

    def _end(self) -> None:
        async def stop() -> None:
            await self.client.shutdown_async(None)
            self.client.exit(None)
            await self.client.stop()

        self.runner.run(stop())
        self.runner.close()


_server = cache(_Server)


def in_editor(path: Path, act: Callable[[Editor], Awaitable[None]]) -> None:
    """Open a score in an editor, and do something there."""
    server = _server()
    server.runner.run(server.edit(path, act))
