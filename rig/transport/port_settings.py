"""Tables of the configuration file, and the names of ports in them."""

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict

Framing = Literal["rtu", "tcp"]


class Settings(BaseModel):
    """A table of the configuration file; every value is checked, none may be NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _addressed(port: str) -> str:
    if not port or (port.startswith("tcp://") and not re.fullmatch(r"tcp://[^/]+:\d{1,5}", port)):
        raise ValueError("expected tcp://HOST:PORT or the name of a serial port")
    return port


Port = Annotated[str, AfterValidator(_addressed)]
