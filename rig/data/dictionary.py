"""Descriptions of every table, column and attribute of a run's files, for data.h5 and docs/columns.md."""

from collections.abc import Iterator
from dataclasses import dataclass

from rig.data.schema import OF_A_SENSOR, PRESS_STREAMS, STREAMS
from rig.data.tables import HOLD_COLUMNS, OF_THE_PRESS, RUN_COLUMNS, SUPERSEDED

TABLES = {
    "indentation_start": "an indentation begins",
    "sample": "a reading of the force, with the position of the indentor",
    "touch": "contact was found: F ∝ d^1.5 through the readings of the touch-off",
    "ramp": "a ramp begins, with its force limits",
    "hold_start": "the target, or an equal part of it, is reached and the hold begins",
    "hold_end": "a hold ended, with the depth and force that were delivered",
    "sync": "a pulse for the recording amplifier",
    "indentation_end": "the indentor is back at clearance",
    "mount": "an indentor was mounted",
    "home": "the home switches were found",
    "zero": "the force sensor was zeroed in the air",
    "move": "the indentor moved to a position, at clearance",
    "find": "contact was found by touch() alone",
    "retract": "the indentor was lifted to clearance",
    "reference": "a reference press was compared with the first one",
    "rest": "a pause without contact ended",
    "choice": "the next press was chosen from the counts so far, or the presses ended",
    "checkpoint": "the protocol passed a checkpoint",
    "note": "the protocol wrote a note",
    "alarm": "an alarm was raised; the run continued unless limits.on_alarm is trip",
    "trip": "the rig tripped",
    "paused": "the operator paused the run",
    "resumed": "the operator resumed the run",
}
"""Descriptions by stream."""

FAMILIES = {
    "precondition_": "of preconditioning presses, which are not data",
    "reference_": "of reference presses, which are not data",
    "find_": "of touch()",
}
"""Descriptions by prefix; tables that end in `_superseded` hold indentations that were repeated."""

