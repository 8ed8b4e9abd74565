"""Has drawings made of what goes on, one at a time and always of the newest, and tells the pages."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from rig.panel.drawn.drawing_process import Drawing, DrawingError, DrawingProcess
from rig.panel.drawn.job import Job
from rig.panel.outlet import Outlet
from rig.transport.clock import Clock

_LOOK_S = 0.05
NO_CURVE: Drawing = {"doi_mm": None, "force_gwt": None}


class Drawer:
    """Has drawn what `wanted` says; what was wanted meanwhile and is no more, is never drawn."""

    def __init__(self, wanted: Callable[[], Job | None], outlet: Outlet, clock: Clock) -> None:
        self._wanted, self._outlet, self._clock = wanted, outlet, clock
        self.process = DrawingProcess()
        self._thread = ThreadPoolExecutor(1, "drawing")
        self._drawn: Job | None = None
        self._told_of: Job | None = None

    async def look_on(self) -> None:
        """Until it is cancelled."""
        while True:
            await self.look()
            await asyncio.sleep(_LOOK_S)

    async def look(self) -> None:
        """Have drawn what is not: finger and indentor first, since what is solved takes longer."""
        job = self._wanted()
        if job != self._told_of:
            self._told_of = job
            self._foresee(job, NO_CURVE)
        if job is None or job == self._drawn:
            return
        still = replace(job, press=None)
        if self._drawn is None or replace(self._drawn, press=None) != still:
            await self._draw(still)
        else:
            await self._draw(job)

    async def _draw(self, job: Job) -> None:
        try:
            told = await asyncio.get_running_loop().run_in_executor(self._thread, self.process.ask, job)
        except DrawingError as error:
            told = {"problem": str(error), "code": error.code}
        self._drawn = job
        prediction = told.pop("prediction", NO_CURVE)
        self._outlet.publish("section", {**self._of(job), "skin": [], **told})
        if job.press is not None and job == self._wanted():
            self._foresee(job, prediction)

    def _foresee(self, job: Job | None, curve: Drawing) -> None:
        self._outlet.publish("prediction", {**self._of(job), **curve})

    def _of(self, job: Job | None) -> dict[str, Any]:
        """Of what it is."""
        press = None if job is None else job.press
        return {
            "unix_s": self._clock.unix_s(),
            "run": None if job is None or job.folder is None else job.folder.name,
            "index": None if press is None else press.index,
            "purpose": None if press is None else press.purpose,
            "shape": None if job is None else job.indentor,
        }

    def close(self) -> None:
        """End the process that draws."""
        self.process.close()
        self._thread.shutdown(wait=False)
