"""The demo on each bench, as a dry-run: what must not change while the code is rearranged.

python -m studies.reference_run [--out FOLDER]    # half a minute; the runs are kept in FOLDER

Prints what tests/frozen/reference_run.txt holds: for each bench and wire the bytes that went either way, and the
journal. A journal is hashed without the identifiers of its documents and the time of day, its numbers to nine digits:
processors differ in the last ones.
"""

import argparse
import hashlib
import json
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.models.fingertip import Fingertip

HERE = Path(__file__).parents[1]
DEMO = ("protocols/steps.py", ("step=1", "force_gwt=2.33"))
_LEADSHINE, _LAUMAS = {"kind": "leadshine"}, {"kind": "laumas", "baud": 115200}
BENCHES: Mapping[str, Mapping[str, Any]] = {
    "grbl": {},
    "rtu": {"stage": _LEADSHINE, "force": _LAUMAS},
    "tcp": {"stage": {**_LEADSHINE, "framing": "tcp"}, "force": {**_LAUMAS, "framing": "tcp"}},
}
"""GRBL with MT-SICS; Leadshine with Laumas as Modbus RTU, and in the frames of Modbus TCP."""
DIGITS = 9


def carried_out(bench: str, finger: Fingertip, out: Path) -> Path:
    """The folder of the demo's run on this bench."""
    config = Config.model_validate(BENCHES[bench])
    script, settings = DEMO
    loaded = load_script(str(HERE / script), list(settings))
    plan = make_plan(loaded, config, finger)
    done = dry_run(Session(loaded, config, finger, plan, NewRun(out)))
    assert done.complete, done.problem
    return done.folder.path


def fingerprint(bench: str, folder: Path) -> Iterator[str]:
    """Lines of the table: bench, what, how much of it, and its SHA-256."""
    sent: dict[tuple[str, str], bytes] = defaultdict(bytes)
    for line in (folder / "bytes.jsonl").read_text(encoding="utf-8").splitlines():
        chunk = json.loads(line)
        sent[chunk["port"], chunk["dir"]] += bytes.fromhex(chunk["hex"])
    for (port, way), content in sorted(sent.items()):
        yield _line(bench, f"{port} {way}", len(content), content)
    documents = [json.loads(line) for line in (folder / "events.jsonl").read_text(encoding="utf-8").splitlines()]
    same = "\n".join(json.dumps(comparable(document)) for document in documents)
    yield _line(bench, "journal", len(documents), same.encode())


def comparable(value: Any) -> Any:
    """A document of a journal, in its order, without what differs from run to run."""
    if isinstance(value, dict):
        return {key: comparable(inner) for key, inner in value.items() if key not in ("uid", "unix_s", "crc32")}
    if isinstance(value, list):
        return [comparable(inner) for inner in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _line(bench: str, what: str, count: int, content: bytes) -> str:
    return f"{bench:<5} {what:<9} {count:>7} {hashlib.sha256(content).hexdigest()}"


def lines(finger: Fingertip, out: Path) -> list[str]:
    """The whole table; the runs are made in `out`."""
    return [line for bench in BENCHES for line in fingerprint(bench, carried_out(bench, finger, out))]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        for line in lines(Fingertip.load(), asked.out or Path(scratch)):
            print(line)


if __name__ == "__main__":
    main()
