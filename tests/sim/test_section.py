"""The plane-strain section: what plane strain means, convergence, and what it refuses."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sim.benchmark import nested
from sim.config import FingertipConfig
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.section import prismatic
from tests.error_codes import raises


@pytest.fixture(scope="module")
def section() -> Fingertip:
    return load("section")


def test_the_skin_of_the_section_is_that_of_the_finger_in_the_receptor_plane(skin: FingertipSurface) -> None:
    plane = FingertipConfig().receptor_plane_mm
    phi = np.linspace(0, np.pi, 50)
    for z_mm in (3.0, 6.0, 11.0):
        assert_allclose(prismatic(skin, plane).section(phi, z_mm), skin.section(phi, plane), atol=1e-13)


def test_the_section_has_no_strain_along_the_finger(section: Fingertip) -> None:
    strain = section.indent("bar:3.0", 0.3, doi_mm=0.6).receptor_strain
    assert np.abs(strain[:, [2, 4, 5]]).max() < 1e-13 * np.abs(strain).max()


def test_the_force_of_the_section_is_the_derivative_of_its_energy(section: Fingertip) -> None:
    # dE/dDOI = F for a conservative contact; E = ½ f·u is exact for linear tissue. Nodes join the contact one by
    # one: 0.2 %.
    def energy(doi_mm: float) -> float:
        state = section.indent("cylinder:9", 0.0, doi_mm=doi_mm).state
        return 0.5 * float((state.force * state.displacement).sum())

    h = 0.005
    slope = (energy(0.5 + h) - energy(0.5 - h)) / (2 * h)
    force = section.indent("cylinder:9", 0.0, doi_mm=0.5).state.normal_force
    assert slope == pytest.approx(force, rel=2e-3)


def test_section_converges_with_the_mesh() -> None:
    meshes = [load("section", FingertipConfig(mesh=nested(n))) for n in (2, 3, 5)]
    for shape, x_mm in (("cylinder:9", 0.0), ("bar:3.0", 0.04)):
        coarse, fine, finest = (mesh.indent(shape, x_mm, doi_mm=0.67) for mesh in meshes)
        errors = [abs(r.force_n / finest.force_n - 1) for r in (coarse, fine)]
        assert errors[1] < errors[0] < 0.03


def test_the_section_refuses_round_shapes(section: Fingertip) -> None:
    with raises(ModelRangeError, "not_prismatic"):
        section.indent("sphere:5", 0.0, doi_mm=0.2)
