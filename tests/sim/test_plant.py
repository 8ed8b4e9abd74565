"""What stands behind the virtual devices: steps and screws in, force out."""

import pytest

from sim.carriage import Carriage, Placement, Pose, Screws, Truth
from sim.contact.shapes import ShapeError
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.plant import Plant, PressedFinger
from tests.error_codes import raises

PLACE = Placement(pad_centre_x_mm=-30.0, apex_z_mm=-25.0)


class Steps:
    """Steps that a test sets by hand; 400 steps make one commanded millimetre."""

    def __init__(self) -> None:
        self.steps = (0, 0, 0)

    def command(self, x_mm: float, z_mm: float) -> None:
        self.steps = (round(400 * x_mm), 0, round(400 * z_mm))

    def __call__(self, t_s: float) -> tuple[int, int, int]:
        return self.steps


@pytest.fixture
def carriage() -> Steps:
    return Steps()


def plant_of(finger: Fingertip, carriage: Steps, screws: Screws | None = None) -> Plant:
    plant = Plant(finger, Carriage(carriage, screws or Screws(), PLACE))
    plant.mount("step:5")
    return plant


def test_the_plant_converts_carriage_steps_to_the_pose_in_the_finger_frame(
    finger: Fingertip, carriage: Steps
) -> None:
    plant = plant_of(finger, carriage)
    carriage.command(-31.0, -25.5)
    pose = plant.pose_at(0.0)
    assert pose.x_mm == pytest.approx(-1.0, abs=1e-12)
    assert pose.height_mm == pytest.approx(finger.apex_height_mm - 0.5, abs=1e-12)
    assert pose.doi_mm == pytest.approx(finger.touch_height_mm("step:5", -1.0) - pose.height_mm, abs=1e-12)


def test_above_the_skin_the_plant_has_no_force_and_solves_no_contact(finger: Fingertip, carriage: Steps) -> None:
    plant = plant_of(finger, carriage)
    for z in (0.0, -20.0, -24.9):
        carriage.command(-30.0, z)
        assert plant.pose_at(0.0).doi_mm < 0
        assert plant.force_n(0.0) == 0.0
    assert plant.contact_solves == 0


@pytest.mark.parametrize("along_mm", [-6.9, 5.9])
def test_beyond_the_ends_of_the_finger_the_plant_has_no_force(finger: Fingertip, along_mm: float) -> None:
    # The receptor plane is 6.893 mm from one end and 5.857 mm from the other.
    press = PressedFinger(finger, "sphere:2")
    beyond = Pose(0.0, -3.0, along_mm)
    assert press.doi_mm(beyond) == float("-inf")
    assert press.force_n(beyond) == 0.0
    assert press.doi_mm(Pose(0.0, -3.0, 0.99 * along_mm)) > float("-inf")


