"""What is drawn: the finger's section, every kind of indentor, and the curve that a press is expected to give."""

import asyncio
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rig.panel.drawing as drawing
from rig.errors import code_of
from rig.panel.drawing import (
    DEPTHS,
    HIGHEST_MM,
    Drawer,
    DrawingError,
    Job,
    PressSummary,
    drawn,
    finger_outlines,
    indentor_outline,
    predicted,
)
from rig.panel.stream import Outlet
from rig.plan.finger_model import copy_name
from sim.config import FingertipConfig, Tissue
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


def test_the_section_is_that_of_the_model_in_the_rig_s_frame(finger: Fingertip) -> None:
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


def test_an_elastic_bone_is_drawn_where_a_rigid_one_is(finger: Fingertip) -> None:
    z_mm, apex_mm = finger.config.receptor_plane_mm, finger.apex_height_mm
    elastic = finger.config.model_copy(update={"tissue": Tissue(bone="elastic")})
    quadratic = finger.config.model_copy(
        update={"mesh": finger.config.mesh.model_copy(update={"element": "quadratic"})}
    )
    rigid = finger_outlines(finger.config, finger.surface, z_mm, apex_mm)
    for other in (elastic, quadratic):
        found = finger_outlines(other, finger.surface, z_mm, apex_mm)
        for name in ("bone", "skin"):
            np.testing.assert_allclose(found[name], rigid[name], atol=1e-4)
        np.testing.assert_allclose(found["layers"], rigid["layers"], atol=1e-4)


def test_the_nail_is_where_the_skin_is_held(finger: Fingertip) -> None:
    config, apex_mm = finger.config, finger.apex_height_mm

    def nail(tissue: Tissue, z_mm: float = 6.9) -> list[Any]:
        found = finger_outlines(config.model_copy(update={"tissue": tissue}), finger.surface, z_mm, apex_mm)
        return found["nail"]

    x, z = np.array(nail(Tissue())).T
    assert x[0] == pytest.approx(-x[-1], abs=0.05)  # it leans
    middle = finger.surface.section(-0.5 * math.pi, 6.9)
    assert (x[90], z[90]) == pytest.approx((float(middle[0]), float(middle[1]) - apex_mm), abs=1e-3)
    end = finger.surface.section(-0.5 * math.pi + math.radians(70), 6.9)
    assert (x[-1], z[-1]) == pytest.approx((float(end[0]), float(end[1]) - apex_mm), abs=1e-3)
    assert nail(Tissue(nail_arc_deg=0)) == []
    assert nail(Tissue(), 4.99) == []
    assert nail(Tissue(), 5.0) != []


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
def test_every_shape_is_cut_through_its_reference_point(
    shape: str, places: tuple[float, ...], heights: list[float] | None
) -> None:
    found = height_at(shape, *places)
    if heights is None:
        assert found[0] == pytest.approx(0.0, abs=1e-3)
        assert found[1] > 0.9
    else:
        assert found == pytest.approx(heights, abs=2e-3)


def test_shapes_of_one_s_own_are_cut_too(tmp_path: Path) -> None:
    profile = tmp_path / "mine.csv"
    profile.write_text("x_mm,height_mm\n-1.0,0.3\n0.0,0.1\n1.0,0.0\n2.0,0.4\n", encoding="utf-8")
    assert height_at(f"profile:{profile},linear", 0.0, 1.5) == pytest.approx([0.1, 0.2], abs=2e-3)
    picture = np.full((41, 41), 255, dtype=np.uint8)
    picture[:, 20:] = 0
    Image.fromarray(picture).save(tmp_path / "mine.png")
    shape = f"heightmap:{tmp_path / 'mine.png'},width_mm=4,height_mm=1,raised=dark"
    left, right = height_at(shape, -1.0, 1.0)
    assert (round(left, 1), round(right, 1)) == (1.0, 0.0)


def test_flanks_are_cut_and_straight_lines_have_two_ends() -> None:
    line = indentor_outline(parse_shape("bar:3.0"))
    assert max(height for _, height in line) == HIGHEST_MM
    assert line[0][1] == line[-1][1] == HIGHEST_MM
    assert -2.0 < line[0][0] < -1.5 < 1.5 < line[-1][0] < 2.0
    assert indentor_outline(parse_shape("flat")) == [[-8.0, 0.0], [8.0, 0.0]]


# --- what is expected ---


