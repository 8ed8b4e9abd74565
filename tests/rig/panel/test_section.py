"""What is drawn: the finger's section, every kind of indentor, and the curve that a press is expected to give."""

import asyncio
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rig.panel.section as section
from rig.panel.section import (
    DEPTHS,
    HIGHEST_MM,
    Job,
    PressSummary,
    Sections,
    depths_of,
    finger_outlines,
    indentor_outline,
    section_of,
)
from rig.panel.stream import Outlet
from rig.plan.finger_model import copy_name
from rig_shared.errors import code_of
from sim.config import FingertipConfig
from sim.contact.shapes import ShapeError, parse_shape
from sim.devices.clock import VirtualClock
from sim.models.fingertip import Fingertip
from tests.rig.panel.test_outlet import events

PRESS = PressSummary(3, "data", 0.5, "doi_mm", 0.6)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "config.toml"
    path.write_text("[limits]\nmax_doi_mm = 1.0\n", encoding="utf-8")
    return path


# --- the finger ---


def test_the_drawn_section_is_that_of_the_finger_model(finger: Fingertip) -> None:
    config, surface, apex_mm = finger.config, finger.surface, finger.apex_height_mm
    told = finger_outlines(config, surface, config.receptor_plane_mm, apex_mm)
    skin, bone = np.array(told["skin"]), np.array(told["bone"])
    x, y = surface.section(np.linspace(-math.pi, math.pi, 181), config.receptor_plane_mm)
    np.testing.assert_allclose(skin, np.stack([x, y - apex_mm], axis=1), atol=6e-5)
    assert -0.2 < skin[:, 1].max() <= 0.0  # the topmost point may lie in another section
    upper, lower = (np.array(ring) for ring in told["layers"])
    top = int(np.argmax(skin[:, 1]))
    depth = skin[top, 1] - np.array([upper[top, 1], lower[top, 1], bone[top, 1]])
    assert depth[0] == pytest.approx(config.tissue.epidermis_mm, rel=0.02)
    assert depth[1] == pytest.approx(config.tissue.epidermis_mm + config.tissue.dermis_mm, rel=0.02)
    assert depth[2] == pytest.approx((skin[top, 1] + apex_mm) * (1 - config.tissue.bone_fraction), rel=0.01)
    for ring in (upper, lower, bone):
        assert ring.shape == skin.shape


# --- the indentor ---


def height_at(shape: str, *places: float) -> list[float]:
    s, height = np.array(indentor_outline(parse_shape(shape))).T
    assert (np.diff(s) > 0).all()
    assert height.min() == pytest.approx(0.0, abs=3e-3)  # a fillet is not met by every step
    assert height.max() <= HIGHEST_MM
    return [round(float(found), 3) for found in np.interp(places, s, height)]


@pytest.mark.parametrize(
    ("shape", "places", "heights"),
    [
        ("bar:3.0", (-1.0, 0.0, 1.0), [0.0, 0.0, 0.0]),
        ("cylinder:4", (0.0, 1.0), [0.0, 2 - math.sqrt(3)]),
        ("step:1", (-4.0, -1.0, 0.225, 0.45, 3.0), [0.0, 0.0, 0.25, 0.5, 0.5]),
        ("grating:0.5,1.2", (0.0, 0.6, 1.2, 1.8, -0.6), [0.0, 0.5, 0.0, 0.5, 0.5]),
        ("wedge:45", (0.0, 1.0), None),
        ("sphere:2", (0.0, 1.0), [0.0, 2 - math.sqrt(3)]),
        ("flat:1.0", (0.0, 0.5), [0.0, 0.0]),
        ("flat", (-8.0, 8.0), [0.0, 0.0]),
        ("line", (-8.0, 0.0, 8.0), [0.0, 0.0, 0.0]),
        ("cylinder:4,turn_deg=45", (1.0,), [2 - math.sqrt(4 - 0.5)]),
        ("cylinder:4,across", (-8.0, 1.0), [0.0, 0.0]),
    ],
)
def test_every_indentor_is_drawn_in_the_section_through_its_reference_point(
    shape: str, places: tuple[float, ...], heights: list[float] | None
) -> None:
    found = height_at(shape, *places)
    if heights is None:
        assert found[0] == pytest.approx(0.0, abs=1e-3)
        assert found[1] > 0.9
    else:
        assert found == pytest.approx(heights, abs=2e-3)


def test_an_indentor_from_a_profile_or_an_image_is_drawn(tmp_path: Path) -> None:
    profile = tmp_path / "mine.csv"
    profile.write_text("x_mm,height_mm\n-1.0,0.3\n0.0,0.1\n1.0,0.0\n2.0,0.4\n", encoding="utf-8")
    assert height_at(f"profile:{profile},linear", 0.0, 1.5) == pytest.approx([0.1, 0.2], abs=2e-3)
    picture = np.full((41, 41), 255, dtype=np.uint8)
    picture[:, 20:] = 0
    Image.fromarray(picture).save(tmp_path / "mine.png")
    shape = f"heightmap:{tmp_path / 'mine.png'},width_mm=4,height_mm=1,raised=dark"
    left, right = height_at(shape, -1.0, 1.0)
    assert (round(left, 1), round(right, 1)) == (1.0, 0.0)


