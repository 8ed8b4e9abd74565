"""Where the receptor is, as a table of the report."""

from rig.compare.place.whereabouts import PlaceRow, Whereabouts, in_mm, within
from rig.report.html import Section
from rig.report.labels import as_number

HEADER = ("measure", "x (mm)", "depth (mm)", "offset (mm)", "k", "ε₀", "deviance over the noise", "its own fit",
          "held by a bound")  # fmt: skip


def place_section(found: Whereabouts) -> Section:
    """Every measure at its likeliest place, the likeliest first."""
    x, depth = (f"{in_mm(low)} to {in_mm(high)} mm" for low, high in found.where[:2])
    return Section(
        f"Where the receptor is: {', '.join(found.stimuli)}",
        f"Each measure at its likeliest place, with 95 % limits by profile likelihood: x sought from {x}, depth from "
        f"{depth}; {found.frame}. Over {found.positions} of {found.recorded} recorded positions, the same for every "
        "place. An interval that is held by a bound goes on beyond it. Intervals hold given this finger model.",
        HEADER,
        tuple(_cells(row, found) for row in found.rows),
    )


def _cells(row: PlaceRow, found: Whereabouts) -> tuple[str, ...]:
    offset = within(row.offset_mm, row.offset_interval) if found.with_offset else "not fitted"
    fit = "not rejected" if row.fits else "rejected"
    return (
        row.measure,
        within(row.x_mm, row.x_interval),
        within(row.depth_mm, row.depth_interval),
        offset,
        as_number(row.k),
        as_number(row.eps0),
        f"{row.deviance:.1f}",
        f"{fit} (p = {row.p_fit:.2g})",
        ", ".join(row.at_bounds) or "–",
    )