@pytest.mark.parametrize(("target", "value"), [("doi_mm", 0.6), ("force_gwt", 2.33)])
def test_the_curve_ends_at_the_target_and_is_the_model_s(target: str, value: float, finger: Fingertip) -> None:
    press = PressSummary(0, "data", 0.5, target, value)
    curve, at_target = predicted(finger, parse_shape("bar:3.0"), press)
    assert len(curve["doi_mm"]) == len(curve["force_gwt"]) == DEPTHS + 1
    assert (curve["doi_mm"][0], curve["force_gwt"][0]) == (0.0, 0.0)
    assert curve[target][-1] == pytest.approx(value, rel=1e-6)
    for k in (2, DEPTHS):
        alone = finger.indent("bar:3.0", 0.5, doi_mm=curve["doi_mm"][k])
        assert curve["force_gwt"][k] == pytest.approx(alone.force_gwt, rel=1e-6)
    np.testing.assert_allclose(np.diff(curve["doi_mm"]), curve["doi_mm"][-1] / DEPTHS, rtol=1e-9)
    last = finger.indent("bar:3.0", 0.5, doi_mm=curve["doi_mm"][-1])
    assert at_target["contact"] == [pytest.approx(region, abs=1e-3) for region in last.contact_regions_mm]
    x, y = last.skin_profile
    np.testing.assert_allclose(at_target["pressed_skin"], np.stack([x, y - finger.apex_height_mm], 1), atol=2e-4)


def test_beyond_the_model_there_is_no_curve_and_a_reason(finger: Fingertip) -> None:
    curve, at_target = predicted(finger, parse_shape("bar:3.0"), PressSummary(0, "data", 0.0, "doi_mm", 3.0))
    assert (curve["doi_mm"], curve["force_gwt"], at_target) == (None, None, {})
    assert curve["code"] == "doi_outside"
    assert curve["problem"]


def test_what_a_plate_does_is_the_same_everywhere(finger: Fingertip) -> None:
    here, there = (
        predicted(finger, parse_shape("flat"), PressSummary(0, "data", x, "doi_mm", 0.3))[0] for x in (0.0, 1.0)
    )
    assert here == there


# --- a drawing ---


def test_a_drawing_of_a_press(config: Path, finger: Fingertip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawing, "_finger", lambda of: finger)
    found = drawn(Job(config, None, "bar:3.0", 0.0, PRESS))
    assert set(found) == {
        "skin", "layers", "bone", "nail", "along_mm", "indentor", "contact", "pressed_skin", "prediction",
    }  # fmt: skip
    plane_mm, apex_mm = finger.config.receptor_plane_mm, finger.apex_height_mm
    assert found["skin"] == finger_outlines(finger.config, finger.surface, plane_mm, apex_mm)["skin"]
    assert found["prediction"] == predicted(finger, parse_shape("bar:3.0"), PRESS)[0]
    json.dumps(found, allow_nan=False)


def test_a_drawing_along_the_finger_is_of_that_section(config: Path, finger: Fingertip) -> None:
    found = drawn(Job(config, None, None, 1.5))
    plane_mm, apex_mm = finger.config.receptor_plane_mm, finger.apex_height_mm
    assert found["skin"] == finger_outlines(finger.config, finger.surface, plane_mm + 1.5, apex_mm)["skin"]
    assert (found["along_mm"], found["indentor"]) == (1.5, None)
    assert "prediction" not in found


def test_a_run_s_own_copies_are_what_is_read(config: Path, tmp_path: Path) -> None:
    (tmp_path / copy_name("mine.csv")).write_text("x_mm,height_mm\n-1,0.5\n0,0\n1,0.5\n", encoding="utf-8")
    told = drawn(Job(config, tmp_path, "profile:mine.csv"))
    s, height = np.array(told["indentor"]).T
    assert float(np.interp(1.0, s, height)) == pytest.approx(0.5, abs=1e-3)
    assert list(drawn(Job(config, None, "profile:mine.csv"))) == ["problem", "code"]


def test_a_configuration_that_changes_is_read_anew(config: Path) -> None:
    before = drawn(Job(config))["skin"]
    config.write_text("[finger.geometry]\nproximal_apex_mm = 3.5\n", encoding="utf-8")
    assert drawn(Job(config))["skin"] != before


