"""What `rig decode` says of what it found: a table, one JSON object, a picture."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from rig.cli.decoding import Answer, DecoderName, Task
from rig.cli.output import out
from rig.cli.pictures import write_picture
from rig.cli.readings_file import pa_per_pseudo
from sim.coding.operators import Operator
from sim.coding.search import decoding_errors, error_surface
from sim.coding.shape_class import felt_solid
from sim.coding.sheet import SheetOperator
from sim.config import FingertipConfig

Array = NDArray[np.float64]

_ROWS = 25
_FINE = 121  # values of a pressure across a picture of the error surface


def left(task: Task, answer: Answer) -> float:
    """Root mean square of SED that the pressures found do not explain, of receptors that are not silent."""
    return float(np.sqrt(np.mean((task.operator.sed(answer.pressure) - task.sed)[task.heard] ** 2)))


def as_json_object(finger: FingertipConfig, task: Task, answer: Answer) -> dict[str, Any]:
    """Arrays and numbers; what is not known is null."""
    operator, noise, profile = task.operator, task.noise, answer.profile
    band = None if profile is None else dict(zip(("low", "high"), (v.tolist() for v in profile.band()), strict=True))
    return {
        "operator": operator.name,
        "energy": operator.energy,
        "place_mm": operator.place_mm.tolist(),
        "pressure": answer.pressure.tolist(),
        "pa_per_pseudo": pa_per_pseudo(finger),
        "sd": None if profile is None else profile.sd.tolist(),
        "band_90": band,
        "true": None if task.true is None else task.true.tolist(),
        "errors": None if task.true is None else decoding_errors(task.true, answer.pressure)._asdict(),
        "receptor_mm": operator.receptor_mm.tolist(),
        "reading": task.reading.tolist(),
        "explained_sed": operator.sed(answer.pressure).tolist(),
        "samples": len(task.reading),
        "noise": {
            "sd": None if noise is None else noise.sd.tolist(),
            "known": None if noise is None else noise.known,
            "left_of_sed": left(task, answer),
        },
        "range": None if answer.within is None else list(answer.within),
        "moves": max(0, len(answer.path) - 1),
        "converged": answer.converged,
        "problems": list(answer.problems),
        "felt": _felt(operator, answer),
        "axial": task.axial,
        "ms": answer.ms,
    }


def print_decoded(finger: FingertipConfig, decoder: DecoderName, task: Task, answer: Answer) -> None:
    """For people; a search that was cut off, and readings that are not explained, say so."""
    operator, found = task.operator, answer.pressure
    moves = f", {len(answer.path) - 1} moves" if len(answer.path) else ""
    out.print(
        f"{decoder}, {operator.name}, SED {operator.energy}: {len(found)} pressures from M = {len(task.reading)} "
        f"readings in {answer.ms:.0f} ms, {'converged' if answer.converged else 'not converged'}{moves}"
    )
    if task.axial is not None:
        out.print(f"  of the receptor plane of the whole finger, under {task.axial} along it")
    if task.noise is not None and answer.profile is not None:
        out.print(f"  noise sd {np.median(task.noise.sd):.3g} of a reading, {task.noise.known}")
    out.print(f"  left of SED, root mean square {left(task, answer):.3g}, {_share(task, answer):.2%} of the highest")
    if task.true is not None:
        errors = decoding_errors(task.true, found)
        out.print(
            f"  Eq. 6.8 {errors.eq_6_8:.3g} (squared), relative L2 {errors.relative_l2:.1%}, "
            f"RMSE over the peak {errors.rmse_over_peak:.1%}"
        )
    else:
        out.print(f"  one pseudo-unit is {pa_per_pseudo(finger):.4g} Pa")
    for problem in answer.problems:
        out.print(f"  beware: {problem}")
    if isinstance(operator, SheetOperator):
        felt = felt_solid(operator.skin, found)
        out.print(
            f"  felt as a {felt.name}, {felt.size_mm:.2g} mm; in contact over {felt.extent_mm[0]:.2f} mm along x, "
            f"{felt.extent_mm[1]:.2f} mm along z"
        )
        out.print(_map(operator, answer))
    else:
        out.print(_table(task, answer))


def _share(task: Task, answer: Answer) -> float:
    return left(task, answer) / float(task.sed.max())


def _felt(operator: Operator, answer: Answer) -> dict[str, Any] | None:
    """Class and size of what touches a sheet."""
    if not isinstance(operator, SheetOperator):
        return None
    felt = felt_solid(operator.skin, answer.pressure)
    return {"class": felt.name, "size_mm": felt.size_mm, "extent_mm": list(felt.extent_mm)}


def _map(operator: SheetOperator, answer: Answer) -> Table:
    """Pressures, x downwards and z to the right; pseudo-units."""
    grid = operator.skin.grid
    table = Table("x \\ z (mm)", *(f"{z:.1f}" for z in grid.z_mm), box=None, padding=(0, 1))
    for x, row in zip(grid.x_mm, answer.pressure.reshape(grid.shape), strict=True):
        table.add_row(f"{x:.1f}", *(f"{v:.0f}" for v in row))
    return table


def _table(task: Task, answer: Answer) -> Table:
    digits = max(0, 2 - int(np.floor(np.log10(max(float(answer.pressure.max()), 1e-6)))))
    columns = {"place (mm)": [f"{v:.2f}" for v in task.operator.place_mm]}
    if task.true is not None:
        columns["true"] = [f"{v:.{digits}f}" for v in task.true]
    columns["found (pseudo)"] = [f"{v:.{digits}f}" for v in answer.pressure]
    if answer.profile is not None:
        band = zip(*answer.profile.band(), strict=True)
        columns["90 % band"] = [f"{low:.{digits}f} … {high:.{digits}f}" for low, high in band]
    table = Table(*columns, box=None, padding=(0, 2))
    rows = list(zip(*columns.values(), strict=True))
    for k in np.unique(np.linspace(0, len(rows) - 1, _ROWS).round().astype(int)).tolist():
        table.add_row(*rows[k])
    return table


def draw(task: Task, answer: Answer, picture: Path) -> None:
    """The way over the error surface where two pressures were searched for, else the pressures with their band."""
    if isinstance(task.operator, SheetOperator):
        _draw_sheet(task.operator, answer, picture)
    elif len(answer.pressure) == 2 and len(answer.path) > 1:
        _draw_search(task, answer, picture)
    else:
        _draw_pressures(task, answer, picture)


def _draw_sheet(operator: SheetOperator, answer: Answer, picture: Path) -> None:
    from rig.report.coding.sheet_figure import Drawn, sheet_figure  # matplotlib: only where it is wanted

    grid = operator.skin.grid
    assert answer.profile is not None
    found, sd = (values.reshape(grid.shape) for values in (answer.pressure, answer.profile.sd))
    write_picture(sheet_figure(Drawn(grid.x_mm, grid.z_mm, found, sd, operator.receptor_mm)), picture)


def _draw_search(task: Task, answer: Answer, picture: Path) -> None:
    from rig.report.coding.search_figures import (
        Surface,
        extents,
        search_figure,
    )  # matplotlib: only where it is wanted

    def surface(low: Array, high: Array) -> Surface:
        first, second = np.linspace(low, high, _FINE).T
        return Surface(first, second, error_surface(task.operator, task.sed, first, second))

    assert answer.within is not None
    whole = {"the error surface": (np.full(2, answer.within.low), np.full(2, answer.within.high))}
    surfaces = {title: surface(*ends) for title, ends in (whole | extents(answer.path)).items()}
    write_picture(search_figure(surfaces, {"univariate": answer.path}, task.true), picture)


def _draw_pressures(task: Task, answer: Answer, picture: Path) -> None:
    from rig.report.coding.decoded_figure import Drawn, decoded_figure  # matplotlib: only where it is wanted

    band = None if answer.profile is None else answer.profile.band()
    operator = task.operator
    drawn = Drawn(
        operator.place_mm,
        answer.pressure,
        band,
        task.true,
        operator.receptor_mm,
        task.sed,
        operator.sed(answer.pressure),
    )
    write_picture(decoded_figure(drawn), picture)
