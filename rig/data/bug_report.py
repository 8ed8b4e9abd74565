"""Bundle for a bug report, without the subject, the notes and the machine."""

import io
import json
import os
import platform
import re
import tempfile
import tokenize
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

from rig.data.folder import RunFolder, replace_bytes
from rig.data.run import RunError
from rig.data.run_time import RunTime, is_timed
from rig_shared.user_files import json_of, read_text

GONE = "(removed)"
_SUBJECT = "SUBJECT"
_FREE = {"subject", "title", "source", "text", "name", "condition", "after", "command"}
"""Keys with free text, at any depth of a document."""

_PLAIN = re.compile(r"[-+]?[\d.]+|[a-z]+:[\d.,]+(?:,across|,turn_deg=[-\d.]+)?")
"""Numbers and shapes: values and literals without personal data."""

_INSIDE = r"[^\\/\n\"'<>|:]+"
_POSIX = re.compile(rf"(?<![\w.…])/(?:{_INSIDE}/)+")
_WINDOWS = re.compile(rf"\b[A-Za-z]:\\+(?:{_INSIDE}\\+)*")
_AGAIN = re.compile("(?:…/)+")
_HOST = re.compile(r"((?:tcp|udp)://)[^:\s\"'/]+")
_STRINGS = {tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}


class Scrubber:
    """Removal of personal data from the texts of one run: code of the subject, notes, names of folders."""

    def __init__(self, subjects: Iterable[str], notes: Iterable[str], folders: Iterable[str]) -> None:
        """Prepare to remove names of folders: `folders` as on the command line, and the home, working and temporary
        folders.
        """
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
        """Return a scrubbed text."""
        for what, put in self._literal:
            text = text.replace(what, put)
        text = _HOST.sub(r"\1…", text)
        return _AGAIN.sub("…/", _WINDOWS.sub("…/", _POSIX.sub("…/", text)))

    def value(self, value: Any, key: str = "") -> Any:
        """Return a scrubbed JSON value: without free text; of parameters, numbers and shapes remain."""
        if isinstance(value, dict):
            return {name: self.value(one, key if key == "parameters" else name) for name, one in value.items()}
        if isinstance(value, list):
            return GONE if key in _FREE else [self.value(one, key) for one in value]
        if not isinstance(value, str):
            return value
        if key in _FREE | {"parameters"} and value and not _PLAIN.fullmatch(value):
            return GONE
        return self.text(value)

    def line(self, line: str, timed: Callable[[Any], Any] = lambda found: found) -> str:
        """Return a scrubbed line of JSON, with its corrected time; of another line only its length."""
        try:
            found = json_of(line)
            return json.dumps(self.value(timed(found) if is_timed(found) else found), ensure_ascii=False)
        except (ValueError, RecursionError):
            return json.dumps({"unreadable": len(line)})

    def script(self, source: str) -> str | None:
        """Return Python source without comments and string literals, line by line; None if it is not Python."""
        try:
            tokens = list(tokenize.generate_tokens(io.StringIO(source).readline))
        except (tokenize.TokenError, SyntaxError):
            return None
        starts = [0, *accumulate(map(len, io.StringIO(source)))]
        pieces, at = list[str](), 0
        for token in tokens:
            put = _put(token)
            if put is not None:
                (first, start), (last, end) = token.start, token.end
                pieces += [source[at : starts[first - 1] + start], put]
                at = starts[last - 1] + end
        return self.text("".join([*pieces, source[at:]]))


def _put(token: tokenize.TokenInfo) -> str | None:
    """Return the replacement of a token, or None if it stays."""
    if token.type == tokenize.COMMENT:
        return "#"
    if token.type not in _STRINGS or _PLAIN.fullmatch(token.string.strip("\"'")):
        return None
    return f'"""{GONE}' + "\n" * token.string.count("\n") + '"""' if token.type == tokenize.STRING else GONE


LEFT_OUT = (
    "the subject's code; notes, titles, sources, names of checkpoints and conditions",
    "parameters that are words; the command line; words and comments of a script of your own",
    "folders, hosts and ports by their names; tables, report and shapes",
)
_MADE_FROM = ("started_utc", "protocol", "virtual", "python", "platform", "versions", "model", "devices")
_ABOUT = """\
Bug report on the indentation rig: one run, and the installation that wrote this file.

Included: {holds}
Not included: {left_out}

Check it before you send it.
"""


