"""Shift invariance on the whole finger: Table 6.1, Fig. 6-4, the error map, and what convolution makes of presses."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.report.coding_figures import DrawnPointSpread, point_spread_figure
from rig.report.page import PageFigure, Section
from rig.report.style import Plot
from sim.coding.all_sites import DRAWN, AllSites, Deformed, Where, all_sites, deformed_by
from sim.coding.point_loads import LoadedFinger
from sim.coding.point_spread import MovedResponse, mean_over, receptor_sheet
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip
from studies.source import shift_by_shape

Array = NDArray[np.float64]
Row = tuple[str, ...]

_FORCE_GWT = 1.0
_HEADER = (
    "site",
    "A",
    "m",
    "r",
    "R²",
    "m by logarithms",
    "round to",
    "moved",
    "A printed",
    "m printed",
    "R² printed",
)
_NAMES: dict[Where, str] = {"pulp": "mean, 18 of the pulp", "all": "mean, all 24"}


class Spreads(NamedTuple):
    """What a process sends back."""

    sites: AllSites
    deformed: Deformed
    by_shape: list[Row]
    nodes: int


def spreads_of_the_finger() -> Spreads:
    """A minute of one core."""
    finger = LoadedFinger(FingertipConfig())
    response = MovedResponse.of(finger, receptor_sheet(finger))
    sites = all_sites(response, _FORCE_GWT)
    deformed = deformed_by(finger, sites.sites[DRAWN], _FORCE_GWT)
    shapes = list(shift_by_shape.rows(response, Fingertip.load()))
    return Spreads(sites, deformed, shapes, len(finger.interior.mesh.nodes))


def spread_sections(found: Spreads) -> list[Section]:
    """Three."""
    sites = found.sites
    drawn = PageFigure(
        "The finger under a point load, and SED about it",
        point_spread_figure(DrawnPointSpread(found.deformed, sites.sites[DRAWN])),
        "Site 10, after Fig. 6-4: the mesh in the load's plane, deformed; SED 0.76 mm below the skin, seen from "
        "outside; "
        "SED against the distance in space, with both fits.",
    )
    table = Section(
        "Shift invariance: SED = A / r^m under 24 equal point loads",
        f"After §6.3 and Table 6.1. A is multiplied by {sites.common_factor:.3f}, which makes its mean over the "
        "pulp the "
        "printed one, since the source's load is not printed. Round to: the highest less the lowest of eight "
        "sectors of "
        "azimuth. Moved: relative L2 of SED, the response of the pad's middle moved to the site. ± is a standard "
        "deviation "
        "over sites, over the mean. What the source leaves open is in docs/validation/coding.md.",
        _HEADER,
        (*_site_rows(sites), *_mean_rows(sites)),
        (drawn,),
    )
    error_map = Section(
        "Shift invariance: the error map of the finger",
        "How much of SED within ± 1.5 mm of a load is missed by moving the response of the pad's middle along the "
        "skin.",
        figures=(
            PageFigure(
                "Relative L2 of SED at each site",
                _map(sites),
                "Dots are the source's sites; the pad's middle is at the cross.",
            ),
        ),
    )
    shapes = Section(
        "Convolution under presses of the finger",
        "One response moved to every force of a press, against finite elements of all its forces, at the receptors "
        "of the "
        "receptor plane. Lateral: size of all forces along the skin over that of all normal ones; normal alone: "
        "against "
        "finite elements of the normal forces.",
        shift_by_shape.HEADER,
        tuple(found.by_shape),
    )
    return [table, error_map, shapes]


def _site_rows(sites: AllSites) -> list[Row]:
    factor = sites.common_factor
    return [
        (
            f"{printed.number}{'' if site.spread.site.on_pulp else ', tip'}",
            f"{factor * site.linear.a:.2f}",
            f"{site.linear.m:.2f}",
            f"{site.linear.r:.3f}",
            f"{site.linear.r2:.3f}",
            f"{site.logarithmic.m:.2f}",
            f"{site.asymmetry:.0%}",
            f"{missed:.0%}",
            f"{printed.a:.2f}",
            f"{printed.m:.2f}",
            f"{printed.r2:.3f}",
        )
        for site, missed, printed in zip(sites.sites, sites.missed, sites.printed, strict=True)
    ]


def _mean_rows(sites: AllSites) -> list[Row]:
    rows: list[Row] = []
    for where, name in _NAMES.items():
        linear, logs, printed = (
            mean_over(laws) for laws in (sites.laws(where), sites.laws(where, "logarithmic"), sites.published(where))
        )
        rows.append(
            (
                name,
                f"{sites.common_factor * linear.a:.2f} ± {linear.a_spread:.1%}",
                f"{linear.m:.2f} ± {linear.m_spread:.1%}",
                "", "",
                f"{logs.m:.2f} ± {logs.m_spread:.1%}",
                "", "",
                f"{printed.a:.2f} ± {printed.a_spread:.1%}",
                f"{printed.m:.2f} ± {printed.m_spread:.1%}",
                "",
            )
        )  # fmt: skip
    return rows


def _map(sites: AllSites) -> Plot:
    x, z = (np.array([getattr(site.spread.site, axis) for site in sites.sites]) for axis in ("x_mm", "z_mm"))
    missed = 100 * np.array(sites.missed)

    def draw(figure: Canvas) -> None:
        axes = figure.subplots()
        shown = axes.tricontourf(x, z, missed, levels=12, cmap="viridis_r")
        axes.plot(x, z, ".", color="black", ms=4)
        for number, at_x, at_z, value in zip(range(1, 25), x, z, missed, strict=True):
            axes.annotate(
                f"{number}: {value:.0f} %", (at_x, at_z), fontsize=6, xytext=(3, 3), textcoords="offset points"
            )
        axes.plot(0.0, FingertipConfig().receptor_plane_mm, "+", color="white", ms=9)
        figure.colorbar(shown, ax=axes, label="relative L2 of SED (%)")
        axes.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal")

    return Plot((5.4, 6.0), draw)
