"""Who lies under the rig: a code, never a name."""

import re

from rig.protocol.errors import BadInputError

_CODE = re.compile(r"[A-Z]{1,3}[0-9]{2,6}")


def checked_subject(code: str | None) -> str | None:
    """The code, if it is one: no name looks like it. Raises BadInputError."""
    if code is None or _CODE.fullmatch(code):
        return code
    raise BadInputError(
        "--subject: expected a code such as S07, one to three capital letters and two to six digits, never a name",
        code="no_subject_code",
    )
