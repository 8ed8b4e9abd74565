"""Modbus clients that were not written here, against the virtual devices in real time: pseudo-terminal and TCP.

minimalmodbus and modbus-tk come with the dev extra; mbpoll (libmodbus) is a Debian package of that name.
"""

import re
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import serial

from rig.bench.served import ServedBench
from rig.clock import WallClock
from rig.devices.make_drivers import open_stage
from rig.plan.config import Config
from tests.waiting import DEADLINE_S, until

FROM_DEV = "comes with the dev extra"
minimalmodbus = pytest.importorskip("minimalmodbus", reason=FROM_DEV)
defines = pytest.importorskip("modbus_tk.defines", reason=FROM_DEV)
modbus_rtu = pytest.importorskip("modbus_tk.modbus_rtu", reason=FROM_DEV)
modbus_tcp = pytest.importorskip("modbus_tk.modbus_tcp", reason=FROM_DEV)
modbus_errors = pytest.importorskip("modbus_tk.exceptions", reason=FROM_DEV)
MBPOLL = shutil.which("mbpoll")
needs_mbpoll = pytest.mark.skipif(MBPOLL is None, reason="mbpoll is not installed (Debian package mbpoll)")
BAUD = 115200
CONFIG = Config.model_validate({"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": BAUD}})
PR0_MINUS_100000 = [0x0001, 0xFFFE, 0x7960, 600, 100, 100, 0, 0]


@contextmanager
def _served(kind: str, tcp: int | None) -> Iterator[str]:
    """The port of one virtual device, served from a thread of this process."""
    stage, force = (kind, None) if kind == "leadshine" else (None, kind)
    with ServedBench(CONFIG, stage=stage, force=force, tcp=tcp) as bench, _running(bench):
        yield next(iter(bench.ports.values()))


@contextmanager
def _running(bench: ServedBench) -> Iterator[None]:
    thread = threading.Thread(target=bench.run)
    thread.start()
    try:
        yield
    finally:
        bench.stop()
        thread.join(DEADLINE_S)
        assert not thread.is_alive()


def _host_and_number(port: str) -> tuple[str, int]:
    host, number = port.removeprefix("tcp://").split(":")
    return host, int(number)


@pytest.fixture
def drives_on_pty() -> Iterator[str]:
    with _served("leadshine", None) as port:
        yield port


@pytest.fixture
def drives_on_tcp() -> Iterator[tuple[str, int]]:
    with _served("leadshine", 0) as port:
        yield _host_and_number(port)


@pytest.fixture
def cell_on_pty() -> Iterator[str]:
    with _served("laumas", None) as port:
        yield port


@pytest.fixture
def cell_on_tcp() -> Iterator[tuple[str, int]]:
    with _served("laumas", 0) as port:
        yield _host_and_number(port)


# --- minimalmodbus, RTU ---


def _minimal(port: str, device: int) -> Any:
    instrument = minimalmodbus.Instrument(port, device, close_port_after_each_call=True)
    instrument.serial.baudrate = BAUD
    instrument.serial.timeout = 1.0
    return instrument


def test_minimalmodbus_moves_a_drive(drives_on_pty: str) -> None:
    """An absolute path of 200 pulses at 600 rpm, triggered in 6002; then back by the mirror at 6207."""
    drive = _minimal(drives_on_pty, 2)
    assert drive.read_register(0x1003) == 0x32
    drive.write_registers(0x6200, [0x0001, 0, 200, 600, 100, 100, 0, 0])
    drive.write_register(0x6002, 0x10, functioncode=6)
    until(lambda: drive.read_register(0x1003) == 0x32)
    assert drive.read_long(0x1014, signed=True, byteorder=minimalmodbus.BYTEORDER_BIG) == 200
    drive.write_registers(0x6200, [0x0001, 0xFFFF, 0xFF38, 600, 100, 100, 0, 0x10])
    until(lambda: drive.read_register(0x1003) == 0x32)
    assert drive.read_long(0x602C, signed=True) == -200


def test_minimalmodbus_reads_a_weight(cell_on_pty: str) -> None:
    cell = _minimal(cell_on_pty, 1)
    assert cell.read_registers(6, 8) == [0x1800, 0, 0, 0, 0, 0, 0, 0x010C]
    assert cell.read_long(7) == 0
    cell.write_register(5, 8, functioncode=16)
    with pytest.raises(minimalmodbus.IllegalRequestError):
        cell.write_register(5, 8, functioncode=6)


# --- modbus-tk, RTU and TCP ---


def test_modbus_tk_reads_and_writes_a_drive_on_a_serial_line(drives_on_pty: str) -> None:
    with serial.Serial(drives_on_pty, BAUD) as port:
        master = modbus_rtu.RtuMaster(port)
        master.set_timeout(1.0)
        assert master.execute(1, defines.READ_HOLDING_REGISTERS, 0x1003, 1) == (0x32,)
        written = master.execute(1, defines.WRITE_MULTIPLE_REGISTERS, 0x6200, output_value=PR0_MINUS_100000)
        assert written == (0x6200, 8)
        assert master.execute(1, defines.READ_HOLDING_REGISTERS, 0x6201, 2, data_format=">i") == (-100000,)


