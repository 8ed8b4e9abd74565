"""What every test may use: the default fingertip, loaded once."""

from collections.abc import Callable

import pytest

from sim.models.fingertip import Fingertip


@pytest.fixture(scope="session")
def finger() -> Fingertip:
    """The default fingertip, from the user's cache or built in seconds."""
    return Fingertip.load()


@pytest.fixture
def rtu() -> Callable[[str], bytes]:
    """A Modbus RTU frame from its hex digits, with the CRC computed bit by bit here and nowhere else."""

    def frame(digits: str) -> bytes:
        content, crc = bytes.fromhex(digits), 0xFFFF
        for byte in content:
            crc ^= byte
            for _ in range(8):
                crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
        return content + crc.to_bytes(2, "little")

    return frame
