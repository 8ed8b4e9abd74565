"""The list of runs and their reports: nothing else that lies on the disk is shown."""

import asyncio
import gc
import os
import shutil
from pathlib import Path
from urllib.parse import quote

import pytest

from rig.panel.access import FILE_POLICY
from tests.rig.panel.stub_panel import OWN, StubPanel

OLD = Path(__file__).parents[2] / "data" / "runs"
SECRET = "nobody's business"
REPORT = "/runs/20260101-complete/report.html"


@pytest.fixture
def runs(panel: StubPanel) -> Path:
    """Two runs, a folder that is none, and things that do not belong to any."""
    out = panel.watcher.out
    for name in ("complete", "stopped"):
        shutil.copytree(OLD / name, out / f"20260101-{name}")
    (out / "20260101-complete" / "report.html").write_text("<p>report</p>", encoding="utf-8")
    (out / "20260102-none").mkdir()
    (out.parent / "outside").mkdir()
    (out.parent / "outside" / "report.html").write_text(SECRET, encoding="utf-8")
    return out


def test_the_list_has_the_newest_run_first_and_names_unreadable_folders(runs: Path, panel: StubPanel) -> None:
    told = panel.get("/runs.json").json()
    dates = [one["date_utc"] for one in told["runs"]]
    assert {one["name"] for one in told["runs"]} == {"20260101-complete", "20260101-stopped"}
    assert dates == sorted(dates, reverse=True)
    assert [one["name"] for one in told["unreadable"]] == ["20260102-none"]
    assert (told["problem"], told["of"]) == (None, 2)


@pytest.mark.parametrize(("shape", "n", "code"), [("bar", 2, None), ("bar:3", 2, None), ("bar:", 0, "no_dimension")])
def test_runs_are_filtered_by_their_shape(runs: Path, panel: StubPanel, shape: str, n: int, code: str | None) -> None:
    told = panel.get(f"/runs.json?shape={quote(shape)}").json()
    assert (len(told["runs"]), told.get("code")) == (n, code)


def test_without_a_folder_there_are_no_runs(panel: StubPanel) -> None:
    told = panel.get("/runs.json").json()
    assert (told["runs"], told["unreadable"], told["code"]) == ([], [], "file_not_found")
    assert str(panel.watcher.out) in told["problem"]


def test_a_report_is_shown_as_it_is_and_may_run_no_script(runs: Path, panel: StubPanel) -> None:
    answer = panel.get(REPORT)
    assert (answer.status_code, answer.content) == (200, b"<p>report</p>")
    assert answer.headers["content-length"] == "13"
    assert answer.headers["content-security-policy"] == FILE_POLICY
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    head = panel.get(REPORT, "HEAD")
    assert (head.status_code, head.content, head.headers["content-length"]) == (200, b"", "13")


@pytest.mark.parametrize(
    "path",
    [
        "/runs/../outside/report.html",
        "/runs/%2e%2e/outside/report.html",
        "/runs/%2e%2e%2foutside/report.html",
        "/runs/..%5coutside/report.html",
        "/runs/20260101-complete/events.jsonl",
        "/runs/20260101-complete/",
        "/runs/20260101-stopped/report.html",
        "/runs//report.html",
        "/runs/./report.html",
        "/runs/.hidden/report.html",
        "/runs/C:/report.html",
        "/runs/a%00b/report.html",
        "/runs/none/report.html",
        "/runs/linked/report.html",
        "/runs/link/report.html",
        "/runs/pipe/report.html",
        "/runs/folder/report.html",
        "/static/../app.py",
        "/static/%2e%2e/app.py",
        "/static/..%2fapp.py",
        "/app.py",
    ],
)
def test_nothing_but_the_report_of_a_run_is_shown(path: str, runs: Path, panel: StubPanel) -> None:
    (runs / "report.html").write_text(SECRET, encoding="utf-8")
    shutil.copytree(runs.parent / "outside", runs / ".hidden")
    (runs / "linked").symlink_to(runs.parent / "outside", target_is_directory=True)
    for name in ("link", "pipe", "folder"):
        (runs / name).mkdir()
    (runs / "link" / "report.html").symlink_to(runs.parent / "outside" / "report.html")
    os.mkfifo(runs / "pipe" / "report.html")
    (runs / "folder" / "report.html").mkdir()
    answer = panel.get(path)
    assert answer.status_code == 404
    assert SECRET.encode() not in answer.content
    assert answer.json()["ok"] is False


def test_a_browser_that_leaves_in_the_middle_leaves_no_file_open(runs: Path, panel: StubPanel) -> None:
    """A file that is not closed would be a warning, and so an error here."""
    (runs / "20260101-complete" / "report.html").write_bytes(bytes(10_000_000))
    scope = {"type": "http", "http_version": "1.1", "method": "GET", "path": REPORT, "query_string": b"",
             "root_path": "", "headers": [(b"host", OWN["host"].encode())]}  # fmt: skip
    begun = asyncio.Event()

    async def receive() -> dict[str, str]:
        await begun.wait()
        return {"type": "http.disconnect"}

    async def send(message: object) -> None:
        begun.set()
        await asyncio.sleep(0)

    asyncio.run(panel.app(scope, receive, send))
    gc.collect()
