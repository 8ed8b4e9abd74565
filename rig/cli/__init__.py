"""The command line: `rig COMMAND`. Exit codes: 0 done, 1 stopped by a limit or trip, 2 bad input, 130 aborted."""

import io
import json
import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from rig.cli.failure import FailureJson

_ABORTED = 130
_NOT_WRITTEN = 2
_READER_GONE = 1


def main() -> None:
    """Run the `rig` program; Ctrl-C may arrive while the rest of it is being imported."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # The encoding of a pipe may lack signs, as on Windows.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        if sys.getfilesystemencoding() != "utf-8" and not all(map(str.isprintable, (*sys.argv, os.getcwd()))):
            _leave("this locale cannot read the name of a file or folder; set PYTHONUTF8=1", _NOT_WRITTEN)
        from rig.cli.program import run

        try:
            run()
        except SystemExit as ended:
            _flush(quietly=bool(ended.code))
            raise
    except KeyboardInterrupt:
        _leave("stopped at once by the operator", _ABORTED)
    except BrokenPipeError:
        _write_nowhere()
        sys.exit(_READER_GONE)
    except OSError as error:
        _write_nowhere()
        _leave(f"{error.filename or 'standard output'}: {error.strerror or error}", _NOT_WRITTEN)


def _flush(*, quietly: bool) -> None:
    """Flush standard output here, because an error at interpreter exit would print a traceback."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        _write_nowhere()
        if not quietly:
            raise


def _write_nowhere() -> None:
    """Redirect standard output to the null device, because another flush at exit would fail again."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _leave(line: str, code: int) -> NoReturn:
    from rig.printable import printable

    print(printable(f"rig: {line}"), file=sys.stderr)
    if "--json" in sys.argv and code == _ABORTED:  # otherwise it is standard output that fails
        failure: FailureJson = {"error_text": line, "code": "interrupted", "exit_code": code}
        print(json.dumps(failure), flush=True)
    sys.exit(code)
