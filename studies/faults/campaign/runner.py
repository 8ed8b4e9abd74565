"""Cases carried out: each in a process forked at the very instant at which its fault strikes.

A worker plays a scenario on the virtual clock, in one thread. At each message that faults strike it forks a child for
each of them; the child goes on with the fault to the end of the program, has another program take up what is missing,
and appends one line to the results. The worker's own play goes on undisturbed.
"""

import gc
import hashlib
import json
import logging
import re
import select
import shutil
import subprocess
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

from rig.data import read_run
from rig.data.events import PRESS_STREAMS
from rig.data.journal import LineFile, read_journal
from rig.devices.base import ForceError, StageError
from rig.engine import EngineError
from rig.engine.bench_memory import BenchMemory
from rig.errors import BadInputError
from rig.protocol import turns
from rig.transport import TransportError
from studies.faults.campaign.cases import FaultCase
from studies.faults.campaign.faults import FaultyCarriage, cell
from studies.faults.campaign.judge import (
    BOUND_GWT,
    claim_of,
    claim_on_record,
    exemption_of,
    hidden,
    true_claim,
    violations,
)
from studies.faults.campaign.scenarios import SCENARIOS, Finished, Scenario
from studies.faults.campaign.world import Message, VirtualWorld, Worst, untouched
from studies.posix import os, resource, signal

LONGEST_CPU_S = 20
FOLLOWED = 8
"""A message's fault is absorbed when so many commands after it are those of the undisturbed run, at the same places.

Such a case is not followed farther; a fault while the sensor is zeroed always is."""
_TO_THE_END = ("zero",)
_AROUND, _SAME_MM = 6, 1e-6
RESUMED = 2
"""Of a worker's cases that end alike in a phase so many are resumed, and all that press harder than the bound."""
STARTS_ANEW_S = 2.5
"""Another program begins this long after a fault: the last late answer has come by then (RTU numbers no answers)."""
_ENDS = (EngineError, StageError, ForceError, TransportError, BadInputError)

Record = dict[str, Any]


