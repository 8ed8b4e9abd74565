"""One file for a bug report: what a run was and what went over the wire, without who lay under the rig."""

import io
import json
import zipfile
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from rig.data.folder import RunFolder, replace_bytes
from rig.data.reader import RunError
from rig.data.scrubbed import Scrubber

LEFT_OUT = (
    "the subject's code; notes, titles, sources, names of checkpoints and conditions",
    "parameters that are words; the command line; words and comments of a script of your own",
    "folders, hosts and ports by their names; tables, report and shapes",
)
_MADE_FROM = ("started_utc", "protocol", "virtual", "python", "platform", "versions", "model", "devices")
_ABOUT = """\
For a bug report on the indentation rig: one run, and the installation that wrote this file.

In it: {holds}
Not in it: {left_out}

Look through it before you send it.
"""


def bug_report(run: Path, to: Path, installation: Mapping[str, Any], shipped: Mapping[str, bytes]) -> dict[str, int]:
    """Write the bundle of a run folder; returns its members with their sizes in bytes.

    shipped: scripts that come with the program, which need no scrubbing, by their names. A run that cannot be read
    is bundled as far as it goes. Raises RunError where nothing is there, UnwritableError.
    """
    folder = RunFolder(run)
    if not any(path.is_file() for path in (folder.events, folder.provenance)):
        raise RunError(
            "run {run}: neither {events} nor {provenance}, expected a run folder",
            code="no_run_folder",
            run=str(run),
            events=folder.events.name,
            provenance=folder.provenance.name,
        )
    scrubber = _scrubber(folder)
    members = {"installation.json": _json(scrubber.value(dict(installation)))}
    for name, made in _MEMBERS.items():
        text = _text(run / name)
        found = None if text is None else made(scrubber, text)
        members |= {} if found is None else {name: found}
    members |= dict(_script(scrubber, _text(run / "protocol.py"), shipped))
    about = _ABOUT.format(holds=", ".join(members), left_out="; ".join(LEFT_OUT))
    return _write(to, {"README.txt": about, **members})


def bundle_name(run: Path) -> str:
    """Of the file that is written: the run's name, without a subject's code in it."""
    folder = RunFolder(run)
    return f"bug-report-{_scrubber(folder).text(run.resolve().name)}.zip"


def _made_from(scrubber: Scrubber, text: str) -> str | None:
    try:
        found = json.loads(text)
    except ValueError:
        return None
    if not isinstance(found, dict):
        return None
    return _json(scrubber.value({name: found[name] for name in _MADE_FROM if name in found}))


def _lines(scrubber: Scrubber, text: str) -> str:
    return "".join(f"{scrubber.line(line)}\n" for line in text.split("\n") if line)


_MEMBERS: dict[str, Callable[[Scrubber, str], str | None]] = {
    "provenance.json": _made_from,
    "config.toml": lambda scrubber, text: scrubber.text(text),
    "events.jsonl": _lines,
    "bytes.jsonl": _lines,
    "timeline.json": _lines,
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
    """By what the folder says of its subject, its notes and its command."""
    subjects, notes, folders = set[str](), set[str](), {str(folder.path.parent), str(folder.path.parent.resolve())}
    for text in (_text(folder.provenance) or "", *(_text(folder.events) or "").split("\n")):
        try:
            told = json.loads(text)
        except ValueError:
            continue
        if not isinstance(told, dict):
            continue
        subjects.add(str(told.get("subject") or ""))
        if told.get("stream") == "note" and isinstance(told.get("data"), dict):
            notes.add(str(told["data"].get("text", "")))
        words = [str(word) for word in told.get("command") or []]
        folders |= {str(Path(word).parent) for word in words}
        folders |= {after for word, after in pairwise(words) if word == "--out"}
    return Scrubber(subjects, notes, folders)


def _text(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None


def _json(told: Any) -> str:
    return json.dumps(told, indent=2) + "\n"


def _write(to: Path, members: Mapping[str, str]) -> dict[str, int]:
    image = io.BytesIO()
    with zipfile.ZipFile(image, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in members.items():
            archive.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)  # without the time of day
    replace_bytes(to, image.getvalue())
    return {name: len(text.encode("utf-8")) for name, text in members.items()}
