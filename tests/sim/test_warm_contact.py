"""A virtual force cell goes on from the contact of its last sample."""

import pytest

from sim.carriage import Pose
from sim.models.fingertip import Fingertip
from sim.plant import PressedFinger


@pytest.mark.parametrize(("shape", "x_mm"), [("cylinder:9", 0.0), ("bar:3.0", 0.0)])
def test_going_on_gives_what_rest_gives(finger: Fingertip, shape: str, x_mm: float) -> None:
    # 1e-8 is the residual required of an answer; the bar's corner is reached on the way down.
    press = PressedFinger(finger, shape)
    touch_mm = finger.touch_height_mm(shape, x_mm) - finger.apex_height_mm
    force_n = 0.0
    for hundredths in range(1, 71):
        force_n = press.force_n(Pose(x_mm, touch_mm - hundredths / 100))
    assert force_n == pytest.approx(finger.indent(shape, x_mm, doi_mm=0.7).force_n, rel=1e-7)
