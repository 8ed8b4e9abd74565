"""Presses of the whole finger read back: by a row of receptors under an axial shape, and over x and z by a sheet.

    .venv/bin/python -m studies.coding.sheets_read_back [SCENES]    # minutes: finer fingers are built

Pressed on finer meshes of the default finger, decoded by the default mesh; sheets of another finger too, on its
default mesh. 30 dB over the receptors there are, unless said.
"""

import sys
import time
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.bayes import decode_profile
from sim.coding.decoder_results import decoding_errors
from sim.coding.encoding import noise_sd
from sim.coding.operators import at_receptors, centred
from sim.coding.pressure import ContactPressure, frictionless
from sim.coding.receptor_readings import Readings
from sim.coding.section import SPACING_MM, receptor_section
from sim.coding.shape_class import SOLIDS, SolidClass, classify_shape, classify_solid, extent_mm
from sim.coding.sheet import (
    HALF_LENGTHS_MM,
    AxialShape,
    Grid,
    ReceptorRow,
    SheetOperator,
    decode_row,
    decode_sheet,
    pressed_skin,
    receptor_row,
    sheet_operator,
)
from sim.config import FingertipConfig, MeshSpec, Tissue
from sim.contact.patch import X, Z
from sim.contact.shapes import parse_shape
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import DEFAULT_DEPTH_MM, points_below
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from sim.units import PSEUDO_E_EPIDERMIS
from studies.coding.profiles_read_back import SAMPLES, SCENES, ProfilePress
from studies.coding.shapes_read_back import OTHER_TISSUE

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

PLANE_MM = FingertipConfig().receptor_plane_mm
ROW_MM = centred(41, SPACING_MM)
"""Places of the row's receptors; the finger's patch is no wider."""

SHEET_MM = centred(13, 0.4)
"""Of the receptors, across and along, about the middle of the pad."""

GRID = Grid(centred(15, 0.3), PLANE_MM + centred(15, 0.3))
EVERY = (1, 2, 3)
SNRS_DB = (30.0, 20.0)
SCENES_A_CLASS, SEED = 6, 7000
FINER = {(X,): MeshSpec(level="fine"), (X, Z): MeshSpec(spacing_mm=0.13, axial_spacing_mm=0.13, epidermis_elements=3)}
"""What is pressed, by shapes prismatic along the finger and by others."""

_ROW_HEAD = (
    "| shape | axial shape | relative L2 | coverage | felt as | size, mm | ms | by the section alone |\n"
    "|---|---|---|---|---|---|---|---|"
)
_SHEET_HEAD = (
    "| pressed by | receptors apart | SNR | relative L2 | coverage | force | extent x, mm | extent z, mm | class "
    "| diameter | ms |\n|---|---|---|---|---|---|---|---|---|---|---|"
)


def main(scenes: int = SCENES_A_CLASS) -> None:
    """Print both tables."""
    print(_ROW_HEAD)
    for scene in SCENES:
        print(f"| {scene.shape} | {row_cells(scene, 8)} |", flush=True)
    print(f"\n{scenes} scenes a class, seeds {SEED} …\n{_SHEET_HEAD}")
    operator = default_sheet()
    drawn = {name: [draw(name, SEED + k) for k in range(scenes)] for name in SOLIDS}
    for who, tissue in (("", Tissue()), (" of another finger", OTHER_TISSUE)):
        pressed = {name: [press(tissue, scene) for scene in several] for name, several in drawn.items()}
        for every in EVERY if not who else EVERY[:1]:
            for snr_db in SNRS_DB if not who else SNRS_DB[:1]:
                for name in SOLIDS:
                    cells = sheet_cells(operator, drawn[name], pressed[name], SampledSheet(every, snr_db))
                    print(f"| {name}{who} | {0.4 * every:.1f} mm | {snr_db:g} dB | {cells} |", flush=True)


# --- a row ---


