"""What the owner of a port is at, for whoever finds the port busy."""

from datetime import datetime

from rig.session.control.announcements import Announced, ControlError, announced

_ANSWER_S = 0.5


def at_work(owner: int) -> dict[str, str]:
    """What a process does, since when, and what stops it; nothing of one that has not announced itself."""
    try:
        found = next((one for one in announced() if one.pid == owner), None)
    except OSError:  # nobody can be announced there
        found = None
    if found is None:
        return {}
    since = datetime.fromtimestamp(found.began_unix_s).isoformat(" ", "seconds")
    return {"does": f"{_what(found)}, {_state(found)}", "since": since, "stopped by": _stop(found)}


def _what(owner: Announced) -> str:
    return owner.kind if owner.protocol is None else f"{owner.kind} of {owner.protocol}"


def _state(owner: Announced) -> str:
    try:
        return str(owner.ask("status", within_s=_ANSWER_S)["state"])
    except ControlError as error:
        return str(error)


def _stop(owner: Announced) -> str:
    return "rig stop" if owner.config is None else f"rig stop --config {owner.config}"
