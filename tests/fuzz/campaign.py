"""`python -m tests.fuzz.campaign`: many inputs for every reader, each within 5 s of processor time and 1 GB.

A process of its own reads, so that what ends or stops it costs one input. Inputs are numbered; a failure is printed
with its number, and `--show READER NUMBER` writes that file to standard output.
"""

import argparse
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

MOST_S, MOST_BYTES = 5.0, 1 << 30
_STUCK_S = 120.0
_EVERY_S = 30.0


class TooLongError(BaseException):
    """An input takes longer than it may."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=1_000_000, help="of all readers together")
    parser.add_argument("--from", dest="first", type=int, default=1_000_000, help="number of the first input")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--show", nargs=2, metavar=("READER", "NUMBER"))
    parser.add_argument("--devices", action="store_true", help="parsers of what devices send, instead of readers")
    parser.add_argument("readers", nargs="*", help="names of readers or parsers instead of all readers")
    asked = parser.parse_args()
    if asked.devices:
        from tests.fuzz.devices import DEVICES

        asked.readers = list(DEVICES)
    if asked.show:
        from tests.fuzz.harness import Target

        with tempfile.TemporaryDirectory() as folder:
            sys.stdout.buffer.write(Target(asked.show[0], Path(folder) / "a").mutated(int(asked.show[1])))
        return
    sys.exit(bool(failures(asked.inputs, asked.first, asked.processes, asked.readers)))


def failures(inputs: int, first: int, processes: int, readers: list[str]) -> int:
    """Run a campaign, print its failures and progress, and return how many inputs failed."""
    import tests.fuzz.harness  # noqa: F401  # here, so that processes inherit what is imported
    from tests.fuzz.readers import READERS

    names = readers or list(READERS)
    each = shares(inputs, names)
    with multiprocessing.get_context("fork").Pool(processes) as pool:
        found: Counter[str] = Counter()
        done, began_s = 0, time.monotonic()
        for name, number, failed in pool.imap_unordered(_supervised, [(name, first, each[name]) for name in names]):
            done += number
            found[name] += len(failed)
            for seed, what in failed[:20]:
                print(f"FAILED {name} {seed}: {what}", flush=True)
            print(f"{done} of {sum(each.values())} inputs in {time.monotonic() - began_s:.0f} s: {number} of the "
                  f"{name}, {len(failed)} failures", flush=True)  # fmt: skip
    print(f"{done} inputs, {found.total()} failures")
    return found.total()


def shares(inputs: int, names: list[str]) -> dict[str, int]:
    """Return the number of inputs of each reader, in proportion to those in the suite."""
    from tests.fuzz.harness import EVERY

    total = sum(EVERY[name].in_suite for name in names)
    return {name: max(round(inputs * EVERY[name].in_suite / total), 1) for name in names}


def _supervised(task: tuple[str, int, int]) -> tuple[str, int, list[tuple[int, str]]]:
    """Read inputs in a process of its own, begun again behind an input that ends it."""
    name, first, number = task
    failed: list[tuple[int, str]] = []
    at, printed_s = first, time.monotonic()
    while at < first + number:
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(read)
            _child(name, at, first + number - at, write)
        os.close(write)
        for line in _lines(read, child):
            kind, _, what = line.partition(" ")
            at = int(kind) if kind.isdigit() else at
            if what:
                failed.append((at, what))
            if time.monotonic() - printed_s > _EVERY_S:
                printed_s = time.monotonic()
                print(f"  {name}: {at - first} of {number}, {len(failed)} failures", flush=True)
        _, status = os.waitpid(child, 0)
        if status:
            failed.append((at, f"the process ended with status {os.waitstatus_to_exitcode(status)}"))
            at += 1
        else:
            break
    return name, number, failed


def _lines(read: int, child: int) -> Iterator[str]:
    """Yield the lines of a child; end it if it says nothing for too long."""
    import select

    with os.fdopen(read, "rb", buffering=0) as file:
        left = b""
        while True:
            if not select.select([file], [], [], _STUCK_S)[0]:
                os.kill(child, signal.SIGKILL)
                return
            data = file.read(1 << 16)
            if not data:
                return
            *lines, left = (left + data).split(b"\n")
            yield from (line.decode("utf-8", "replace") for line in lines)


def _child(name: str, first: int, number: int, write: int) -> None:
    """Read the inputs; before each its number is written, and behind it what failed. Never returns."""
    ended, seed = 1, first
    try:
        from tests.fuzz.harness import Target

        warnings.simplefilter("error")
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            target = Target(name, Path(folder) / "files" / "a")
            for example in target.examples:
                if said := target.failure(example):
                    os.write(write, f"{first} example: {said}\n".encode())
            signal.signal(signal.SIGPROF, _too_long)
            most = _size_bytes() + MOST_BYTES
            resource.setrlimit(resource.RLIMIT_AS, (most, most))
            for seed in range(first, first + number):
                os.write(write, f"{seed}\n".encode())
                content = target.mutated(seed)
                signal.setitimer(signal.ITIMER_PROF, MOST_S)
                try:
                    said = target.failure(content)
                except TooLongError:
                    said = f"more than {MOST_S:g} s:" + traceback.format_exc()[-600:]
                finally:
                    signal.setitimer(signal.ITIMER_PROF, 0)
                if said:
                    os.write(write, f"{seed} {' '.join(said.split())}\n".encode())
            if sorted(os.listdir(folder)) != ["files"]:
                os.write(write, f"{first} wrote into the current folder: {os.listdir(folder)}\n".encode())
            os.chdir("/")
        ended = 0
    except BaseException:
        os.write(write, f"{seed} {' '.join(traceback.format_exc()[-900:].split())}\n".encode())
    finally:
        os._exit(ended)


def _too_long(*_: object) -> None:
    raise TooLongError


def _size_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


if __name__ == "__main__":
    main()