MEANINGS = {
    "t_s": "time of the event since the start of the run",
    "index": "number of the press among those of its kind, from 0, in the order of the protocol; −1 outside a press",
    "indentor": "shape of the indentor, e.g. bar:3.0",
    "x_mm": "lateral position of the indentor's reference point, from the center of the pad",
    "along_mm": "position along the finger, from the receptor plane",
    "height_mm": "height of the indentor's lowest point above the nominal apex of the finger",
    "target": "commanded quantity and its unit: doi_mm (depth past contact) or force_gwt",
    "value": "commanded value, in the unit of target",
    "commanded": "commanded value of this hold, in the unit of target",
    "increments": "number of holds, at equal parts of the target",
    "verb": "verb of the press: indent or ramp",
    "indentation_start.speed_mm_s": "speed that the protocol asked for, of the press or the ramp",
    "predicted_doi_mm": "depth in the last hold that the finger model predicts",
    "predicted_force_gwt": "force in the last hold that the finger model predicts",
    "indentation_start.hold_s": "duration of each hold that the protocol asked for",
    "target_doi_mm": "commanded depth past contact, for a hold its own part; empty if a force was commanded",
    "target_force_gwt": "commanded force, for a hold its own part; empty if a depth was commanded",
    "block": "number of the block in the schedule, from 1; empty outside a schedule",
    "repeat": "repetition of the condition in its block, from 1; empty outside a schedule",
    "condition": "item of the schedule, as text",
    "phase": "activity: clearance, moving, approach, back off, touch, press, ramp, hold or compliance",
    "doi_mm": "depth past the fitted contact, corrected for the rig's compliance; empty before contact is found",
    "doi_sd_mm": "standard deviation of doi_mm, from the step of the stage and the compliance",
    "force_gwt": "force on the finger, positive when pressing",
    "hold_end.force_gwt": "mean force over the readings of the hold",
    "force_sd_gwt": "standard deviation of the readings of the hold",
    "peak_gwt": "highest force since the previous hold, or since contact",
    "ramp_gwt": "change of force during the ramp to the hold",
    "ramp_s": "duration of the ramp to the hold",
    "readings": "number of readings in the hold",
    "asked_s": "commanded duration of the hold",
    "hold_s": "actual duration of the hold",
    "interval_sd_s": "standard deviation of the time between readings of the hold",
    "stable": "whether the sensor reported the reading as stable",
    "contact": "state of contact: lifted (measured), raised (by position only), disagreement, touching or unknown",
    "contact_s": "total contact time in the run so far",
    "threshold_gwt": "force that counts as contact",
    "height_at_threshold_mm": "height at which the force first exceeded the threshold",
    "contact_height_mm": "height of first contact above the nominal apex, from the fit",
    "fit_points": "number of readings in the fit",
    "doi_bias_mm": "depth already reached when the force exceeded the threshold, from the fit",
    "speed_mm_s": "speed of the ramp",
    "measured_gwt": "force at the depth of the ramp, by the last press by increments there",
    "trip_gwt": "force that trips the ramp",
    "bound_gwt": "force that it does not exceed: the trip of a press and the overshoot of an increment",
    "stop_mm": "stopping distance, with the delays of sensor, reading and controller",
    "hold": "number of the hold in its indentation, from 1",
    "at": "event that the pulse marks: touch, hold_start or hold_end",
    "rise_s": "time since the start of the run when the device had confirmed the rise",
    "uncertainty_s": "uncertainty of the rise: it may have been earlier by as much",
    "width_s": "duration of the pulse",
    "duration_s": "duration from the start of the indentation until clearance",
    "true_x_mm": "virtual bench only: true lateral position of the indentor",
    "true_doi_mm": "virtual bench only: true depth past contact",
    "true_doi_bias_mm": "virtual bench only: true depth at the touch minus doi_mm",
    "controller": "identification reported by the stage's controller",
    "sensor": "identification reported by the force sensor",
    "noise_gwt": "standard deviation of readings in the air",
    "offset_gwt": "zero: reading in the air that is subtracted from every reading",
    "drift_gwt": "drift of the previous zero: mean force in the air just before; empty at the first zeroing",
    "deviation": "largest deviation from the first reference press, relative to its force",
    "rest_s": "duration of the pause",
    "choice.index": "number of the indentation that was chosen, from 0",
    "choice.reason": "why this press, or why there is none (docs/adaptive_runs.md)",
    "count": "spikes in the hold of the indentation before; empty if no count arrived",
    "probabilities": "probability of each candidate after that count, as JSON",
    "information_bits": "information (bits) that the press is expected to give about which candidate is true",
    "possible": "number of the press among those that the run may choose from, from 0; empty at the end",
    "chosen_in_s": "time between the arrival of the count and the choice",
    "name": "name of the checkpoint",
    "text": "text of the note",
    "reason": "reason, as text",
    "by": "who resumed the run",
}
"""Descriptions by column, or by table and column where they differ."""

OF_A_SENSOR_MEANINGS = {
    "fx_n": "force along the sensor's x axis, not zeroed",
    "fy_n": "force along the sensor's y axis, not zeroed",
    "fz_n": "force along the sensor's z axis, not zeroed",
    "tx_nm": "torque about the sensor's x axis, not zeroed",
    "ty_nm": "torque about the sensor's y axis, not zeroed",
    "tz_nm": "torque about the sensor's z axis, not zeroed",
    "packets_lost": "packets of the sensor that have not arrived since its stream was started",
    "packets_repeated": "packets of the sensor without a new sample since its stream was started",
    "packets_late": "packets of the sensor that arrived after a newer one since its stream was started",
}
"""Descriptions of the columns that a sensor adds to `sample`."""

