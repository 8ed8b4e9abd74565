"""Passes over a script in fresh processes: whether it makes the same steps each time, as a run needs."""

import contextlib
import json
import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

from rig.plan.config import Config, config_from
from rig.protocol.api import Rig
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.script import Script, script_with
from rig.protocol.steps import Step
from rig_shared.errors import code_of

_HASH_SEEDS = ("1", "2")
_PASSES = 3
"""Passes that a run makes in one process."""
_LONGEST_S = 60.0


class StepDifference(NamedTuple):
    """First step in which two passes differ: its number, and the step in each, in words.

    `kept` is whether passes differ within a process and not between processes: something outlasts a pass.
    """

    number: int
    one: str
    other: str
    kept: bool = False

    @property
    def remedy(self) -> str:
        """What to change in the script."""
        if self.kept:
            return (
                "a module that does not lie beside the script keeps a generator, counter or list from one pass to "
                "the next; make or seed it in run(rig), or put the module beside the script"
            )
        return "seed what is random (random.Random(7).shuffle), sort what is a set"


def find_difference(
    script: Script, config: Config, steps: Sequence[tuple[Step[Any, Any], Any]]
) -> StepDifference | None:
    """Return the first difference between a pass and those in two fresh processes with other hash seeds, or None.

    steps: those of the first pass, with the answers that the script received; they are given again.
    """
    here = [in_words(step) for step, _ in steps]
    answers = [answer for _, answer in steps]
    tables = config.model_dump(mode="json", exclude_none=True)
    order = pickle.dumps((str(script.path), script.name, script.given, tables, answers))
    with contextlib.ExitStack() as running:
        processes = [running.enter_context(_pass(seed)) for seed in _HASH_SEEDS]
        passes = [_passes(process, order) for process in processes]
        for process in processes:
            process.kill()
    found = next(filter(None, (_first(here, there) for some in passes for there in some)), None)
    first, *others = passes
    kept = all(some == first for some in others) and any(one != first[0] for one in first)
    return None if found is None else found._replace(kept=kept)


def _passes(process: subprocess.Popen[bytes], order: bytes) -> list[list[str]]:
    """Return the steps of each pass in a process, in words."""
    try:
        found: list[list[str]] = json.loads(process.communicate(order, timeout=_LONGEST_S)[0])
    except (subprocess.TimeoutExpired, ValueError):
        return [["no end of the pass"]]
    return found


def _pass(hash_seed: str) -> subprocess.Popen[bytes]:
    words = [sys.executable, "-m", "rig.plan.fresh_passes"]
    env, pipe = {**os.environ, "PYTHONHASHSEED": hash_seed}, subprocess.PIPE
    return subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=env)


def _first(here: list[str], there: list[str]) -> StepDifference | None:
    longest = max(len(here), len(there))
    pairs = zip(*(one + ["the end"] * (longest - len(one)) for one in (here, there)), strict=True)
    return next((StepDifference(n, *pair) for n, pair in enumerate(pairs, 1) if pair[0] != pair[1]), None)


def in_words(step: Step[Any, Any]) -> str:
    """Return a step as the call of its verb."""
    values = {field.name: getattr(step, field.name) for field in fields(step) if field.repr}
    return f"{step.verb}({', '.join(f'{name}={value!r}' for name, value in values.items() if value is not None)})"


class _AnyModel:
    """Model of a pass that predicts nothing; the first pass has checked the indentors."""

    def refuse_shape(self, indentor: str) -> None:
        return

    def press(self, *about: Any) -> Any:
        raise NotImplementedError

    def touch_height_mm(self, *about: Any) -> Any:
        raise NotImplementedError


class _Replay:
    """Handler that gives the answers of the first pass."""

    def __init__(self, answers: Sequence[Any]) -> None:
        self._answers = answers
        self.steps: list[str] = []

    def handle(self, step: Step[Any, Any], place: PressPlace) -> Any:
        self.steps.append(in_words(step))
        number = len(self.steps) - 1
        return self._answers[number] if number < len(self._answers) else None


def main() -> None:
    """Make as many passes as a run does, and print the steps of each as JSON."""
    path, name, parameters, tables, answers = pickle.load(sys.stdin.buffer)
    config, passes = config_from("config", tables, Path()), []
    with contextlib.redirect_stdout(sys.stderr):
        for _ in range(_PASSES):
            replay = _Replay(answers)
            passes.append(replay.steps)
            try:
                script = script_with(Path(path), name, parameters)
                script.run(Rig(script.parameters, ScriptState(config, _AnyModel()), replay))
            except (Exception, SystemExit) as error:
                replay.steps.append(f"an error ({code_of(error)}): {error}")
    print(json.dumps(passes))


if __name__ == "__main__":
    main()
