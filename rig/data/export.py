"""The journal as tables: data.h5 and one tidy CSV a stream, each put in place by one rename."""

import csv
import io
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import h5py
import numpy as np

from rig.data.dictionary import FLAGS, TEXT, about_table, meaning
from rig.data.folder import replace_bytes, replace_text
from rig.data.reader import Run, provenance_of
from rig.data.run_tables import Table, tables


def export_run(run: Run, *, again: bool = True) -> None:
    """Write data.h5 (units as attributes) and STREAM.csv beside the journal; not again: only those that are missing.

    Events of indentations that were interrupted and begun again go into tables of their own, STREAM_superseded.
    """
    found = tables(run)
    if again or not run.folder.data.exists():
        _write_hdf5(run, found)
    for name, table in found.items():
        path = run.folder.path / f"{name}.csv"
        if again or not path.exists():
            replace_text(path, _as_csv(table.columns))


def _write_hdf5(run: Run, found: Mapping[str, Table]) -> None:
    image = io.BytesIO()  # a full disk met by HDF5 itself leaves a file that nobody can close
    with h5py.File(image, "w") as file:
        file.attrs.update(_attributes(run))
        for stream, table in found.items():
            group = file.create_group(stream)
            group.attrs["description"] = about_table(stream)
            for name, values in table.columns.items():
                dataset = group.create_dataset(name, data=_as_array(name, values))
                dataset.attrs["unit"] = table.units[name]
                dataset.attrs["description"] = meaning(stream, name)
    replace_bytes(run.folder.data, image.getvalue())


def _attributes(run: Run) -> dict[str, Any]:
    """Of the whole file, as rig/data/dictionary.py tells them."""
    start = run.start
    return {
        "run": run.folder.path.resolve().name,
        "uid": start.get("uid", ""),
        "date_utc": datetime.fromtimestamp(start["unix_s"], UTC).isoformat(timespec="seconds"),
        "version": provenance_of(run).get("versions", {}).get("indentation-rig", ""),
        "protocol": start["protocol"],
        "title": start["title"],
        "subject": start.get("subject") or "",
        "virtual": bool(start["virtual"]),
        "planned_indentations": start["planned_indentations"],
        "complete": run.complete,
    }


def _as_array(name: str, values: list[Any]) -> Any:
    """Numbers as float64 (NaN where absent), flags as they are, text as UTF-8."""
    if name in FLAGS:
        return np.array([value is True for value in values])
    if name not in TEXT and all(value is None or isinstance(value, int | float) for value in values):
        return np.array([np.nan if value is None else float(value) for value in values])
    return np.array(["" if value is None else str(value) for value in values], dtype=h5py.string_dtype())


def _as_csv(columns: dict[str, list[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return text.getvalue()
