"""Small drawings: what is drawn is what was computed, and lies inside the drawing."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from sim.config import FingertipConfig
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.pictures import cut
from sim.models.result import IndentationResult
from tests.sim.coarse_mesh import coarse_mesh

SCENES = {
    "bar:3": (0.2, None),
    "sphere:2": (0.3, 7.2),
}


@pytest.fixture(scope="module")
def short() -> Fingertip:
    """As fine along the finger as the default one, coarse across it."""
    mesh = coarse_mesh(0.3, 0.17, patch_x_mm=2.5, patch_z_mm=2.0, round_patch_mm=2.0)
    return load("finger", FingertipConfig(mesh=mesh), cached=False)


@pytest.fixture(scope="module", params=SCENES)
def pressed(request: pytest.FixtureRequest, finger: Fingertip, short: Fingertip) -> IndentationResult:
    """One of each kind of shape, off the middle."""
    x_mm, z_mm = SCENES[request.param]
    return (finger if z_mm is None else short).indent(request.param, x_mm, z_mm=z_mm, doi_mm=0.6)


def test_the_skin_lies_on_the_indentor_where_it_bears(pressed: IndentationResult) -> None:
    seen = cut(pressed)
    apart = np.hypot(*(seen.pressed[:, :, None] - seen.indentor[:, None])).min(axis=1)
    bearing = seen.pressure > 0
    assert bearing.any()
    assert apart[bearing].max() < 0.1  # the indentor is drawn by points 0.03 mm apart, more where it is steep
    assert apart[~bearing].max() > 0.2
    assert (seen.at_rest[1] - seen.pressed[1]).max() == pytest.approx(0.6, abs=0.15)
    assert (np.diff(seen.at_rest[0]) > 0).all()
    if pressed.indentor.name != "line":
        assert seen.pressure.tolist() == pressed.pressure_profile[1].tolist()
        assert seen.pressed.tolist() == np.stack(pressed.skin_profile).tolist()
    else:
        assert seen.at_rest[0].tolist() == pressed.axial_profile[0].tolist()


def _drawing(html: str) -> tuple[ElementTree.Element, list[np.ndarray]]:
    """The figure, and the points of its lines in pixels."""
    figure = ElementTree.fromstring(html)
    lines = [line.attrib["points"] for line in figure.iter() if line.tag.endswith("polyline")]
    return figure, [np.array([pair.split(",") for pair in line.split()], dtype=float) for line in lines]


def test_a_press_is_drawn_to_scale(pressed: IndentationResult) -> None:
    figure, (body, pressure, at_rest, skin) = _drawing(pressed._repr_html_())
    seen, (_, _, width, height) = cut(pressed), map(float, figure[0].attrib["viewBox"].split())
    left, top = seen.indentor[0, 0], seen.at_rest[1].max() + 1.6
    assert skin == pytest.approx(32 * np.stack([seen.pressed[0] - left, top - seen.pressed[1]], axis=1), abs=0.051)
    assert at_rest[:, 1].min() == pytest.approx(32 * 1.6, abs=0.051)
    assert pressure[:, 1].max() == pytest.approx(32 * 1.2, abs=0.051)
    hanging = [32 * (seen.at_rest[0] - left), 32 * 1.2 * seen.pressure / seen.pressure.max()]
    assert pressure[:-2] == pytest.approx(np.stack(hanging, axis=1), abs=0.051)
    assert body[-2:].tolist() == [[width, 0], [0, 0]]
    assert pressure[-2:, 1].tolist() == [0, 0]
    for points in (body, pressure, at_rest, skin):
        assert points.min() >= 0
        assert (points.max(axis=0) <= [width + 0.1, height + 0.1]).all()
    assert figure[1].text == f"{pressed!r}, highest pressure {pressed.peak_pressure_kpa:.3g} kPa"
    assert len(pressed._repr_html_()) < 8000


@pytest.mark.parametrize("name", ["finger", "section"])
def test_a_finger_is_drawn_with_its_receptors(name: str, finger: Fingertip) -> None:
    drawn = finger if name == "finger" else load("section")
    html = drawn._repr_html_()
    figure, (section,) = _drawing(html)
    dots = np.array(re.findall(r'cx="([\d.]+)" cy="([\d.]+)"', html), dtype=float)
    receptors = drawn.model.receptors.position_mm
    assert np.diff(dots[:, 0]) == pytest.approx(32 * np.diff(receptors[:, 0]), abs=0.11)
    assert dots[:, 1].min() - section[:, 1].min() == pytest.approx(32 * 0.76, abs=0.5)
    assert section.min() == pytest.approx(32 * 0.3, abs=0.051)
    assert figure[1].text == repr(drawn)


def test_a_name_cannot_break_the_page(pressed: IndentationResult) -> None:
    odd = replace(pressed, indentor=replace(pressed.indentor, name="a<b&c"))
    assert "a&lt;b&amp;c" in odd._repr_html_()
