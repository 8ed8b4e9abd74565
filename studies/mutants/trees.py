"""Copies of the project to change at will, and what runs in them."""

import compileall
import json
import os
import py_compile
import shutil
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Any

from platformdirs import user_cache_path


def copy_project(root: Path, to: Path) -> None:
    """The files of the project as they are now, without what git ignores, compiled."""
    listed = ["git", "-C", str(root), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    shutil.rmtree(to, ignore_errors=True)
    for name in subprocess.run(listed, check=True, capture_output=True, text=True).stdout.split("\0"):
        if name and (root / name).is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, to / name)
    # a mutant may be as long as the original and of the same second: only its content tells them apart
    by_content = py_compile.PycInvalidationMode.CHECKED_HASH
    for room in ("rig", "sim", "rig_shared", "tests", "studies"):
        compileall.compile_dir(to / room, quiet=2, invalidation_mode=by_content)


def surroundings(tree: Path) -> dict[str, str]:
    """The environment of whatever runs in a tree: its own code, caches and temporary files; one thread."""
    for folder in ("cache", "tmp"):
        (tree.parent / f"{tree.name}.{folder}").mkdir(exist_ok=True)
    own = {
        "PYTHONPATH": str(tree),
        "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1",
        "RIG_CACHE_DIR": str(tree.parent / f"{tree.name}.cache"),
        "TMPDIR": str(tree.parent / f"{tree.name}.tmp"),
    }
    return {**os.environ, **own}


def lend_models(tree: Path) -> None:
    """Copy the models that this user has, so that no mutant waits for them; what a mutant makes stays in its tree."""
    lent = Path(surroundings(tree)["RIG_CACHE_DIR"])
    own = os.environ.get("RIG_CACHE_DIR")
    for model in (Path(own) if own else user_cache_path("indentation-rig")).glob("*.*"):
        if not (lent / model.name).exists() and model.suffix in {".model", ".answers"}:
            shutil.copy2(model, lent / model.name)


class Worker:
    """A worker process in a tree of its own."""

    def __init__(self, tree: Path, *, simulator: bool) -> None:
        """`simulator`: import `sim` once, since only `rig` will be changed."""
        command = [sys.executable, "-m", "studies.mutants.worker", "simulator" if simulator else "none"]
        self._process = subprocess.Popen(
            command, cwd=tree, env=surroundings(tree), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, **request: Any) -> tuple[str, str, float]:
        """Outcome, the test that noticed, and seconds."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        outcome, test, seconds = json.loads(self._process.stdout.readline())
        return outcome, test, seconds

    def __enter__(self) -> "Worker":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait()