@pytest.mark.parametrize(
    ("job", "code"),
    [
        (Job(Path("none.toml")), "file_not_found"),
        (Job(Path("config.toml"), None, "bar:x"), None),
        (Job(Path("config.toml"), None, "bar:3.0", 0.0, PRESS), "runtime"),
    ],
)
def test_what_cannot_be_drawn_is_told(
    job: Job, code: str | None, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(of: FingertipConfig) -> Fingertip:
        raise RuntimeError("by mistake")

    monkeypatch.chdir(config.parent)
    monkeypatch.setattr(drawing, "_finger", broken)
    found = drawn(job)
    assert list(found) == ["problem", "code"]
    if code is None:  # the shape's own
        with pytest.raises(ShapeError) as refused:
            parse_shape(job.indentor or "")
        assert found == {"problem": str(refused.value), "code": code_of(refused.value)}
    else:
        assert found["code"] == code


# --- the newest ---


class ToldProcess:
    """Draws at once, and remembers what."""

    def __init__(self) -> None:
        self.jobs: list[Job] = []
        self.fails = False

    def ask(self, job: Job) -> dict[str, Any]:
        self.jobs.append(job)
        if self.fails:
            raise DrawingError("it has ended")
        return {"skin": [[0, 0]], **({"prediction": {"doi_mm": [1], "force_gwt": [2]}} if job.press else {})}

    def close(self) -> None:
        self.jobs.clear()


class Asking:
    """A drawer, what is wanted of it, and a page that looks on."""

    def __init__(self) -> None:
        self.wanted: Job | None = None
        self.outlet, self.process = Outlet(), ToldProcess()
        self.drawer = Drawer(lambda: self.wanted, self.outlet, VirtualClock(1000.0))
        self.drawer.process = self.process  # type: ignore[assignment]

    def look(self, job: Job | None) -> list[tuple[str, dict[str, Any]]]:
        self.wanted = job
        with self.outlet.joined() as client:
            client.taken(0.0)
            asyncio.run(self.drawer.look())
            return events(client.taken(0.0))


STILL = Job(Path("c"), Path("runs/one"), "bar:3.0")
MOVING = Job(Path("c"), Path("runs/one"), "bar:3.0", 0.0, PRESS)
OF = {"unix_s": 1000.0, "run": "one", "shape": "bar:3.0"}
OF_THE_PRESS, OF_NONE = {**OF, "index": 3, "purpose": "data"}, {**OF, "index": None, "purpose": None}
NO_CURVE = {"doi_mm": None, "force_gwt": None}


def test_the_finger_is_drawn_first_and_what_is_solved_after_it() -> None:
    asking = Asking()
    assert asking.look(None) == []
    assert dict(asking.look(MOVING)) == {
        "prediction": {**OF_THE_PRESS, **NO_CURVE}, "section": {**OF_NONE, "skin": [[0, 0]]},
    }  # fmt: skip
    assert dict(asking.look(MOVING)) == {
        "section": {**OF_THE_PRESS, "skin": [[0, 0]]},
        "prediction": {**OF_THE_PRESS, "doi_mm": [1], "force_gwt": [2]},
    }
    assert asking.look(MOVING) == []
    assert asking.process.jobs == [STILL, MOVING]


def test_the_next_press_of_the_same_is_solved_at_once() -> None:
    asking = Asking()
    for _ in range(2):
        asking.look(MOVING)
    other = Job(Path("c"), Path("runs/one"), "bar:3.0", 0.0, PressSummary(4, "data", 1.0, "doi_mm", 0.6))
    found = asking.look(other)
    assert [told["index"] for _, told in found] == [4, 4]
    assert asking.process.jobs == [STILL, MOVING, other]
    back = asking.look(STILL)
    assert dict(back)["prediction"] == {**OF_NONE, **NO_CURVE}
    assert asking.process.jobs[-1] == STILL
    assert asking.look(STILL) == []
    assert dict(asking.look(None))["prediction"]["run"] is None


def test_a_curve_of_a_press_that_is_over_is_not_told() -> None:
    asking = Asking()
    for _ in range(2):
        asking.look(STILL)
    asking.drawer._request = iter([MOVING, None, None]).__next__  # over while it is drawn
    with asking.outlet.joined() as client:
        client.taken(0.0)
        asyncio.run(asking.drawer.look())
        found = events(client.taken(0.0))
    assert dict(found)["prediction"] == {**OF_THE_PRESS, **NO_CURVE}


def test_what_fails_is_told_and_not_tried_again() -> None:
    asking = Asking()
    asking.process.fails = True
    assert dict(asking.look(STILL))["section"] == {
        **OF_NONE,
        "skin": [],
        "problem": "it has ended",
        "code": "not_drawn",
    }
    assert asking.look(STILL) == []
    asking.drawer.close()
    assert asking.process.jobs == []
