"""The page of `ergon view` as one file: its modules, a motion file and a sound inside it.

The modules are those that the server sends, unchanged but for the names of what they import. What
they ask a server for, a script before them answers from the file itself, and a policy in the file
forbids the browser every request.
"""

from __future__ import annotations

import base64
import html
import http.client
import json
import re
import urllib.parse
from collections.abc import Callable

from ergon.exchange.safe import MARK

_IMPORT_PATTERN = re.compile(r'(?<= from )"\./([\w-]+\.js)"')
_LINK_PATTERN = re.compile(r'<(?:link|script)\b[^>]*\b(?:href|src)="([\w.-]+)"[^>]*>(?:</script>)?')
# Words of the page's address, which a file has none of.
_ADDRESS_EXPRESSION = "new URLSearchParams(location.search)"
_CONTENT_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' data:; style-src 'unsafe-inline'; "
    "img-src data:; media-src blob:; connect-src 'none'; form-action 'none'; base-uri 'none'"
)
_ANSWERS_SCRIPT = """\
{
  const bytes = (name) => {
    const text = document.getElementById(`shared-${name}`);
    return text && Uint8Array.from(atob(text.textContent), (letter) => letter.charCodeAt(0));
  };
  window.fetch = async (name) => {
    const held = { motion: "motion", "sound.wav": "sound" }[name];
    const body = held && bytes(held);
    return body ? new Response(body) : new Response(null, { status: 404 });
  };
  window.WebSocket = class { // nothing is live here: it opens never, and ends never
    static OPEN = 1;
    readyState = 0;
    send() {}
  };
}
"""


def page_files(url: str) -> Callable[[str], str]:
    """A reader of the files of the page that a server at `url` sends, by name."""
    url_parts = urllib.parse.urlsplit(url)

    def read(module_name: str) -> str:
        page_connection = http.client.HTTPConnection(url_parts.netloc, timeout=60.0)
        try:
            page_connection.request("GET", url_parts.path + module_name)
            page_answer = page_connection.getresponse()
            if page_answer.status != http.client.OK:
                raise OSError(
                    f"the page's file {module_name or 'index.html'}: {page_answer.status}"
                )
            return page_answer.read().decode()
        finally:
            page_connection.close()

    return read


def shared_page(
    read_file: Callable[[str], str],
    title: str,
    words: list[str],
    motion: bytes,
    sound: bytes | None,
) -> str:
    """The text of one HTML file with everything in it.

    `read_file` gives the files of the page by name; `words` are those of the page's address that
    hold where the file is opened without any. A sound is FLAC or WAV.
    """
    index_page = read_file("")
    module_texts = _page_modules(read_file, "main.js")
    main_text = module_texts["main.js"]
    if main_text.count(_ADDRESS_EXPRESSION) != 1:
        raise ValueError("the page does not read the words of its address where it did")
    address_script = _ADDRESS_EXPRESSION.replace(")", f" || {json.dumps('&'.join(words))})")
    module_texts["main.js"] = main_text.replace(_ADDRESS_EXPRESSION, address_script)
    imports = {
        f"ergon/{name}": _data_url(
            "text/javascript", _IMPORT_PATTERN.sub(r'"ergon/\1"', text).encode()
        )
        for name, text in module_texts.items()
    }
    icon = _data_url("image/svg+xml", read_file("icon.svg").encode())
    head_html = "\n".join(
        (
            f'<meta http-equiv="Content-Security-Policy" content="{_CONTENT_POLICY}">',
            f"<title>{html.escape(title)}</title>",
            f'<link rel="icon" href="{icon}">',
            f"<style>\n{read_file('style.css')}</style>",
            f"<script>\n{_ANSWERS_SCRIPT}</script>",
            f'<script type="importmap">{json.dumps({"imports": imports})}</script>',
        )
    )
    files_by_name = [("motion", motion)] + ([("sound", sound)] if sound is not None else [])
    page_tail = "\n".join(
        (
            *(
                f'<script type="text/plain" id="shared-{name}">'
                f"{base64.b64encode(content).decode()}</script>"
                for name, content in files_by_name
            ),
            '<script type="module">import "ergon/main.js";</script>',
        )
    )
    text = _LINK_PATTERN.sub("", re.sub(r"<title>[^<]*</title>", "", index_page))
    text = text.replace("<!doctype html>", f"<!doctype html>\n<!-- {MARK.decode()} -->", 1)
    return text.replace("</head>", f"{head_html}\n</head>", 1).replace(
        "</body>", f"{page_tail}\n</body>", 1
    )


def _page_modules(read_module: Callable[[str], str], first_module: str) -> dict[str, str]:
    """A module and all that it imports, by name."""
    module_texts: dict[str, str] = {}
    module_names = [first_module]
    while module_names:
        module_name = module_names.pop()
        if module_name not in module_texts:
            module_texts[module_name] = read_module(module_name)
            module_names += _IMPORT_PATTERN.findall(module_texts[module_name])
    return module_texts


def _data_url(media_type: str, content: bytes) -> str:
    return f"data:{media_type};base64,{base64.b64encode(content).decode()}"
