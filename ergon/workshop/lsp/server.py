"""The Language Server Protocol: the open documents of an editor, and answers about them.

A score is read while it is typed; when it is opened or saved, the engine checks it too, as
`ergon check` does.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

from lsprotocol import types as t
from pygls.exceptions import JsonRpcInvalidRequest
from pygls.lsp.server import LanguageServer
from pygls.uris import from_fs_path
from pygls.workspace import TextDocument

from ergon import _core
from ergon.api import score as scores
from ergon.api.check import try_stage
from ergon.common.manual_pages import mistake_page_uri
from ergon.common.regular import read_bounded
from ergon.notation.tables.shapes import NAME
from ergon.notation.text import document
from ergon.notation.text.document import Document
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import Collector, Diagnostic, TextError, quote
from ergon.notation.text.files import installed_path
from ergon.notation.text.format import formatted
from ergon.notation.text.syntax import MAX_BYTES
from ergon.notation.text.values import Place
from ergon.scores.edits.renaming import reference_spans, rename
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.load import Loaded, load

from . import answers, cursor
from .catalogue import Catalogue, build_catalogue
from .guard import GuardedInput

# An editor reports every keystroke; a score is read once typing has paused for this long [s].
TYPING_PAUSE = 0.15
_SCORE_PATTERN = re.compile(r"^ergon[ \t]*:", re.MULTILINE)
_SEVERITIES = {
    "error": t.DiagnosticSeverity.Error,
    "warning": t.DiagnosticSeverity.Warning,
    "note": t.DiagnosticSeverity.Information,
}
_KINDS = {
    "field": t.CompletionItemKind.Field,
    "kind": t.CompletionItemKind.Class,
    "name": t.CompletionItemKind.Reference,
    "value": t.CompletionItemKind.Value,
    "unit": t.CompletionItemKind.Unit,
}


@dataclass(slots=True)
class _OpenDocument:
    """What is kept of an open document."""

    catalogue: Catalogue = field(default_factory=Catalogue)  # catalogue of the last legible text
    # The documents that its diagnostics are about.
    diagnostic_uris: set[str] = field(default_factory=set)
    version: int = 0


class Server(LanguageServer):
    """Answers about the open documents."""

    def __init__(self) -> None:
        """Start with no document."""
        super().__init__(
            "ergon", _core.__version__, text_document_sync_kind=t.TextDocumentSyncKind.Incremental
        )
        self._open: dict[str, _OpenDocument] = {}

    # --- reading ----------------------------------------------------------------------------------

    async def read_document(self, uri: str, *, saved: bool = False) -> None:
        """Read a document, unless it changes again meanwhile; if `saved`, let the engine check it
        too.
        """
        with contextlib.suppress(asyncio.CancelledError):  # the server ends meanwhile
            await self._read(uri, saved)

    async def _read(self, uri: str, saved: bool) -> None:
        open_document = self._open.setdefault(uri, _OpenDocument())
        open_document.version += 1
        version = open_document.version
        await asyncio.sleep(0 if saved else TYPING_PAUSE)
        if open_document.version != version:
            return
        if not self.is_score(uri):
            self._publish(uri, open_document, [])
            return
        loaded = self._load(uri)
        self._publish(uri, open_document, loaded.diagnostics)
        if loaded.names is not None:
            open_document.catalogue = build_catalogue(loaded)
        if saved and loaded.piece is not None:
            _, stage_diagnostics = await asyncio.to_thread(try_stage, loaded, None)
            if open_document.version == version:
                self._publish(uri, open_document, [*loaded.diagnostics, *stage_diagnostics])

    def forget_document(self, uri: str) -> None:
        """Forget a document, and clear its diagnostics."""
        open_document = self._open.pop(uri, _OpenDocument())
        open_document.version += 1
        self._publish(uri, open_document, [])

    def is_score(self, uri: str) -> bool:
        """Whether a document is a score; an editor sends every YAML file that is open."""
        text = self.workspace.get_text_document(uri)
        return text.language_id == "ergon" or _SCORE_PATTERN.search(text.source) is not None

    def _load(self, uri: str) -> Loaded:
        path = _path_of_uri(uri)
        overlay = {
            str(_path_of_uri(document_uri)): text_document.source
            for document_uri, text_document in self.workspace.text_documents.items()
        }
        text = self.workspace.get_text_document(uri).source
        return load(path, text=text, overlay=overlay, bounds=scores.bounds(str(path), False))

    def rename_spans(self, uri: str, old: str, new: str) -> list[tuple[int, int]]:
        """Begin and end of each place where a score names what is to be called `new`. Raises
        EditError.
        """
        if not NAME.fullmatch(new):
            raise EditError(
                f"{quote(new)} is not a name: a name has letters, digits, '-' and '_', and begins "
                "with a letter"
            )
        loaded = self._load(uri)
        if loaded.piece is None:
            raise EditError("the score has mistakes; mend them first, so that all uses are known")
        path = str(_path_of_uri(uri))
        texts = Texts(
            path,
            self.workspace.get_text_document(uri).source,
            {name: file.text for name, file in loaded.files.items() if name != path},
            bounds=scores.bounds(path, False),
        )
        rename(texts, loaded.piece, old, new)  # this also tests that the piece is the same
        return reference_spans(texts, loaded.piece, old, new)

    def _publish(
        self, uri: str, open_document: _OpenDocument, reported: Sequence[Diagnostic]
    ) -> None:
        """Publish each diagnostic in the document that it is about, and clear the earlier ones."""
        diagnostics_by_uri: dict[str, list[t.Diagnostic]] = {
            uri: [],
            **{old: [] for old in open_document.diagnostic_uris},
        }
        for diagnostic in reported:
            diagnostic_uri = _uri_of_file(diagnostic.place.file, uri)
            diagnostics_by_uri.setdefault(diagnostic_uri, []).append(
                self._diagnostic(diagnostic_uri, diagnostic)
            )
        open_document.diagnostic_uris = {
            diagnostic_uri
            for diagnostic_uri, diagnostics in diagnostics_by_uri.items()
            if diagnostics
        }
        for diagnostic_uri, diagnostics in diagnostics_by_uri.items():
            self.text_document_publish_diagnostics(
                t.PublishDiagnosticsParams(diagnostic_uri, diagnostics)
            )

    def _diagnostic(self, uri: str, diagnostic: Diagnostic) -> t.Diagnostic:
        message = diagnostic.message + (
            f"; did you mean '{diagnostic.suggestion}'?" if diagnostic.suggestion else ""
        )
        page = mistake_page_uri(diagnostic.code)
        return t.Diagnostic(
            self.range(uri, diagnostic.place),
            message + (f"\n{diagnostic.help}" if diagnostic.help else ""),
            severity=_SEVERITIES[diagnostic.severity],
            code=diagnostic.code,
            code_description=t.CodeDescription(page) if page else None,
            source="ergon",
            data=diagnostic.suggestion,
        )

    # --- places -----------------------------------------------------------------------------------

    def range(self, uri: str, symbol_place: Place) -> t.Range:
        """The range of a place, in the client's units."""
        text_document = self._document(uri)
        start = t.Position(symbol_place.line - 1, symbol_place.column - 1)
        end = t.Position(symbol_place.line - 1, symbol_place.column - 1 + symbol_place.length)
        return text_document.position_codec.range_to_client_units(
            text_document.lines, t.Range(start, end)
        )

    def _document(self, uri: str) -> TextDocument:
        """An open document, or a file that one of them uses."""
        open_text: TextDocument | None = self.workspace.text_documents.get(unquote(uri))
        if open_text is not None:
            return open_text
        try:
            file_text = read_bounded(_path_of_uri(uri), MAX_BYTES).decode("utf-8", "replace")
        except OSError:
            file_text = ""
        return TextDocument(uri, file_text, position_codec=self.workspace.position_codec)

    def locate(
        self, uri: str, position: t.Position
    ) -> tuple[TextDocument, int, Document, Catalogue]:
        """An open document, the index of a position in it, its nodes, and the names it knows."""
        text_document = self.workspace.get_text_document(uri)
        file = document.compose(text_document.source, str(_path_of_uri(uri)), Collector())
        known_names = self._open.setdefault(uri, _OpenDocument()).catalogue
        return text_document, text_document.offset_at_position(position), file, known_names


