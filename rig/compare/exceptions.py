"""Errors of the input to a comparison, in a module that commands can import quickly."""

from rig.errors import RigError


class ComparisonError(RigError, ValueError):
    """Runs and recordings that cannot be compared."""

    default_code = "comparison"


class FingersError(ComparisonError):
    """Plausible-fingers file that does not suit the runs; the message names file and key."""

    default_code = "fingers"


class RecordingError(RigError, ValueError):
    """Unusable recording; the message names file, row and column."""

    default_code = "recording"
