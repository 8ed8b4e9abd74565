"""Every kind of finger that the program serves or rehearses is identified, by the shipped force tables."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rig.cli.identify_finger import is_virtual, scope_of, usual_goals
from rig.identify.adaptive_presses import SHAPES, Identification, IdentificationOptions, with_reliable_touch
from rig.identify.random_finger import truth_of
from rig.plan.config import Config
from sim.config import FingertipConfig
from sim.identification.next_press import held_gwt
from sim.identification.posterior import parameter_bands
from sim.identification.predicted_forces import MeasuredPress, PredictedForces, nominal_trajectory
from sim.identification.prior import Prior
from tests.made_up_fingers import pressed

PRIOR = Prior()
OPTIONS = IdentificationOptions(usual_goals(SHAPES))
SHARES = tuple(0.1 * k for k in range(1, 11))
SHAPE_SD = 0.007  # of a shape's force, as between the tables and the bench

DEFAULT = {
    "ln_stiffness": 0.0, "ln_e_dermis": np.log(0.1), "ln_e_fat": np.log(0.1), "stiffening": 0.0, "share_fast": 0.0,
    "share_slow": 0.0, "ln_tau_slow_s": np.log(1.4), "x_mm": 0.0, "height_mm": 0.0,
}  # fmt: skip
CASES: Mapping[str, Mapping[str, float]] = {
    "default": {},
    "half as stiff": {"ln_stiffness": np.log(0.5)},
    "twice as stiff": {"ln_stiffness": np.log(2.0)},
    "least stiffening": {"stiffening": 0.02},
    "most stiffening": {"stiffening": 0.8},
    "relaxing": {"share_fast": 0.2, "share_slow": 0.2},
    "varied moduli": {"ln_e_dermis": np.log(0.2), "ln_e_fat": np.log(0.06)},
    "random finger 7": truth_of(7),
}
NOISE_GWT = {"random finger 7": 0.02}


@cache
def _predicted() -> PredictedForces:
    return PredictedForces.over(FingertipConfig(), PRIOR, *scope_of(OPTIONS))


def _identified(
    truth: np.ndarray,
    noise_gwt: float,
    changed: Callable[[MeasuredPress], MeasuredPress] = lambda measured: measured,
) -> Identification:
    chance = np.random.default_rng(1)
    off = {shape: float(np.exp(SHAPE_SD * chance.standard_normal())) for shape in SHAPES}
    identification = Identification(with_reliable_touch(Config()), _predicted(), OPTIONS)
    while not identification.enough:
        press = identification.next()
        way = nominal_trajectory(press.indentor, press.x_mm, press.doi_mm, identification.chooser.pace, SHARES)
        measured = pressed(_predicted(), truth, way, chance, noise_gwt)
        measured = replace(measured, force_gwt=off[press.indentor] * measured.force_gwt)
        identification.take(press, changed(measured))
    return identification


@pytest.mark.quick(rows=lambda name: name in ("default", "random finger 7"))
@pytest.mark.parametrize("name", CASES)
def test_it_is_identified_and_its_forces_lie_in_their_bands(name: str) -> None:
    numbers = {**DEFAULT, **CASES[name]}
    truth = np.array([numbers[one] for one in PRIOR.names])
    identification = _identified(truth, NOISE_GWT.get(name, 0.001))
    assert identification.flag is None
    true = [held_gwt(_predicted(), truth[None], goal, identification.chooser.pace)[0] for goal in OPTIONS.goals]
    assert sum(w.low <= t <= w.high for w, t in zip(identification.widths, true, strict=True)) >= 4
    assert all(one.low <= one.estimate <= one.high for one in parameter_bands(identification.learned))
    for name in ("stiffening", "share_slow"):  # 0 in some kinds of tissue
        none = identification.learned.draws[:, PRIOR.index(name)] == 0
        assert none.mean() == pytest.approx(float(numbers[name] == 0), abs=0.3)


@pytest.mark.quick(rows=lambda power: power > 0)
@pytest.mark.parametrize("power", [0.4, -0.4])
def test_force_that_grows_as_in_no_finger_is_flagged(power: float) -> None:
    """Bone under the skin, and rubber: no kind of tissue takes them in."""

    def changed(measured: MeasuredPress) -> MeasuredPress:
        share = np.clip(measured.force_gwt / measured.force_gwt.max(), 0.02, 1.0)
        return replace(measured, force_gwt=measured.force_gwt * share**power)

    truth = np.array([DEFAULT[one] for one in PRIOR.names])
    assert _identified(truth, 0.02, changed).flag == "no_finger"


@pytest.mark.parametrize(
    ("stage", "force", "virtual"),
    [
        ("tcp://127.0.0.1:5000", "tcp://localhost:5001", True),
        ("/dev/pts/3", "/dev/pts/4", True),
        ("/dev/ttyUSB0", "tcp://127.0.0.1:5001", False),
        ("tcp://10.0.0.7:5000", "tcp://10.0.0.7:5001", False),
    ],
)
def test_a_bench_is_virtual_if_this_machine_serves_both_ports(stage: str, force: str, virtual: bool) -> None:
    config = Config.model_validate({"stage": {"port": stage}, "force": {"port": force}})
    assert is_virtual(config) == virtual
