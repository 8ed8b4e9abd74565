"""What can be wrong with a parameter study; apart, so that commands may know of it cheaply."""

from rig.errors import RigError


class StudyError(RigError, ValueError):
    """The file of a study is not understood; the message names file and key."""

    default_code = "study"


class WorkersError(RigError):
    """The work cannot be given out, or those who did it have gone."""

    default_code = "workers"
