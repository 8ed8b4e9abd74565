"""The tables that come with the program are those of the fingers of today, and nobody waits for what is there."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.cli.identify_finger import USUAL_GOALS, scope_of
from rig.identify.adaptive_presses import IdentificationOptions
from sim.config import FingertipConfig
from sim.identification.force_table import Scope, shipped
from sim.identification.predicted_forces import PredictedForces
from sim.identification.prior import Prior
from sim.models.fingertip import Fingertip
from tests.sim.coarse_mesh import coarse_mesh

WANTED = IdentificationOptions(USUAL_GOALS)


def _predicted(config: FingertipConfig | None = None) -> PredictedForces:
    return PredictedForces.over(config or FingertipConfig(), Prior(), *scope_of(WANTED))


def _nothing(what: str, function: Callable[[Any], Any], items: Sequence[Any], /) -> Iterable[Any]:
    assert not items, f"{len(items)} {what}"
    return ()


def test_the_first_identification_of_a_default_finger_builds_no_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))
    _predicted().have(WANTED.indentors, _nothing)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("shape", "stiffening"), [(shape, 0.3 * (n % 2)) for n, shape in enumerate(WANTED.indentors)]
)
def test_every_shipped_force_table_is_near_direct_presses(finger: Fingertip, shape: str, stiffening: float) -> None:
    """At moduli, places and depths between its nodes; its own error, an rms of six presses, is with it: of one press
    three times that is allowed."""
    table = shipped(shape, _predicted().scope)
    assert table is not None
    assert 0 < table.error < 0.03
    tissue = finger.config.tissue.model_copy(update={"stiffening": stiffening})
    stiff = Fingertip.load(finger.config.model_copy(update={"tissue": tissue}))
    basis = table.tissue_basis([np.log([tissue.e_dermis]), np.log([tissue.e_fat])])
    for x_mm, doi_mm in ((-0.7, 0.25), (0.4, 0.6)):
        found = table.forces_gwt(basis, np.array([stiffening]), np.array([x_mm]), np.array([[doi_mm]]))[0, 0]
        direct = stiff.indent(shape, x_mm, doi_mm=doi_mm).force_gwt
        assert abs(np.log(found / direct)) < 3 * table.error + 1e-4
    x = table.scope.touch_x.nodes.tolist()[3]
    assert table.touch_mm[3] == pytest.approx(finger.touch_height_mm(shape, x) - finger.apex_height_mm, abs=2e-5)


def test_no_shipped_table_is_used_for_another_finger_shape_or_wider_scope() -> None:
    other, scope = _predicted(FingertipConfig(mesh=coarse_mesh(0.5, 0.7))), _predicted().scope
    assert other._shipped("bar:3.0") is None
    assert _predicted()._shipped("bar:3.0") is not None
    assert shipped("bar:2.9", scope) is None
    assert shipped("bar:3.0", Scope(scope.tissue, 1.9, scope.depth_mm)) is None
    assert shipped("bar:3.0", Scope(scope.tissue[:1], scope.farthest_mm, scope.depth_mm)) is None


def test_a_shape_that_reaches_the_rim_of_the_patch_is_refused_before_the_builds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))
    built: list[int] = []

    def work(what: str, function: Callable[[Any], Any], items: Sequence[Any], /) -> Iterable[Any]:
        if what == "full builds":
            built.append(len(items))
            return ()
        return map(function, items)

    foreseen = _predicted(FingertipConfig(mesh=coarse_mesh(0.5, 0.7, patch_x_mm=2.1, patch_z_mm=0.8)))
    refused = foreseen.have(["bar:3.0"], work)
    assert list(refused) == ["bar:3.0"]
    assert "mesh.patch_x_mm / patch_z_mm" in refused["bar:3.0"]
    assert built == [0]