class Played:
    """One scenario on one bench, played by a worker that forks a child for each of its cases."""

    def __init__(
        self,
        bench: str,
        scenario: Scenario,
        of: Sequence[FaultCase],
        out: int,
        told: Callable[[], None],
        folder: Path,
    ) -> None:
        """out: the file descriptor that records are appended to; told hears of each case that is over."""
        self._bench, self._scenario, self._out, self._told, self._folder = bench, scenario, out, told, folder
        self._at: dict[int, list[FaultCase]] = {}
        for case in of:
            self._at.setdefault(case.message, []).append(case)
        self._case: FaultCase | None = None  # in a child
        self._begun_s = 0.0
        self._commands: list[tuple[int, bytes, tuple[float, float]]] = []  # of the undisturbed run
        self._to_come: list[tuple[bytes, tuple[float, float]]] = []  # in a child
        self._next = self._alike = 0
        self._endings: Counter[bytes] = Counter()
        self._hears, self._says = os.pipe()

    def play(self) -> None:
        """All cases; a child never returns."""
        self._note_commands()
        self._state(self._folder)
        self.world = world = VirtualWorld(self._bench)
        world.tap = self._tap
        self._run = self._folder / "run"
        try:
            finished = ended(lambda: self._scenario.play(world, self._run))
        finally:
            if self._case is not None:
                self._leave(finished)
        if finished.exit != "done" or self._at:
            raise RuntimeError(f"{self._bench}, {self._scenario.name}: {len(self._at)} messages not met, {finished}")

    def _note_commands(self) -> None:
        """Play it once to know where each command of the undisturbed run is given."""
        world = VirtualWorld(self._bench)

        def noted(message: Message) -> list[tuple[float, bytes]]:
            if message.is_command:
                self._commands.append((message.number, message.content, world.pose_mm(message.t_s)))
            return untouched(message)

        world.tap = noted
        self._state(self._folder / "undisturbed")
        self._scenario.play(world, self._folder / "undisturbed" / "run")

    def _follow(self, message: Message) -> None:
        """In a child: end it where the fault has been absorbed. What is asked or told again stands between."""
        if not self._to_come or not message.is_command:
            return
        told, (x_mm, z_mm) = message.content, self.world.pose_mm(message.t_s)
        for n in (self._next, *range(max(self._next - _AROUND, 0), self._next + _AROUND)):
            if n < len(self._to_come):
                expected, (at_x_mm, at_z_mm) = self._to_come[n]
                if told == expected and max(abs(x_mm - at_x_mm), abs(z_mm - at_z_mm)) < _SAME_MM:
                    self._alike = self._alike + 1 if n == self._next else 1
                    self._next = n + 1
                    break
        else:
            self._alike = 0
        if self._alike == FOLLOWED:
            self._leave(Finished("absorbed", "", None))

    def _tap(self, message: Message) -> list[tuple[float, bytes]]:
        if self._case is not None:
            self._follow(message)
            return untouched(message)
        whole = [(0.0, message.data)]
        for case in self._at.pop(message.number, ()):
            if case.data != message.data:
                raise RuntimeError(f"{case.name}: met {message.data!r}, expected {case.data!r}")
            remembered = _files(self._folder / "state")
            child = os.fork()
            if child == 0:
                return self._strike(case, message)
            _, status = os.waitpid(child, 0)
            _restore(self._folder / "state", remembered)
            if status == 0:
                self._endings[os.read(self._hears, _DIGEST)] += 1
            else:
                self._append({**about(case), "exit": "crashed", "reason": f"the process ended with {status}"})
            self._told()
        return whole

    def _strike(self, case: FaultCase, message: Message) -> list[tuple[float, bytes]]:
        """In the child: what arrives of the message; from here on the world is this case's own."""
        gc.disable()
        turns.take_over()
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_CPU_S, LONGEST_CPU_S))
        self._begun_s = time.process_time()
        self._case, world = case, self.world
        world.worst = Worst()
        folder = self._folder / "cases" / str(os.getpid())
        folder.mkdir(parents=True)
        if world.journal is not None and world.journal.path.exists():
            shutil.copytree(world.journal.path.parent, folder / "run")
            world.journal.path = folder / "run" / "events.jsonl"
            world.journal.file = LineFile(world.journal.path)
            world.folder = folder / "run"
        self._run = folder / "run"
        if case.fault is not None:
            if case.phase not in _TO_THE_END:
                self._to_come = [(told, at) for number, told, at in self._commands if number >= case.message]
            return case.fault.pieces(message.data)
        if case.mechanics != "none":
            world.mechanics = FaultyCarriage(world, case.mechanics)
        world.felt_n = cell(world, case.cell)
        world.touch_n *= hidden(case.cell)
        return [(0.0, message.data)]

    def _state(self, folder: Path) -> None:
        (folder / "state").mkdir(parents=True, exist_ok=True)
        os.environ["RIG_STATE_DIR"] = str(folder / "state")

    def _leave(self, finished: Finished) -> None:
        """In the child: judge, resume, append, and end the process."""
        code, self._to_come = 1, []  # what another program does next absorbs nothing
        try:
            assert self._case is not None
            self._append(self._judged(self._case, finished))
            shutil.rmtree(self._folder / "cases" / str(os.getpid()), ignore_errors=True)
            code = 0
        except BaseException:  # whatever it is: the worker says that the child has crashed
            traceback.print_exc()
        finally:
            os._exit(code)

    def _judged(self, case: FaultCase, finished: Finished) -> Record:
        world = self.world
        at_rest(world)
        worst, left_gwt, claim = world.worst, world.true_gwt, claim_of(finished.at)
        absorbed = finished.exit == "absorbed"  # in the middle of something
        on_record = "none" if absorbed else claim_on_record(BenchMemory(world.config).read())
        record: Record = {
            **about(case),
            "exit": finished.exit,
            "reason": finished.reason[:300],
            "claim": claim,
            "report_true": true_claim(claim, left_gwt, case.cell),
            "on_record": on_record,
            "record_true": true_claim(on_record, left_gwt, case.cell),
            "worst_gwt": round(worst.force_gwt, 3),
            "worst_in": worst.phase,
            "drag_mm": round(worst.drag_mm, 4),
            "left_gwt": round(left_gwt, 3),
            **_NOT_RESUMED,
        }
        ending = self._digest(case, finished, record)
        if self._endings[ending] < RESUMED or record["worst_gwt"] > BOUND_GWT:
            record |= self._resumed(finished)
        os.write(self._says, ending)
        record["s"] = round(time.process_time() - self._begun_s, 3)
        return record

    def _digest(self, case: FaultCase, finished: Finished, record: Record) -> bytes:
        """Of what cases that end alike have in common."""
        reason = re.sub(r"[0-9a-f]{2}( [0-9a-f]{2})+|[-0-9.]+|'[^']*'", "#", finished.reason)
        left_gwt = round(record["left_gwt"], 1)
        alike = (case.phase, finished.exit, reason, record["claim"], left_gwt, case.way, case.wire)
        also = "" if case.fault is not None else case.name
        return hashlib.sha256(f"{alike} {also} {sorted(finished_presses(self._run))}".encode()).digest()

    def _resumed(self, finished: Finished) -> Record:
        """Mended, and taken up by another program with drivers of its own."""
        world = self.world
        if isinstance(world.mechanics, FaultyCarriage):
            world.mechanics.mend()
        world.felt_n = world.true_n
        world.worst = Worst()
        before = finished_presses(self._run)
        if finished.exit in ("done", "absorbed"):
            return {"resumed": None, **kept(self._run, before)}
        world.clock.wait_s(STARTS_ANEW_S)
        again = ended(lambda: self._scenario.take_up(world, self._run))
        worst = {"resume_worst_gwt": round(world.worst.force_gwt, 3), "resume_reason": again.reason[:200]}
        return {"resumed": again.exit == "done", **worst, **kept(self._run, before)}

    def _append(self, record: Record) -> None:
        record = {**DEFAULTS, **record}
        exemption = exemption_of(record)
        record["violations"] = violations(record)
        record["exempt"] = None if exemption is None else exemption.name
        os.write(self._out, (json.dumps(record) + "\n").encode("ascii"))


