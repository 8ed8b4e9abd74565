"""`finger.tissue.stiffness` scales E everywhere, no model is built for it; what is linear alone says so."""

import pickle
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from sim.coding.point_loaded_finger import LoadedFinger, Site
from sim.coding.point_spread import MovedResponse, PointSpread, judged, receptor_sheet, spreads
from sim.coding.raju_table_6_1 import deformed_by
from sim.coding.readings_file import pa_per_pseudo
from sim.config import FingertipConfig, Tissue
from sim.errors import ModelRangeError
from sim.finger.mesh import build_mesh
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorPlaces, receptors_at
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import MeshedFinger
from sim.models.interpolation import FingerWithReceptors
from sim.models.interpolation_weights import node_tissues
from sim.models.sources import OnDisk
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

MESH = coarse_mesh(0.7, 0.7, patch_x_mm=1.4, patch_z_mm=1.4, growth=2.0, far_growth=3.0, far_spacing_mm=3.0)
MIDDLE = Site(10, 0.098, 6.893, on_pulp=True)
STIFF = 2.5
ALONG = (0,)


def config(stiffness: float) -> FingertipConfig:
    return FingertipConfig(mesh=MESH, tissue=Tissue(stiffness=stiffness))


@cache
def finger(stiffness: float) -> Fingertip:
    return Fingertip.load(config(stiffness), receptor_x_mm=(0.0,))


@cache
def spread(stiffness: float) -> tuple[LoadedFinger, PointSpread]:
    loaded = LoadedFinger(config(stiffness))
    return loaded, spreads(loaded, receptor_sheet(loaded, 0.5), [MIDDLE], 2.0, 1.5)[0]


def missed(stiffness: float) -> float:
    loaded, found = spread(stiffness)
    response = MovedResponse.of(loaded, receptor_sheet(loaded, 0.5))
    return response.missed(found, 2.0)


def moved(stiffness: float) -> float:
    loaded, found = spread(stiffness)
    return float(np.abs(deformed_by(loaded, judged(found), 1.0).moved_mm).max())


SCALED: dict[str, tuple[Callable[[float], float], int]] = {
    "E of a configuration": (lambda s: config(s).tissue.e_epidermis_mpa, 1),
    "E of a finger": (lambda s: finger(s).e_epidermis_mpa, 1),
    "E of a pickled finger": (lambda s: pickle.loads(pickle.dumps(finger(s))).e_epidermis_mpa, 1),
    "force at a depth": (lambda s: finger(s).indent("cylinder:9", doi_mm=0.1).force_n, 1),
    "peak pressure at a depth": (lambda s: finger(s).indent("cylinder:9", doi_mm=0.1).peak_pressure_mpa, 1),
    "force of a half-space": (lambda s: load("halfspace", config(s)).indent("cylinder:9", doi_mm=0.1).force_n, 1),
    "force of a section": (lambda s: load("section", config(s)).indent("cylinder:9", doi_mm=0.1).force_n, 1),
    "depth at scaled force": (lambda s: finger(s).indent("cylinder:9", force_gwt=0.3 * s).doi_mm, 0),
    "sed at a depth": (lambda s: float(finger(s).indent("cylinder:9", doi_mm=0.1).receptor_measures["sed"][0]), 0),
    "strain of a point load": (lambda s: float(finger(s).point_load(0.0, 1.0).receptor_measures["ep1"][0]), -1),
    "sed of a point load": (lambda s: float(spread(s)[1].sed.max()), -2),
    "displacement of a point load": (moved, -1),
    "what a moved response misses": (missed, 0),
    "Pa of a pseudo-unit": (lambda s: pa_per_pseudo(config(s)), 1),
}
"""A number that hangs on Young's modulus by a power of it."""


@pytest.mark.parametrize("name", SCALED)
def test_every_result_scales_with_the_tissue_stiffness(name: str) -> None:
    number, power = SCALED[name]
    assert number(STIFF) == pytest.approx(number(1.0) * STIFF**power, rel=1e-6)


def test_no_model_is_built_for_another_tissue_stiffness() -> None:
    def made_of(**tissue: float) -> list[object]:
        told = FingertipConfig(mesh=MESH, tissue=Tissue(**tissue))  # type: ignore[arg-type]
        surface = FingertipSurface.fit(told.geometry)
        receptors = receptors_at(told, surface, ReceptorPlaces.of((0.0,), 0.76, None))
        return OnDisk(told, surface, receptors).made_of((ALONG, None))

    assert made_of(stiffness=STIFF, stiffening=0.5) == made_of()
    assert made_of(e_fat=0.2) != made_of()


def test_fingers_of_two_stiffnesses_are_interpolated_between_the_same_builds() -> None:
    assert node_tissues(Tissue(stiffness=STIFF, stiffening=0.5)) == node_tissues(Tissue())
    families = {FingerWithReceptors(config(s), ReceptorPlaces.of((0.0,), 0.76, None)).family for s in (1.0, STIFF)}
    assert len(families) == 1


REFUSED: dict[str, Callable[[FingertipConfig], object]] = {
    "section": lambda told: load("section", told),
    "halfspace": lambda told: load("halfspace", told),
    "point loads": LoadedFinger,
    "point load": lambda told: Fingertip.load(told, receptor_x_mm=(0.0,)).point_load(0.0, 1.0),
    "inside": lambda told: Fingertip.load(told, receptor_x_mm=(0.0,)).fields([], [[0.0, 4.0, 6.9]]),
    "deck": lambda told: MeshedFinger(told, build_mesh(told, FingertipSurface.fit(told.geometry)), 0.2),
}


@pytest.mark.parametrize("name", REFUSED)
def test_linear_models_refuse_stiffening_tissue(name: str) -> None:
    told = FingertipConfig(mesh=MESH, tissue=Tissue(stiffening=0.25))
    with raises(ModelRangeError, "linear_alone", stiffening=0.25):
        REFUSED[name](told)
