"""Tables of the configuration file, and the names of ports in them."""

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict

from rig.errors import RuleError

Framing = Literal["rtu", "tcp"]
EIGHT_N_ONE = "8N1"


class Settings(BaseModel):
    """A table of the configuration file; every value is checked, none may be NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _addressed(port: str) -> str:
    if not port.strip() or (port.startswith("tcp://") and not re.fullmatch(r"tcp://[^/]+:\d{1,5}", port)):
        raise RuleError("expected tcp://HOST:PORT or the name of a serial port", code="no_port_name")
    return port


def _spelled(character: str) -> str:
    if not re.fullmatch(r"[78][NEO][12]", character):
        raise RuleError("expected data bits, parity and stop bits, such as 8N1 or 7E1", code="no_character")
    return character


Character = Annotated[str, AfterValidator(_spelled)]
"""Of a serial line: data bits, parity (none, even, odd) and stop bits."""

Port = Annotated[str, AfterValidator(_addressed)]