def serve() -> int:
    """Serve an editor on stdin and stdout until it disconnects, and return the exit code: 1 after
    `exit` without `shutdown` (LSP 3.17, `exit`). Raises ProtocolError.
    """
    logging.getLogger("pygls").setLevel(logging.ERROR)  # its warnings are about the editor
    # pygls closes its output at `exit`, and this process has to flush its own after that.
    with open(os.dup(sys.stdout.fileno()), "wb") as output:
        guarded = GuardedInput(sys.stdin.buffer, output, _HANDLERS.keys())
        server().start_io(guarded, output)  # type: ignore[arg-type]  # it has what pygls calls
    if guarded.failure is not None:
        raise guarded.failure
    return int(guarded.exits_early)


def server() -> Server:
    """A server with the handlers of all requests."""
    new_server = Server()
    for method, handler in _HANDLERS.items():
        new_server.feature(method, *_OPTIONS.get(method, ()))(handler)
    return new_server


# --- handlers, one for each request ---------------------------------------------------------------


async def _on_open(ls: Server, params: t.DidOpenTextDocumentParams) -> None:
    await ls.read_document(params.text_document.uri, saved=True)


async def _on_change(ls: Server, params: t.DidChangeTextDocumentParams) -> None:
    await ls.read_document(params.text_document.uri)


