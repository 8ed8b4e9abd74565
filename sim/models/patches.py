"""A larger patch for a scene that leaves the mesh's own: how large, and whether it fits into the memory."""

import numpy as np
from numpy.typing import NDArray

from sim.config.fingertip_config import FingertipConfig
from sim.finger.grading import MeshError, angles_around, axial_places
from sim.finger.surface import FingertipSurface
from sim.models.discretised import meshed_for
from sim.models.errors import ModelRangeError
from sim.models.pressing import RimError

Array = NDArray[np.float64]
HalfWidths = tuple[float, float]
"""Along x and along z, in the receptor plane; mm."""

_GROWTH = 1.25  # a patch is so many times as wide as the mesh's own, or a power of that: scenes share them
_TOUCHED = 0.85  # how far contact goes of how far the indentor would lie below the undeformed skin
_MARGIN_MM = 1.5  # beyond a first touch
_FROM_ENDS_MM = 0.5  # of the finger, as the mesh wants it
_OF_HALF_WIDTH = 0.93  # of the section; its sides are no function of x
_COPIES = 10  # of the compliance while it is made, the factor that it comes from counted in; measured
_BYTES = 8


def half_widths(config: FingertipConfig, slopes: tuple[int, ...]) -> HalfWidths:
    """Of the patch that the mesh has by itself, for indentors that slope along some axes."""
    mesh = meshed_for(config, slopes).mesh
    return mesh.patch_x_mm, mesh.patch_z_mm


def widened(config: FingertipConfig, patch: HalfWidths | None) -> FingertipConfig:
    """The same finger with another patch."""
    if patch is None:
        return config
    sizes = {"patch_x_mm": patch[0], "patch_z_mm": patch[1], "round_patch_mm": 0.0}
    return config.model_copy(update={"mesh": config.mesh.model_copy(update=sizes)})


def larger(
    config: FingertipConfig, surface: FingertipSurface, slopes: tuple[int, ...], patch: HalfWidths, met: RimError
) -> HalfWidths:
    """The next larger patch where an indentor met the rim of one.

    Raises `met` where there is none, and ModelRangeError where it would take too much memory.
    """
    if not config.contact.patch_gb:
        raise met
    centre = np.array([0.0, config.receptor_plane_mm])
    reach, others = np.abs(met.at_mm - centre), np.abs(met.others_mm - centre)
    spacing = np.array([config.mesh.spacing_mm, meshed_for(config, slopes).mesh.axial_mm])
    now, own, most = np.array(patch), np.array(half_widths(config, slopes)), _most(config, surface, spacing[1])
    at_rim = reach > now - 1.5 * spacing
    least = np.where(at_rim | ~at_rim.any(), _GROWTH * now, now)
    touched = _TOUCHED * others.max(axis=0) if len(others) else np.where(at_rim, reach + _MARGIN_MM, 0.0)
    steps = np.ceil(np.log(np.maximum(least, touched) / own) / np.log(_GROWTH) - 1e-6)
    then = np.minimum(own * _GROWTH**steps, np.maximum(most, now))
    if (then <= now).all() or (not len(others) and (reach >= then).any()):
        raise met
    found = float(then[0]), float(then[1])
    _refuse_memory(config, surface, slopes, found, met)
    return found


def _most(config: FingertipConfig, surface: FingertipSurface, axial_mm: float) -> Array:
    """(2,) the largest half-widths that the finger has room for."""
    x, _ = surface.section(np.linspace(0.0, np.pi, 181), config.receptor_plane_mm)
    along = min(config.receptor_plane_mm, config.geometry.length_mm - config.receptor_plane_mm) - _FROM_ENDS_MM
    return np.array([_OF_HALF_WIDTH * min(x.max(), -x.min()), axial_mm * np.floor(along / axial_mm)])


def _refuse_memory(
    config: FingertipConfig, surface: FingertipSurface, slopes: tuple[int, ...], patch: HalfWidths, met: RimError
) -> None:
    meshed = meshed_for(widened(config, patch), slopes)
    try:
        nodes = int(axial_places(meshed)[1].sum()) * int(angles_around(meshed, surface)[1].sum())
    except MeshError:
        raise met from None
    needed_gb = _COPIES * _BYTES * (nodes * (len(slopes) + 1)) ** 2 / 1e9
    if needed_gb > config.contact.patch_gb:
        raise ModelRangeError(
            "{problem}; a patch of ± {patch_x_mm:.2f} × ± {patch_z_mm:.2f} mm would take {needed_gb:.2g} GB, "
            "contact.patch_gb = {patch_gb:g}",
            code="patch_too_large",
            problem=str(met),
            patch_x_mm=patch[0],
            patch_z_mm=patch[1],
            needed_gb=needed_gb,
            patch_gb=config.contact.patch_gb,
        )
