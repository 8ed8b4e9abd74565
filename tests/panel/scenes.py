"""States of the bench as the panel's server tells them, to be drawn and looked at."""

import math
from collections.abc import Sequence
from typing import Any

COLUMNS = ("unix_s", "t_s", "force_gwt", "doi_mm", "x_mm", "height_mm", "phase", "index", "purpose")
RUN = "20260301T101500Z-steps-a1b2c3"


def bench(**other: Any) -> dict[str, Any]:
    """Nothing is running."""
    return {
        "controls": None,
        "configured": True,
        "owner": None,
        "run": None,
        "hand": None,
        "notice": None,
        "problem": None,
        "others": [],
        "devices": {
            "stage": {"word": "no data", "homed": None, "age_s": None},
            "force": {"word": "no data", "age_s": None},
        },
        "newest": {"force_gwt": None, "age_s": None},
        "attention": None,
        "limits": {"trip_gwt": 20.39, "max_doi_mm": 1.5},
        **other,
    }


def running(state: str = "running", **other: Any) -> dict[str, Any]:
    """A run on the virtual bench, in its ninth press of sixty."""
    run = {
        "folder": f"runs/{RUN}",
        "name": RUN,
        "protocol": "steps",
        "subject": "S07",
        "state": state,
        "now": "step:1 at −0.40 mm, to 2.33 gwt",
        "next": "step:1 at −0.20 mm, to 2.33 gwt",
        "left_s": 1034.0,
        "done": 8,
        "planned": 60,
        "problem": None,
    }
    owner = {
        "kind": "run",
        "pid": 4711,
        "virtual": True,
        "ports": ["/dev/ttyACM0", "/dev/ttyUSB0"],
        "state": state,
        "stopped": False,
        "reachable": True,
    }
    devices = {"stage": {"word": "press", "homed": True, "age_s": 0.05}, "force": {"word": "reads", "age_s": 0.05}}
    newest = {
        "force_gwt": 2.341,
        "doi_mm": 0.412,
        "x_mm": -0.4,
        "y_mm": 0.0,
        "height_mm": -0.398,
        "phase": "press",
        "t_s": 31.0,
        "age_s": 0.05,
        "placed_age_s": 0.05,
    }
    return bench(owner=owner, run=run, devices=devices, newest=newest, **other)


def by_hand(**other: Any) -> dict[str, Any]:
    """The stage is taken by hand, homed and zeroed."""
    hand = {
        "state": "Idle",
        "x_mm": 1.2,
        "y_mm": 0.0,
        "z_mm": -20.0,
        "height_mm": 3.0,
        "force_gwt": 0.01,
        "homed": True,
        "zeroed": True,
        "trip_gwt": 203.9,
        "busy": None,
        "did": None,
        "ended_by": None,
        "stopped": False,
        "next": None,
        **other,
    }
    owner = {
        "kind": "by hand",
        "pid": 4712,
        "virtual": False,
        "ports": ["/dev/ttyACM0", "/dev/ttyUSB0"],
        "state": "Idle",
        "stopped": hand["stopped"],
        "reachable": True,
    }
    devices = {
        "stage": {"word": "Idle", "homed": hand["homed"], "age_s": 0.05},
        "force": {"word": "reads", "age_s": 0.05},
    }
    newest = {
        "force_gwt": 0.01,
        "doi_mm": None,
        "x_mm": 1.2,
        "y_mm": 0.0,
        "height_mm": 3.0,
        "phase": None,
        "t_s": 5.0,
        "age_s": 0.05,
        "placed_age_s": 0.05,
    }
    return bench(owner=owner, hand=hand, devices=devices, newest=newest)


def schedule(presses: int = 60, done: int = 8) -> dict[str, Any]:
    """Home, zero, presses in two blocks, one of them now."""
    first = [
        {"index": None, "words": words, "block": None, "repeat": None, "condition": None, "done": True, "now": False}
        for words in ("home", "zero")
    ]
    steps = [
        {
            "index": n,
            "words": f"step:1 at {-2 + 0.2 * (n % 30):+.2f} mm, to 2.33 gwt",
            "block": 1 + n // 30,
            "repeat": 1,
            "condition": f"x {-2 + 0.2 * (n % 30):+.2f}",
            "done": n < done,
            "now": n == done,
            "purpose": "data",
        }
        for n in range(presses)
    ]
    return {"run": RUN, "steps": first + steps}


