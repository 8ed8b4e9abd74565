"""What the source leaves open about Table 6.1, and how far each choice moves A and m; and what the mesh does to them.

.venv/bin/python -m studies.source.shift_choices    # two minutes
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sim.coding.point_loads import LoadedFinger, PowerLaw, published_sites
from sim.coding.point_spread import SPACING_MM, Judged, Sheet, judged, mean_over, receptor_sheet, spreads
from sim.config import FingertipConfig, MeshSpec, Tissue
from sim.contact.patch import Y, Z
from sim.measures.receptors import DEFAULT_DEPTH_MM
from studies.registry import show

HEADER = ("instead", "m, pulp", "A over the default's", "A's spread, pulp", "all", "m by logarithms")
MESH_HEADER = ("mesh of site 10", "m", "m by logarithms", "A over the default's")
Row = tuple[str, ...]

_FROM_Z_MM = 2.0  # no site's neighbourhood begins before
_SITE = 9  # the tenth
_EVEN_MM = (1.5, 1.5)  # about site 10: what lies farther away is smooth


def main() -> None:
    """Print both tables."""
    for header, rows in ((HEADER, choices()), (MESH_HEADER, meshes())):
        show(header, rows)


def choices() -> Iterator[Row]:
    """One row for each choice, the default's first."""
    finger, sites = LoadedFinger(FingertipConfig()), published_sites()
    usual = receptor_sheet(finger)
    first = [judged(spread) for spread in spreads(finger, usual, sites)]
    yield _row("the default", first, first)
    others = {
        **{f"within ± {width:g} mm": (usual, {"half_width_mm": width}) for width in (1.0, 2.0, 3.0)},
        "receptors 0.70 mm deep": (receptor_sheet(finger, SPACING_MM, 0.70), {}),
        "receptors 0.82 mm deep": (receptor_sheet(finger, SPACING_MM, 0.82), {}),
        "receptors vertically 0.76 mm below": (_vertically_below(finger, usual), {}),
        "loads on the nearest node": (usual, {"at_node": True}),
        "loads along −y": (usual, {"direction": "vertical"}),
    }
    for name, (sheet, told) in others.items():
        yield _row(name, [judged(spread) for spread in spreads(finger, sheet, sites, **told)], first)  # type: ignore[arg-type]
    yield _row("in the site's own plane across the finger", [_across(site) for site in first], first)
    for name, tissue in {
        "epidermis 0.3 mm": Tissue(epidermis_mm=0.3),
        "epidermis 0.5 mm": Tissue(epidermis_mm=0.5),
        "no epidermis (as soft as the rest)": Tissue(e_dermis=1.0, e_fat=1.0),
    }.items():
        other = LoadedFinger(FingertipConfig(tissue=tissue))
        yield _row(name, [judged(spread) for spread in spreads(other, receptor_sheet(other), sites)], first)


def meshes() -> Iterator[Row]:
    """Site 10 on finer meshes."""
    first: PowerLaw | None = None
    for name, mesh in {
        "0.17 mm, two elements in the epidermis": MeshSpec(axial_spacing_mm=0.17),
        "0.1 mm, three": MeshSpec(level="fine", axial_spacing_mm=0.1),
    }.items():
        finger = LoadedFinger(FingertipConfig(mesh=mesh), _EVEN_MM)
        found = judged(spreads(finger, receptor_sheet(finger), published_sites()[_SITE : _SITE + 1])[0])
        first = first or found.linear
        yield name, f"{found.linear.m:.2f}", f"{found.logarithmic.m:.2f}", f"{found.linear.a / first.a:.3f}"


def _vertically_below(finger: LoadedFinger, sheet: Sheet) -> Sheet:
    at = sheet.skin_mm - DEFAULT_DEPTH_MM * np.eye(3)[Y]
    there = (at[:, Y] > 0) & (sheet.skin_mm[:, Z] > _FROM_Z_MM) & (at[:, Z] < finger.recovered_z_mm[1])
    return Sheet(sheet.skin_mm[there], at[there])


def _across(site: Judged) -> Judged:
    """Of the receptors nearest to the site's z alone."""
    spread = site.spread
    away = np.abs(spread.sheet.skin_mm[:, Z] - spread.load_mm[Z])
    row = away < away.min() + 1e-6
    return judged(
        replace(
            spread,
            sheet=Sheet(*(v[row] for v in spread.sheet)),
            sed=spread.sed[row],
            young_ratio=spread.young_ratio[row],
        )
    )


def _row(name: str, sites: Sequence[Judged], first: Sequence[Judged]) -> Row:
    pulp, default = (mean_over([s.linear for s in some if s.spread.site.on_pulp]) for some in (sites, first))
    everything = mean_over([site.linear for site in sites])
    logs = mean_over([site.logarithmic for site in sites if site.spread.site.on_pulp])
    return (
        name,
        f"{pulp.m:.2f} ± {pulp.m_spread:.1%}",
        f"{pulp.a / default.a:.2f}",
        f"{pulp.a_spread:.1%}",
        f"{everything.a_spread:.1%}",
        f"{logs.m:.2f} ± {logs.m_spread:.1%}",
    )


if __name__ == "__main__":
    main()
