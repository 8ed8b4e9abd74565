"""`rig panel`: what it prints, opens and refuses; serving itself is looked at in real time."""

import webbrowser
from pathlib import Path

import pytest

import rig.panel.app as serving
from rig.control.client import runtime_folder
from tests.program import Program


class ToldPanel:
    """Serves nothing, and remembers what it was begun with."""

    url, port = "http://127.0.0.1:8123/#token=the-token", 8123
    offered: serving.Offered
    served = 0

    def __init__(self, offered: serving.Offered) -> None:
        type(self).offered = offered

    def serve(self) -> None:
        type(self).served += 1


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the browser was begun with."""
    found: list[str] = []
    monkeypatch.setattr(serving, "Panel", ToldPanel)
    monkeypatch.setattr(ToldPanel, "served", 0)

    def told(url: str) -> bool:
        path = Path(url.removeprefix("file://"))
        assert path.stat().st_mode & 0o777 == 0o600
        found.extend([url, path.read_text(encoding="utf-8")])
        return True

    monkeypatch.setattr(webbrowser, "open", told)
    return found


def test_it_prints_the_page_and_opens_it_by_a_file_of_its_own(program: Program, opened: list[str]) -> None:
    ended = program("panel")
    assert (ended.code, ended.out) == (0, f"{ToldPanel.url}\n")
    assert ended.err == "press Ctrl-C to close the panel; a running protocol continues\n"
    url, page = opened
    assert "the-token" not in url
    assert f'url={ToldPanel.url}"' in page
    assert list(runtime_folder().glob("panel-*")) == []
    assert (ToldPanel.served, ToldPanel.offered) == (1, serving.Offered(Path("runs"), None, 0))


@pytest.mark.parametrize("word", ["--no-browser", "--json"])
def test_a_browser_is_opened_for_people_who_want_one(word: str, program: Program, opened: list[str]) -> None:
    ended = program("panel", word, "--out", "elsewhere", "--config", "rig.toml", "--port", 8123)
    assert (opened, ToldPanel.served) == ([], 1)
    assert ToldPanel.offered == serving.Offered(Path("elsewhere"), Path("rig.toml"), 8123)
    if word == "--json":
        told = ended.json
        assert (told["url"], told["port"], set(told)) == (ToldPanel.url, 8123, {"url", "port", "pid"})
        assert ended.err == ""


@pytest.mark.parametrize("port", [1, 1023, 65536, -1])
def test_a_port_is_one_that_anybody_may_have(port: int, program: Program, opened: list[str]) -> None:
    ended = program("panel", "--port", port, "--json")
    assert (ended.code, ended.error_code) == (2, "outside_range")
    assert ToldPanel.served == 0


def test_a_configuration_that_is_none_is_told_before_anything_is_served(program: Program, tmp_path: Path) -> None:
    ended = program("panel", "--json", "--config", tmp_path / "none.toml")
    assert ended.code == 2
    assert "none.toml" in ended.complaint
    assert ended.error_code
