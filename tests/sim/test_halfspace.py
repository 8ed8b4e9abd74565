"""The half-space against closed forms that it does not use, and against Hertz."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import dblquad

from sim.config import E_EPIDERMIS_MPA, FingertipConfig, Tissue
from sim.contact.indentor import BOTH, Indentor
from sim.contact.patch import Patch, X, Y, Z
from sim.contact.points import ContactPose
from sim.contact.shapes import parse_shape
from sim.contact.solver import solve_contact
from sim.errors import ModelRangeError
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.halfspace import interior_strain, surface_compliance
from studies.verification.halfspace import boussinesq_strain
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

POISSON = 0.48
SHEAR = 1 / (2 * (1 + POISSON))
AXES = (X, Z, Y)


def test_strain_under_a_point_load_agrees_with_boussinesq() -> None:
    # Johnson (1985), Eq. 3.18 and 3.19, written out there as stresses; here differentiated displacements.
    x, z = np.array([0.1, 0.5, 1.0, -0.7]), np.array([0.3, -0.2, 0.5, 0.9])
    points = np.stack([x, 0 * x, z], axis=1)
    ours = -interior_strain(points, 0.76, np.zeros((1, 3)), SHEAR, POISSON)[:, :, 0, Y]
    assert_allclose(ours, boussinesq_strain(x, np.full(4, 0.76), z, POISSON), atol=1e-13)


def test_strain_under_a_tangential_load_balances_the_load() -> None:
    # Shear stress over a plane at depth 0.7 must carry the whole force; integrated over 60 depths, the rest is < 3 %.
    side = np.arange(-42, 42.01, 0.28)
    x, z = (v.ravel() for v in np.meshgrid(side, side))
    strain = interior_strain(np.stack([x, 0 * x, z], axis=1), 0.7, np.zeros((1, 3)), SHEAR, POISSON)
    carried = SHEAR * strain[:, 3, 0, X].sum() * 0.28**2
    assert carried == pytest.approx(1.0, abs=0.03)


def test_the_deflection_in_the_middle_of_a_loaded_square_agrees_with_theory() -> None:
    # Love (1929), Johnson Eq. 3.26: 2a by 2a under p = F / 4a² sinks by (8/π) ln(1 + √2) a p (1 − ν²) / E.
    a = 0.1
    c = surface_compliance(np.zeros((1, 2)), np.full((1, 2), a), (Y,), SHEAR, POISSON)
    assert c[0, 0] == pytest.approx(
        8 / np.pi * np.log(1 + np.sqrt(2)) * a * (1 - POISSON**2) / (4 * a * a), rel=1e-12
    )


@pytest.mark.parametrize(("moved", "pushed"), [(X, X), (Z, Z), (X, Z), (X, Y), (Z, Y)])
def test_every_surface_compliance_kernel_agrees_with_quadrature(moved: int, pushed: int) -> None:
    at, half = np.array([[0.0, 0.0], [0.31, 0.17]]), np.full((2, 2), 0.05)
    c = surface_compliance(at, half, AXES, SHEAR, POISSON).reshape(3, 2, 3, 2)

    def at_point(dz: float, dx: float) -> float:  # Johnson Eq. 3.75, 3.19 on the surface, for a unit force
        x, z = at[1, 0] - dx, at[1, 1] - dz
        r = np.hypot(x, z)
        s, t = {X: (x, z), Z: (z, x)}[moved]
        if pushed == moved:
            return float(((1 - POISSON) / r + POISSON * s * s / r**3) / (2 * np.pi * SHEAR))
        if pushed == Y:
            return float((1 - 2 * POISSON) * s / (4 * np.pi * SHEAR * r * r))
        return float(POISSON * s * t / r**3 / (2 * np.pi * SHEAR))

    mean = dblquad(at_point, -0.05, 0.05, -0.05, 0.05, epsabs=1e-12)[0] / 0.01
    assert c[AXES.index(moved), 1, AXES.index(pushed), 0] == pytest.approx(mean, rel=1e-8)


def test_a_sphere_on_the_half_space_agrees_with_hertz() -> None:
    # Johnson Eq. 4.23: F = 4/3 E* √R d^1.5. 18 nodes across the contact; slopes below 1/10, hence 1 %.
    side, h = np.arange(-15, 16) * 0.027, 0.027
    x, z = (v.ravel() for v in np.meshgrid(side, side))
    at, half = np.stack([x, z], axis=1), np.full((len(x), 2), 0.5 * h)
    patch = Patch(
        np.stack([x, 0 * x, z], axis=1),
        np.full(len(x), h * h),
        (len(side), len(side)),
        AXES,
        compliance=surface_compliance(at, half, AXES, SHEAR, POISSON),
    )
    doi, radius = 0.006, 10.0
    state = solve_contact(patch, ContactPose(parse_shape("sphere:10"), (0.0, 0.0), -doi, doi), between_nodes=False)
    exact = 4 / 3 / (1 - POISSON**2) * np.sqrt(radius) * doi**1.5
    assert state.converged
    assert state.normal_force == pytest.approx(exact, rel=0.01)


HOMOGENEOUS = {"e_dermis": 1.0, "e_fat": 1.0}


@pytest.mark.parametrize(
    ("tissue", "ratio"),
    [
        ({}, 0.21),
        ({"stiffness": 2.0}, 0.42),  # all layers are stiffer alike
        (HOMOGENEOUS, 1.0),  # one modulus, which needs no fit
        ({**HOMOGENEOUS, "stiffness": 0.5, "epidermis_mm": 0.2}, 0.5),
        ({"e_fat": 0.02}, None),
        ({"bone_fraction": 0.4}, None),
    ],
)
def test_the_half_space_modulus_is_fitted_to_the_layers_or_refused(
    tissue: dict[str, float], ratio: float | None
) -> None:
    config = FingertipConfig(tissue=Tissue(**tissue), mesh=coarse_mesh(0.5, 0.6))
    if ratio is None:
        with raises(ModelRangeError, "no_modulus", keys=next(iter(tissue))):
            load("halfspace", config)
        return
    default = load("halfspace", FingertipConfig(mesh=config.mesh), slopes=BOTH).indent("sphere:1", doi_mm=0.2)
    own = load("halfspace", config, slopes=BOTH).indent("sphere:1", doi_mm=0.2)
    assert own.force_n / default.force_n == pytest.approx(ratio / 0.21, rel=1e-6)


def test_the_half_space_model_of_a_homogeneous_finger_agrees_with_hertz() -> None:
    """F = 4/3 E / (1 − ν²) √R d^1.5, with R = 0.78 mm from the sphere's 1 mm and the skin's curvature."""
    finger = FingertipConfig(tissue=Tissue(**HOMOGENEOUS))
    hertz_n = 4 / 3 * E_EPIDERMIS_MPA / (1 - 0.48**2) * 0.78**0.5 * 0.2**1.5
    found = load("halfspace", finger, slopes=BOTH).indent("sphere:1", doi_mm=0.2)
    assert found.force_n == pytest.approx(hertz_n, rel=0.06)


def test_the_half_space_model_agrees_with_the_finger_within_20_percent_at_small_depth(finger: Fingertip) -> None:
    # A homogeneous body cannot be a layered one; its modulus was set for DOI 0.4 (sim/halfspace.py).
    halfspace, shape = load("halfspace"), Indentor.along(parse_shape("cylinder:9").profile)
    for doi_mm in (0.2, 0.4):
        ours, theirs = (model.indent(shape, 0.0, doi_mm=doi_mm) for model in (halfspace, finger))
        assert ours.force_n == pytest.approx(theirs.force_n, rel=0.2)