def test_modbus_tk_reads_and_writes_a_drive_over_tcp(drives_on_tcp: tuple[str, int]) -> None:
    master = modbus_tcp.TcpMaster(*drives_on_tcp, timeout_in_sec=1.0)
    try:
        assert master.execute(2, defines.READ_HOLDING_REGISTERS, 0x1003, 1) == (0x32,)
        assert master.execute(2, defines.WRITE_SINGLE_REGISTER, 0x1801, output_value=0x2244) == (0x1801, 0x2244)
        with pytest.raises(modbus_errors.ModbusError) as caught:
            master.execute(2, defines.READ_HOLDING_REGISTERS, 0x1234, 1)
        assert caught.value.get_exception_code() == defines.ILLEGAL_DATA_ADDRESS
        with pytest.raises(modbus_errors.ModbusError) as caught:
            master.execute(2, defines.READ_COILS, 0, 1)
        assert caught.value.get_exception_code() == defines.ILLEGAL_FUNCTION
    finally:
        master.close()


def test_modbus_tk_weighs_over_tcp(cell_on_tcp: tuple[str, int]) -> None:
    master = modbus_tcp.TcpMaster(*cell_on_tcp, timeout_in_sec=1.0)
    try:
        assert master.execute(1, defines.READ_HOLDING_REGISTERS, 6, 8) == (0x1800, 0, 0, 0, 0, 0, 0, 0x010C)
        assert master.execute(1, defines.WRITE_MULTIPLE_REGISTERS, 5, output_value=[7]) == (5, 1)
        assert master.execute(1, defines.READ_HOLDING_REGISTERS, 6, 1) == (0x1C00,)
    finally:
        master.close()


# --- mbpoll ---


def _mbpoll(*words: str) -> str:
    assert MBPOLL is not None
    done = subprocess.run([MBPOLL, *words], capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    return done.stdout + done.stderr


def _values(printed: str) -> dict[int, str]:
    return {int(n): value.strip() for n, value in re.findall(r"^\[(\d+)\]:\s*(\S+)", printed, re.MULTILINE)}


@needs_mbpoll
def test_mbpoll_writes_and_reads_eight_registers_over_tcp(drives_on_tcp: tuple[str, int]) -> None:
    host, port = drives_on_tcp
    common = ["-m", "tcp", "-p", str(port), "-a", "1", "-0", "-r", "25088"]
    assert "Written 8 references" in _mbpoll(*common, "-t", "4:hex", host, *(f"0x{v:04X}" for v in PR0_MINUS_100000))
    read = _values(_mbpoll(*common, "-t", "4:hex", "-c", "8", "-1", host))
    assert [int(read[25088 + n], 16) for n in range(8)] == PR0_MINUS_100000


@needs_mbpoll
def test_mbpoll_reads_32_bit_values_with_the_high_word_first(drives_on_tcp: tuple[str, int]) -> None:
    """`-B`: 32-bit values high word first."""
    host, port = drives_on_tcp
    common = ["-m", "tcp", "-p", str(port), "-a", "2", "-0", "-r", "25089", "-t", "4:int", "-B"]
    assert "Written 1 references" in _mbpoll(*common, host, "--", "-100000")
    assert _values(_mbpoll(*common, "-c", "1", "-1", host))[25089] == "-100000"
    hexes = _mbpoll(
        "-m", "tcp", "-p", str(port), "-a", "2", "-0", "-r", "25089", "-t", "4:hex", "-c", "2", "-1", host
    )
    assert _values(hexes) == {25089: "0xFFFE", 25090: "0x7960"}


@needs_mbpoll
def test_mbpoll_reads_drive_and_transmitter_on_a_serial_line(drives_on_pty: str, cell_on_pty: str) -> None:
    common = ["-m", "rtu", "-b", str(BAUD), "-P", "none", "-0", "-t", "4:hex", "-1"]
    assert _values(_mbpoll(*common, "-a", "1", "-r", "4099", "-c", "1", drives_on_pty)) == {4099: "0x0032"}
    weight = _values(_mbpoll(*common, "-a", "1", "-r", "6", "-c", "8", cell_on_pty))
    assert (weight[6], weight[13]) == ("0x1800", "0x010C")
    assert "Illegal data address" in _mbpoll(*common, "-a", "1", "-r", "4660", "-c", "1", drives_on_pty)
    assert "timed out" in _mbpoll(*common, "-a", "9", "-o", "0.2", "-r", "4099", "-c", "1", drives_on_pty)


# --- and our own driver, in real time ---


@pytest.mark.quick(rows=lambda tcp: tcp is None)
@pytest.mark.parametrize("tcp", [None, 0], ids=["rtu on a pty", "tcp"])
def test_the_leadshine_driver_homes_moves_and_stops_in_real_time(tcp: int | None) -> None:
    with _served("leadshine", tcp) as port:
        fast = {"homing_high_rpm": 600, "homing_low_rpm": 100}
        drives = {"x": {"device_id": 1, **fast}, "z": {"device_id": 2, **fast}}
        config = Config.model_validate({"stage": {"kind": "leadshine", "port": port, "drives": drives}})
        stage = open_stage(config, WallClock())
        try:
            assert "Leadshine drive 2" in stage.connect()
            stage.home()
            stage.move_to(z_mm=-1.0, speed_mm_s=5.0)
            assert stage.status().z_mm == pytest.approx(-1.0, abs=0.0013)
            stage.stop()  # raises where one still runs after a second
            assert stage.status().state == "Idle"
        finally:
            stage.close()
