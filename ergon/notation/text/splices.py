"""The replacements in a text that set, add or take away a value.

The texts given are one line each; `Layout` finds what stands beside the change.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ergon.common.errors import ErgonError
from ergon.notation.text.errors import quote
from ergon.notation.text.spans import Layout, Span, Splice

Path = Sequence[str | int]


class EditError(ErgonError):
    """An edit that cannot be made; the message is one sentence."""


def named(path: Path) -> str:
    """A path as a user writes it."""
    return quote(".".join(map(str, path)))


class Changes:
    """The splices of each kind of change in one layout."""

    def __init__(self, layout: Layout) -> None:
        """Take the layout of the text."""
        self.layout = layout

    def rows(self, span: Span) -> list[tuple[int, int]]:
        """Where the lines of a block begin and end in the text."""
        row_spans, row_start = [], self.layout.next_line(self.layout.header_end(span))
        while row_start < span.end:
            row_spans.append((row_start, self.layout.line_end(row_start)))
            row_start = self.layout.next_line(row_start)
        return row_spans

    # --- setting ---------------------------------------------------------------------------------

    def replace_child(self, parent: Span, child_index: int, text: str) -> list[Splice]:
        """Set the value of a child; if the old value has several lines, all of them are removed."""
        text_layout, child_span = self.layout, parent.items[child_index]
        if child_span.start == child_span.end:  # nothing after the colon or dash
            if parent.kind == "sequence":
                return [Splice(child_span.start, child_span.start, f" {text}")]
            colon = text_layout.next_token(parent.keys[child_index].end)
            if text_layout.text[colon : colon + 1] == ":":
                return [Splice(colon + 1, colon + 1, f" {text}")]
            end = parent.keys[child_index].end
            return [Splice(end, end, f": {text}")]
        if child_span.is_block:
            header_splice = Splice(child_span.start, text_layout.header_end(child_span), text)
            return [header_splice, *self.lines_after(child_span.start, child_span.end)]
        is_below_key = child_span.kind in ("mapping", "sequence") and text_layout.begins_line(
            child_span.start
        )
        if is_below_key and not child_span.is_flow:
            child_start = text_layout.child_start(parent, child_index)
            key_end = parent.keys[child_index].end if parent.kind == "mapping" else child_start
            value_offset = text_layout.next_token(key_end) + 1
            return [
                Splice(value_offset, value_offset, f" {text}"),
                Splice(*text_layout.full_lines(child_span.start, child_span.end), ""),
            ]
        return [Splice(child_span.start, child_span.end, text)]

    def lines_after(self, start_index: int, end_index: int) -> list[Splice]:
        """Remove the lines after that of the character `start_index`, up to that of the character
        `end_index`.
        """
        text_layout = self.layout
        next_line = text_layout.next_line(start_index)
        return (
            [Splice(*text_layout.full_lines(next_line, end_index), "")]
            if next_line <= end_index and next_line > start_index
            else []
        )

    def add_entry(
        self,
        spans: list[Span],
        path: Path,
        entry_text: str,
        name_order: Sequence[str],
        is_item: bool,
    ) -> list[Splice]:
        """Add an entry that does not exist yet, below the last part of its path that does."""
        if not spans:
            nested_text = self.layout.newline.join(self.nested_lines(path, entry_text, 0, is_item))
            full_text = self.layout.text
            line_break_before = (
                self.layout.newline if full_text and not full_text.endswith(("\n", "\r")) else ""
            )
            return [
                Splice(
                    len(full_text),
                    len(full_text),
                    line_break_before + nested_text + self.layout.newline,
                )
            ]
        last_span, path_rest = spans[-1], path[len(spans) - 1 :]
        if last_span.is_empty and len(spans) > 1:
            return self.fill_empty(
                spans[-2], last_span, path[len(spans) - 2], path_rest, entry_text, is_item
            )
        if last_span.kind != "mapping" or not path_rest or isinstance(path_rest[0], int):
            raise EditError(f"there is no {named(path)}")
        if last_span.is_flow:
            return self.append_item(last_span, _flow(path_rest, entry_text, is_item))
        indent = self.layout.column(last_span.keys[0].start)
        nested_lines = self.nested_lines(path_rest, entry_text, indent, is_item)
        if len(spans) == 1:
            return self.insert_section(last_span, str(path_rest[0]), nested_lines, name_order)
        return [self.insert_below(last_span.end, nested_lines)]

    def fill_empty(
        self, parent: Span, node: Span, name: str | int, path_rest: Path, text: str, is_item: bool
    ) -> list[Splice]:
        """Fill an empty value: with lines below its name, or in flow style in its place."""
        child_index = parent.index(name)
        assert child_index is not None
        if parent.is_flow or node.start != node.end or not (path_rest or is_item):
            return self.replace_child(
                parent, child_index, _flow(path_rest, text, is_item, outermost=True)
            )
        indent = (
            self.layout.column(self.layout.child_start(parent, child_index))
            + self.layout.indent_step
        )
        # Without a name left to make, the value itself is the list.
        nested_lines = (
            self.nested_lines(path_rest, text, indent, is_item)
            if path_rest
            else [" " * indent + f"- {text}"]
        )
        return [self.insert_below(node.end, nested_lines)]

    def nested_lines(
        self, names_below: Path, value_text: str, indent: int, is_item: bool
    ) -> list[str]:
        """Lines of nested names; the innermost holds the value, or a list of it."""
        indent_step = self.layout.indent_step
        nested_lines = [
            f"{' ' * (indent + indent_step * depth)}{name}:"
            for depth, name in enumerate(names_below)
        ]
        if is_item:
            return [
                *nested_lines,
                f"{' ' * (indent + indent_step * len(names_below))}- {value_text}",
            ]
        return [*nested_lines[:-1], f"{nested_lines[-1]} {value_text}"]

    def insert_below(self, index: int, lines: Sequence[str]) -> Splice:
        """Insert lines after the line of a character."""
        end = self.layout.line_end(index)
        return Splice(end, end, "".join(self.layout.newline + line for line in lines))

    def insert_section(
        self, root: Span, name: str, lines: list[str], order: Sequence[str]
    ) -> list[Splice]:
        """Insert a section in its place, with an empty line above if the others have one."""
        section_rank = order.index(name) if name in order else len(order)
        earlier_sections = [
            key_index
            for key_index, key in enumerate(root.keys)
            if key.value in order[:section_rank] or section_rank == len(order)
        ]
        text_layout = self.layout
        if not earlier_sections:
            start = root.keys[0].start
            return [Splice(start, start, "".join(line + text_layout.newline for line in lines))]
        section_end = root.items[earlier_sections[-1]].end
        next_line = text_layout.next_line(section_end)
        is_spaced = text_layout.is_blank(next_line)
        if next_line == len(text_layout.text):
            is_spaced = text_layout.newline * 2 in text_layout.text
        return [
            self.insert_below(section_end, ["", *lines] if is_spaced and len(lines) > 1 else lines)
        ]

    def append_item(self, list_span: Span, item_text: str) -> list[Splice]:
        """Add an item at the end of a list or, in flow style, of a mapping."""
        text_layout = self.layout
        if not list_span.is_flow:
            dash_column = text_layout.column(text_layout.child_start(list_span, 0))
            return [self.insert_below(list_span.end, [f"{' ' * dash_column}- {item_text}"])]
        if not list_span.items:
            opening_index = text_layout.text.index(
                "[" if list_span.kind == "sequence" else "{", list_span.start
            )
            return [Splice(opening_index + 1, opening_index + 1, item_text)]
        last_item = list_span.items[-1]
        end_index = max(last_item.end, list_span.keys[-1].end) if list_span.keys else last_item.end
        start_index = text_layout.child_start(list_span, len(list_span.items) - 1)
        if not text_layout.begins_line(start_index):
            return [Splice(end_index, end_index, f", {item_text}")]
        comma = text_layout.next_token(end_index)
        has_comma = text_layout.text[comma : comma + 1] == ","
        splices = [] if has_comma else [Splice(end_index, end_index, ",")]
        item_line = " " * text_layout.column(start_index) + item_text + ("," if has_comma else "")
        closing_index = list_span.end - 1
        if (
            text_layout.line_end(end_index) > closing_index
        ):  # the bracket closes in the last item's line
            return [Splice(end_index, end_index, f", {item_text}")]
        return [*splices, self.insert_below(end_index, [item_line])]

    def insert_before(self, node: Span, item_index: int, text: str) -> list[Splice]:
        """Insert an item before another one of a list: in its line, or in a line above it."""
        text_layout = self.layout
        start_index = text_layout.child_start(node, item_index)
        item_head = text if node.is_flow else f"- {text}"
        if text_layout.begins_line(start_index):
            separator = (
                ("," if node.is_flow else "")
                + text_layout.newline
                + " " * text_layout.column(start_index)
            )
            return [Splice(start_index, start_index, item_head + separator)]
        if not node.is_flow:
            raise EditError(
                "an entry cannot be inserted above this one, which does not begin a line"
            )
        return [Splice(start_index, start_index, f"{text}, ")]

    def wrap_in_list(self, parent: Span, lone_span: Span, item_text: str) -> list[Splice]:
        """Make a lone value the first item of a list of two."""
        text_layout = self.layout
        if lone_span.is_flow or parent.is_flow or lone_span.kind == "scalar":
            if lone_span.is_block:
                raise EditError("a text of several lines cannot become an item of a list")
            return [
                Splice(lone_span.start, lone_span.start, "["),
                Splice(lone_span.end, lone_span.end, f", {item_text}]"),
            ]
        if lone_span.kind == "alias" or not text_layout.begins_line(lone_span.start):
            raise EditError(
                "the value cannot become a list as it is written; "
                "edit the text of the score instead"
            )
        indent, splices = text_layout.column(lone_span.start), []
        start_index = text_layout.line_start(lone_span.start)
        while start_index <= lone_span.end:
            if text_layout.text[start_index : text_layout.line_end(start_index)].strip():
                line_start_text = (
                    "- " if start_index == text_layout.line_start(lone_span.start) else "  "
                )
                splices.append(Splice(start_index + indent, start_index + indent, line_start_text))
            if (
                text_layout.next_line(start_index) == start_index
                or text_layout.next_line(start_index) > lone_span.end
            ):
                break
            start_index = text_layout.next_line(start_index)
        return [*splices, self.insert_below(lone_span.end, [f"{' ' * indent}- {item_text}"])]

    # --- taking away -----------------------------------------------------------------------------

    def cut_block(self, parent_span: Span, child_index: int) -> list[Splice]:
        """Remove an entry with its lines; of two empty lines that would meet, one is removed
        too.
        """
        text_layout = self.layout
        start_index, end_index = (
            text_layout.child_start(parent_span, child_index),
            parent_span.items[child_index].end,
        )
        if not text_layout.begins_line(start_index):
            if len(parent_span.items) == 1:
                return [Splice(start_index, text_layout.line_end(end_index), "")]
            cut_end = text_layout.child_start(parent_span, 1)
            if "#" in text_layout.text[text_layout.line_end(end_index) : cut_end]:
                raise EditError(
                    "a comment is between this entry and the next; move the comment first"
                )
            return [Splice(start_index, cut_end, "")]
        cut_start, cut_end = text_layout.line_start(start_index), text_layout.next_line(end_index)
        reaches_end = cut_end == len(text_layout.text)
        if (
            cut_start
            and text_layout.is_blank(cut_start - 1)
            and (reaches_end or text_layout.is_blank(cut_end))
        ):
            cut_start = text_layout.line_start(cut_start - 1)
        return [Splice(*text_layout.with_break(cut_start, cut_end), "")]

    def cut_flow(
        self, parent_span: Span, child_index: int, removed_numbers: Collection[int]
    ) -> list[Splice]:
        """Remove an item with its comma, when the items `removed_numbers` are removed too. If it
        has lines of its own, these are removed.
        """
        text_layout = self.layout
        start_index, end_index = (
            text_layout.child_start(parent_span, child_index),
            parent_span.items[child_index].end,
        )
        if parent_span.keys:
            end_index = max(end_index, parent_span.keys[child_index].end)
        comma = text_layout.next_token(end_index)
        cut_stop = comma + 1 if text_layout.text[comma : comma + 1] == "," else end_index
        is_last = all(
            later_index in removed_numbers
            for later_index in range(child_index + 1, len(parent_span.items))
        )
        cut_start = parent_span.items[child_index - 1].end if child_index else start_index
        if parent_span.keys and child_index:
            cut_start = max(cut_start, parent_span.keys[child_index - 1].end)
        line_rest = text_layout.text[cut_stop : text_layout.line_end(cut_stop)].strip()
        if text_layout.begins_line(start_index) and (not line_rest or line_rest.startswith("#")):
            splices = [Splice(*text_layout.full_lines(start_index, cut_stop), "")]
            if (
                is_last and child_index and cut_stop == end_index
            ):  # the list had no comma at its end
                comma = text_layout.next_token(cut_start)
                splices.append(Splice(comma, comma + 1, ""))
            return splices
        if not is_last or not child_index:
            gap = text_layout.text[cut_stop : text_layout.next_token(cut_stop)]
            spaces = len(gap) - len(gap.lstrip(" ")) if cut_stop > end_index else 0
            return [Splice(start_index, cut_stop + spaces, "")]
        if "#" in text_layout.text[cut_start:start_index]:
            return [Splice(start_index, end_index, "")]  # the comma before may end a list
        return [Splice(cut_start, end_index, "")]


def _flow(names_below: Path, text: str, is_item: bool, outermost: bool = False) -> str:
    """`a: {b: text}`; with `outermost`, the first name is in braces too."""
    inner = f"[{text}]" if is_item else text
    for depth, name in enumerate(reversed(names_below)):
        is_first = depth == len(names_below) - 1
        inner = f"{name}: {inner}" if is_first and not outermost else f"{{{name}: {inner}}}"
    return inner
