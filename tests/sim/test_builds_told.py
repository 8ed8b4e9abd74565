"""Whatever factorises a stiffness says so before: a command can show that something goes on."""

import ast
import logging
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from sim.config import FingertipConfig
from sim.contact.indentor import ACROSS, ALONG, BOTH
from sim.finger.surface import FingertipSurface
from sim.models import condensed
from sim.models.catalogue import BUILDERS, load
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import strain_maps
from tests.sim.coarse_mesh import coarse_mesh
from tests.sources import trees_with

Build = Callable[[FingertipConfig], object]


@pytest.fixture(autouse=True)
def everything_is_long(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """And nothing is in the cache."""
    monkeypatch.setattr(condensed, "LONG", 1)
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))


def mapped(config: FingertipConfig) -> object:
    finger = load("finger", config, cached=False)
    return list(strain_maps(config, [finger.indent("cylinder:9", doi_mm=0.1)]))


BUILDS: dict[str, tuple[Build, int]] = {
    "a finger": (Fingertip.load, 1),
    "one that is not kept": (lambda config: load("finger", config, cached=False), 1),
    "for shapes across it": (lambda config: Fingertip.load(config, slopes=ACROSS), 1),
    "for round shapes": (lambda config: Fingertip.load(config, slopes=BOTH), 1),
    "a larger patch": (lambda config: Fingertip.load(config).model_for(ALONG, (2.0, 1.5)), 2),
    "a section": (lambda config: load("section", config), 1),
    "strain everywhere": (mapped, 2),
}
"""What is built, and how many matrices are factorised for it."""


@pytest.mark.parametrize("what", BUILDS)
def test_it_is_said_before(what: str, caplog: pytest.LogCaptureFixture) -> None:
    build, factors = BUILDS[what]
    mesh = coarse_mesh(0.8, 0.8, patch_x_mm=1.5, patch_z_mm=1.5, round_patch_mm=1.0)
    with caplog.at_level(logging.INFO, "sim.models"):
        build(FingertipConfig(mesh=mesh))
    assert len([record for record in caplog.records if record.name == condensed.__name__]) == factors


FACTORS = ("PardisoFactor", "DissectionFactor")


def test_nothing_is_factorised_elsewhere() -> None:
    """Factors are made in one function."""
    root = Path(str(files("sim")))
    makers = {
        path.relative_to(root).as_posix()
        for path, tree in trees_with(root, *FACTORS)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in FACTORS
    }
    assert makers == {"models/condensed.py", "benchmark.py"}  # which measures how long one takes


def test_every_builder_is_walked() -> None:
    """A half-space is made of formulas."""
    assert set(BUILDERS) == {"finger", "section", "halfspace"}


@pytest.mark.parametrize(("unknowns", "level"), [(3, logging.INFO), (2, logging.DEBUG)])
def test_what_takes_no_time_is_said_quietly(
    unknowns: int, level: int, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(condensed, "LONG", 3)
    matrix = condensed.sp.csr_array(np.eye(unknowns))
    with caplog.at_level(logging.DEBUG, "sim.models"):
        condensed.condense(matrix, np.array([0]), np.zeros((unknowns, 1), np.int64))
    assert [(record.levelno, record.args) for record in caplog.records] == [(level, (unknowns,))]


def test_each_step_of_a_finger_is_said_quietly(skin: FingertipSurface, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG, "sim.models.finger_3d"):
        finger = load(
            "finger", FingertipConfig(mesh=coarse_mesh(0.5, 0.5, patch_x_mm=1.5, patch_z_mm=1.5)), cached=False
        )
    steps = [record for record in caplog.records if record.name == "sim.models.finger_3d"]
    assert {record.levelno for record in steps} == {logging.DEBUG}
    for name, record in zip(finger.model.timing_s, steps, strict=True):
        assert record.args == (name,)
