"""Presses chosen on real ports: counts from a growing file, a stop during the wait, sources that misbehave."""

import json
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from rig.bench.served import ServedBench
from rig.data import read_run
from rig.design.chooser import ChooserLostError, ChooserProcess, Choosing
from rig.design.design import DesignRequest
from rig.design.designed import as_block
from rig.design.fibers import Unknowns
from rig.design.press_times import PressTimes
from rig.design.presses import possible_presses
from rig.design.response_table import ABOUT, CANDIDATES, ResponseTable
from rig.design.script_text import script_text
from rig.errors import CountError
from rig.plan.config import Config, load_config
from sim.config import FingertipConfig
from tests.rig.real_time.elsewhere import STOP, Elsewhere
from tests.sim.coarse_mesh import coarse_mesh
from tests.waiting import DEADLINE_S, until

pytest.importorskip("pty", reason="needs pseudo-terminals")

REQUEST = DesignRequest(
    ("ep1", "sed", "e22"), ("bar:3.0",), 1.5, "doi_mm", (0.3,),
    Unknowns(rate_per_s=(60.0, 100.0), x_mm=(0.0, 0.1), below_mm=(0.3, 0.4)),
    hold_s=0.2, rest_s=0.1, seed=2,
)  # fmt: skip


def _script() -> str:
    presses = possible_presses(REQUEST.shapes, REQUEST.kind, REQUEST.targets)
    return script_text([np.array([10, 12, 8])], presses, "About.", "rig design", 0.2, 0.1, as_block(REQUEST, None))


LOOK_S = 0.02


class Lab:
    """Software of a lab: after each hold that ends in a journal it appends a count to a file."""

    def __init__(self, run: Elsewhere, path: Path, most: int) -> None:
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._count, args=(run, path, most))
        self._thread.start()

    def _count(self, run: Elsewhere, path: Path, most: int) -> None:
        path.write_text("index,count\n", encoding="utf-8")
        counted = 0
        while not self._over.wait(LOOK_S) and counted < most:
            held = [
                one["data"]["index"] for one in run.documents if one.get("stream") == "hold_end" and "data" in one
            ]
            for index in held[counted:most]:
                with path.open("a", encoding="utf-8") as file:
                    file.write(f"{index},{3 + index}\n")
                counted += 1

    def end(self) -> None:
        self._over.set()
        self._thread.join(DEADLINE_S)


@pytest.fixture
def chosen(elsewhere: Callable[..., Elsewhere], whole: tuple[ServedBench, Path],
           tmp_path: Path) -> Iterator[Callable[..., tuple[Elsewhere, Path]]]:  # fmt: skip
    """Start a run on wires with counts from a file, of which so many arrive.

    Responses are those of a coarse finger: on the default one, the presses that may be chosen take seconds.
    """
    _, config = whole
    coarse = load_config(config).model_copy(update={"finger": FingertipConfig(mesh=coarse_mesh(0.5, 0.7))})
    config.write_text(coarse.as_toml(), encoding="utf-8")
    labs: list[Lab] = []

    def start(most: int, within_s: float = 20.0) -> tuple[Elsewhere, Path]:
        counts = tmp_path / "counts.csv"
        options = ("--yes", "--config", config, "--set", f"counts={counts}", "--set", f"count_within_s={within_s}")
        run = elsewhere(_script(), "run", *options, "--json")
        labs.append(Lab(run, counts, most))
        return run, counts

    yield start
    for lab in labs:
        lab.end()


@pytest.mark.study
def test_counts_of_a_growing_file_choose_presses_and_then_the_plan_goes_on(
    chosen: Callable[..., tuple[Elsewhere, Path]],
) -> None:
    """After the first press a count arrives; after the second none does within the time."""
    run, counts = chosen(1, within_s=1.0)
    code, out, err = run.end()
    assert code == 0, err
    answer = json.loads(out)
    assert answer["choice"]["planned_from"] == 2
    found = read_run(run.folder)
    first, second, *_ = found.stream("choice")
    assert (first["count"], second["count"]) == (None, 3)
    assert len(found.stream("alarm")) == 1
    assert found.complete
    assert counts.read_text(encoding="utf-8").splitlines() == ["index,count", "0,3"]


def test_a_stop_while_the_run_waits_for_a_count_is_at_once(chosen: Callable[..., tuple[Elsewhere, Path]]) -> None:
    """The indentor is lifted, no move follows, and the run resumes without further options."""
    run, _ = chosen(0, within_s=60.0)
    run.comes_to(lambda: any(one.get("stream") == "rest" and "data" in one for one in run.documents))
    assert run.ask("stop") == {"ok": True, "stopped": True}
    code, _, err = run.end()
    assert code == 130, err
    sent = run.sent
    assert STOP in sent
    behind = [bytes.fromhex(one) for one in sent[sent.index(STOP) + 1 :]]
    assert not [one for one in behind if b"G" in one or b"$" in one], "no move follows it"
    last = run.documents[-1]
    assert (last["status"], last["indentor"]["contact"]) == ("aborted", "unknown")


