"""Errors of a parameter study, in a module that commands can import quickly."""

from rig.errors import RigError


class StudyError(RigError, ValueError):
    """Invalid study file; the message names file and key."""

    default_code = "study"


class WorkersError(RigError):
    """Tasks that cannot be distributed, or whose workers have gone."""

    default_code = "workers"