# --- what is expected ---


@pytest.mark.parametrize(("target", "value"), [("doi_mm", 0.6), ("force_gwt", 2.33)])
def test_the_predicted_curve_is_that_of_the_model_up_to_the_target(
    target: str, value: float, finger: Fingertip
) -> None:
    press = PressSummary(0, "data", 0.5, target, value)
    depths = depths_of(finger, parse_shape("bar:3.0"), press)
    assert len(depths) == DEPTHS
    assert depths[-1][target] == pytest.approx(value, rel=1e-6)
    for one in (depths[1], depths[-1]):
        alone = finger.indent("bar:3.0", 0.5, doi_mm=one["doi_mm"])
        assert one["force_gwt"] == pytest.approx(alone.force_gwt, rel=1e-6)
        assert one["contact"] == [pytest.approx(region, abs=1e-3) for region in alone.contact_regions_mm]
        x, y = alone.skin_profile
        np.testing.assert_allclose(one["skin"], np.stack([x, y - finger.apex_height_mm], 1), atol=2e-4)
    each_mm = np.diff([0.0, *(one["doi_mm"] for one in depths)])
    np.testing.assert_allclose(each_mm, depths[-1]["doi_mm"] / DEPTHS, rtol=1e-9)


def test_no_depth_is_solved_for_a_press_that_is_over(finger: Fingertip) -> None:
    press = PressSummary(0, "data", 0.5, "doi_mm", 0.6)
    assert len(depths_of(finger, parse_shape("bar:3.0"), press, lambda: True)) == 1


def test_a_press_beyond_the_model_is_drawn_without_a_curve_and_with_the_reason(config: Path) -> None:
    found = section_of(Job(config, None, "bar:3.0", 0.0, PressSummary(0, "data", 0.0, "doi_mm", 3.0)))
    assert "depths" not in found
    assert found["skin"]
    assert (found["code"], bool(found["problem"])) == ("doi_outside", True)


# --- a drawing ---


def test_a_press_along_the_finger_is_drawn_in_the_section_there(config: Path, finger: Fingertip) -> None:
    found = section_of(Job(config, None, None, 1.5))
    plane_mm, apex_mm = finger.config.receptor_plane_mm, finger.apex_height_mm
    assert found["skin"] == finger_outlines(finger.config, finger.surface, plane_mm + 1.5, apex_mm)["skin"]
    assert (found["along_mm"], found["indentor"]) == (1.5, None)
    assert "depths" not in found


def test_a_run_is_drawn_with_its_own_copies_of_the_shape_files(config: Path, tmp_path: Path) -> None:
    (tmp_path / copy_name("mine.csv")).write_text("x_mm,height_mm\n-1,0.5\n0,0\n1,0.5\n", encoding="utf-8")
    told = section_of(Job(config, tmp_path, "profile:mine.csv"))
    s, height = np.array(told["indentor"]).T
    assert float(np.interp(1.0, s, height)) == pytest.approx(0.5, abs=1e-3)
    assert list(section_of(Job(config, None, "profile:mine.csv"))) == ["problem", "code"]


def test_the_drawing_follows_a_changed_configuration(config: Path) -> None:
    before = section_of(Job(config))["skin"]
    config.write_text("[finger.geometry]\nproximal_apex_mm = 3.5\n", encoding="utf-8")
    assert section_of(Job(config))["skin"] != before


@pytest.mark.parametrize(
    ("job", "code"),
    [
        (Job(Path("none.toml")), "file_not_found"),
        (Job(Path("config.toml"), None, "bar:x"), None),
        (Job(Path("config.toml"), None, "bar:3.0", 0.0, PRESS), "runtime"),
    ],
)
def test_a_section_that_cannot_be_drawn_names_its_problem(
    job: Job, code: str | None, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(of: FingertipConfig) -> Fingertip:
        raise RuntimeError("by mistake")

    monkeypatch.chdir(config.parent)
    monkeypatch.setattr(section, "_finger", broken)
    found = section_of(job)
    assert list(found) == ["problem", "code"]
    if code is None:  # the shape's own
        with pytest.raises(ShapeError) as refused:
            parse_shape(job.indentor or "")
        assert found == {"problem": str(refused.value), "code": code_of(refused.value)}
    else:
        assert found["code"] == code


# --- what pages are told ---


def test_a_page_gets_the_finger_before_the_predicted_press(config: Path) -> None:
    outlet, clock, press = Outlet(), VirtualClock(1000.0), replace(PRESS, value=0.2)
    asked = [Job(config, None, "bar:3.0", 0.0, press)]
    sections = Sections(lambda: asked[0], outlet, clock)
    with outlet.joined() as client:
        found = []
        for _ in range(3):
            asyncio.run(sections.look())
            found += [told for kind, told in events(client.taken(0.0)) if kind == "section"]
    still, pressed = found
    assert (still["index"], still["depths"], bool(still["skin"])) == (None, [], True)
    assert (pressed["index"], pressed["purpose"], len(pressed["depths"])) == (3, "data", DEPTHS)
