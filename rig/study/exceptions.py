"""Errors of a parameter study, in a module that commands can import quickly."""

from rig.errors import RigError


class StudyError(RigError, ValueError):
    """The file of a study is not understood; the message names file and key."""

    default_code = "study"


class WorkersError(RigError):
    """The work cannot be given out, or those who did it have gone."""

    default_code = "workers"
