"""What every table, column and attribute of a run's files is: written into data.h5, and the page docs/columns.md."""

from collections.abc import Iterator
from dataclasses import dataclass

from rig.data.schema import PRESS_STREAMS, STREAMS
from rig.data.tables import HOLD_COLUMNS, OF_THE_PRESS, RUN_COLUMNS, SUPERSEDED

TABLES = {
    "indentation_start": "an indentation begins",
    "sample": "a reading of the force, and where the indentor was",
    "touch": "contact was found: F ∝ d^1.5 through the readings of the touch-off",
    "hold_start": "the target, or an equal part of it, is reached; from now on the indentor rests",
    "hold_end": "a hold is over: what was delivered",
    "sync": "a pulse for the recording amplifier",
    "indentation_end": "the indentor is back at clearance",
    "mount": "an indentor was mounted",
    "home": "the home switches were found",
    "zero": "the force sensor was zeroed in the air",
    "move": "a place was gone to, at clearance",
    "find": "contact was found by touch() alone",
    "retract": "the indentor was lifted to clearance",
    "reference": "a reference press was compared with the first one",
    "rest": "the finger was let be",
    "checkpoint": "a checkpoint of the script was passed",
    "note": "the script noted something",
    "alarm": "something is not as it should be; the run goes on",
    "trip": "the rig tripped",
    "paused": "the operator paused",
    "resumed": "the operator went on",
}
"""By the name of the stream."""

FAMILIES = {
    "precondition_": "of preconditioning presses, which are no data",
    "reference_": "of reference presses, which are no data",
    "find_": "of touch()",
}
"""By what their names begin with; a name that ends in `_superseded` is of indentations that were begun again."""

MEANINGS = {
    "t_s": "when it was journalled, on the run's clock",
    "index": "number of the press among those of its kind, from 0, in the order of the script; −1 outside of one",
    "indentor": "shape, as the program names it",
    "x_mm": "lateral place of the indentor's reference point, from the pad's centre",
    "along_mm": "place along the finger, from the pad's centre",
    "height_mm": "height of the indentor's lowest point above the nominal apex of the finger",
    "target": "what was commanded, and its unit: doi_mm (depth past contact) or force_gwt",
    "value": "how much of it, in the unit of target",
    "commanded": "the hold's own part of it, in the unit of target",
    "increments": "holds at equal parts of the target",
    "target_doi_mm": "depth past contact that was commanded; empty where a force was; of a hold its own part",
    "target_force_gwt": "force that was commanded; empty where a depth was; of a hold its own part",
    "block": "of the schedule, from 1; empty outside of one",
    "repeat": "of the condition in its block, from 1; empty outside of one",
    "condition": "item of the schedule, as text",
    "phase": "what was being done: clearance, moving, approach, back off, touch, press, hold or compliance",
    "doi_mm": "depth past the fitted contact, corrected for the rig's compliance; empty before contact is found",
    "doi_sd_mm": "standard deviation of doi_mm: of a step of the stage, and of the compliance",
    "force_gwt": "force on the finger, pressing being positive",
    "hold_end.force_gwt": "mean force over the readings of the hold",
    "force_sd_gwt": "standard deviation of the readings of the hold",
    "peak_gwt": "highest force since the hold before, or since contact",
    "ramp_gwt": "change of force on the way to the hold",
    "ramp_s": "how long that took",
    "readings": "how many readings the hold has",
    "asked_s": "how long the hold was to last",
    "hold_s": "how long it lasted",
    "interval_sd_s": "standard deviation of the time between its readings",
    "stable": "whether the sensor called the reading stable",
    "contact": "what is known about contact then: lifted (measured), raised (by position alone), or a disagreement",
    "contact_s": "how long the finger has been touched so far in this run",
    "threshold_gwt": "force that counted as contact",
    "height_at_threshold_mm": "height at which that was first read",
    "contact_height_mm": "height of first contact by the fit, above the nominal apex",
    "fit_points": "readings that the fit goes through",
    "doi_bias_mm": "depth already reached when the threshold was crossed, by the fit",
    "hold": "number of the hold within its indentation, from 1",
    "at": "what the pulse marks: touch, hold_start or hold_end",
    "rise_s": "when the device had confirmed the rise, on the run's clock",
    "uncertainty_s": "how long before that it may have been",
    "width_s": "how long the output was on",
    "duration_s": "from its start to clearance again",
    "true_x_mm": "virtual bench only: where the indentor truly was",
    "true_doi_mm": "virtual bench only: the true depth past contact",
    "true_doi_bias_mm": "virtual bench only: true depth at the touch less doi_mm",
    "controller": "what the stage's controller says of itself",
    "sensor": "what the force sensor says of itself",
    "noise_gwt": "standard deviation of readings in the air",
    "offset_gwt": "reading in the air that forces are counted from",
    "drift_gwt": "mean force in the air just before, by the zero of then; empty at the first",
    "deviation": "largest deviation from the first reference, as a share of its force",
    "rest_s": "for how long",
    "name": "of the checkpoint",
    "text": "what was noted",
    "reason": "why, in words",
    "by": "who went on",
}
"""By the name of the column, or by that of its table and its own where that says more."""