def test_a_contact_that_does_not_converge_gives_no_force(finger: Fingertip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.contact.solver.MAX_PASSES", 1)
    with raises(ModelRangeError, "no_answer", indentor="bar:3", x_mm=0.0):
        PressedFinger(finger, "bar:3.0").force_n(Pose(0.0, -1.0))


def test_the_plant_has_the_force_of_the_model_at_the_true_pose(finger: Fingertip, carriage: Steps) -> None:
    plant = plant_of(finger, carriage)
    carriage.command(-31.0, -25.5)
    pose = plant.pose_at(0.0)
    assert pose.doi_mm > 0.2
    assert plant.force_n(0.0) == finger.indent("step:5", pose.x_mm, doi_mm=pose.doi_mm).force_n


def test_the_force_of_the_plant_follows_whole_motor_steps(finger: Fingertip, carriage: Steps) -> None:
    # 1 µm is 0.4 of a step: commands that round to the same step are one pose and one force.
    plant = plant_of(finger, carriage)
    forces = []
    for z in (-25.5000, -25.5010, -25.5025):
        carriage.command(-31.0, z)
        forces.append(plant.force_n(0.0))
    assert forces[0] == forces[1]
    assert plant.contact_solves == 2
    deeper = finger.indent("step:5", -1.0, doi_mm=plant.pose_at(0.0).doi_mm).force_n
    assert forces[2] == pytest.approx(deeper, rel=1e-8)
    assert forces[2] > forces[0]


def test_a_screw_two_percent_off_shifts_the_true_pose_and_force(finger: Fingertip, carriage: Steps) -> None:
    # A screw that travels 2 % more for each step: x and z are 1.02 of what was commanded, from the switches. 30.5 mm
    # commanded are 31.11 mm; the finger stays where it is.
    true, wrong = plant_of(finger, carriage), plant_of(finger, carriage, Screws(400 / 1.02, 400 / 1.02))
    carriage.command(-30.5, -24.8)
    good, bad = true.pose_at(0.0), wrong.pose_at(0.0)
    assert good.x_mm == pytest.approx(-0.5, abs=1e-12)
    assert bad.x_mm == pytest.approx(30.0 - 1.02 * 30.5, abs=1e-12)
    assert bad.height_mm - good.height_mm == pytest.approx(-0.02 * 24.8, abs=1e-12)
    lower = finger.touch_height_mm("step:5", bad.x_mm) - finger.touch_height_mm("step:5", good.x_mm)
    assert bad.doi_mm - good.doi_mm == pytest.approx(0.02 * 24.8 + lower, abs=1e-12)
    assert good.doi_mm < 0 < bad.doi_mm
    assert true.force_n(0.0) == 0.0
    assert wrong.force_n(0.0) == finger.indent("step:5", bad.x_mm, doi_mm=bad.doi_mm).force_n > 0


@pytest.mark.parametrize("way_mm", [0.002, 0.3, 0.9])
def test_a_compliant_virtual_rig_shares_the_travel_with_the_finger(
    finger: Fingertip, carriage: Steps, way_mm: float
) -> None:
    """Springs in series: way = DOI + compliance · F(DOI), to the 1e-6 mm at which the depth is left."""
    compliance = 0.5
    plant = Plant(finger, Carriage(carriage, Screws(400_000, 400_000), PLACE), Truth(2.0, compliance))
    plant.mount("step:5")
    z = PLACE.apex_z_mm + finger.touch_height_mm("step:5", 0.0) - finger.apex_height_mm - way_mm
    carriage.command(1000 * PLACE.pad_centre_x_mm, 1000 * z)
    force, doi = plant.force_n(0.0), plant.pose_at(0.0).doi_mm
    assert 0 < doi < way_mm
    assert doi + compliance * force == pytest.approx(way_mm, abs=2e-6)
    assert force == pytest.approx(2 * finger.indent("step:5", 0.0, doi_mm=doi).force_n, rel=1e-6)


def test_the_force_of_the_plant_does_not_depend_on_the_steps_before(finger: Fingertip, carriage: Steps) -> None:
    # A start moved on by the last change is only a start: what comes out is the answer from rest.
    plant = plant_of(finger, carriage)
    for depth in (0.1, 0.12, 0.2, 0.15, 0.15, 0.4, 0.41, 0.02, 0.5):
        carriage.command(-31.0, -25.0 - depth)
        force, pose = plant.force_n(0.0), plant.pose_at(0.0)
        if pose.doi_mm > 0:
            at_once = finger.indent("step:5", pose.x_mm, doi_mm=pose.doi_mm).force_n
            assert force == pytest.approx(at_once, rel=1e-8), depth


def test_mounting_another_indentor_changes_the_force_of_the_plant(finger: Fingertip, carriage: Steps) -> None:
    plant = plant_of(finger, carriage)
    carriage.command(-30.0, -25.4)
    step = plant.force_n(0.0)
    plant.mount("bar:1.5")
    bar = plant.force_n(0.0)
    assert bar != step
    exact = finger.indent("bar:1.5", 0.0, doi_mm=plant.pose_at(0.0).doi_mm).force_n
    assert bar == pytest.approx(exact, rel=1e-8)  # the plant solves to a residual of 1e-8
    with raises(ShapeError, "no_such", shape="spoon"):
        plant.mount("spoon")


def test_a_pose_deeper_than_the_model_allows_is_refused(finger: Fingertip, carriage: Steps) -> None:
    plant = plant_of(finger, carriage)
    carriage.command(-30.0, -28.0)
    with raises(ModelRangeError, "doi_outside", deepest_mm=2.0):
        plant.force_n(0.0)
