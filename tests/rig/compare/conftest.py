"""Stimuli made by hand, and one real run of a bar."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.stimuli import StimulusRow
from rig.data import Run
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip
from tests.sim.coarse_mesh import as_toml, coarse_mesh

Array = NDArray[np.float64]

BAR = """\
from rig.protocol import Rig

def run(rig: Rig) -> None:
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (0.8, 0.4, 0.1, -0.2, -0.6, 0.1):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.4, increments=2, hold_s=0.5)
"""


COARSE_FINGERS = f"""\
receptor_x_mm = [-1.0, 0.0]

{as_toml(coarse_mesh(0.5, 0.5, patch_x_mm=2.5, patch_z_mm=2.5))}
[finger.tissue]
epidermis_mm = [0.3, 0.5]

"""


@pytest.fixture
def coarse_fingers() -> str:
    """The tables of a parameter study of two fingers of few nodes; presses are still to follow."""
    return COARSE_FINGERS


@pytest.fixture(scope="session")
def bar_run(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Bar 3.0 in two increments to DOI 0.4 at five places, x = 0.1 twice."""
    return dry_run_of(BAR, finger, tmp_path_factory.mktemp("bar"))


def dry_run_of(text: str, finger: Fingertip, folder: Path) -> Run:
    """A script carried out on the virtual bench with a finger."""
    path = folder / "presses.py"
    path.write_text(text, encoding="utf-8")
    script, config = load_script(str(path)), Config(finger=finger.config)
    return dry_run(Session(script, config, finger, make_plan(script, config, finger), NewRun(folder))).run


@pytest.fixture(scope="session")
def make_stimulus() -> Callable[..., StimulusRow]:
    """A stimulus whose measures are given as (18, n, receptors), or flat where they are not."""

    def make(
        indentor: str,
        x_mm: Array,
        receptor_mm: Array,
        profiles: dict[str, Array],
        *,
        kind: str = "force_gwt",
        commanded: float = 2.33,
        run: str | None = None,
    ) -> StimulusRow:
        measures = np.zeros((len(MEASURES), len(x_mm), len(receptor_mm)))
        for name, profile in profiles.items():
            measures[MEASURES.index(name)] = profile
        flat = np.ones(len(x_mm))
        skin = np.linspace(-1, 1, 9)
        pressure = np.ones((len(x_mm), 9))
        return StimulusRow(
            run or f"run of {indentor}",
            indentor,
            kind,
            commanded,
            x_mm,
            flat,
            flat,
            measures,
            receptor_mm,
            skin,
            pressure,
            np.tile([-1.0, 1.0], (len(x_mm), 1, 1)),
        )

    return make