OF_A_HOLD = {
    "index": MEANINGS["index"],
    "hold": MEANINGS["hold"],
    "x_mm": MEANINGS["x_mm"],
    **{name: MEANINGS[name] for name in OF_THE_PRESS},
}
MODEL_TABLES = {
    "model_contact": {
        "doi_mm": "depth past contact that the model was pressed to",
        "force_gwt": "force that the model says",
        "peak_pressure_pseudo": "highest nodal pressure, in pseudo-units",
        "region": "number of the contact region in the receptor plane, from 1",
        "from_x_mm": "its left end, on the undeformed skin",
        "to_x_mm": "its right end",
    },
    "model_pressure": {
        "undeformed_x_mm": "lateral place of a node of the skin in the receptor plane, undeformed",
        "skin_x_mm": "where that node is under the indentor",
        "skin_y_mm": "and how high",
        "pressure_pseudo": "nodal pressure, unfiltered, in pseudo-units",
    },
    "model_measures": {
        "receptor_x_mm": "lateral place of the receptor",
        "e11 … third": "the 18 measures there, tension positive: strains as numbers, stresses in pseudo-units",
    },
}
"""What the finger model says of each hold, in CSV files beside the report: their own columns after `OF_A_HOLD`."""

TEXT = frozenset({
    *("indentor", "target", "condition", "phase", "at", "controller", "sensor", "contact"),
    *("name", "text", "reason", "by"),
})  # fmt: skip
FLAGS = frozenset({"stable"})

ATTRIBUTES = {
    "run": "name of the run's folder",
    "uid": "of the run's first document, unlike that of any other run",
    "date_utc": "when the run began, ISO 8601",
    "version": "of the program that made the run",
    "protocol": "name of the script",
    "title": "what the script says it is",
    "subject": "code of whoever lay under the rig; empty where none was given",
    "virtual": "whether it ran on the virtual bench",
    "planned_indentations": "how many indentations were planned",
    "complete": "whether all of them were done and the run ended by itself",
}
"""Of data.h5. Every table has a `description` there, every dataset a `unit` and a `description`."""

_OF_A_RUN = {
    "run": ATTRIBUTES["run"],
    "date_utc": ATTRIBUTES["date_utc"],
    "protocol": ATTRIBUTES["protocol"],
    "subject": ATTRIBUTES["subject"],
    "virtual": ATTRIBUTES["virtual"],
    "state": "how the run ended: done, incomplete, aborted, tripped, limited, failed, killed or running",
}


@dataclass(frozen=True)
class Column:
    """One column of a CSV, dataset of data.h5."""

    table: str
    name: str
    unit: str
    dtype: str
    what: str


