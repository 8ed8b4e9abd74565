"""`rig shift-invariance`: how SED spreads under equal point loads at the source's 24 sites of the finger."""

from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from rich.table import Table

from rig.cli.options import FingertipOption, JsonOption
from rig.cli.output import busy, out, print_json, told_in_one_line
from rig.cli.pictures import PictureOption, checked_picture, write_picture
from rig.cli.sampling import DepthOption, SpacingOption, bounded
from rig.plan.config import load_config
from sim.coding.point_spread.all_sites import DRAWN, AllSites, Where, all_sites, deformed_by
from sim.coding.point_spread.loaded_finger import LoadedFinger
from sim.coding.point_spread.moved_response import MovedResponse
from sim.coding.point_spread.spreads import HALF_WIDTH_MM, SPACING_MM, Judged, Mean, mean_over, receptor_sheet
from sim.measures.receptors import DEFAULT_DEPTH_MM

_WHERE: dict[Where, str] = {"pulp": "18 pulp sites", "all": "all 24 sites"}


class Sampled(NamedTuple):
    """What the source leaves open, and the size of the loads."""

    spacing_mm: float
    half_width_mm: float
    depth_mm: float
    force_gwt: float


def command(
    force_gwt: Annotated[float, typer.Option(metavar="F", help="Of each load; the source does not say.")] = 1.0,
    half_width_mm: Annotated[
        float, typer.Option(metavar="MM", help="Of a site's neighbourhood, along x and along z.")
    ] = HALF_WIDTH_MM,
    spacing_mm: SpacingOption = SPACING_MM,
    receptor_depth_mm: DepthOption = DEFAULT_DEPTH_MM,
    config: FingertipOption = None,
    picture: PictureOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fit SED = A / r^m under 24 equal point loads, and print A and m beside the source's Table 6.1."""
    with told_in_one_line(as_json=as_json):
        sampled = Sampled(
            bounded("--spacing-mm", spacing_mm, 0.05, 0.5),
            bounded("--half-width-mm", half_width_mm, 0.5, 4.0),
            bounded("--receptor-depth-mm", receptor_depth_mm, 0.1, 3.0),
            bounded("--force-gwt", force_gwt, 1e-3, 100.0),
        )
        checked_picture(picture)
        settings = load_config(config).finger
        with busy("24 point loads on the whole finger: about twenty seconds …", as_json=as_json):
            finger = LoadedFinger(settings)
            sheet = receptor_sheet(finger, sampled.spacing_mm, sampled.depth_mm)
            found = all_sites(MovedResponse.of(finger, sheet), sampled.force_gwt, sampled.half_width_mm)
            if picture is not None:
                _draw(finger, found.sites[DRAWN], sampled.force_gwt, picture)
        if as_json:
            print_json(_as_json(found, sampled))
        else:
            _print(found, sampled)


def _draw(finger: LoadedFinger, site: Judged, force_gwt: float, picture: Path) -> None:
    from rig.report.coding.point_spread_figure import Drawn, point_spread_figure  # matplotlib, if wanted

    write_picture(point_spread_figure(Drawn(deformed_by(finger, site, force_gwt), site)), picture)


def _as_json(found: AllSites, sampled: Sampled) -> dict[str, Any]:
    return {
        "sampled": sampled._asdict(),
        "common_factor": found.common_factor,
        "sites": [
            {
                **site.spread.site._asdict(),
                "receptors": len(site.spread.sed),
                "linear": site.linear._asdict(),
                "logarithmic": site.logarithmic._asdict(),
                "by_azimuth": [None if np.isnan(v) else v for v in site.spread.by_azimuth(site.linear).tolist()],
                "moved_response_relative_l2": missed,
                "printed": {"a": printed.a, "m": printed.m, "r2": printed.r2},
            }
            for site, missed, printed in zip(found.sites, found.missed, found.printed, strict=True)
        ],
        **{
            where: {
                "linear": mean_over(found.laws(where))._asdict(),
                "logarithmic": mean_over(found.laws(where, "logarithmic"))._asdict(),
                "printed": mean_over(found.published(where))._asdict(),
            }
            for where in _WHERE
        },
    }


def _print(found: AllSites, sampled: Sampled) -> None:
    factor = found.common_factor
    out.print(
        f"SED {sampled.depth_mm:g} mm below the skin = A / r^m, under {sampled.force_gwt:g} gwt along the inward "
        f"normal,\nreceptors {sampled.spacing_mm:g} mm apart within ± {sampled.half_width_mm:g} mm of each site in x "
        f"and in z; A × {factor:.4g}, so that its mean over the\npulp is the printed one"
    )
    header = (
        "site",
        "A",
        "m",
        "r",
        "R²",
        "m by\nlogs",
        "round\nto",
        "moved",
        "A\nprinted",
        "m\nprinted",
        "R²\nprinted",
    )
    table = Table(*header, box=None, padding=(0, 1))
    for site, missed, printed in zip(found.sites, found.missed, found.printed, strict=True):
        law, log = site.linear, site.logarithmic
        table.add_row(
            f"{printed.number}{'' if site.spread.site.on_pulp else ' tip'}",
            f"{factor * law.a:.2f}", f"{law.m:.2f}", f"{law.r:.3f}", f"{law.r2:.3f}", f"{log.m:.2f}",
            f"{site.asymmetry:.0%}", f"{missed:.0%}", f"{printed.a:.2f}", f"{printed.m:.2f}", f"{printed.r2:.3f}",
        )  # fmt: skip
    out.print(table)
    for where, name in _WHERE.items():
        for kind, laws in (
            ("linear", found.laws(where)),
            ("logarithmic", found.laws(where, "logarithmic")),
            ("printed", found.published(where)),
        ):
            out.print(f"{name}, {kind:<12}{_said(mean_over(laws), 1.0 if kind == 'printed' else factor)}")


def _said(mean: Mean, factor: float) -> str:
    return f"m {mean.m:.3f} ± {mean.m_spread:.1%}, A {factor * mean.a:.2f} ± {mean.a_spread:.1%}"