# --- sources in their process ---

_SOURCES = """\
import os, time

from rig.errors import CountError


class Source:
    asked = False

    def made(self, press): self.asked = True
    def truth(self): return None
    def close(self): pass
    def new(self): return self.instead() if self.asked else []


class Blocks(Source):
    def instead(self): time.sleep(3600)


class Floods(Source):
    def instead(self): return [(0, 3)] * 1_000_000


class Crashes(Source):
    def instead(self): os._exit(9)


class RaisesWhatCannotBeSent(Source):
    def instead(self):
        error = CountError("the electrode is out", "electrode_out")
        error.electrode = lambda: 3
        raise error


class SaysItself(Source):
    def truth(self): return {"candidate": self}


class Prints(Source):
    def instead(self):
        print("a line of the source", flush=True)
        self.asked = False
        return [(0, 3)]
"""


@pytest.fixture
def choosing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Choosing]:
    """Return what a choice needs, on a table of two bumps, with a source of a module of its own."""
    (tmp_path / "lab_sources.py").write_text(_SOURCES, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    presses = possible_presses(("bar:3.0",), "doi_mm", (0.5,))
    x_mm, below_mm = np.linspace(-0.5, 0.5, 5), np.linspace(0.1, 0.7, 4)
    values = np.zeros((1, len(presses), len(CANDIDATES), 20), dtype=np.float32)
    for name, wide in (("ep1", 0.5), ("sed", 0.9), ("e22", 1.6)):
        bump = np.exp(-0.5 * ((np.array([p.x_mm for p in presses])[:, None] - np.tile(x_mm, 4)) / wide) ** 2)
        values[0, :, CANDIDATES.index(name)] = bump
    table = ResponseTable(tuple(presses), values, x_mm, below_mm, np.ones((len(presses), len(ABOUT))))
    times = PressTimes(20.0, np.full(len(presses), 10.0), 60.0)

    def make(source: str) -> Choosing:
        return Choosing(REQUEST, f"lab_sources:{source}", Config(), table, times, (), 0)

    return make


LOST: dict[str, type[CountError] | None] = {
    "Blocks": None,
    "Floods": CountError,
    "Crashes": ChooserLostError,
    "RaisesWhatCannotBeSent": CountError,
}


@pytest.mark.parametrize("source", LOST)
def test_whatever_a_source_does_the_run_only_looks(source: str, choosing: Callable[[str], Choosing]) -> None:
    """A look is one poll of a pipe, an error is one of the program's, and the process ends when it is closed."""
    chooser = ChooserProcess(choosing(source))
    try:
        chooser.begin(None)
        until(chooser.is_ready)
        chooser.begin(chooser.decision().possible)
        if (expected := LOST[source]) is None:
            assert not any(chooser.is_ready() for _ in range(1000))
        else:
            until(chooser.is_ready)
            with pytest.raises(expected) as caught:
                chooser.decision()
            assert type(caught.value) is expected, "a class of the lab would need its module here"
    finally:
        chooser.close()
    assert not chooser._process.is_alive()


@pytest.mark.skipif(not hasattr(os, "getpriority"), reason="needs niceness (POSIX)")
def test_the_choice_gives_way_to_the_process_that_drives_the_stage(choosing: Callable[[str], Choosing]) -> None:
    chooser = ChooserProcess(choosing("Blocks"))
    try:
        assert chooser._process.pid is not None
        assert os.getpriority(os.PRIO_PROCESS, chooser._process.pid) == os.getpriority(os.PRIO_PROCESS, 0) + 5
    finally:
        chooser.close()


@pytest.mark.parametrize("source", ["Missing", "SaysItself"])
def test_a_source_that_cannot_be_opened_is_one_error(source: str, choosing: Callable[[str], Choosing]) -> None:
    """It has no such function, or says of its nerve what no journal can hold."""
    with pytest.raises(CountError) as caught:
        ChooserProcess(choosing(source))
    assert caught.value.code == "source_failed"


def test_what_a_source_prints_is_not_in_the_output_of_the_command(
    choosing: Callable[[str], Choosing], capfd: pytest.CaptureFixture[str]
) -> None:
    """JSON on standard output stays JSON."""
    chooser = ChooserProcess(choosing("Prints"))
    try:
        chooser.begin(None)
        until(chooser.is_ready)
        chooser.begin(chooser.decision().possible)
        until(chooser.is_ready)
        assert chooser.decision().spikes == 3
    finally:
        chooser.close()
    printed = capfd.readouterr()
    assert not printed.out
    assert printed.err
