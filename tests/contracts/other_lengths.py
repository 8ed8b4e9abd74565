"""Reads of other lengths than a table has: after a failure a Modbus device replies to one before it is believed."""

from collections.abc import Iterable

LONGEST, READ = 20, 3
NO_SUCH_ADDRESS = bytes([0x80 | READ, 2])


def other_lengths(questions: Iterable[bytes]) -> dict[bytes, bytes]:
    """Each read at the same addresses with another number of registers, refused: the device has no so many there."""
    known = set(questions)
    reads = {question[:5] for question in known if len(question) == 6 and question[1] == READ}
    longer = [read + bytes([count]) for read in reads for count in range(1, LONGEST + 1)]
    return {question: question[:1] + NO_SUCH_ADDRESS for question in longer if question not in known}
