"""Descriptions of every table, column and attribute of a run's files, for data.h5 and docs/columns.md."""

from collections.abc import Iterator, Mapping

from rig.data.events import (
    EVENTS,
    OF_THE_PRESS,
    PRESS_EVENTS,
    TIME,
    Column,
    HoldEndEvent,
    OfThePress,
    OfTheSensor,
    columns_of,
    description_of,
    stream_of,
)
from rig.data.presses import PressRecord
from rig.data.run_status import RunStatus
from rig.data.tables import HOLD_COLUMNS, PRESSES, RUN_COLUMNS, SUPERSEDED

FAMILIES = {
    "precondition_": "of preconditioning presses, which are not data",
    "reference_": "of reference presses, which are not data",
    "find_": "of touch()",
}
"""Descriptions by prefix; tables that end in `_superseded` hold indentations that were repeated."""

_TABLES: Mapping[str, type] = {PRESSES: PressRecord, **{stream_of(event): event for event in EVENTS}}
_ALSO = {column.name: column for column in (TIME, *columns_of(OfThePress), *columns_of(OfTheSensor))}

_OF_HOLD_END = {column.name: column.what for column in columns_of(HoldEndEvent)}
OF_A_HOLD = {
    **{name: _OF_HOLD_END[name] for name in ("index", "hold", "x_mm")},
    **{column.name: column.what for column in columns_of(OfThePress)},
}
MODEL_TABLES = {
    "model_contact": {
        "doi_mm": "depth past contact in the model",
        "force_gwt": "force predicted by the model",
        "peak_pressure_kpa": "highest nodal pressure",
        "region": "number of the contact region in the receptor plane, from 1",
        "from_x_mm": "left end of the region, on the undeformed skin",
        "to_x_mm": "right end of the region, on the undeformed skin",
    },
    "model_pressure": {
        "undeformed_x_mm": "lateral position of a skin node in the receptor plane, undeformed",
        "skin_x_mm": "lateral position of the node under the indentor",
        "skin_y_mm": "height of the node under the indentor",
        "pressure_kpa": "nodal pressure, unfiltered",
    },
    "model_measures": {
        "receptor_x_mm": "lateral position of the receptor",
        "e11 … third": "18 measures at the receptor, tension positive: strains unitless, stresses in pseudo-units",
    },
}
"""Columns of the model's CSV files beside the report, after those of `OF_A_HOLD`."""

ATTRIBUTES = {
    "run": "name of the run's folder",
    "uid": "unique identifier of the run",
    "date_utc": "start of the run, ISO 8601",
    "version": "version of the program that made the run",
    "protocol": "name of the protocol",
    "title": "title of the protocol",
    "subject": "code of the subject; empty if none was given",
    "virtual": "whether the run used the virtual bench",
    "planned_indentations": "number of planned indentations",
    "complete": "whether all planned indentations were done and the run ended normally",
}
"""Attributes of data.h5. Each table also has a `description`, each dataset a `unit` and a `description`."""

_OF_A_RUN = {
    "run": ATTRIBUTES["run"],
    "date_utc": ATTRIBUTES["date_utc"],
    "protocol": ATTRIBUTES["protocol"],
    "subject": ATTRIBUTES["subject"],
    "virtual": ATTRIBUTES["virtual"],
    "state": f"state of the run: {', '.join(RunStatus)}",
}


def about_table(stream: str) -> str:
    """Return the description of a table, empty for one that this program does not write."""
    family, name = _plain(stream)
    if name not in _TABLES:
        return ""
    words = description_of(_TABLES[name])
    return f"{words} ({FAMILIES[family]})" if family else words


def column_of(stream: str, name: str) -> Column | None:
    """Return the column of a table by its name, None for one that this program does not write."""
    event = _TABLES.get(_plain(stream)[1])
    own = {} if event is None else {column.name: column for column in columns_of(event)}
    return own.get(name, _ALSO.get(name))


def _plain(stream: str) -> tuple[str, str]:
    """Return the family of a table, and its name without it."""
    name = stream.removesuffix(SUPERSEDED)
    family = next((begin for begin in FAMILIES if name.startswith(begin)), "")
    return family, name.removeprefix(family)


def described_tables() -> dict[str, list[Column]]:
    """Return the columns of all tables; families have the columns of the table of the same name."""
    return {stream: list(_columns(stream)) for stream in _TABLES}


def _columns(stream: str) -> Iterator[Column]:
    table = _TABLES[stream]
    of_a_press = table in PRESS_EVENTS
    if table is not PressRecord:
        yield TIME
    yield from (one for one in columns_of(table) if not of_a_press or one.name not in OF_THE_PRESS)
    if of_a_press:
        yield from columns_of(OfThePress)


def as_markdown() -> str:
    """Return the output of `rig show --columns`, which is also a page of the documentation."""
    return "".join([_tables(), _attributes(), _many_runs(), _model()])


def _model() -> str:
    parts = [
        (
            "\n## Predictions of the finger model\n\nThese files are written with the report. Each has one row per "
            "hold and item.\n"
        )
    ]
    of_a_hold = ", ".join(f"`{name}`" for name in OF_A_HOLD)
    parts.append(f"Each row begins with {of_a_hold}, as above.\n\n| file | column | meaning |\n|---|---|---|\n")
    for name, own in MODEL_TABLES.items():
        parts += [f"| `{name}.csv` | `{column}` | {words} |\n" for column, words in own.items()]
    return "".join(parts)


def _tables() -> str:
    parts = ["## Every column\n"]
    for stream, columns in described_tables().items():
        row = "press" if stream == PRESSES else "event"
        parts.append(f"\n### `{stream}`\n\nOne row per {row}: {about_table(stream)}.\n\n{_HEAD}")
        parts += map(_row, columns)
    parts.append(f"\n### Columns of `sample` with a Net F/T sensor\n\n{_HEAD}")
    parts += map(_row, columns_of(OfTheSensor))
    parts.append("\n### The same columns\n\n| table | rows |\n|---|---|\n")
    parts += [f"| `{begin}…` | {words} |\n" for begin, words in FAMILIES.items()]
    return "".join([*parts, f"| `…{SUPERSEDED}` | of indentations that were interrupted and repeated |\n"])


def _attributes() -> str:
    rows = [f"| `{name}` | {words} |\n" for name, words in ATTRIBUTES.items()]
    return "".join(["\n## Attributes of `data.h5`\n\n| attribute | what it is |\n|---|---|\n", *rows])


def _many_runs() -> str:
    of_runs = (Column(name, "", bool if name == "virtual" else str, _OF_A_RUN[name]) for name in RUN_COLUMNS)
    of_holds = (column_of("hold_end", name) or column_of("touch", name) for name in HOLD_COLUMNS)
    rows = [_row(column) for column in (*of_runs, *of_holds) if column is not None]
    return "".join([f"\n## Columns of `rig runs --table`\n\nOne row per hold.\n\n{_HEAD}", *rows])


_HEAD = "| column | unit | dtype in `data.h5` | what it is |\n|---|---|---|---|\n"


def _row(column: Column) -> str:
    return f"| `{column.name}` | {column.unit} | {column.dtype} | {column.what} |\n"
