"""Descriptors that are kept for a stop when other programs have used up all others."""

import os

import pytest

from rig.panel.server import Reserve

resource = pytest.importorskip("resource")


@pytest.mark.parametrize("failures", [0, 1, 3], ids=lambda n: f"{n} connections not accepted")
def test_a_stop_has_descriptors_whatever_new_connections_have_taken(failures: int) -> None:
    reserve, taken = Reserve(), list[int]()
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    reserve.fill()
    highest = os.open(os.devnull, os.O_RDONLY)
    os.close(highest)

    def use_up() -> int:
        begin = len(taken)
        try:
            while True:
                taken.append(os.open(os.devnull, os.O_RDONLY))
        except OSError:
            return len(taken) - begin

    resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 32, before[1]))
    try:
        use_up()
        for _ in range(failures):
            reserve.release()
            use_up()
        assert reserve.short is (failures > 0)
        with reserve.freed():
            assert use_up() >= 8
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
        for one in taken:
            os.close(one)
        reserve.close()
