"""Before anybody mounts an indentor, the sensor names itself; if neither device answers, the ports may be swapped."""

from itertools import product
from types import SimpleNamespace
from typing import Any

import pytest

from rig.bench.real import WAKES_S, refuse_silent_sensor
from rig.devices.base import ForceError
from tests.contracts.force import Connected, ForceBytes
from tests.contracts.stage import StageBench, StageBytes
from tests.contracts.test_forces import DEVICES as SENSORS
from tests.contracts.test_stages import DEVICES as STAGES
from tests.error_codes import raises

PAIRS = [pytest.param(*pair, id=f"{pair[0].name}-{pair[1].name}") for pair in product(STAGES, SENSORS)]


def _bench(stage: StageBytes, sensor: ForceBytes) -> tuple[Any, StageBench, Connected]:
    stands, reads = StageBench(stage, connected=False), Connected(sensor)
    reads.wire.asked.clear()
    return SimpleNamespace(clock=reads.wire.clock, stage=stands.stage, force=reads.driver), stands, reads


@pytest.mark.parametrize(("stage", "sensor"), PAIRS)
def test_a_sensor_that_answers_is_only_identified(stage: StageBytes, sensor: ForceBytes) -> None:
    bench, stands, reads = _bench(stage, sensor)
    refuse_silent_sensor(bench)
    assert (reads.wire.asked, stands.wire.asked) == (list(sensor.on_identify), [])


@pytest.mark.parametrize(("stage", "sensor"), PAIRS)
def test_a_silent_sensor_is_reported_and_two_silent_devices_may_be_swapped(
    stage: StageBytes, sensor: ForceBytes
) -> None:
    bench, stands, reads = _bench(stage, sensor)
    reads.wire.silent = True
    begun_s = bench.clock.monotonic_s()
    with raises(ForceError, "no_device"):
        refuse_silent_sensor(bench)
    assert bench.clock.monotonic_s() - begun_s <= 2 * WAKES_S
    assert stage.trigger not in stands.wire.asked
    stands.wire.silent = True
    with raises(ForceError, "swapped_ports"):
        refuse_silent_sensor(bench)
    assert set(reads.wire.asked) <= {*sensor.on_identify, *sensor.again}
