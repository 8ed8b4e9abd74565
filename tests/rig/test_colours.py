"""Colours that stand for different things stay apart for whoever confuses colours, and on paper.

Dichromacies as Machado, Oliveira & Fernandes (2009), IEEE Trans. Vis. Comput. Graph. 15, 1291, Table 1, severity 1.0,
in linear RGB; distances are CIE 1976 ΔE*ab, of which 2.3 is just noticeable (Mahy et al. 1994): four of that are
told at a glance.
"""

import re
from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from rig.report.plot import Plot, Subplot, guide
from rig.report.run_figures import PHASES
from rig.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE, YELLOW, shade

SEEN = {
    "all colours": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.01182, 0.04294, 0.968881],
    ],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
GLANCE = 4 * 2.3
# sRGB to CIE XYZ, IEC 61966-2-1, and its white.
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(colour: object, seen: NDArray[np.float64]) -> NDArray[np.float64]:
    srgb = np.array(to_rgb(colour))  # type: ignore[arg-type]
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    ratio = XYZ @ np.clip(seen @ linear, 0, 1) / XYZ.sum(axis=1)
    x, y, z = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def nearest(colours: list[object], seen: object) -> float:
    places = [lab(colour, np.asarray(seen, dtype=float)) for colour in colours]
    return min(float(np.linalg.norm(a - b)) for a, b in combinations(places, 2))


@pytest.mark.parametrize("sight", SEEN)
@pytest.mark.parametrize(
    "colours",
    [[BLUE, ORANGE, GREEN, GREY, PURPLE, YELLOW], list(PHASES.values()), [BLUE, ORANGE, GREY, "black"]],
    ids=["palette", "phases", "contact panels"],
)
def test_colors_of_different_things_stay_distinguishable_for_every_color_vision(
    colours: list[object], sight: str
) -> None:
    assert nearest(colours, SEEN[sight]) > GLANCE


@pytest.mark.parametrize("sight", SEEN)
def test_ordered_shades_differ_in_lightness_for_every_color_vision(sight: str) -> None:
    lightness = [lab(shade(k, 8), np.asarray(SEEN[sight], dtype=float))[0] for k in range(8)]
    assert (np.diff(lightness) > 4).all()


def test_the_color_distance_shrinks_between_red_and_green_for_a_deuteranope() -> None:
    red, green = "#b45f00", "#6b7a00"
    assert nearest([red, green], SEEN["all colours"]) > 2 * nearest([red, green], SEEN["deuteranopia"])


CELLS = np.arange(6.0).reshape(2, 3)
ON_THE_MAP = {
    "a text over a map": (CELLS, (1.0, 0.5), True),
    "a text above a map, as the probabilities of a group": (CELLS, (1.0, -0.7), False),
    "a text over a map without values, as without recordings": (np.full((2, 3), np.nan), (1.0, 0.5), False),
}


@pytest.mark.parametrize(("cells", "place", "kept"), ON_THE_MAP.values(), ids=ON_THE_MAP)
def test_on_a_dark_page_only_text_on_a_color_map_keeps_its_color(
    cells: NDArray[np.float64], place: tuple[float, float], kept: bool
) -> None:
    """Black on the dark page itself could not be read."""
    number = guide("text", *place, "84 %", ha="center", va="bottom")
    plot = Plot((3, 3), [Subplot("", "", [guide("imshow", cells), number])])
    (group,) = re.findall(r'<g id="(\w+)">\s*<text [^>]*>84 %<', plot.page_svg)
    assert group.startswith("map") is kept


def test_edges_of_markers_on_a_color_map_keep_their_color_on_a_dark_page() -> None:
    """Browsers do not find the map around a marker that they repeat, so that it has a rule of its own."""
    marks = guide("plot", [0, 1], [0, 1], "o", mfc="black", mec="white")
    svg = Plot((3, 3), [Subplot("", "", [guide("imshow", CELLS), marks])]).page_svg
    (name,) = re.findall(r'<g id="map_\d+">\s*<defs>\s*<path id="(\w+)"', svg)
    assert f"#{name}{{stroke:#ffffff!important}}" in svg
