"""What a report's HTML page consists of, in the order of the page."""

import base64
import re
from dataclasses import dataclass, field
from html.parser import HTMLParser

HEADINGS = ("h1", "h2", "h3")
_TEXTS = (*HEADINGS, "p", "li", "figcaption")
_SKIPPED = ("style", "nav", "title")
_CELLS = ("td", "th")
_SPACES = re.compile(r"[ \t\r\n]+")  # but not the ones that hold words together


@dataclass
class Block:
    """A heading, a paragraph, a picture or a table, in the order of the page."""

    kind: str
    text: str = ""
    picture: bytes = b""
    rows: list[list[str]] = field(default_factory=list)


def blocks(html: str) -> list[Block]:
    """What a page of this program's reports consists of; pictures must be PNG."""
    reader = _Reader()
    reader.feed(html)
    return [block for block in reader.found if block.text or block.picture or block.rows]


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[Block] = []
        self._skipping = 0
        self._pieces: list[str] | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in _SKIPPED:
            self._skipping += 1
        elif tag in _TEXTS or tag in _CELLS:
            self._pieces = []
        elif tag == "table":
            self.found.append(Block("table"))
        elif tag == "tr":
            self.found[-1].rows.append([])
        elif tag == "img":
            _, _, content = (dict(attrs)["src"] or "").partition("base64,")
            self.found.append(Block("picture", picture=base64.b64decode(content)))

    def handle_endtag(self, tag: str) -> None:
        if tag in _SKIPPED:
            self._skipping -= 1
        elif tag in _TEXTS or tag in _CELLS:
            text, self._pieces = _SPACES.sub(" ", "".join(self._pieces or [])).strip(), None
            if tag in _CELLS:
                self.found[-1].rows[-1].append(text)
            else:
                self.found.append(Block(tag, f"• {text}" if tag == "li" else text))

    def handle_data(self, data: str) -> None:
        if self._pieces is not None and not self._skipping:
            self._pieces.append(data)