def row_cells(scene: ProfilePress, draws: int) -> str:
    """Mean over draws of the noise."""
    row, finger = default_row(), pressed_finger((X,), Tissue(), sheet=False)
    result = finger.indent(scene.shape, scene.x_mm, doi_mm=scene.doi_mm)
    ends, sed = centred(SAMPLES - 4, SPACING_MM), np.asarray(result.receptor_measures["sed"])
    true = in_plane(row, result).means(0.5 * (ends[1:] + ends[:-1]))
    shapes = [AxialShape(half, finger.surface.apex.position_mm[Z]) for half in HALF_LENGTHS_MM]
    section = frictionless(
        receptor_section(FingertipConfig(), ROW_MM, np.full(len(ROW_MM), DEFAULT_DEPTH_MM)), ends, "finite"
    )
    sd, found, names, alone = noise_sd(sed, SNRS_DB[0]), [], [], []
    for k in range(draws):
        said = Readings.of_sed(sed + sd * np.random.default_rng(SEED + k).normal(size=len(sed)), sd)
        began = time.process_time()
        by = decode_row(row, shapes, ends, said)
        spent_ms = 1e3 * (time.process_time() - began)
        felt = classify_shape(by.operator.skin, by.profile.pressure)
        low, high = by.profile.band()
        inside = true > 0.02 * true.max()
        held = ((low <= true) & (true <= high))[inside].mean()
        error = decoding_errors(true, by.profile.pressure).relative_l2
        found.append((error, held, by.shape.half_length_mm, felt.size_mm, spent_ms))
        names.append(felt.name)
        alone.append(decoding_errors(true, decode_profile(section, said).pressure).relative_l2)
    error, held, half, size, spent_ms = np.mean(found, axis=0)
    name = max(set(names), key=names.count)
    told = f"ellipse:{half:.1f} | {error:.1%} | {held:.0%} | {names.count(name)} of {draws} {name}"
    return f"{told} | {size:.2f} | {spent_ms:.0f} | {np.mean(alone):.0%}"


@cache
def default_row() -> ReceptorRow:
    """What decodes rows."""
    return receptor_row(FingertipConfig(), ROW_MM, DEFAULT_DEPTH_MM)


def in_plane(row: ReceptorRow, result: IndentationResult) -> ContactPressure:
    """What a press bears on the skin of the receptor plane."""
    patch, across = result.model.patch, result.model.across
    place = row.line.places(patch.x[across])
    outward = row.line.normals(row.line.angles(place)).T
    pressure = PSEUDO_E_EPIDERMIS * result.state.force[:, across] / patch.area_mm2[across]
    inward = -(outward * pressure).sum(axis=0)
    along = outward[1] * pressure[0] - outward[0] * pressure[1]
    return ContactPressure(place, np.gradient(place), inward, along)


# --- a sheet ---


class PressedSheet(NamedTuple):
    """One press: pressures at the grid's places, and SED at the sheet without noise."""

    true: Array
    sed: Array


class SheetScene(NamedTuple):
    """A press of a class and a size (of a bar its width, of a step its number); mm."""

    shape: str
    size: float
    x_mm: float
    z_mm: float | None
    doi_mm: float


class SampledSheet(NamedTuple):
    """Each so manyth receptor both ways, and noise."""

    every: int
    snr_db: float

    @property
    def receptors(self) -> Flags:
        """(m,) of the sheet."""
        chosen = np.zeros((len(SHEET_MM), len(SHEET_MM)), np.bool_)
        chosen[:: self.every, :: self.every] = True
        return chosen.ravel()


def draw(name: SolidClass, seed: int) -> SheetScene:
    """A sphere, a cylinder, a bar that touches with both edges, or a step near its reference."""
    rng = np.random.default_rng((seed, SOLIDS.index(name)))
    x_mm, z_mm = rng.uniform(-0.4, 0.4), PLANE_MM + rng.uniform(-0.4, 0.4)
    if name == "sphere":
        radius = rng.uniform(1.25, 4.0)
        return SheetScene(f"sphere:{radius:.3f}", 2 * radius, x_mm, z_mm, rng.uniform(0.35, 0.65))
    if name == "cylinder":
        diameter = rng.uniform(3.0, 9.0)
        return SheetScene(f"cylinder:{diameter:.3f}", diameter, x_mm, None, rng.uniform(0.35, 0.6))
    if name == "bar":
        width = rng.uniform(1.8, 3.0)
        return SheetScene(f"bar:{width:.3f}", width, x_mm / 4, None, rng.uniform(0.45, 0.65))
    number = int(rng.choice((1, 3, 5)))
    return SheetScene(f"step:{number}", number, rng.uniform(-1.6, -1.0), None, rng.uniform(0.5, 0.65))


