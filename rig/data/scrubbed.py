"""Text of a run without who lay under the rig, what was noted, and where on which machine it was."""

import io
import json
import os
import platform
import re
import tempfile
import tokenize
from collections.abc import Iterable
from pathlib import Path
from typing import Any

GONE = "(removed)"
_SUBJECT = "SUBJECT"
_FREE = {"subject", "title", "source", "text", "name", "condition", "after", "command"}
"""Keys whose text a person wrote, at any depth of a document."""

_PLAIN = re.compile(r"[-+]?[\d.]+|[a-z]+:[\d.,]+(?:,across|,turn_deg=[-\d.]+)?")
"""Numbers and shapes: a value or a literal that says nothing of anybody."""

_INSIDE = r"[^\\/\n\"'<>|:]+"
_POSIX = re.compile(rf"(?<![\w.…])/(?:{_INSIDE}/)+")
_WINDOWS = re.compile(rf"\b[A-Za-z]:\\+(?:{_INSIDE}\\+)*")
_AGAIN = re.compile("(?:…/)+")
_HOST = re.compile(r"(tcp://)[^:\s\"'/]+")
_STRINGS = {tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}


class Scrubber:
    """What is to go from every text of one run: a subject's code, notes, folders by their names."""

    def __init__(self, subjects: Iterable[str], notes: Iterable[str], folders: Iterable[str]) -> None:
        """folders: as they were given on a command line; those of this machine go too."""
        here = (Path.home(), Path.cwd(), Path(tempfile.gettempdir()))
        known = {*folders, *map(str, here), *(str(path.resolve()) for path in here)}
        ends = tuple(filter(None, (os.sep, os.altsep)))
        literal = {note: GONE for note in notes if note.strip()}
        literal |= {folder.rstrip("/\\") + end: "…/" for folder in known if len(folder) > 1 for end in ends}
        literal |= {code: _SUBJECT for code in subjects if code}
        if len(platform.node()) > 2:
            literal[platform.node()] = "HOST"
        escaped = {json.dumps(what)[1:-1]: put for what, put in literal.items()}
        self._literal = sorted((escaped | literal).items(), key=lambda one: -len(one[0]))

    def text(self, text: str) -> str:
        """Any text."""
        for what, put in self._literal:
            text = text.replace(what, put)
        text = _HOST.sub(r"\1…", text)
        return _AGAIN.sub("…/", _WINDOWS.sub("…/", _POSIX.sub("…/", text)))

    def value(self, value: Any, key: str = "") -> Any:
        """Anything from JSON: free text goes, of parameters all that is neither a number nor a shape."""
        if isinstance(value, dict):
            return {name: self.value(one, key if key == "parameters" else name) for name, one in value.items()}
        if isinstance(value, list):
            return GONE if key in _FREE else [self.value(one, key) for one in value]
        if not isinstance(value, str):
            return value
        if key in _FREE | {"parameters"} and value and not _PLAIN.fullmatch(value):
            return GONE
        return self.text(value)

    def line(self, line: str) -> str:
        """A line of JSON; one that is none only says how long it was."""
        try:
            found = json.loads(line)
        except ValueError:
            return json.dumps({"unreadable": len(line)})
        return json.dumps(self.value(found), ensure_ascii=False)

    def script(self, source: str) -> str | None:
        """Python without comments and without words between quotes, line by line as it was; None if it is none."""
        try:
            tokens = list(tokenize.generate_tokens(io.StringIO(source).readline))
        except (tokenize.TokenError, SyntaxError):
            return None
        lines = source.splitlines(keepends=True)
        for token in reversed(tokens):
            put = _put(token)
            if put is not None:
                (first, start), (last, end) = token.start, token.end
                whole = lines[first - 1][:start] + put + lines[last - 1][end:]
                lines[first - 1 : last] = whole.splitlines(keepends=True)
        return self.text("".join(lines))


def _put(token: tokenize.TokenInfo) -> str | None:
    """What stands instead of a token; None where it stays."""
    if token.type == tokenize.COMMENT:
        return "#"
    if token.type not in _STRINGS or _PLAIN.fullmatch(token.string.strip("\"'")):
        return None
    return f'"""{GONE}' + "\n" * token.string.count("\n") + '"""' if token.type == tokenize.STRING else GONE