OF_A_HOLD = {
    "index": MEANINGS["index"],
    "hold": MEANINGS["hold"],
    "x_mm": MEANINGS["x_mm"],
    **{name: MEANINGS[name] for name in OF_THE_PRESS},
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

TEXT = frozenset({
    *("indentor", "target", "condition", "phase", "at", "controller", "sensor", "contact"),
    *("verb", "name", "text", "reason", "by", "probabilities"),
})  # fmt: skip
FLAGS = frozenset({"stable"})

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
    "state": "state of the run: done, incomplete, aborted, tripped, limited, failed, killed or running",
}


@dataclass(frozen=True)
class Column:
    """Column of a CSV file, and dataset of data.h5."""

    table: str
    name: str
    unit: str
    dtype: str
    what: str


def about_table(stream: str) -> str:
    """Return the description of a table."""
    family, name = _plain(stream)
    words = TABLES.get(name, "")
    return f"{words} ({FAMILIES[family]})" if family else words


def meaning(stream: str, column: str) -> str:
    """Return the description of a column, or an empty text."""
    return MEANINGS.get(f"{_plain(stream)[1]}.{column}", MEANINGS.get(column, OF_A_SENSOR_MEANINGS.get(column, "")))


def _plain(stream: str) -> tuple[str, str]:
    """Return the family of a table, and its name without it."""
    name = stream.removesuffix(SUPERSEDED)
    family = next((begin for begin in FAMILIES if name.startswith(begin)), "")
    return family, name.removeprefix(family)


def dtype(column: str) -> str:
    """Return the type in data.h5, where a missing number is NaN and a missing text empty."""
    return "text (UTF-8)" if column in TEXT else "bool" if column in FLAGS else "float64"


def columns() -> Iterator[Column]:
    """Yield every column of every table; families have the columns of the table of the same name."""
    for stream in TABLES:
        units = {"t_s": "s", **STREAMS[stream]}
        own = {name: unit for name, unit in units.items() if stream not in PRESS_STREAMS or name not in OF_THE_PRESS}
        joined = OF_THE_PRESS if stream in PRESS_STREAMS else {}
        for name, unit in {**own, **joined}.items():
            yield Column(stream, name, unit, dtype(name), meaning(stream, name))


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
    for stream, words in TABLES.items():
        parts.append(f"\n### `{stream}`\n\nOne row per event: {words}.\n\n{_HEAD}")
        parts += [_row(one.name, one.unit, one.dtype, one.what) for one in columns() if one.table == stream]
    parts.append(f"\n### Columns of `sample` with a Net F/T sensor\n\n{_HEAD}")
    parts += [_row(name, unit, dtype(name), meaning("sample", name)) for name, unit in OF_A_SENSOR.items()]
    parts.append("\n### The same columns\n\n| table | rows |\n|---|---|\n")
    parts += [f"| `{begin}…` | {words} |\n" for begin, words in FAMILIES.items()]
    return "".join([*parts, f"| `…{SUPERSEDED}` | of indentations that were interrupted and repeated |\n"])


def _attributes() -> str:
    rows = [f"| `{name}` | {words} |\n" for name, words in ATTRIBUTES.items()]
    return "".join(["\n## Attributes of `data.h5`\n\n| attribute | what it is |\n|---|---|\n", *rows])


def _many_runs() -> str:
    units = {name: unit for keys in (*STREAMS.values(), OF_THE_PRESS, {"t_s": "s"}) for name, unit in keys.items()}
    of_runs = [
        _row(name, "", "bool" if name == "virtual" else "text (UTF-8)", _OF_A_RUN[name]) for name in RUN_COLUMNS
    ]
    of_holds = [_row(name, units[name], dtype(name), meaning("hold_end", name)) for name in HOLD_COLUMNS]
    return "".join([f"\n## Columns of `rig runs --table`\n\nOne row per hold.\n\n{_HEAD}", *of_runs, *of_holds])


_HEAD = "| column | unit | dtype in `data.h5` | what it is |\n|---|---|---|---|\n"


def _row(name: str, unit: str, kind: str, words: str) -> str:
    return f"| `{name}` | {unit} | {kind} | {words} |\n"
