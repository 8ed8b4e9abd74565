"""A random finger's truth beside what was learned of it."""

import math
from pathlib import Path

import pytest

from rig.identify.random_finger import truth_of
from rig.plan.finger_file import Band, Draw, FingerFile, IdentifiedFinger, Place, Posterior
from sim.config import FingertipConfig
from sim.identification.prior import Prior, named
from tests.program import Program

NAMES = Prior().names
SD = 0.1


def _file(folder: Path, off_sds: float) -> Path:
    """A finger file of random finger 3, with an error in each parameter."""
    mean = [value + off_sds * SD for value in truth_of(3).values()]
    covariance = [[SD**2 if k == j else 0.0 for j in range(len(NAMES))] for k in range(len(NAMES))]
    place = Place(x_mm=0, x_sd_mm=0, height_mm=0, height_sd_mm=0, cell_zero_gwt=0, cell_zero_sd_gwt=0)
    draws = tuple(Draw(stiffness=stiffness, e_dermis=0.1, e_fat=0.1) for stiffness in (0.9, 0.95, 1.05, 1.1))
    identified = IdentifiedFinger(
        date="2026-11-23", version="1", bench="b", runs=("r",), journals_sha256=("s",), presses=1, place=place,
        posterior=Posterior(names=NAMES, mean=tuple(mean), covariance=tuple(map(tuple, covariance))), draw=draws,
        band=Band(model_error=0.02),
    )  # fmt: skip
    path = folder / "finger.toml"
    file = FingerFile(finger=FingertipConfig(), relaxation=((0.2, 1.4),), identified=identified)
    path.write_text(file.sealed().as_toml())
    return path


@pytest.mark.parametrize(("off_sds", "inside"), [(0.0, True), (1.6, True), (-1.7, False)])
def test_serve_reveal_prints_the_truth_beside_the_identified_band(
    program: Program, tmp_path: Path, off_sds: float, inside: bool
) -> None:
    found = program("serve", "--reveal", 3, "--beside", _file(tmp_path, off_sds), "--json").json["parameters"]
    assert [one["name"] for one in found] == [named(name) for name in NAMES]
    assert {one["inside"] for one in found} == {inside}
    by = {one["name"]: one for one in found}
    truth = truth_of(3)
    assert by["stiffness"]["truth"] == pytest.approx(math.exp(truth["ln_stiffness"]))
    assert by["x_mm"]["truth"] == pytest.approx(truth["x_mm"])
    assert by["x_mm"]["high"] - by["x_mm"]["low"] == pytest.approx(2 * 1.645 * SD, rel=1e-3)
