"""Streams of a journal: their keys and units. Positions are in the finger's frame."""

from collections.abc import Iterable, Mapping

READING = "sample"
"""Ending of the names of the streams of readings."""

PRESS_STREAMS = {
    "indentation_start": {
        "index": "", "indentor": "", "x_mm": "mm", "verb": "", "target": "", "value": "", "increments": "",
        "speed_mm_s": "mm/s", "hold_s": "s", "predicted_doi_mm": "mm", "predicted_force_gwt": "gwt",
        "block": "", "repeat": "", "condition": "",
    },
    "sample": {
        "index": "", "phase": "", "x_mm": "mm", "height_mm": "mm", "doi_mm": "mm", "force_gwt": "gwt", "stable": "",
        "contact_s": "s",
    },
    "touch": {
        "index": "", "threshold_gwt": "gwt", "height_at_threshold_mm": "mm", "contact_height_mm": "mm",
        "fit_points": "", "doi_bias_mm": "mm", "doi_mm": "mm", "true_doi_bias_mm": "mm",
    },
    "ramp": {
        "index": "", "speed_mm_s": "mm/s", "measured_gwt": "gwt", "trip_gwt": "gwt", "bound_gwt": "gwt",
        "stop_mm": "mm",
    },
    "hold_start": {"index": "", "hold": "", "target": "", "commanded": "", "doi_mm": "mm", "force_gwt": "gwt"},
    "hold_end": {
        "index": "", "hold": "", "x_mm": "mm", "doi_mm": "mm", "doi_sd_mm": "mm",
        "force_gwt": "gwt", "force_sd_gwt": "gwt", "commanded": "", "peak_gwt": "gwt",
        "ramp_gwt": "gwt", "ramp_s": "s",
        "readings": "", "asked_s": "s", "hold_s": "s", "interval_sd_s": "s", "true_x_mm": "mm", "true_doi_mm": "mm",
    },
    "sync": {"index": "", "at": "", "rise_s": "s", "uncertainty_s": "s", "width_s": "s"},
    "indentation_end": {"index": "", "duration_s": "s"},
}  # fmt: skip
"""Streams of one press. Keys starting with `true_` come from the virtual plant and are absent on hardware."""

_NOT_DATA = {name: keys for name, keys in PRESS_STREAMS.items() if name != "ramp"}

STREAMS = {
    "mount": {"indentor": ""},
    "home": {"controller": "", "contact": "", "force_gwt": "gwt"},
    "zero": {"sensor": "", "noise_gwt": "gwt", "offset_gwt": "gwt", "drift_gwt": "gwt"},
    "move": {"x_mm": "mm", "along_mm": "mm", "height_mm": "mm"},
    **PRESS_STREAMS,
    **{f"precondition_{name}": keys for name, keys in _NOT_DATA.items()},
    **{f"reference_{name}": keys for name, keys in _NOT_DATA.items()},
    **{f"find_{name}": PRESS_STREAMS[name] for name in ("sample", "touch")},
    "find": {"index": "", "indentor": "", "x_mm": "mm", "along_mm": "mm", "contact_height_mm": "mm"},
    "retract": {"height_mm": "mm", "contact_s": "s", "contact": "", "force_gwt": "gwt"},
    "reference": {"index": "", "deviation": ""},
    "rest": {"rest_s": "s"},
    "choice": {
        "index": "", "indentor": "", "x_mm": "mm", "target": "", "value": "", "reason": "", "count": "",
        "probabilities": "", "information_bits": "", "possible": "", "chosen_in_s": "s",
    },
    "checkpoint": {"name": ""},
    "note": {"text": ""},
    "alarm": {"reason": ""},
    "trip": {"reason": "", "force_gwt": "gwt", "contact_s": "s"},
    "paused": {"reason": ""},
    "resumed": {"by": ""},
}  # fmt: skip
"""All streams. Presses that are not data (`precondition_…`, `reference_…`) have separate streams."""

OF_A_SENSOR = {
    "fx_n": "N", "fy_n": "N", "fz_n": "N", "tx_nm": "N·m", "ty_nm": "N·m", "tz_nm": "N·m",
    "packets_lost": "", "packets_repeated": "", "packets_late": "",
}  # fmt: skip
"""Keys that a force sensor may add to samples (`ForceReading.also`); its entry in the registry names them."""


def streams_with(also: Iterable[str]) -> Mapping[str, Mapping[str, str]]:
    """Return all streams, with these keys of `OF_A_SENSOR` in samples."""
    more = {key: OF_A_SENSOR[key] for key in also}
    return {name: {**keys, **more} if name.endswith(READING) else keys for name, keys in STREAMS.items()}


INSTANTS = ("rise_s",)
"""Keys whose values are times of the run, like `t_s`; any other time is a duration."""

WAITED_FOR = ("mount", "resumed")
"""Events that end a wait for a person, which does not count as run time."""
