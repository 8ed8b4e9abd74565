"""How workers share the tests: file by file; in real time, where most tests wait, mostly one by one."""

from typing import Any

from xdist.scheduler.loadfile import LoadFileScheduling


class Dealt(LoadFileScheduling):
    """Scheduler of `--dist loadfile` that deals out some tests alone, and one at a time.

    xdist gives a worker its next file while two tests are left to it, which may take half a minute; and it looks for
    each test in the list of all of them.
    """

    def __init__(self, config: Any, log: Any, alone: tuple[str, ...], together: tuple[str, ...]) -> None:
        super().__init__(config, log)
        self._alone, self._together = alone, together
        self._places: dict[Any, dict[str, int]] = {}

    def _split_scope(self, nodeid: str) -> str:
        name = nodeid.removeprefix("tests/")
        alone = name.startswith(self._alone) and not name.startswith(self._together)
        return nodeid if alone else super()._split_scope(nodeid)

    def _assign_work_unit(self, node: Any) -> None:
        if node not in self._places:
            self._places[node] = {name: place for place, name in enumerate(self.registered_collections[node])}
        scope, unit = self.workqueue.popitem(last=False)
        self.assigned_work[node][scope] = unit
        node.send_runtest_some([self._places[node][name] for name, done in unit.items() if not done])

    def _reschedule(self, node: Any) -> None:
        done = [scope for scope, unit in self.assigned_work[node].items() if all(unit.values())]
        for scope in done:
            del self.assigned_work[node][scope]
        # A worker begins a test when it knows the next one.
        if node.shutting_down or not self.workqueue or self._pending_of(self.assigned_work[node]) <= 1:
            super()._reschedule(node)
