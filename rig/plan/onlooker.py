"""What is known of a run from its folder alone, as it goes on: step now and next, what is done, the time left."""

from collections.abc import Iterable, Mapping
from typing import Any

from rig.data.folder import RunFolder
from rig.engine.journal import Document
from rig.plan.agenda import Ahead, Course, CourseStep, written_ns
from rig.plan.timeline import BEGUN, ENDED, step_in_words

LATE = 1000
"""Events: a course that has not come by then comes no more."""


class Onlooker:
    """What is known of a run by its journal so far, and by the course that its folder keeps."""

    def __init__(self, folder: RunFolder) -> None:
        self.folder = folder
        self.start: Mapping[str, Any] = {}
        self.finished: set[int] = set()  # numbers of the indentations that are over
        self._since: list[Document] = []  # the start or the last resuming; events after it until there is a course
        self._course_ns = 0
        self._ahead: Ahead | None = None
        self._begun = ""

    def take(self, documents: Iterable[Document]) -> None:
        """What came to the journal."""
        for document in documents:
            self._take(document)
        if self._since and written_ns(self.folder) != self._course_ns:
            self._course_ns, course = written_ns(self.folder), Course.kept(self.folder)
            self._ahead = None if course is None else Ahead(course, self._since[0]["t_s"])
            for document in self._since:
                self._pass(document)
        if self._ahead is not None or len(self._since) > LATE:
            del self._since[1:]

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """What the journal was told."""
        if stream.endswith(BEGUN):
            self._begun = step_in_words(stream, data)
        elif stream.endswith(ENDED):
            self._begun = ""
        if stream == ENDED:
            self.finished.add(data["index"])

    def _take(self, document: Document) -> None:
        if document["doc"] in ("start", "resume"):
            self.start = document if document["doc"] == "start" else self.start
            self._since, self._ahead = [document], None
        elif document["doc"] == "event":
            if self._ahead is None and len(self._since) == 1:
                self._course_ns = 0  # a course is kept before anything happens: the one that is there is of this part
            self.event(document["stream"], document["data"])
            if not document["stream"].endswith("sample"):
                self._since.append(document)
            self._pass(document)

    def _pass(self, document: Document) -> None:
        if self._ahead is not None and document["doc"] == "event":
            self._ahead.event(document["t_s"], document["stream"], document["data"])

    @property
    def now(self) -> str:
        """The step that it is at, in words; empty where that is not known."""
        return self._begun if self._ahead is None else self._ahead.agenda.now

    @property
    def next(self) -> str:
        """The step after it."""
        return "" if self._ahead is None else self._ahead.agenda.next

    @property
    def steps(self) -> list[CourseStep]:
        """All of them, in order; none where its course is not known."""
        return [] if self._ahead is None else self._ahead.agenda.steps

    @property
    def left_s(self) -> float | None:
        """Seconds of the run's clock, None where nobody knows."""
        return None if self._ahead is None else self._ahead.left_s

    @property
    def planned(self) -> int | None:
        """How many indentations it was begun with."""
        return self.start.get("planned_indentations")
