"""Friction beside a closed form and beside another program."""

import shutil

import pytest

from studies.friction import mindlin
from studies.friction.beside_calculix import SCENES, Scene, calculix, here, largest_sed_error


def test_a_sphere_is_cattaneos_and_mindlins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mindlin, "ACROSS", 15)  # the page has 21; errors of both are within what is asked for
    rows = list(mindlin.rows())
    assert len(rows) == len(mindlin.PARTS_OF_SLIDING)
    for row in rows:
        assert row.residual < 1e-8
        assert row.force == pytest.approx(row.closed_force, rel=0.01)
        assert row.tangential == pytest.approx(row.closed_tangential, rel=0.02)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="no ccx (Debian package calculix-ccx)")
@pytest.mark.xdist_group("calculix")
@pytest.mark.parametrize("scene", SCENES[:2], ids=lambda scene: scene.shape)
def test_calculix_has_the_same_force_and_sed(scene: Scene) -> None:
    finger, ours = here(scene)
    its = calculix(scene, finger)
    assert ours.force == pytest.approx(its.force, rel=0.01)
    assert ours.shear == pytest.approx(its.shear, rel=0.03, abs=1e-4)
    assert largest_sed_error(ours, its) < 0.03
