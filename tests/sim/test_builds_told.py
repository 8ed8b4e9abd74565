"""Whatever factorises a stiffness says so before: a command can show that something goes on."""

import logging
from collections.abc import Callable
from pathlib import Path

import pytest

from sim.config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.models import condensed
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import strain_maps
from tests.sim.coarse_mesh import coarse_mesh

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
    "a larger patch": (lambda config: Fingertip.load(config).model_for(ALONG, (2.0, 1.5)), 2),
    "a section": (lambda config: load("section", config), 1),
    "strain everywhere": (mapped, 2),
}
"""What is built, and how many matrices are factorised for it."""


@pytest.mark.parametrize("what", BUILDS)
def test_every_model_build_is_logged_before_it_begins(what: str, caplog: pytest.LogCaptureFixture) -> None:
    build, factors = BUILDS[what]
    mesh = coarse_mesh(0.8, 0.8, patch_x_mm=1.5, patch_z_mm=1.5, round_patch_mm=1.0)
    with caplog.at_level(logging.INFO, "sim.models"):
        build(FingertipConfig(mesh=mesh))
    assert len([record for record in caplog.records if record.name == condensed.__name__]) == factors