def bug_report(run: Path, to: Path, installation: Mapping[str, Any], shipped: Mapping[str, bytes]) -> dict[str, int]:
    """Write the bundle of a run folder and return its members with their sizes in bytes.

    shipped: scripts that come with the program, by name, which need no scrubbing. An unreadable run is bundled as
    far as possible. Raises RunError if there is no run, UnwritableError.
    """
    folder = RunFolder(run)
    if not any(path.is_file() for path in (folder.events, folder.provenance)):
        raise RunError(
            f"run folder {run} contains neither {folder.events.name} nor {folder.provenance.name}; give a run folder",
            "no_run_folder",
        )
    scrubber = _scrubber(folder)
    members = {"installation.json": _json(scrubber.value(dict(installation)))}
    time = RunTime()
    for name, made in _MEMBERS.items():
        text = _text(run / name)
        found = None if text is None else made(scrubber, text, time)
        members |= {} if found is None else {name: found}
    members |= dict(_script(scrubber, _text(run / "protocol.py"), shipped))
    about = _ABOUT.format(holds=", ".join(members), left_out="; ".join(LEFT_OUT))
    return _write(to, {"README.txt": about, **members})


def bundle_name(run: Path) -> str:
    """Return the name of the bundle: that of the run, without the subject's code."""
    folder = RunFolder(run)
    return f"bug-report-{_scrubber(folder).text(run.resolve().name)}.zip"


def _made_from(scrubber: Scrubber, text: str, time: RunTime) -> str | None:
    try:
        found = json_of(text)
        known = {name: found[name] for name in _MADE_FROM if name in found} if isinstance(found, dict) else None
        return None if known is None else _json(scrubber.value(known))
    except (ValueError, RecursionError):
        return None


def _lines(scrubber: Scrubber, text: str, timed: Callable[[Any], Any]) -> str:
    return "".join(f"{scrubber.line(line, timed)}\n" for line in text.split("\n") if line)


_MEMBERS: dict[str, Callable[[Scrubber, str, RunTime], str | None]] = {
    "provenance.json": _made_from,
    "config.toml": lambda scrubber, text, time: scrubber.text(text),
    "events.jsonl": lambda scrubber, text, time: _lines(scrubber, text, time.document),
    "bytes.jsonl": lambda scrubber, text, time: _lines(scrubber, text, time.chunk),  # after the journal
    "timeline.json": lambda scrubber, text, time: _lines(scrubber, text, lambda found: found),
}


def _script(scrubber: Scrubber, text: str | None, shipped: Mapping[str, bytes]) -> Iterator[tuple[str, str]]:
    if text is None:
        return
    known = next((name for name, content in shipped.items() if content == text.encode("utf-8")), None)
    if known is not None:
        yield f"protocol_{known}", text
        return
    scrubbed = scrubber.script(text)
    if scrubbed is not None:
        yield "protocol.py", scrubbed


def _scrubber(folder: RunFolder) -> Scrubber:
    """Return the scrubber for the folder's subject, notes and command."""
    subjects, notes, folders = set[str](), set[str](), {str(folder.path.parent), str(folder.path.parent.resolve())}
    for text in (_text(folder.provenance) or "", *(_text(folder.events) or "").split("\n")):
        try:
            document = json_of(text)
        except ValueError:
            continue
        if not isinstance(document, dict):
            continue
        subjects.add(str(document.get("subject") or ""))
        if document.get("stream") == "note" and isinstance(document.get("data"), dict):
            notes.add(str(document["data"].get("text", "")))
        command = document.get("command")
        words = [str(word) for word in command] if isinstance(command, list) else []
        folders |= {str(Path(word).parent) for word in words}
        folders |= {after for word, after in pairwise(words) if word == "--out"}
    return Scrubber(subjects, notes, folders)


def _text(path: Path) -> str | None:
    try:
        return read_text(path, encoding="utf-8", errors="replace")
    except OSError:
        return None


def _json(document: Any) -> str:
    return json.dumps(document, indent=2) + "\n"


def _write(to: Path, members: Mapping[str, str]) -> dict[str, int]:
    contents = {name: text.encode("utf-8", "backslashreplace") for name, text in members.items()}
    image = io.BytesIO()
    with zipfile.ZipFile(image, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)  # without the time of day
    replace_bytes(to, image.getvalue())
    return {name: len(content) for name, content in contents.items()}