@cache
def pressed_finger(slopes: tuple[int, ...], tissue: Tissue, *, sheet: bool) -> Fingertip:
    """What is pressed, with the row's receptors or the sheet's; another finger on the default mesh."""
    config = FingertipConfig(tissue=tissue, mesh=FINER[slopes] if tissue == Tissue() else MeshSpec())
    if not sheet:
        x_mm = default_row().skin.model.receptors.position_mm[:, X]
        return Fingertip.load(config, slopes=slopes, receptor_x_mm=x_mm.tolist())
    z_mm = (PLANE_MM + SHEET_MM).tolist()
    return Fingertip.load(config, slopes=slopes, receptor_x_mm=SHEET_MM.tolist(), receptor_z_mm=z_mm)


def press(tissue: Tissue, scene: SheetScene) -> PressedSheet:
    """By its finger: what it bears along the skin's inward normal, and SED."""
    shape = parse_shape(scene.shape)
    finger = pressed_finger(shape.axes, tissue, sheet=True)
    result = finger.indent(shape, scene.x_mm, z_mm=scene.z_mm, doi_mm=scene.doi_mm)
    patch = result.model.patch
    force = np.zeros((3, len(patch)))
    force[list(patch.axes)] = result.state.force
    phi = finger.surface.angle_at(patch.x, patch.position_mm[:, Z])
    inward = -(force * finger.surface.normal(phi, patch.position_mm[:, Z]).T).sum(axis=0)
    true = GRID.nearest(patch.position_mm, patch.area_mm2, PSEUDO_E_EPIDERMIS * inward / patch.area_mm2)
    return PressedSheet(true, np.asarray(result.receptor_measures["sed"]))


def default_sheet() -> SheetOperator:
    """What decodes sheets."""
    config, (x_mm, z_mm) = FingertipConfig(), np.meshgrid(SHEET_MM, PLANE_MM + SHEET_MM)
    points = points_below(config, FingertipSurface.fit(config.geometry), x_mm.ravel(), DEFAULT_DEPTH_MM, z_mm.ravel())
    return sheet_operator(pressed_skin(config, points, np.full(len(points), DEFAULT_DEPTH_MM)), GRID, "finite")


def sheet_cells(
    operator: SheetOperator, scenes: Sequence[SheetScene], pressed: Sequence[PressedSheet], sampled: SampledSheet
) -> str:
    """Means over scenes of one class."""
    there = at_receptors(operator, sampled.receptors)
    found, names, sizes = [], [], []
    for k, (scene, one) in enumerate(zip(scenes, pressed, strict=True)):
        signal = one.sed[sampled.receptors]
        sd = noise_sd(signal, sampled.snr_db)
        said = signal + sd * np.random.default_rng((k, len(signal))).normal(size=len(signal))
        began = time.process_time()
        profile = decode_sheet(there, Readings.of_sed(said, sd), GRID.shape)
        spent_ms = 1e3 * (time.process_time() - began)
        felt = classify_solid(operator.skin, profile.pressure)
        low, high = profile.band()
        inside = one.true > 0.05 * one.true.max()
        held = ((low <= one.true) & (one.true <= high))[inside].mean()
        off = np.array(felt.extent_mm) - extent_mm(operator.skin, one.true)
        force = profile.pressure.sum() / one.true.sum()
        found.append((decoding_errors(one.true, profile.pressure).relative_l2, held, force, *off, spent_ms))
        names.append(felt.name)
        if scene.shape.split(":")[0] == felt.name and felt.name in ("sphere", "cylinder"):
            sizes.append(felt.size_mm / scene.size - 1)
    error, held, force, x, z, spent_ms = np.mean(found, axis=0)
    right = sum(name == scene.shape.split(":")[0] for name, scene in zip(names, scenes, strict=True))
    size = f"{100 * np.mean(sizes):+.0f} ± {100 * np.std(sizes):.0f} %" if sizes else "–"
    cells = (f"{error:.0%}", f"{held:.0%}", f"{force - 1:+.0%}", f"{x:+.2f}", f"{z:+.2f}")
    return " | ".join([*cells, f"{right} of {len(scenes)}", size, f"{spent_ms:.0f}"])


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
