"""Where `rig decode` takes readings from: pressures or a press that it encodes first, or a file."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.cli.coded import Scene, told
from rig.cli.decoding import Noisy, Task, noise_of
from rig.cli.readings_file import GivenReadings
from rig.protocol.errors import BadInputError
from sim.coding.bayes import FEWEST_FOR_CONTACTS, FittedReceptor
from sim.coding.encoding import Encoded, Noise, NoisePlace, encode, sd_at_rest
from sim.coding.operators import (
    Operator,
    OperatorName,
    centred,
    convolution,
    felt_where,
    impulse_responses,
    influence,
    normal_alone,
    normal_influence,
)
from sim.coding.pressure import borne_by, frictionless
from sim.coding.section import SPACING_MM, Energy, SampledSection, Sampling, felt_section, sampled_section
from sim.coding.sheet import (
    FEWEST_PLACES,
    GRID_MM,
    ROW_ERROR,
    SHEET_SPACING_MM,
    AxialShape,
    Grid,
    felt_row,
    felt_skin,
    sheet_operator,
)
from sim.config import FingertipConfig
from sim.contact.patch import X, Z
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import points_below

Array = NDArray[np.float64]

_HELD = 0.95  # of a press's force under the pressures that are sought
_SOUGHT = 0.8  # of the receptors' half length: beyond, too few of them feel a pressure


class Encoding(NamedTuple):
    """How pressures are encoded first."""

    energy: Energy
    receptor: FittedReceptor | None
    noise: Noise | None
    at: NoisePlace  # where noise enters: that of readings too


def task_of_pressures(
    config: FingertipConfig, sampling: Sampling, by: OperatorName, how: Encoding, pressure: Array
) -> Task:
    """Encoded and read back by the same operator."""
    section = sampled_section(config, sampling)
    mine = told(section, by, how.energy, pressure)
    operator = mine.operator if by == "convolution" else normal_alone(mine.operator)
    return _task(operator, _encoded(mine.operator, mine.pressure, how), how, pressure)


def task_of_press(config: FingertipConfig, sampling: Sampling, by: OperatorName, how: Encoding, scene: Scene) -> Task:
    """Felt as finite elements have it; read back as pressures without friction, or folded ones, about the middle."""
    section = sampled_section(config, sampling)
    borne = borne_by(section, section.finger.indent(scene.indentor, scene.x_mm, doi_mm=scene.doi_mm))
    felt = influence(section, borne.place_mm, borne.width_mm, how.energy)
    half = int(_SOUGHT * section.sampling.half_length)
    operator = _sought(section, by, how.energy, half)
    true = borne.means(operator.place_mm)
    held = float(true.sum() * section.sampling.spacing_mm / (borne.normal * borne.width_mm).sum())
    if held < _HELD:
        raise BadInputError(
            "--shape at x = {x_mm:g} mm: {held:.0%} of its force is between {low_mm:.2f} and {high_mm:.2f} mm, where "
            "pressures are sought, expected {least:.0%} or more",
            code="beside_the_search",
            x_mm=scene.x_mm,
            held=held,
            low_mm=float(operator.place_mm[0]),
            high_mm=float(operator.place_mm[-1]),
            least=_HELD,
        )
    return _task(operator, _encoded(felt, borne.stacked, how), how, true)


def task_of_readings(
    config: FingertipConfig, how: Encoding, given: GivenReadings, spacing_mm: float, *, contacts: bool
) -> Task:
    """Pressures between the outermost receptors, so far apart; where they are not sought within contacts no more than
    there are readings, with straight lines between them.
    """
    _refuse_kind(given, how)
    if given.z_mm is not None:
        if not contacts:
            raise BadInputError(
                "--readings with a column z_mm: expected --decoder ours, the only one of sheets",
                code="sheet_not_decoded",
            )
        return Task(
            _over_sheet(config, given, spacing_mm, how.energy), given.reading, how.receptor, _noise(given, how)
        )
    section = felt_section(config, given.place_mm, given.depth_mm)
    low, high = _on_patch(given, section.line.places(section.model.patch.x))
    n = round((high - low) / spacing_mm)
    if n < 1:
        raise BadInputError(
            "{option} over {length_mm:g} mm of skin: expected more than {least_mm:g} mm",
            code="too_short", option="--readings", length_mm=high - low, least_mm=spacing_mm,
        )  # fmt: skip
    if contacts and n >= FEWEST_FOR_CONTACTS:
        operator: Operator = frictionless(section, np.linspace(low, high, n + 1), how.energy)
    else:
        few = np.linspace(low, high, min(n + 1, len(given.place_mm)))
        operator = normal_influence(section, few, SPACING_MM, how.energy)
    return Task(operator, given.reading, how.receptor, _noise(given, how))


def tasks_of_row(
    config: FingertipConfig, how: Encoding, given: GivenReadings, spacing_mm: float, half_lengths_mm: Sequence[float]
) -> list[Task]:
    """Pressures in the receptor plane of the whole finger, one task for each ellipse along it."""
    _refuse_kind(given, how)
    if given.z_mm is not None:
        raise BadInputError(
            "--axial beside a column z_mm: expected a row of receptors, a sheet needs no axial shape",
            code="axial_of_sheet",
        )
    row = felt_row(config, given.place_mm, given.depth_mm)
    low, high = _on_patch(given, row.line.places(row.felt.nodes_mm[:, X]))
    n = round((high - low) / spacing_mm)
    if n < FEWEST_FOR_CONTACTS:
        least_mm = FEWEST_FOR_CONTACTS * spacing_mm
        raise BadInputError(
            "{option} with a row over {length_mm:.2f} mm of skin: expected {least_mm:.2f} mm or more",
            code="too_short", option="--axial", length_mm=high - low, least_mm=least_mm,
        )  # fmt: skip
    centre_mm = row.line.surface.apex.position_mm[Z]
    shapes = [AxialShape(half, centre_mm) for half in half_lengths_mm]
    operators = row.under_each(shapes, np.linspace(low, high, n + 1), how.energy)
    return [
        Task(operator, given.reading, how.receptor, _noise(given, how), error=ROW_ERROR, axial=shape.name)
        for shape, operator in zip(shapes, operators, strict=True)
    ]


def _refuse_kind(given: GivenReadings, how: Encoding) -> None:
    if (given.kind == "rate") != (how.receptor is not None):
        expected = "--gain and --threshold beside rates" if given.kind == "rate" else "no --threshold beside SED"
        raise BadInputError(
            "--readings with a column {column}: expected {expected}",
            code="receptor_mismatch", column=given.kind, expected=expected,
        )  # fmt: skip


def _on_patch(given: GivenReadings, place_mm: Array) -> tuple[float, float]:
    """From the first to the last receptor, as far as places of the patch go."""
    low, high = np.clip(given.place_mm[[0, -1]], place_mm.min(), place_mm.max()).tolist()
    return low, high


def _over_sheet(config: FingertipConfig, given: GivenReadings, spacing_mm: float, energy: Energy) -> Operator:
    """Pressures over x and z between the outermost receptors, as far as the finger's patch goes."""
    assert given.z_mm is not None
    apart = max(spacing_mm, SHEET_SPACING_MM)
    sides = [_places(name, v, middle, apart) for name, v, middle in (
        ("x_mm", given.place_mm, 0.0), ("z_mm", given.z_mm, config.receptor_plane_mm))]  # fmt: skip
    points = points_below(config, FingertipSurface.fit(config.geometry), given.place_mm, given.depth_mm, given.z_mm)
    return sheet_operator(felt_skin(config, points, given.depth_mm), Grid(*sides), energy)


