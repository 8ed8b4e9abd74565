"""A stop that came while nothing was carried out, recorded all the same: before a run began, and after it ended."""

from dataclasses import asdict
from datetime import UTC, datetime

from rig.data import RunFolder, new_run_folder, read_run
from rig.engine import Journal
from rig.engine.journal import add_to_end, read_journal
from rig.engine.streams import STREAMS
from rig.plan.config import Config
from rig.protocol.script import Script
from rig.session.ending import Whereabouts
from rig.session.provenance import provenance
from rig.session.resume import StoppedRun
from rig.session.running import AT_ONCE
from rig.session.session import NewRun
from rig.transport.byte_log import ByteLog
from rig.transport.clock import WallClock


def record_before(script: Script, config: Config, into: NewRun | StoppedRun, *, virtual: bool) -> RunFolder:
    """A run that was stopped while it was planned: aborted, and nothing moved.

    In a folder of its own, or as one part more of the run that was to be taken up. Raises OSError, FolderBusyError.
    """
    if isinstance(into, NewRun):
        now = datetime.now(UTC)
        about = provenance(script, config, None, now, virtual=virtual, subject=into.subject)
        folder = new_run_folder(into.out, script.name, now, script.path, config.as_toml(), about)
    else:
        folder = into.folder
    before = None if isinstance(into, NewRun) else into.run
    clock = WallClock(into.begins_at_s)
    with folder.owned(), Journal(folder.events, clock, STREAMS, virtual=virtual) as journal:
        if before is None:
            journal.start(
                {
                    "protocol": script.name,
                    "title": script.title,
                    "source": script.source,
                    "parameters": script.parameters.model_dump(mode="json"),
                    "planned_indentations": 0,
                    "subject": into.subject,
                    "virtual": virtual,
                }
            )
            at = Whereabouts("not moved")
        else:
            journal.resume({"missing": before.missing, "after": before.last_checkpoint})
            known = None if before.stop is None else before.stop.get("indentor")
            at = Whereabouts(**known) if known else Whereabouts.last_known(before)
        journal.at_end = lambda: {"indentor": asdict(at), "stopped_while": "planning"}
        journal.stop("aborted", AT_ONCE)
    return folder


def record_after(folder: RunFolder, state: str, wire: str) -> None:
    """The bytes of a stop, and the stop itself where the run's last document does not say it.

    A run that had ended stays what it was: its end is said again, with the state that it was stopped in.
    Raises OSError, FolderBusyError.
    """
    with folder.owned():
        with ByteLog(folder.bytes_log) as log:
            for line in wire.splitlines(keepends=True):
                log.write(line)
        *_, last = read_journal(folder.events)
        if last["doc"] != "stop":
            at = asdict(Whereabouts.last_known(read_run(folder.path)))
            end = {"doc": "stop", "status": "aborted", "reason": AT_ONCE, "indentor": at, "stopped_while": state}
            add_to_end(folder.events, end, WallClock().unix_s())
        elif last["status"] != "aborted" or state == "reporting":
            add_to_end(folder.events, {"stopped_while": state}, WallClock().unix_s())
        folder.write_checksums()
