"""Clients of others against the virtual Net F/T, and the driver over real datagrams, all on loopback addresses."""

import itertools
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from importlib.util import find_spec

import pytest

from rig.bench.served import ServedBench
from rig.clock import WallClock
from rig.devices.base import ForceReading, ForceSensor, ForceTimeout
from rig.devices.make_drivers import open_force
from rig.plan.config import Config
from rig.units import GWT_N
from sim.devices.line import Load, SerialLine, VirtualForceSpec
from sim.devices.net_ft import VirtualNetFt
from sim.serve.ports import UdpPort
from sim.serve.real_time_loop import WallScheduler
from tests.waiting import DEADLINE_S, until

GRAMS = 50.0
COUNTS = -round(1000 * GRAMS)


@contextmanager
def _served(rate_hz: float = 1000.0) -> Iterator[tuple[int, VirtualNetFt]]:
    """The number of both ports of a virtual sensor under 50 g, served from a thread of this process."""
    scheduler = WallScheduler()
    line = SerialLine(scheduler, 1e9)
    load = Load(lambda t_s: GRAMS * GWT_N)
    sensor = VirtualNetFt(scheduler, line, load, VirtualForceSpec(0.01, 0.01, own={"press": "-z"}), rate_hz)
    port = UdpPort(scheduler, line, 0)
    port.listen()
    thread = threading.Thread(target=scheduler.run)
    thread.start()
    try:
        yield int(port.name.rpartition(":")[2]), sensor
    finally:
        scheduler.stop()
        thread.join(DEADLINE_S)
        assert not thread.is_alive()
        port.close()
        scheduler.close()


def _patiently(ask: Callable[[], object]) -> None:
    """Until it succeeds: a busy machine may exceed the maximum sample age."""

    def asked() -> bool:
        with suppress(ForceTimeout):
            ask()
            return True
        return False

    until(asked)


def _reading(force: ForceSensor) -> ForceReading:
    found = list[ForceReading]()
    _patiently(lambda: found.append(force.read()))
    return found[0]


@pytest.mark.skipif(find_spec("pynetft") is None, reason="pynetft comes with the dev extra")
def test_pynetft_reads_and_biases_the_virtual_net_ft_sensor() -> None:
    import pynetft

    with _served() as (number, sensor):
        config = pynetft.Config(sensor_host="127.0.0.1", rdt_port=number, http_port=number, receive_timeout=5.0)
        with pynetft.Client(config, queue_size=4096) as client:
            samples = client.samples(timeout=DEADLINE_S)
            found = [next(samples) for _ in range(500)]
            assert {sample.raw_wrench for sample in found} == {(0, 0, COUNTS, 0, 0, 0)}
            assert found[0].force[2] == pytest.approx(-1e-3 * GRAMS)
            assert found[0].force_unit == pynetft.ForceUnit.KILOGRAM_FORCE
            numbers = [sample.rdt_sequence for sample in found]
            assert numbers == list(range(numbers[0], numbers[0] + 500))
            health = client.health()
            assert health.sensor_configuration is not None
            assert health.sensor_configuration.product_name == "Virtual Net F/T"
            assert health.sensor_configuration.calibration.counts_per_force_unit == 1e6
            client.bias()
            until(lambda: next(samples).raw_wrench[2] == 0)
            sensor.status = 0x80010000
            until(lambda: next(samples).status == 0x80010000)
            assert until(lambda: client.health().warning_count) > 0
            sensor.status = 0x80020000
            until(lambda: client.health().device_error_count)


def test_the_net_ft_driver_reads_and_zeroes_over_real_datagrams() -> None:
    with _served() as (number, sensor):
        table = {"kind": "net_ft", "port": f"udp://127.0.0.1:{number}", "net_ft": {"http_port": number}}
        config = Config.model_validate({"force": table})
        with closing(open_force(config, WallClock())) as force:
            assert "Virtual Net F/T" in force.connect()
            for _ in range(20):
                began_s = WallClock().monotonic_s()
                reading = _reading(force)
                assert reading.t_s >= began_s
                assert reading.force_n == pytest.approx(GRAMS * GWT_N, abs=1e-6)
                assert reading.also["packets_lost"] == 0
            jumps = itertools.count(5000, 5000)

            def lost() -> bool:
                sensor.start_at(next(jumps))
                return _reading(force).also["packets_lost"] > 0

            until(lost)
            _patiently(force.zero)
            assert _reading(force).force_n == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("tcp", [None, 0])
def test_rig_serve_offers_net_ft_records_and_settings_page_at_one_port_number(tcp: int | None) -> None:
    with ServedBench(Config(), stage=None, force="net_ft", tcp=tcp) as bench:
        thread = threading.Thread(target=bench.run)
        thread.start()
        try:
            port = bench.ports["force"]
            number = int(port.rpartition(":")[2])
            table = {"kind": "net_ft", "port": port, "net_ft": {"http_port": number}}
            with closing(open_force(Config.model_validate({"force": table}), WallClock())) as force:
                assert "Virtual Net F/T" in force.connect()
                assert _reading(force).force_n == 0.0
        finally:
            bench.stop()
            thread.join(DEADLINE_S)