async def _on_save(ls: Server, params: t.DidSaveTextDocumentParams) -> None:
    await ls.read_document(params.text_document.uri, saved=True)


def _on_close(ls: Server, params: t.DidCloseTextDocumentParams) -> None:
    ls.forget_document(params.text_document.uri)


def _complete(ls: Server, params: t.CompletionParams) -> t.CompletionList:
    text_document, index, file, known_names = ls.locate(params.text_document.uri, params.position)
    is_score = ls.is_score(params.text_document.uri)
    completions = (
        answers.completions(text_document.source, index, file, known_names) if is_score else []
    )
    begin = index - len(cursor.word_before(text_document.source, index))
    typed_range = t.Range(
        _client_position(text_document, begin), _client_position(text_document, index)
    )
    return t.CompletionList(
        is_incomplete=True, items=list(_completion_items(completions, typed_range))
    )


def _client_position(text_document: TextDocument, text_index: int) -> t.Position:
    """The position of an index; that of the end is on the last line, unless this line is ended."""
    if text_index < len(text_document.source):
        return text_document.client_position_at_offset(text_index)
    document_lines = text_document.lines
    if not document_lines or text_document.source.endswith(("\n", "\r")):
        return t.Position(len(document_lines), 0)
    return t.Position(
        len(document_lines) - 1, text_document.position_codec.client_num_units(document_lines[-1])
    )


def _completion_items(
    completions: Iterable[answers.Completion], word_range: t.Range
) -> Iterable[t.CompletionItem]:
    for item_index, completion in enumerate(completions):
        yield t.CompletionItem(
            completion.word,
            kind=_KINDS[completion.kind],
            detail=completion.detail,
            sort_text=f"{item_index:05d}",
            filter_text=completion.word,
            text_edit=t.TextEdit(word_range, completion.word + completion.suffix),
        )


def _hover(ls: Server, params: t.HoverParams) -> t.Hover | None:
    uri = params.text_document.uri
    _, index, file, known_names = ls.locate(uri, params.position)
    explanation = answers.explanation(index, file, known_names) if ls.is_score(uri) else None
    return (
        None
        if explanation is None
        else t.Hover(t.MarkupContent(t.MarkupKind.Markdown, explanation))
    )


def _definition(ls: Server, params: t.DefinitionParams) -> t.Location | None:
    uri = params.text_document.uri
    _, index, file, known_names = ls.locate(uri, params.position)
    name_definition = answers.definition(index, file, known_names)
    if name_definition is None:
        return None
    target_uri = _uri_of_file(name_definition.place.file, uri)
    return t.Location(target_uri, ls.range(target_uri, name_definition.place))


def _code_actions(ls: Server, params: t.CodeActionParams) -> list[t.CodeAction]:
    """Quick fixes that replace a mistake by its suggestion."""
    uri = params.text_document.uri
    return [
        t.CodeAction(
            f"Write '{diagnostic.data}'",
            kind=t.CodeActionKind.QuickFix,
            diagnostics=[diagnostic],
            edit=t.WorkspaceEdit({uri: [t.TextEdit(diagnostic.range, diagnostic.data)]}),
        )
        for diagnostic in params.context.diagnostics
        if diagnostic.source == "ergon" and isinstance(diagnostic.data, str)
    ]


