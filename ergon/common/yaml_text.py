"""Untrusted YAML of other programs: bounded, without aliases, tags and numbers."""

from __future__ import annotations

from typing import Any

import yaml

from ergon.common.errors import ErgonError
from ergon.common.terminal import printable

_DEPTH_MAX = 32


class YamlError(ErgonError, ValueError):
    """The text is not YAML, or not YAML that is read here."""


class _Loader(yaml.BaseLoader):
    """Refuses a table that has a key twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [str(key.value) for key, _ in node.value]
        if len(set(keys)) < len(keys):
            repeated_key = next(key for key in keys if keys.count(key) > 1)
            raise YamlError(f"a table of it has {printable(repeated_key[:40])!r} twice")
        return super().construct_mapping(node, deep)


def decode_yaml(data: bytes, errors: str = "strict") -> str:
    """The text of a file of YAML in UTF-8, or in UTF-16 if a mark says so.

    `errors` is that of `bytes.decode`. Raises UnicodeDecodeError if that is `strict`.
    """
    has_wide_mark = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    return data.decode("utf-16" if has_wide_mark else "utf-8-sig", errors)


def parse_yaml(data: bytes, events_max: int) -> Any:
    """A document of lists, tables and texts. Numbers stay texts: those of YAML 1.1 may take hours
    (1:1:1:…) and its 030 is 24, where the EBU's reader has 30.
    """
    try:
        yaml_text = decode_yaml(data)
        depth = 0
        for n_events, yaml_event in enumerate(yaml.parse(yaml_text, Loader=yaml.BaseLoader)):
            if isinstance(yaml_event, yaml.AliasEvent):
                raise YamlError("its YAML has aliases, which are not read")
            depth += isinstance(yaml_event, yaml.CollectionStartEvent)
            depth -= isinstance(yaml_event, yaml.CollectionEndEvent)
            if depth > _DEPTH_MAX:
                raise YamlError("its YAML is nested too deeply")
            if n_events > events_max:
                raise YamlError(f"its YAML has more than {events_max:,} values")
        return yaml.load(yaml_text, Loader=_Loader)
    except (UnicodeDecodeError, ValueError, yaml.YAMLError) as error:
        if isinstance(error, YamlError):
            raise
        reason = " ".join(str(error).split())
        raise YamlError(f"this is not YAML: {reason}") from None
