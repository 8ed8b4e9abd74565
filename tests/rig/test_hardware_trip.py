"""The transmitter's relay on the stage's stop input: it stops a press with the program frozen, on both stages."""

import io
from typing import Any

import pytest

from rig.bench.virtual import VirtualBench, bench_around
from rig.data.journal import NoJournal
from rig.engine import Engine, RunAborted, TripError, verbs
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.session.hardware_stop import explained_by_stop_inputs, refuse_stop_inputs, stop_inputs_of
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.rig.hand_bench import Spring

K_GWT, CONTACT_MM = 30.0, -0.1  # five times as stiff as a finger
STAGES = {"grbl": ("hold", "door"), "leadshine": ("di2",)}
CASES = [(stage, name) for stage, names in STAGES.items() for name in names]


def _config(stage: str, **stop: Any) -> Config:
    return Config.model_validate(
        {
            "stage": {"kind": stage},
            "force": {"kind": "laumas", "baud": 115200, "sample_period_s": 0.0125},
            "stop": stop,
        }
    )


def _bench(config: Config) -> VirtualBench:
    clock = VirtualClock(1.7e9)
    return bench_around(lambda carriage: Spring(carriage, K_GWT, CONTACT_MM), config, clock, io.StringIO())


def _worst_gwt(bench: VirtualBench, for_s: float) -> float:
    """While the program does nothing at all."""
    worst = 0.0
    until_s = bench.clock.monotonic_s() + for_s
    while bench.clock.monotonic_s() < until_s:
        bench.clock.wait_s(0.002)
        worst = max(worst, bench.plant.force_n(bench.clock.monotonic_s()) / GWT_N)
    return worst


def frozen(stage: str, name: str | None, speed_mm_s: float, set_point_gwt: float = 60.0) -> float:
    """The worst force (gwt) where the program is frozen in a move of 3 mm into the finger."""
    wired = {} if name is None else {"trip_input": name, "trip_gwt": set_point_gwt}
    bench = _bench(_config(stage, **wired))
    bench.stage.connect()
    bench.stage.home()
    frame = Config().frame
    bench.stage.move_to(x_mm=frame.pad_centre_x_mm, speed_mm_s=10)
    bench.stage.move_to(z_mm=frame.apex_z_mm + 0.5, speed_mm_s=10)
    next(bench.stage.moving(z_mm=frame.apex_z_mm - 2.5, speed_mm_s=speed_mm_s))
    return _worst_gwt(bench, 4 / speed_mm_s + 2)


@pytest.mark.parametrize(("stage", "name"), CASES)
@pytest.mark.parametrize("speed_mm_s", [0.5, 5.0])
def test_the_relay_stops_a_press_whose_program_is_frozen(stage: str, name: str, speed_mm_s: float) -> None:
    """Without it the move goes on to its end. With it: two samples of 12.5 ms, and the way to a stop."""
    without, with_it = frozen(stage, None, speed_mm_s), frozen(stage, name, speed_mm_s)
    assert without > 110
    stiffness_gwt_mm = 1.5 * K_GWT ** (2 / 3) * 60 ** (1 / 3)
    stop_mm = speed_mm_s * (4 * 0.0125 + 0.01 + 0.1) + speed_mm_s**2 / (2 * 50)
    assert 60 <= with_it < 60 + 1.3 * stiffness_gwt_mm * stop_mm


@pytest.mark.parametrize(("stage", "name"), CASES)
def test_a_press_that_the_relay_stops_trips(stage: str, name: str) -> None:
    """Its set-point lies below the soft trip here: it should lie above the hard one."""
    config = _config(stage, trip_input=name, trip_gwt=2.0)
    bench = _bench(config)
    engine = Engine(config, bench, NoJournal(), stop_inputs=stop_inputs_of(config, None))
    refuse_stop_inputs(config, bench)
    with raises(TripError, "hardware_trip", trip_input=name):
        _pressed(config, engine)


def _pressed(config: Config, engine: Engine) -> None:
    with explained_by_stop_inputs(config, engine.bench.stage):
        verbs.mount(engine, "bar:3.0")
        verbs.home(engine)
        verbs.zero(engine)
        verbs.move_to(engine, 0.0)
        while True:
            engine.go_to_height(engine.height_mm - 0.05, 0.5)
            engine.reading()


@pytest.mark.parametrize(("stage", "name"), CASES)
def test_a_relay_set_point_other_than_the_configured_one_is_refused(
    stage: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = _config(stage, trip_input=name, trip_gwt=200.0)
    bench = _bench(told)
    refuse_stop_inputs(told, bench)
    for other_gwt in (100.0, 190.0, 210.0, 2000.0):
        with raises(BadInputError, "another_set_point", key="stop.trip_gwt", value=other_gwt, found_gwt=200.0):
            refuse_stop_inputs(_config(stage, trip_input=name, trip_gwt=other_gwt), bench)


def test_the_stop_button_is_told_apart_from_the_relay() -> None:
    config = _config("grbl", kind="board", input="door", trip_input="hold", trip_gwt=200.0)
    bench = _bench(config)
    engine = Engine(config, bench, NoJournal(), stop_inputs=stop_inputs_of(config, None))
    bench.clock.call_at(30.0, lambda: bench.board.press("door"))  # type: ignore[union-attr]
    with raises(RunAborted, "stop_button"):
        _pressed(config, engine)