def about_table(stream: str) -> str:
    """What the rows of a table are."""
    family, name = _plain(stream)
    words = TABLES.get(name, "")
    return f"{words} ({FAMILIES[family]})" if family else words


def meaning(stream: str, column: str) -> str:
    """What a column of a table is; empty where nobody has said."""
    return MEANINGS.get(f"{_plain(stream)[1]}.{column}", MEANINGS.get(column, ""))


def _plain(stream: str) -> tuple[str, str]:
    """The family of a table, and its namesake outside of it."""
    name = stream.removesuffix(SUPERSEDED)
    family = next((begin for begin in FAMILIES if name.startswith(begin)), "")
    return family, name.removeprefix(family)


def dtype(column: str) -> str:
    """In data.h5: numbers are NaN where a row has none, text is empty there."""
    return "text (UTF-8)" if column in TEXT else "bool" if column in FLAGS else "float64"


def columns() -> Iterator[Column]:
    """Every column of every table but those of families, which have those of their namesakes."""
    for stream in TABLES:
        units = {"t_s": "s", **STREAMS[stream]}
        own = {name: unit for name, unit in units.items() if stream not in PRESS_STREAMS or name not in OF_THE_PRESS}
        joined = OF_THE_PRESS if stream in PRESS_STREAMS else {}
        for name, unit in {**own, **joined}.items():
            yield Column(stream, name, unit, dtype(name), meaning(stream, name))


def as_markdown() -> str:
    """Return the reference of `rig show --columns`, which the documentation has as a page."""
    return "".join([_tables(), _attributes(), _many_runs(), _model()])


def _model() -> str:
    parts = [
        "\n## What the finger model says\n\nWritten with the report, one row for what each file lists under a hold.\n"
    ]
    of_a_hold = ", ".join(f"`{name}`" for name in OF_A_HOLD)
    parts.append(f"Each row begins with {of_a_hold}, as above.\n\n| file | column | what it is |\n|---|---|---|\n")
    for name, own in MODEL_TABLES.items():
        parts += [f"| `{name}.csv` | `{column}` | {words} |\n" for column, words in own.items()]
    return "".join(parts)


def _tables() -> str:
    parts = ["## Every column\n"]
    for stream, words in TABLES.items():
        parts.append(f"\n### `{stream}`\n\nA row: {words}.\n\n{_HEAD}")
        parts += [_row(one.name, one.unit, one.dtype, one.what) for one in columns() if one.table == stream]
    parts.append("\n### The same columns\n\n| table | rows |\n|---|---|\n")
    parts += [f"| `{begin}…` | {words} |\n" for begin, words in FAMILIES.items()]
    return "".join([*parts, f"| `…{SUPERSEDED}` | of indentations that were interrupted and begun again |\n"])


def _attributes() -> str:
    rows = [f"| `{name}` | {words} |\n" for name, words in ATTRIBUTES.items()]
    return "".join(["\n## Attributes of `data.h5`\n\n| attribute | what it is |\n|---|---|\n", *rows])


def _many_runs() -> str:
    units = {name: unit for keys in (*STREAMS.values(), OF_THE_PRESS, {"t_s": "s"}) for name, unit in keys.items()}
    of_runs = [
        _row(name, "", "bool" if name == "virtual" else "text (UTF-8)", _OF_A_RUN[name]) for name in RUN_COLUMNS
    ]
    of_holds = [_row(name, units[name], dtype(name), meaning("hold_end", name)) for name in HOLD_COLUMNS]
    return "".join([f"\n## Columns of `rig runs --table`\n\nA row: a hold is over.\n\n{_HEAD}", *of_runs, *of_holds])


_HEAD = "| column | unit | dtype in `data.h5` | what it is |\n|---|---|---|---|\n"


def _row(name: str, unit: str, kind: str, words: str) -> str:
    return f"| `{name}` | {unit} | {kind} | {words} |\n"