def _rename(ls: Server, params: t.RenameParams) -> t.WorkspaceEdit:
    """Another name for what is called so, in every place of the score. Raises JsonRpcException
    with the reason where it is not renamed.
    """
    uri = params.text_document.uri
    text_document, index, *_ = ls.locate(uri, params.position)
    name = cursor.word_at(text_document.source, index).strip("/-").partition(".")[0]
    try:
        spans = ls.rename_spans(uri, name, params.new_name)
    except EditError as error:
        raise JsonRpcInvalidRequest(str(error)) from None
    edits = [
        t.TextEdit(
            t.Range(
                text_document.client_position_at_offset(start),
                text_document.client_position_at_offset(stop),
            ),
            params.new_name,
        )
        for start, stop in spans
    ]
    return t.WorkspaceEdit({uri: edits})


def _document_symbols(ls: Server, params: t.DocumentSymbolParams) -> list[t.DocumentSymbol]:
    """Sections, and the names below them."""
    uri = params.text_document.uri
    root = ls.locate(uri, t.Position(0, 0))[2].root if ls.is_score(uri) else None
    entries = root.entries.items() if isinstance(root, document.Mapping) else ()
    symbols = []
    for name, (key, child) in entries:
        inner_entries = child.entries.items() if isinstance(child, document.Mapping) else ()
        children = [_symbol(ls, uri, word, node.place) for word, (node, _) in inner_entries]
        symbols.append(_symbol(ls, uri, name, key.place, children))
    return symbols


def _symbol(
    ls: Server, uri: str, symbol_name: str, place: Place, children: Sequence[t.DocumentSymbol] = ()
) -> t.DocumentSymbol:
    symbol_range = ls.range(uri, place)
    kind = t.SymbolKind.Namespace if children else t.SymbolKind.Field
    return t.DocumentSymbol(symbol_name, kind, symbol_range, symbol_range, children=children)


def _format(ls: Server, params: t.DocumentFormattingParams) -> list[t.TextEdit] | None:
    text_document = ls.workspace.get_text_document(params.text_document.uri)
    if not ls.is_score(params.text_document.uri):
        return None
    try:
        formatted_text = formatted(text_document.source)
    except TextError:  # its place is among the diagnostics
        return None
    if formatted_text == text_document.source:
        return None
    full_range = t.Range(t.Position(0, 0), t.Position(len(text_document.lines), 0))
    return [t.TextEdit(full_range, formatted_text)]


def _path_of_uri(uri: str) -> Path:
    """The file of a document; a document that is not saved yet counts as one in the working
    folder.
    """
    parts = urlparse(uri)
    path = unquote(parts.path)
    return Path(path) if parts.scheme == "file" else Path(Path(path).name or "untitled.yaml")


def _uri_of_file(file_name: str, open_uri: str) -> str:
    """The URI of a file that a score names; a file of the library is found where ergon is
    installed.
    """
    path = Path(file_name)
    if path == _path_of_uri(open_uri):
        return open_uri
    return (
        from_fs_path(str((path if path.exists() else installed_path(file_name)).resolve()))
        or open_uri
    )


_HANDLERS: dict[str, Callable[..., Any]] = {
    t.TEXT_DOCUMENT_DID_OPEN: _on_open,
    t.TEXT_DOCUMENT_DID_CHANGE: _on_change,
    t.TEXT_DOCUMENT_DID_SAVE: _on_save,
    t.TEXT_DOCUMENT_DID_CLOSE: _on_close,
    t.TEXT_DOCUMENT_COMPLETION: _complete,
    t.TEXT_DOCUMENT_HOVER: _hover,
    t.TEXT_DOCUMENT_DEFINITION: _definition,
    t.TEXT_DOCUMENT_CODE_ACTION: _code_actions,
    t.TEXT_DOCUMENT_RENAME: _rename,
    t.TEXT_DOCUMENT_DOCUMENT_SYMBOL: _document_symbols,
    t.TEXT_DOCUMENT_FORMATTING: _format,
}
_OPTIONS = {
    t.TEXT_DOCUMENT_COMPLETION: (t.CompletionOptions(trigger_characters=[" ", "{", "[", "."]),),
    t.TEXT_DOCUMENT_CODE_ACTION: (t.CodeActionOptions([t.CodeActionKind.QuickFix]),),
}