def _files(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.iterdir()}


def _restore(folder: Path, files: dict[Path, bytes]) -> None:
    """What a program remembers of the bench lies where it did as it began: a child writes there, too."""
    for path in folder.iterdir():
        if path not in files:
            path.unlink()
    for path, data in files.items():
        path.write_bytes(data)


_DIGEST = hashlib.sha256().digest_size
_NOT_RESUMED = {"resumed": None, "lost": 0, "repeated": 0, "mixed": 0}
DEFAULTS = {
    "worst_gwt": 0.0,
    "drag_mm": 0.0,
    "left_gwt": 0.0,
    "report_true": True,
    "record_true": True,
    "claim": "none",
    **_NOT_RESUMED,
}


@cache
def commit() -> str:
    """What the program is at, where git knows; names of cases hold at one commit."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=7"]
    found = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parent, check=False)
    return found.stdout.strip() or "unknown"


def about(case: FaultCase) -> Record:
    """What a record says of its case."""
    place = {"bench": case.bench, "scenario": case.scenario, "phase": case.phase}
    struck = {"kind": case.kind, "mechanics": case.mechanics, "cell": case.cell, "data": case.data.hex()}
    return {"commit": commit(), "case": case.name, **place, **struck, "struck_gwt": case.force_gwt}


def ended(play: Callable[[], Finished]) -> Finished:
    """How it ended, also where a command by hand ends with an error."""
    try:
        return play()
    except _ENDS as error:
        return Finished("failed", " ".join(str(error).split()), None)
    except Exception as error:
        return Finished("crashed", f"{type(error).__name__}: {error}", None)


def at_rest(world: VirtualWorld) -> None:
    """Let what was told to move come to its end."""
    for _ in range(200):
        before = world.pose_mm(world.clock.monotonic_s())
        world.clock.wait_s(0.1)
        if world.pose_mm(world.clock.monotonic_s()) == before:
            return


def finished_presses(run: Path) -> dict[int, Any]:
    """The finished presses of a run, as its journal has them; nothing where there is no run."""
    if not (run / "events.jsonl").exists():
        return {}
    with suppress(Exception):
        return dict(read_run(run).done)
    return {}


def attempts(journal: Path) -> dict[int, list[tuple[int, str, dict[str, Any]]]]:
    """Return the last attempt at each indentation, by index: the part of the run, stream and event of each line.

    A part begins where the run was taken up.
    """
    found: dict[int, list[tuple[int, str, dict[str, Any]]]] = {}
    part = 0
    for document in read_journal(journal):
        part += document["doc"] == "resume"
        if document["doc"] != "event" or document["stream"] not in PRESS_STREAMS:
            continue
        stream, data = document["stream"], document["data"]
        if stream == "indentation_start":
            found[data["index"]] = []
        if data.get("index") in found:
            found[data["index"]].append((part, stream, {"t_s": document["t_s"], **data}))
    return found


def kept(run: Path, before: dict[int, Any]) -> Record:
    """Whether what was done before is there as it was, once each and of one attempt."""
    if not (run / "events.jsonl").exists():
        return {}
    after = read_run(run)
    told = attempts(run / "events.jsonl")
    return {
        "lost": sum(after.done.get(index) != holds for index, holds in before.items()),
        "repeated": after.repeated,
        "mixed": sum(len({part for part, _, _ in told[index]}) > 1 for index in after.done),
    }


def work(cases: Iterable[FaultCase], out: Path, told: Callable[[], None] = lambda: None) -> None:
    """Carry cases out in this process and its children; records are appended to `out`."""
    logging.disable(logging.CRITICAL)  # of pymodbus: a broken frame is no news here
    gc.collect()
    gc.freeze()
    by_scenario: dict[tuple[str, str], list[FaultCase]] = {}
    for case in cases:
        by_scenario.setdefault((case.bench, case.scenario), []).append(case)
    scenarios = {scenario.name: scenario for scenario in SCENARIOS}
    file = os.open(out, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        for number, ((bench, name), some) in enumerate(by_scenario.items()):
            Played(bench, scenarios[name], some, file, told, Path(folder) / str(number)).play()
    os.close(file)


def carry_out(cases: Sequence[FaultCase], out: Path, processes: int, going: "CampaignProgress | None" = None) -> None:
    """Carry cases out in so many processes at a time, saying how far they have come."""
    if not cases:
        return
    commit()  # once, and not in every child
    workers = []
    for n in range(processes):
        reading, writing = os.pipe()
        worker = os.fork()
        if worker == 0:
            code = 1
            try:
                os.close(reading)
                work(cases[n::processes], out, partial(_tick, writing))
                code = 0
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(code)
        os.close(writing)
        workers.append((worker, reading))
    try:
        (going or CampaignProgress(len(cases), lambda line: None)).follow([reading for _, reading in workers])
    except BaseException:
        for worker, _ in workers:
            os.kill(worker, signal.SIGTERM)
        raise
    failed = [status for worker, _ in workers if (status := os.waitpid(worker, 0)[1])]
    if failed:
        raise RuntimeError(f"{len(failed)} of {processes} workers failed")


def _tick(writing: int) -> None:
    os.write(writing, b".")


class CampaignProgress:
    """How many cases are over, and how long the others will take."""

    def __init__(self, number: int, say: Callable[[str], None], every_s: float = 20.0) -> None:
        self._left, self._say, self._every_s = number, say, every_s
        self._done, self._begun_s, self._said_s = 0, time.monotonic(), time.monotonic()

    def skip(self, number: int) -> None:
        """So many are in the results already."""
        self._left -= number

    def follow(self, pipes: list[int]) -> None:
        """Until all workers have closed their ends."""
        while pipes:
            for pipe in select.select(pipes, [], [], 1.0)[0]:
                heard = os.read(pipe, 4096)
                self._done, self._left = self._done + len(heard), self._left - len(heard)
                if not heard:
                    pipes.remove(pipe)
                    os.close(pipe)
            now_s = time.monotonic()
            if self._done and now_s - self._said_s > self._every_s:
                self._said_s, each_s = now_s, (now_s - self._begun_s) / self._done
                self._say(f"{self._left} left, {1000 * each_s:.0f} ms each, {each_s * self._left / 60:.0f} min")
