"""The journal as tables: data.h5 and one tidy CSV a stream, each put in place by one rename."""

import csv
import io
from typing import Any

import h5py
import numpy as np

from rig.data.folder import replace_bytes, replace_text
from rig.data.reader import Run


def export_run(run: Run, *, again: bool = True) -> None:
    """Write data.h5 (units as attributes) and STREAM.csv beside the journal; not again: only those that are missing.

    Events of indentations that were interrupted and begun again go into tables of their own, STREAM_superseded.
    """
    tables = {name: _columns(run.units[name], found) for name, found in run.events.items() if found}
    tables |= {f"{name}_superseded": _columns(run.units[name], found) for name, found in run.superseded.items()}
    if again or not run.folder.data.exists():
        _write_hdf5(run, tables)
    for name, columns in tables.items():
        path = run.folder.path / f"{name}.csv"
        if again or not path.exists():
            replace_text(path, _as_csv(columns))


def _columns(units: dict[str, str], events: list[dict[str, Any]]) -> dict[str, list[Any]]:
    """t_s and every described key, None where an event lacks it."""
    return {key: [event.get(key) for event in events] for key in ("t_s", *units)}


def _write_hdf5(run: Run, tables: dict[str, dict[str, list[Any]]]) -> None:
    image = io.BytesIO()  # a full disk met by HDF5 itself leaves a file that nobody can close
    with h5py.File(image, "w") as file:
        for key in ("protocol", "title", "planned_indentations"):
            file.attrs[key] = run.start[key]
        file.attrs["complete"] = run.complete
        file.attrs["subject"] = run.start.get("subject") or ""
        for stream, columns in tables.items():
            group = file.create_group(stream)
            for key, values in columns.items():
                dataset = group.create_dataset(key, data=_as_array(values))
                dataset.attrs["unit"] = "s" if key == "t_s" else run.units[stream.removesuffix("_superseded")][key]
    replace_bytes(run.folder.data, image.getvalue())


def _as_array(values: list[Any]) -> Any:
    """Numbers as float64 (NaN where absent), booleans as they are, text as UTF-8."""
    present = [value for value in values if value is not None]
    if present and all(isinstance(value, bool) for value in present) and len(present) == len(values):
        return np.array(values)
    if all(isinstance(value, int | float) for value in present):
        return np.array([np.nan if value is None else float(value) for value in values])
    return np.array(["" if value is None else str(value) for value in values], dtype=h5py.string_dtype())


def _as_csv(columns: dict[str, list[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return text.getvalue()
