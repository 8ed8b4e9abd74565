"""Whether a stage that is told to go on and on has stood meanwhile: by the pace of its looks and of its answers."""

import pytest

from rig.engine.dead_man import StagePace

STEP_MM, LOOK_S, HEARD_S = 0.0025, 0.02, 0.005


class Walked:
    """A stage that goes at a speed for so many looks."""

    def __init__(self) -> None:
        self.pace, self.t_s, self.gone_mm = StagePace(STEP_MM), 0.0, 0.0

    def looks(self, count: int, mm_s: float, *, at_rest: bool = False) -> StagePace:
        for _ in range(count):
            self.t_s += LOOK_S + HEARD_S
            self.gone_mm += mm_s * (LOOK_S + HEARD_S)
            self.pace.seen(self.t_s - HEARD_S, self.t_s, self.gone_mm, at_rest=at_rest)
        return self.pace


def _verdict(pace: StagePace) -> tuple[bool, bool]:
    return pace.doubtful, pace.stood


@pytest.mark.parametrize("mm_s", [0.1, 1.0, 5.0])
def test_a_stage_at_one_pace_is_not_doubted(mm_s: float) -> None:
    walked = Walked()
    walked.pace.accepted(0.003)
    assert _verdict(walked.looks(20, mm_s)) == (False, False)


@pytest.mark.parametrize(("to_mm_s", "doubted"), [(0.95, False), (0.7, True), (0.0, True)])
def test_one_that_slows_down_is_doubted_until_it_is_at_rest(to_mm_s: float, doubted: bool) -> None:
    """Over two looks, 0.05 s at 5 mm/s; what is surely gone in 0.045 s, and a step and the last digit less."""
    walked = Walked()
    walked.looks(6, 5.0)
    assert _verdict(walked.looks(2, 5.0 * to_mm_s)) == (doubted, False)
    assert walked.looks(1, 5.0).doubtful is doubted, "it stays"
    assert _verdict(walked.looks(1, 0.0, at_rest=True)) == (False, False)
    assert _verdict(walked.looks(3, 1.0)) == (False, False), "begun anew"


@pytest.mark.parametrize(("took_s", "doubted"), [(0.0109, False), (0.0111, True)])
def test_a_line_that_is_taken_in_late_is_a_doubt(took_s: float, doubted: bool) -> None:
    """Later than twice the quickest and 5 ms."""
    walked = Walked()
    for first_s in (0.004, 0.003, 0.0035):
        walked.pace.accepted(first_s)
    walked.looks(6, 5.0)
    walked.pace.accepted(took_s)
    assert _verdict(walked.looks(1, 5.0)) == (doubted, False)


def test_both_at_once_is_a_stage_that_stood() -> None:
    walked = Walked()
    walked.pace.accepted(0.003)
    walked.looks(6, 5.0)
    walked.pace.accepted(0.1)
    assert _verdict(walked.looks(1, 0.0)) == (True, True)
    assert walked.looks(1, 0.0).stood is False, "said once"


def test_what_rounding_hides_is_no_doubt() -> None:
    """At 0.1 mm/s two looks are 0.005 mm: a step and a digit are 0.0035."""
    walked = Walked()
    walked.looks(6, 0.1)
    assert walked.looks(2, 0.02).doubtful is False
