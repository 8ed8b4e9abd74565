"""The layers under the skin: how deep each goes, and the nodes on rays through them towards the bone's axis."""

import numpy as np
from numpy.typing import NDArray

from sim.config.fingertip_config import FingertipConfig, MeshSpec, Tissue
from sim.finger.grading import MeshError, order_of, with_middles
from sim.finger.surface import FingertipSurface

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LAYERS = ("epidermis", "dermis", "fat", "bone")
EPIDERMIS, DERMIS, FAT, BONE = range(4)

_DEEPEST_DERMIS = 0.7
"""Lower face of the dermis: at most this part of the way to the bone, so that the fat's elements do not vanish."""


def nodes_on_rays(config: FingertipConfig, surface: FingertipSurface, phi: Array, z_mm: Array) -> tuple[Array, Ints]:
    """(n_z, n_phi, n_r, 3) nodes on rays from the bone's axis, and the layer of each radial element."""
    tissue = config.tissue
    p, z = np.meshgrid(phi, z_mm)
    x, y = surface.section(p, z)
    skin = np.stack([x, y, z], -1)
    radius = np.hypot(x, y)
    ray = np.stack([x, y, 0 * z], -1) / radius[..., None]
    cosine = np.clip(np.einsum("zpk,zpk->zp", surface.normal(p, z), ray), 0.6, 1.0)
    thickness = radius * (1 - tissue.bone_fraction)
    stretch = np.minimum(1 / cosine, _DEEPEST_DERMIS * thickness / (tissue.epidermis_mm + tissue.dermis_mm))

    # depths of the interfaces along each ray; the fractions between them are the same everywhere
    apex_depth = float(thickness[np.argmin(np.abs(z_mm - config.receptor_plane_mm))].max())
    ends, layers = _radial_fractions(config.mesh, tissue, apex_depth)
    order = order_of(config.mesh)
    fractions = with_middles(ends, order)
    knots = np.stack(
        [
            0 * thickness,
            tissue.epidermis_mm * stretch,
            (tissue.epidermis_mm + tissue.dermis_mm) * stretch,
            thickness,
        ]
    )
    piece = np.minimum(fractions.astype(int), 2)
    depth = knots[piece] + (knots[piece + 1] - knots[piece]) * (fractions - piece)[:, None, None]
    nodes = skin[:, :, None] - np.moveaxis(depth, 0, -1)[..., None] * ray[:, :, None]
    if tissue.bone == "elastic":
        inwards = 1 - 0.5 * np.arange(1, order + 1)[:, None] / order
        core = nodes[:, :, -1:] * np.concatenate([inwards, inwards, np.ones((order, 1))], axis=1)
        nodes, layers = np.concatenate([nodes, core], axis=2), np.append(layers, BONE)
    return nodes, layers


def _radial_fractions(mesh: MeshSpec, tissue: Tissue, depth_mm: float) -> tuple[Array, Ints]:
    """Node positions through the layers (0–1 epidermis, 1–2 dermis, 2–3 fat) and each element's layer."""
    epidermis = np.linspace(0, 1, mesh.epidermis_elements + 1)
    n_dermis = max(1, round(tissue.dermis_mm / mesh.dermis_spacing_mm))
    dermis = 1 + np.linspace(0, 1, n_dermis + 1)[1:]
    top = tissue.epidermis_mm + tissue.dermis_mm
    below = depth_mm - top
    if top > _DEEPEST_DERMIS * depth_mm:
        raise MeshError(
            "epidermis + dermis = {skin_mm:.2f} mm reach the bone, {bone_mm:.2f} mm below the skin, or nearly: "
            "expected at most {most_mm:.2f} mm, so that fat is left",
            code="no_fat",
            skin_mm=top,
            bone_mm=float(depth_mm),
            most_mm=float(_DEEPEST_DERMIS * depth_mm),
        )
    steps, x = [], 0.0
    step = mesh.dermis_spacing_mm
    while x < below:
        step = step if top + x < mesh.dermis_fine_depth_mm - 1e-9 else step * mesh.growth
        steps.append(min(step, mesh.near_spacing_mm))
        x += steps[-1]
    fat = 2 + np.cumsum(steps) / np.sum(steps)
    layers = np.repeat([EPIDERMIS, DERMIS, FAT], [mesh.epidermis_elements, n_dermis, len(steps)])
    return np.concatenate([epidermis, dermis, fat]), layers
