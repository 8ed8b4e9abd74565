"""`rig` as a program of its own whose figures are empty; the process of its finger imports this file again."""

import os
import time
from typing import Any

from rig.cli import main, script_execution

_drawn = script_execution.make_report


def _make_report(*arguments: Any) -> None:
    from matplotlib.figure import Figure

    from rig.report.plot import Plot

    Plot._laid_out = property(lambda plot: Figure((1, 1)))  # type: ignore[assignment]
    while "HELD_REPORT" in os.environ:
        time.sleep(0.01)
    _drawn(*arguments)


script_execution.make_report = _make_report
if __name__ == "__main__":
    main()
