"""Small drawings: what is drawn is what was computed."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.pictures import cut


def test_the_drawing_of_a_press_shows_the_skin_on_the_indentor_where_it_bears(finger: Fingertip) -> None:
    pressed = finger.indent("bar:3", 0.2, doi_mm=0.6)
    seen = cut(pressed)
    apart = np.hypot(*(seen.pressed[:, :, None] - seen.indentor[:, None])).min(axis=1)
    bearing = seen.pressure > 0
    assert bearing.any()
    assert apart[bearing].max() < 0.1  # the indentor is drawn by points 0.03 mm apart, more where it is steep
    assert apart[~bearing].max() > 0.2
    assert seen.pressure.tolist() == pressed.pressure_profile[1].tolist()
    assert seen.pressed.tolist() == np.stack(pressed.skin_profile).tolist()


@pytest.mark.parametrize(("shape", "z_mm"), [("line", 7.2), ("sphere:2", 7.2)])
def test_the_drawing_of_a_press_escapes_the_indentor_name(coarse_finger: Fingertip, shape: str, z_mm: float) -> None:
    pressed = coarse_finger.indent(shape, z_mm=z_mm, doi_mm=0.3)
    odd = replace(pressed, indentor=replace(pressed.indentor, name="a<b&c"))
    drawn = ElementTree.fromstring(odd._repr_html_())
    assert drawn[1].text == f"{odd!r}, highest pressure {odd.peak_pressure_kpa:.3g} kPa"
    assert len(odd._repr_html_()) < 8000


@pytest.mark.parametrize("name", ["finger", "section"])
def test_the_drawing_of_a_finger_shows_its_receptors(name: str, finger: Fingertip) -> None:
    drawn = finger if name == "finger" else load("section")
    dots = np.array(re.findall(r'cx="([\d.]+)" cy="([\d.]+)"', drawn._repr_html_()), dtype=float)
    receptors = drawn.model.receptors.position_mm
    assert np.diff(dots[:, 0]) == pytest.approx(32 * np.diff(receptors[:, 0]), abs=0.11)
