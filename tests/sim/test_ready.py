"""Loops are compiled once, kept where that is possible, and whoever waits is told."""

import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from numba.core.event import Event, EventStatus, broadcast

from sim import compiling
from sim.contact import lcp, newton, warmup
from sim.contact.compiled import (
    factors,
    planes_and_residual,
    points_between_nodes,
    profile_curves,
    skin_compliance,
)
from sim.contact.measured_profile import MeasuredProfile
from sim.models.fingertip import Fingertip

LOOPS = [name if name.endswith(".py") else f"{name}/loops.py" for name in compiling._WITH_LOOPS]


def doubled(x: float) -> float:
    return 2 * x


@pytest.fixture
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A place for modules of its own, and a cache folder of the user that is not there yet."""
    here = tmp_path / "modules"
    for name in LOOPS:
        (here / name).parent.mkdir(parents=True, exist_ok=True)
        (here / name).write_text("1")
    monkeypatch.setattr(compiling, "_HERE", here)
    monkeypatch.setattr(compiling, "user_cache_path", lambda name: tmp_path / "cache" / name)
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path / "models"))
    known = compiling._folder
    known.cache_clear()
    yield here
    known.cache_clear()


def test_compiled_loops_are_stored_in_the_cache_folder_of_the_user(modules: Path, tmp_path: Path) -> None:
    made = compiling.compiled(doubled)
    assert made(3.0) == 6.0
    assert list((tmp_path / "cache").glob("indentation-rig/loops-*/*/*.nbc"))
    assert not (tmp_path / "models").exists()


def test_loops_without_a_cache_folder_are_compiled(modules: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (modules / "a_file").write_text("")
    monkeypatch.setattr(compiling, "_folder", lambda: modules / "a_file" / "below")
    made = compiling.compiled(doubled)
    assert made(3.0) == 6.0
    assert vars(made)["_cache"].cache_path is None  # numba would have taken a folder of its own choice


@pytest.mark.parametrize("changed", LOOPS[::4])
def test_changed_module_is_compiled_again(modules: Path, changed: str) -> None:
    before = compiling._folder()
    compiling._folder.cache_clear()
    assert compiling._folder() == before
    (modules / changed).write_text("2")
    compiling._folder.cache_clear()
    assert compiling._folder() != before


@pytest.mark.parametrize(("unused_s", "kept"), [(86_300, True), (86_500, False)])
def test_loops_unused_for_a_day_are_removed(modules: Path, unused_s: int, kept: bool) -> None:
    mine = compiling._folder()
    assert mine is not None
    other = mine.with_name("loops-of-older-modules")
    for folder in (mine, other):
        folder.mkdir(exist_ok=True)
        os.utime(folder, times=(folder.stat().st_mtime - unused_s,) * 2)
    used_s = mine.stat().st_mtime
    compiling._folder.cache_clear()
    compiling._folder()
    assert other.exists() == kept
    assert mine.stat().st_mtime > used_s + 3_600  # it is used now


def test_compilation_is_logged_once(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    warmup.make_ready.cache_clear()

    def compiles(*_: object, **__: object) -> None:
        for _event in range(2):
            broadcast(Event("numba:compile", EventStatus.START))
            broadcast(Event("numba:compile", EventStatus.END))

    monkeypatch.setattr(warmup, "solve_contact", compiles)
    with caplog.at_level(logging.INFO, "sim"):
        warmup.make_ready()
    assert [record.name for record in caplog.records] == [warmup.__name__]
    warmup.make_ready.cache_clear()


EVERY_KIND = [
    "bar:1.5",
    "step:1",
    "wedge:45",
    "grating:0.5,1.2",
    "cylinder:9",
    "bar:1.5,turn_deg=30",
    "sphere:3",
    "line",
]


def test_no_press_waits_for_the_compiler(coarse_finger: Fingertip) -> None:
    """Each loop is compiled for one kind of arguments: no press waits for a compiler."""
    modules = (skin_compliance, planes_and_residual, profile_curves, points_between_nodes, factors, lcp, newton)
    loops = [loop for module in modules for loop in vars(module).values() if hasattr(loop, "signatures")]
    warmup.make_ready()
    before = [set(loop.signatures) for loop in loops]
    ridges = MeasuredProfile("two ridges", (-1.2, -0.6, 0.0, 0.6, 1.2), (0.4, 0.0, 0.25, 0.0, 0.4))
    for shape in (*EVERY_KIND, ridges):
        coarse_finger.indent(shape, doi_mm=0.3)
    assert [set(loop.signatures) for loop in loops] == before
