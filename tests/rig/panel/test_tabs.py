"""Which tab has the controls."""

from rig.panel.owners import GONE_S, Tabs


def test_a_tab_that_looks_on_keeps_the_controls() -> None:
    tabs = Tabs()
    tabs.opened("a")
    tabs.take("a", 0.0)
    tabs.look(100.0)
    assert tabs.holder == "a"
    tabs.opened("a")
    tabs.closed("a", 100.0)
    tabs.look(200.0)
    assert tabs.holder == "a"
    tabs.closed("a", 200.0)
    tabs.look(200.0 + GONE_S)
    assert tabs.holder == "a"
    tabs.look(200.1 + GONE_S)
    assert tabs.holder is None


def test_what_another_tab_does_keeps_nobody() -> None:
    assert GONE_S == 5.0
    tabs = Tabs()
    tabs.take("a", 0.0)
    tabs.opened("b")
    assert tabs.may("b", 4.0) is False
    tabs.closed("b", 4.0)
    tabs.look(5.1)
    assert tabs.holder is None
    assert tabs.may("b", 6.0) is True
    assert tabs.may("b", 10.0) is True
    tabs.look(14.9)
    assert tabs.holder == "b"
    tabs.look(15.1)
    assert tabs.holder is None
