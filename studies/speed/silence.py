"""How long each command keeps its user waiting without a word, with nothing in the cache: a table of all commands.

    .venv/bin/python -m studies.speed.silence [COMMAND …] [--coarse]

Standard error is a pseudo-terminal, where named work shows a live line; in a pipe it has a line only when something
changes. Every command runs with an empty cache.
Commands at the bench talk to virtual devices that are served beside them. The table has seconds of this machine. A
silence may take 3 s on a machine as fast as the reference; the limit grows with the time of the reference
computation, and with the number of processes that share a processor. Exits with 1 where a silence was longer. A
command that only a program starts is left out: it says nothing of its progress.
"""

import argparse
import json
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from sim.benchmark import reference_s
from studies.posix import os, pty

LIMIT_S, REFERENCE_S = 3.0, 0.3
"""Longest silence, and the time of the reference computation on the machine it holds for."""

_TIMEOUT_S = 900.0
_SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (-0.3, 0.0, 0.3):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.3, hold_s=0.2)
"""
_STUDY = '[finger.tissue]\nepidermis_mm = [0.3, 0.5]\n\n[[press]]\nshape = "bar:3.0"\ndoi_mm = 0.1\n'
_COARSE = '\n[finger.mesh]\nlevel = "coarse"\n'
_PRESS = "--shape bar:3.0 --x-mm 0 --doi-mm 0.2"

WORDS = {
    "dry-run": "mine.py --config finger.toml",
    "run": "mine.py --config rig.toml --yes --mounted bar:3.0",
    "identify": "--dry-run --config finger.toml --to found.toml --presses 4",
    "check": "mine.py --config finger.toml",
    "design": "--candidates ep1,sed --shapes bar:3.0 --minutes 5 --quick --config finger.toml",
    "resume": "stopped",
    "nerve": "runs/RUN",
    "compare": "runs/RUN",
    "runs": "runs",
    "show": "runs/RUN",
    "watch": "runs/RUN",
    "stream": "--out runs",
    "panel": "--no-browser --port 0",
    "export": "runs/RUN --csv",
    "study": "study.toml",
    "indent": f"{_PRESS} --model finger --config finger.toml",
    "impulse": "--config finger.toml",
    "shift-invariance": "--config finger.toml",
    "encode": "--pressure 1,2 --config finger.toml",
    "decode": "--pressure 1,2 --config finger.toml",
    "finger": "--config finger.toml",
    "find": "touches/RUN",
    "export-deck": f"{_PRESS} --out deck.inp --config finger.toml",
    "serve": "--tcp 0 --config finger.toml",
    "home": "--config rig.toml",
    "zero": "--config rig.toml",
    "status": "--config rig.toml",
    "stop": "--config rig.toml",
    "jog": "--config rig.toml --axis x --by-mm 1",
    "calibrate": "force --config rig.toml --mass-g 5",
    "bench": "--quick",
    "cache": "",
    "config": "",
    "doctor": "",
    "init": "--yes --port tcp://127.0.0.1:9 --to new.toml",
}
"""Arguments of every command that a person starts."""

_SERVICES = ("serve", "panel", "stream")
"""Commands that wait for others; they are interrupted once they are ready."""

_READY_S = 20.0


class Waited(NamedTuple):
    """How long a command was silent (s)."""

    first_s: float  # until the first output
    silence_s: float
    whole_s: float
    code: int
    said: str


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[[], *WORDS], metavar="COMMAND")
    parser.add_argument("--coarse", action="store_true", help="a coarse mesh instead of the default finger")
    options = parser.parse_args()
    allowed_s = LIMIT_S * max(1.0, reference_s() / REFERENCE_S) * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
    print("| command | first output (s) | longest silence (s) | whole (s) |")
    print("|---|---|---|---|")
    long = []
    with tempfile.TemporaryDirectory() as folder, _prepared(Path(folder), coarse=options.coarse):
        for name in options.names or WORDS:
            first = _cold(name, Path(folder))
            row = (f"{first.first_s:.1f}", f"{first.silence_s:.1f}", f"{first.whole_s:.1f}")
            print(f"| `{name}` | {' | '.join(row)} |", flush=True)
            if first.silence_s > allowed_s or first.first_s > allowed_s / LIMIT_S:
                long.append(name)
    print(f"\nallowed here: {allowed_s:.1f} s; longer: {', '.join(long) or 'none'}")
    sys.exit(bool(long))


@contextmanager
def _prepared(folder: Path, *, coarse: bool) -> Iterator[None]:
    """Write scripts, runs and configurations; serve a bench. The models of this are not those of the commands."""
    finger = _COARSE if coarse else ""
    for name, text in {"mine.py": _SCRIPT, "study.toml": _STUDY + finger, "finger.toml": finger}.items():
        (folder / name).write_text(text, encoding="utf-8")
    environment = _environment(folder, "own")
    for out, script in (("runs", "mine.py"), ("touches", "find_finger")):
        words = [script, "--config", "finger.toml", "--out", out]
        subprocess.run(_rig("dry-run", *words), cwd=folder, env=environment, check=True, capture_output=True)
        (run,) = (folder / out).iterdir()
        run.rename(folder / out / "RUN")
    _stop_short(shutil.copytree(folder / "runs" / "RUN", folder / "stopped"))
    words = ["--tcp", "0", "--config", "finger.toml", "--indentor", "bar:3.0"]
    with subprocess.Popen(
        _rig("serve", *words),
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as served:
        assert served.stdout is not None
        ports = json.loads(served.stdout.readline())
        tables = "".join(f"[{room}]\nport = {json.dumps(ports[room])}\n" for room in ("stage", "force"))
        (folder / "rig.toml").write_text(tables + finger, encoding="utf-8")
        try:
            yield
        finally:
            served.send_signal(signal.SIGINT)


def _stop_short(run: str | Path) -> None:
    """Leave of a run what a kill after its first indentation leaves."""
    journal = Path(run) / "events.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    ended = next(n for n, line in enumerate(lines) if '"stream": "indentation_end", "data"' in line)
    journal.write_text("".join(lines[: ended + 1]), encoding="utf-8")


def _environment(folder: Path, cache: str) -> dict[str, str]:
    return os.environ | {"RIG_CACHE_DIR": str(folder / cache), "RIG_STATE_DIR": str(folder / "state")}


def _rig(*words: str) -> list[str]:
    return [sys.executable, "-m", "rig", *words]


def _cold(name: str, folder: Path) -> Waited:
    """Run a command with an empty cache."""
    shutil.rmtree(folder / "cache", ignore_errors=True)
    found = _waited(name, folder)
    if found.code not in (0, 1, 2, 130) or "Traceback" in found.said:
        raise RuntimeError(f"rig {name}: {found.said}")
    return found


def _waited(name: str, folder: Path) -> Waited:
    for left in ("deck.inp", "found.toml"):
        (folder / left).unlink(missing_ok=True)
    if name == "resume":
        shutil.rmtree(folder / "stopped")
        _stop_short(shutil.copytree(folder / "runs" / "RUN", folder / "stopped"))
    far, near = pty.openpty()
    began_s = time.monotonic()
    with (
        open(far, "rb", buffering=0) as screen,
        subprocess.Popen(
            _rig(name, *WORDS[name].split()),
            cwd=folder,
            env=_environment(folder, "cache") | {"TERM": "xterm"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=near,
            bufsize=0,
        ) as process,
    ):
        os.close(near)
        assert process.stdout is not None
        at_s, said = [began_s], b""
        for chunk in _chunks(process.stdout.fileno(), screen.fileno()):
            at_s.append(time.monotonic())
            said += chunk
            if name in _SERVICES and (
                b"http" in said or b"tcp" in said or b"socket" in said or b"rig_markers" in said
            ):
                at_s.append(time.monotonic())
                process.send_signal(signal.SIGINT)
                break
        code = process.wait(_TIMEOUT_S)
    ended_s = time.monotonic()
    times_s = at_s if name in _SERVICES else [*at_s, ended_s]
    gaps_s = [after - before for before, after in pairwise(times_s)]
    first_s = (at_s[1] if len(at_s) > 1 else ended_s) - began_s
    return Waited(first_s, max(gaps_s, default=0.0), ended_s - began_s, abs(code), said.decode(errors="replace"))


def _chunks(*streams: int) -> Iterator[bytes]:
    """Yield what a process writes to its streams, as it comes."""
    with selectors.DefaultSelector() as selector:
        for stream in streams:
            selector.register(stream, selectors.EVENT_READ)
        while selector.get_map():
            ready = selector.select(_READY_S)
            if not ready:
                return
            for key, _ in ready:
                try:
                    chunk = os.read(key.fd, 65536)
                except OSError:  # a terminal that no process has open any more
                    chunk = b""
                if chunk:
                    yield chunk
                else:
                    selector.unregister(key.fileobj)


if __name__ == "__main__":
    main()
