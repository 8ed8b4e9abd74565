"""What every test may use: the default fingertip, loaded once."""

import pytest

from sim.fingertip import Fingertip


@pytest.fixture(scope="session")
def finger() -> Fingertip:
    """The default fingertip, from the user's cache or built in seconds."""
    return Fingertip.load()
