"""How far the answers under sharp shapes hang on the path, and on where the nodes lie.

    .venv/bin/python bench/branches.py        # the tables of docs/hard_cases.md, several minutes

First table: the force of one pose from rest at once, and pressed in by 0.2, 0.05 and 0.0125 mm. Second: the same
shape at 8 places over one element; what a parabola over two elements leaves is scatter of the discretisation, with
contact at nodes only and also between them.
"""

from collections.abc import Iterable

import numpy as np

from sim.config import Contact, FingertipConfig, MeshSpec
from sim.contact.measured_profile import MeasuredProfile
from sim.contact.profiles import Bar, Grating, Profile, Step, Wedge
from sim.contact.solver import ContactState
from sim.fingertip import Fingertip

STEPS_MM = (np.inf, 0.2, 0.05, 0.0125)
KINKS = MeasuredProfile("zigzag", (-1.6, -0.8, 0.0, 0.8, 1.6), (0.3, 0.0, 0.3, 0.0, 0.3), linear=True)
POSES: dict[str, tuple[Profile, float, float]] = {
    **{f"bar 1.5, edge radius {r:g}": (Bar(1.5, r), 0.0, 0.73) for r in (0.2, 0.05, 0.01, 0.0)},
    "step 1": (Step("1"), -1.63, 0.73),
    "wedge 60": (Wedge(60.0), 0.0, 0.73),
    "wedge 60, radius 0": (Wedge(60.0, 0.0), 0.0, 0.73),
    "grating 0.5, 1.2": (Grating(0.5, 1.2), 0.1, 0.73),
    "zigzag": (KINKS, 0.1, 0.73),
}
OFFSETS = 8
PLACES: dict[str, tuple[Profile, float, float]] = {
    "step 1, DOI 0.2": (Step("1"), -1.63, 0.2),
    "step 1, DOI 0.73": (Step("1"), -1.63, 0.73),
    "bar 1.5, DOI 0.73": (Bar(1.5), 0.0, 0.73),
    "bar 1.5, edge radius 0, DOI 0.73": (Bar(1.5, 0.0), 0.0, 0.73),
    "wedge 60, DOI 0.4": (Wedge(60.0), 0.0, 0.4),
}


def pressed(finger: Fingertip, pose: tuple[Profile, float, float], step_mm: float) -> float:
    """Force in gwt at the end of a path in equal steps."""
    profile, x, doi = pose
    state: ContactState | None = None
    for depth in np.linspace(0, doi, int(np.ceil(doi / step_mm)) + 1 if np.isfinite(step_mm) else 2)[1:]:
        result = finger.indent(profile, x, doi_mm=float(depth), start=state or _at_rest(finger))
        state = result.state
    return result.force_gwt


def _at_rest(finger: Fingertip) -> ContactState:
    """No contact: a start that keeps `indent` from pressing in by itself."""
    return finger.indent("bar:3.0", 0.0, doi_mm=1e-6).state


def scatter(finger: Fingertip, pose: tuple[Profile, float, float]) -> float:
    """Largest distance of forces over two elements of places from their parabola, over their mean."""
    profile, x, doi = pose
    offset = np.arange(-OFFSETS, OFFSETS + 1) * MeshSpec().spacing_mm / OFFSETS
    force = np.array([finger.indent(profile, float(x + o), doi_mm=doi).force_gwt for o in offset])
    return float(np.abs(force - np.polyval(np.polyfit(offset, force, 2), offset)).max() / force.mean())


def _row(name: str, cells: Iterable[str]) -> None:
    print(f"| {name} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    """Print both tables."""
    finger = Fingertip.load()
    _row("pose", ("at once, gwt", "by 0.2 mm", "by 0.05 mm", "by 0.0125 mm", "spread"))
    print("|---|---|---|---|---|---|")
    for name, pose in POSES.items():
        force = [pressed(finger, pose, step) for step in STEPS_MM]
        _row(name, (*(f"{f:.6f}" for f in force), f"{np.ptp(force) / force[-1]:.1e}"))
    print()
    nodes_only = Fingertip.load(FingertipConfig(contact=Contact(between_nodes=False)))
    _row("pose", ("scatter, nodes only", "scatter, also between nodes"))
    print("|---|---|---|")
    for name, pose in PLACES.items():
        _row(name, (f"{scatter(f, pose):.2%}" for f in (nodes_only, finger)))


if __name__ == "__main__":
    main()