def _places(name: str, receptors_mm: Array, middle_mm: float, apart_mm: float) -> Array:
    low, high = np.clip([receptors_mm.min(), receptors_mm.max()], middle_mm - GRID_MM, middle_mm + GRID_MM)
    n = int((high - low) / apart_mm + 1e-9) + 1
    if n < FEWEST_PLACES:
        raise BadInputError(
            "{option}, {column}: a sheet over {length_mm:.2f} mm, expected {least_mm:g} mm or more within "
            "± {half_mm:g} mm of {middle_mm:.2f}",
            code="too_short",
            option="--readings",
            column=name,
            length_mm=high - low,
            least_mm=(FEWEST_PLACES - 1) * apart_mm,
            half_mm=GRID_MM,
            middle_mm=middle_mm,
        )
    return np.asarray(0.5 * (low + high) + centred(n, apart_mm))


def _sought(section: SampledSection, by: OperatorName, energy: Energy, half: int) -> Operator:
    """SED at the section's own receptors under 2 half + 1 pressures."""
    n, spacing = 2 * half + 1, section.sampling.spacing_mm
    if by == "influence":
        return frictionless(section, centred(n + 1, spacing), energy)
    full = convolution(impulse_responses(section), n, energy)
    return felt_where(full, slice(half, half + len(section.place_mm)))


def _encoded(operator: Operator, pressure: Array, how: Encoding) -> Encoded:
    encoded = encode(operator, pressure, None if how.receptor is None else how.receptor.receptor, how.noise)
    if not encoded.rate.max() > 0:
        raise BadInputError(
            "no receptor says anything: expected pressure, and a --threshold below its SED", code="all_silent"
        )
    return encoded


def _task(operator: Operator, encoded: Encoded, how: Encoding, true: Array) -> Task:
    receptor = None if how.receptor is None else how.receptor.receptor
    seed = 0 if how.noise is None else how.noise.seed
    return Task(operator, encoded.rate, how.receptor, noise_of(encoded, receptor, how.at, seed), true)


def _noise(given: GivenReadings, how: Encoding) -> Noisy | None:
    if given.sd is not None:
        return Noisy(given.sd, "told by the file", how.at)
    if given.at_rest is not None:
        m = len(given.reading)
        return Noisy(np.full(m, sd_at_rest(given.at_rest)), f"measured at rest of {m} receptors", how.at)
    return None
