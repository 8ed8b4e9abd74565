"""A coarse finger for the algebra, the default mesh, and the default section with its samples."""

import pytest

from sim.coding.operators import centred
from sim.coding.pressure import Frictionless, frictionless
from sim.coding.section import SampledSection, Sampling, sampled_section
from sim.config import FingertipConfig, Geometry
from sim.finger.mesh import FingerMesh, build_mesh
from sim.finger.surface import FingertipSurface
from sim.models.catalogue import load
from sim.models.condensed import FiniteElements, discretise
from sim.models.fingertip import Fingertip
from tests.sim.coarse_mesh import coarse_mesh


@pytest.fixture(scope="session")
def skin() -> FingertipSurface:
    """The default surface through the published points."""
    return FingertipSurface.fit(Geometry())


@pytest.fixture(scope="session")
def coarse_config() -> FingertipConfig:
    """Some 2 000 nodes: for algebra, not for mechanics."""
    return FingertipConfig(mesh=coarse_mesh(0.5, 0.5, patch_x_mm=1.5, patch_z_mm=1.5))


@pytest.fixture(scope="session")
def coarse_finger() -> Fingertip:
    """Nodes 0.3 mm apart both ways, patches of ± 2.5 mm for every kind of shape: a second to make, for mechanics."""
    mesh = coarse_mesh(0.3, 0.3, patch_x_mm=2.5, patch_z_mm=2.5, round_patch_mm=2.5)
    return load("finger", FingertipConfig(mesh=mesh), cached=False)


@pytest.fixture(scope="session")
def halfspace() -> Fingertip:
    """The cheapest model, with the skin of the default finger."""
    return load("halfspace")


@pytest.fixture(scope="session")
def coarse_problem(coarse_config: FingertipConfig, skin: FingertipSurface) -> FiniteElements:
    """The coarse finger's stiffness, not condensed."""
    return discretise(coarse_config, build_mesh(coarse_config, skin))


@pytest.fixture(scope="session")
def default_mesh(skin: FingertipSurface) -> FingerMesh:
    """The mesh of the default fingertip."""
    return build_mesh(FingertipConfig(), skin)


@pytest.fixture(scope="session")
def section() -> SampledSection:
    """The section of the default finger, with the source's samples."""
    return sampled_section(FingertipConfig(), Sampling())


@pytest.fixture(scope="session")
def operator(section: SampledSection) -> Frictionless:
    """39 samples 170 µm apart on it."""
    return frictionless(section, centred(40, 0.17), "finite")
