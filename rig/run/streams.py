"""The streams of a journal: their keys and units. Positions are in the finger's frame."""

STREAMS = {
    "mount": {"indentor": ""},
    "home": {"controller": ""},
    "zero": {"sensor": ""},
    "move": {"x_mm": "mm", "height_mm": "mm"},
    "indentation_start": {"index": "", "indentor": "", "x_mm": "mm", "target": "", "value": "", "increments": ""},
    "sample": {
        "index": "", "phase": "", "x_mm": "mm", "height_mm": "mm", "doi_mm": "mm", "force_gwt": "gwt", "stable": "",
    },
    "touch": {
        "index": "", "threshold_gwt": "gwt", "height_at_threshold_mm": "mm", "contact_height_mm": "mm",
        "fit_points": "", "doi_bias_mm": "mm", "true_doi_bias_mm": "mm",
    },
    "hold_start": {"index": "", "hold": "", "target": "", "commanded": "", "doi_mm": "mm", "force_gwt": "gwt"},
    "hold_end": {
        "index": "", "hold": "", "x_mm": "mm", "doi_mm": "mm", "force_gwt": "gwt", "force_sd_gwt": "gwt",
        "readings": "", "hold_s": "s", "true_x_mm": "mm", "true_doi_mm": "mm",
    },
    "sync": {"index": "", "at": "", "rise_s": "s", "uncertainty_s": "s", "width_s": "s"},
    "indentation_end": {"index": "", "duration_s": "s"},
    "retract": {"height_mm": "mm"},
    "note": {"text": ""},
    "trip": {"reason": "", "force_gwt": "gwt"},
    "paused": {"reason": ""},
    "resumed": {"by": ""},
}  # fmt: skip
"""Keys starting with `true_` come from the virtual plant and are absent on hardware."""
