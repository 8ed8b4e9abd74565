"""Errors of the input to a design, in a module that commands can import quickly."""

from rig.errors import RigError


class DesignError(RigError, ValueError):
    """Input from which no presses can be chosen."""

    default_code = "design"