def section() -> dict[str, Any]:
    """An ellipse for a finger, a smaller one within, a bone, a bar 3 mm wide; flat under it at each depth."""

    def ellipse(a: float, b: float, z: float) -> list[list[float]]:
        return [[a * math.sin(2 * math.pi * k / 90), z + b * math.cos(2 * math.pi * k / 90)] for k in range(90)]

    def depth(doi_mm: float) -> dict[str, Any]:
        upper = [(0.1 * k, 6.5 * math.sqrt(1 - (0.1 * k / 8) ** 2) - 6.5) for k in range(-40, 41)]
        skin = [[x, min(z, -doi_mm) if abs(x) <= 1.5 else z] for x, z in upper]
        return {"doi_mm": doi_mm, "force_gwt": 8.56 * doi_mm**1.5, "contact": [[-1.4, 1.4]], "skin": skin}

    return {
        "run": RUN,
        "index": 8,
        "purpose": "data",
        "skin": ellipse(8, 6.5, -6.5),
        "layers": [ellipse(7.2, 5.8, -6.5)],
        "bone": ellipse(3.4, 2.6, -7.5),
        "nail": None,
        "indentor": [[-1.5, 6], [-1.5, 0], [1.5, 0], [1.5, 6]],
        "depths": [depth(0.1 * n) for n in range(1, 6)],
    }


def readings(unix_s: float, upto_s: float = 31.0, each_s: float = 0.1) -> list[Sequence[Any]]:
    """Presses of ten seconds each, some noise that is the same each time; the last is of this instant."""
    rows: list[Sequence[Any]] = []
    for n in range(round(upto_s / each_s) + 1):
        t_s = n * each_s
        inside = t_s % 10
        depth = max(0.0, min(inside - 3, 0.42 * 5, (9.0 - inside) * 4) / 5)
        force = 8.4 * depth**1.5 + 0.01 * math.sin(37 * t_s)
        phase = "approach" if inside < 3 else "press" if inside < 5.2 else "hold" if inside < 9 else "retract"
        index = 5 + int(t_s // 10)
        touched = inside >= 3
        x_mm, height_mm = -1 + 0.2 * (index - 5), -depth if touched else 3 - inside
        doi_mm = round(depth, 4) if touched else None
        rows.append((unix_s - upto_s + t_s, t_s, round(force, 3), doi_mm, x_mm, height_mm, phase, index, "data"))
    return rows


def runs(n: int = 3) -> list[dict[str, Any]]:
    """As `rig runs --json` lists them."""
    states = ("done", "aborted", "tripped")
    return [
        {
            "name": f"20260301T10{k:02d}00Z-steps-{k:06d}",
            "date_utc": f"2026-03-01T10:{k:02d}:00+00:00",
            "protocol": "steps",
            "title": "Steps",
            "subject": "S07" if k % 2 else "",
            "shapes": ["step:1", "bar:3.0"][: 1 + k % 2],
            "state": states[k % 3],
            "virtual": k % 2 == 0,
            "planned": 21,
            "done": 21 - k % 3,
            "duration_s": 305.0,
        }
        for k in range(n)
    ]


def attention(status: str, reason: str, *, may_touch: bool) -> dict[str, Any]:
    """What a person must do now."""
    return {
        "status": status,
        "reason_text": reason,
        "where_text": "held, at x = -0.40 mm, 0.40 mm below the nominal apex; the indentor may still touch it",
        "next_text": "free the finger first, straight up: by hand or with the controller's own jog",
        "resume": f"rig resume /home/someone/with/a/long/folder/name/runs/{RUN}",
        "may_touch": may_touch,
    }


def tripping() -> dict[str, Any]:
    """A run that has just tripped; its process still closes the record."""
    return running(attention=attention("tripped", "the force sensor is silent", may_touch=False))


def ended(status: str = "tripped", reason: str = "force 21.3 gwt exceeds the soft trip") -> dict[str, Any]:
    """A run that ended early, its indentor pressed; nobody has the ports."""
    scene = running(status)
    scene["run"] |= {"now": None, "next": None, "left_s": None}
    scene["newest"] |= {"age_s": 12.0, "placed_age_s": 12.0}
    for device in scene["devices"].values():
        device["age_s"] = 12.0
    return scene | {"owner": None, "attention": attention(status, reason, may_touch=True)}


SCENES = {
    "idle": bench,
    "not configured": lambda: bench(configured=False),
    "planning": lambda: running("planning", notice="plans"),
    "asking": lambda: running("asking", notice="waits at its terminal: mount bar:3.0"),
    "running": running,
    "pausing": lambda: running("pausing"),
    "paused": lambda: running("paused"),
    "reporting": lambda: running("reporting"),
    "tripping": tripping,
    "tripped": ended,
    "stopped": lambda: ended("aborted", "stopped at once from the panel"),
    "by hand": by_hand,
    "by hand, busy": lambda: by_hand(busy="home", homed=False, zeroed=False),
    "by hand, stopped": lambda: (
        by_hand(stopped=True, homed=False, ended_by="stopped by the operator", next="home")
        | {"attention": attention("aborted", "stopped by the operator", may_touch=True)}
    ),
}
