"""Errors of the input to a comparison, in a module that commands can import quickly."""

from rig.errors import RigError


class ComparisonError(RigError, ValueError):
    """The runs and recordings do not go together."""

    default_code = "comparison"


class FingersError(ComparisonError):
    """The file of plausible fingers cannot be used with these runs; the message names file and key."""

    default_code = "fingers"


class RecordingError(RigError, ValueError):
    """A recording cannot be used; the message names file, row and column."""

    default_code = "recording"
