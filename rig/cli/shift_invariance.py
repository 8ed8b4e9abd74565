"""`rig shift-invariance`: how SED spreads under equal point loads at the source's 24 sites of the finger."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from rig.cli.options import FingertipOption, JsonOption
from rig.cli.output import busy, err, out, print_json, say_now, told_in_one_line
from rig.cli.pictures import PictureOption, checked_picture, write_picture
from rig.cli.sampling import DepthOption, SpacingOption, bounded
from rig.plan.config import load_config
from sim.coding.all_sites import DRAWN, AllSites, Deformed, Sampled, Where, kept_sites
from sim.coding.point_spread import HALF_WIDTH_MM, SPACING_MM, Judged, Mean, mean_over
from sim.measures.receptors import DEFAULT_DEPTH_MM

_WHERE: dict[Where, str] = {"pulp": "18 pulp sites", "all": "all 24 sites"}


_BUSY = "24 point loads on the whole finger: from the cache, or about twenty seconds …"
_TOLD_EACH = 1000  # receptors, where nothing turns


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
        with busy(_BUSY, as_json=as_json):
            found, deformed = kept_sites(settings, sampled, None if as_json else _told)
            if picture is not None:
                _draw(deformed, found.sites[DRAWN], picture)
        if as_json:
            print_json(_as_json(found, sampled))
        else:
            _print(found, sampled)


def _told(done: int, of: int) -> None:
    """How many of the receptors have their strain; then the stiffness is factorised, which takes as long."""
    if err.is_terminal or done % _TOLD_EACH == 0:
        say_now(f"strain at {done} of {of} receptors …")
    if done == of >= _TOLD_EACH:
        say_now("a factorisation, then 24 loads …")


def _draw(deformed: Deformed, site: Judged, picture: Path) -> None:
    from rig.report.coding.point_spread_figure import Drawn, point_spread_figure  # matplotlib, if wanted

    write_picture(point_spread_figure(Drawn(deformed, site)), picture)


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
