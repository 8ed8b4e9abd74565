"""Recorded positions that a run does not cover: listed, and the range of a run that would."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, Overlay

_DECIMALS = 6


def left_out(overlay: Overlay) -> NDArray[np.bool_]:
    """(p, receptors) recorded positions at which a receptor's SSRP is not known."""
    return np.isnan(overlay.eps[0])


def range_needed(overlay: Overlay) -> tuple[float, float]:
    """Lowest and highest x in mm of a run that covers the recording at every receptor."""
    position, receptor = overlay.recording.position_mm, overlay.stimulus.receptor_mm
    return float(position.min() + receptor.min()), float(position.max() + receptor.max())


def left_out_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """For `--json`: each recording under each stimulus, and what is left out of it at each receptor."""
    return [_row(overlay) for overlay in comparison.overlays]


def _row(overlay: Overlay) -> dict[str, Any]:
    missing = left_out(overlay)
    return {
        "shape": overlay.stimulus.indentor,
        "condition": overlay.stimulus.condition,
        "recording": overlay.recording.name,
        "positions": len(missing),
        "left_out": [
            {"receptor_mm": round(float(x), _DECIMALS), "positions_mm": _rounded(overlay.recording.position_mm[gone])}
            for x, gone in zip(overlay.stimulus.receptor_mm, missing.T, strict=True)
            if gone.any()
        ],
        "range_needed_mm": [round(x, _DECIMALS) for x in range_needed(overlay)],
    }


def left_out_lines(comparison: Comparison) -> list[str]:
    """For people: one line for each recording under a stimulus that does not cover it at every receptor."""
    return [_line(overlay) for overlay in comparison.overlays if left_out(overlay).any()]


def _line(overlay: Overlay) -> str:
    missing = left_out(overlay)
    never, sometimes = missing.all(axis=1), missing.any(axis=1)
    position = overlay.recording.position_mm
    low, high = range_needed(overlay)
    said = [f"{overlay.stimulus.title}: {sometimes.sum()} of {len(position)} positions of {overlay.recording.name}"]
    said.append(f"at some receptors ({_told(position[sometimes & ~never])})" if (sometimes & ~never).any() else "")
    said.append(f"at every one ({_told(position[never])})" if never.any() else "")
    return f"{', '.join(filter(None, said))}; a run from {high:g} to {low:g} mm covers them"


def _told(position: NDArray[np.float64]) -> str:
    return f"{', '.join(f'{x:g}' for x in _rounded(position))} mm"


def _rounded(position: NDArray[np.float64]) -> list[float]:
    return [round(float(x), _DECIMALS) + 0.0 for x in position]
