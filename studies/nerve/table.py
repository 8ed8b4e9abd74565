"""The 18 published tests beside our classes of afferents.

.venv/bin/python -m studies.nerve.table [TEST…]
"""

import sys
from collections.abc import Iterator

from studies.nerve.rows import TESTS, Row
from studies.nerve.scenes import Scenes
from studies.registry import show

HEADER = ("test", "stimulus", "published", "ours: mean (range over seeds)", "TouchSim", "verdict", "remark")


def cells(row: Row) -> tuple[str, ...]:
    """Return a row of the table."""
    verdict = {True: "pass", False: "fail", None: "not counted"}[row.passed]
    return row.test, row.stimulus, row.published, row.ours, row.touchsim, verdict, row.remark


def main(wanted: list[str]) -> None:
    """Print the table."""
    scenes = Scenes()

    def rows() -> Iterator[Row]:
        for test in TESTS:
            if not wanted or test.__name__ in wanted:
                yield from test(scenes)

    show(HEADER, map(cells, rows()))


if __name__ == "__main__":
    main(sys.argv[1:])
