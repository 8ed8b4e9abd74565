"""The command line: `rig COMMAND`. Exit codes: 0 done, 1 stopped by a limit or trip, 2 bad input, 130 aborted."""

import io
import json
import sys
from typing import NoReturn

_ABORTED = 130
_NOT_WRITTEN = 2


def main() -> None:
    """Run the `rig` program; Ctrl-C may arrive while the rest of it is being imported."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # The encoding of a pipe may lack signs, as on Windows.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        from rig.cli.program import run

        run()
    except KeyboardInterrupt:
        _leave("stopped at once by the operator", _ABORTED)
    except OSError as error:
        _leave(f"{error.filename or 'standard output'}: {error.strerror or error}", _NOT_WRITTEN)


def _leave(line: str, code: int) -> NoReturn:
    from rig.printable import printable

    print(printable(f"rig: {line}"), file=sys.stderr)
    if "--json" in sys.argv and code == _ABORTED:  # otherwise it is standard output that fails
        print(json.dumps({"error_text": line, "code": "interrupted", "exit_code": code}), flush=True)
    sys.exit(code)
