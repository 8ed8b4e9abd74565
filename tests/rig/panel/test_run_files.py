"""The catalogue, and the files of runs: nothing that does not lie in a run's own folder is shown."""

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


@pytest.fixture
def runs(panel: StubPanel) -> Path:
    """Two runs, a folder that is none, and things that do not belong to any."""
    out = panel.watcher.out
    for name in ("complete", "stopped"):
        shutil.copytree(OLD / name, out / f"20260101-{name}")
    (out / "20260101-complete" / "report.html").write_text("<p>report</p>", encoding="utf-8")
    (out / "20260102-none").mkdir()
    (out / "beside.txt").write_text(SECRET, encoding="utf-8")
    (out.parent / "outside").mkdir()
    (out.parent / "outside" / "secret.txt").write_text(SECRET, encoding="utf-8")
    return out


def test_the_runs_there_are_the_newest_first(runs: Path, panel: StubPanel) -> None:
    told = panel.get("/runs.json").json()
    assert {one["name"] for one in told["runs"]} == {"20260101-complete", "20260101-stopped"}
    assert [one["date_utc"] for one in told["runs"]] == sorted(
        (one["date_utc"] for one in told["runs"]), reverse=True
    )
    assert [one["name"] for one in told["unreadable"]] == ["20260102-none"]
    assert (told["problem"], told["of"]) == (None, 2)
    assert set(told["runs"][0]) == {
        "name", "uid", "date_utc", "protocol", "title", "subject", "shapes", "state", "virtual", "planned", "done",
        "duration_s", "damage",
    }  # fmt: skip


@pytest.mark.parametrize(("shape", "n", "code"), [("bar", 2, None), ("bar:3", 2, None), ("bar:", 0, "no_dimension")])
def test_runs_are_filtered_by_their_shape(runs: Path, panel: StubPanel, shape: str, n: int, code: str | None) -> None:
    told = panel.get(f"/runs.json?shape={quote(shape)}").json()
    assert (len(told["runs"]), told.get("code")) == (n, code)


@pytest.mark.parametrize("limit", ["-1", "a", "1.5", "\u0662", ""])
def test_a_limit_is_a_number(limit: str, panel: StubPanel) -> None:
    answer = panel.get(f"/runs.json?limit={quote(limit)}")
    assert answer.status_code == 400
    assert (answer.json()["ok"], answer.json()["code"]) == (False, "not_a_number")


def test_without_a_folder_there_are_no_runs(panel: StubPanel) -> None:
    told = panel.get("/runs.json").json()
    assert (told["runs"], told["unreadable"]) == ([], [])
    assert str(panel.watcher.out) in told["problem"]
    assert told["code"] == "file_not_found"


def test_the_files_of_a_run(runs: Path, panel: StubPanel) -> None:
    (runs / "20260101-complete" / ".lock").touch()
    (runs / "20260101-complete" / "folder").mkdir()
    files = panel.get("/runs/20260101-complete/").json()["files"]
    assert files == sorted(files, key=lambda one: one["name"])
    assert {"name": "report.html", "bytes": 13} in files
    assert not {".lock", "folder"} & {one["name"] for one in files}


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("report.html", "text/html; charset=utf-8"),
        ("events.jsonl", "text/plain; charset=utf-8"),
        ("hold_end.csv", "text/plain; charset=utf-8"),
        ("protocol.py", "text/plain; charset=utf-8"),
        ("config.toml", "text/plain; charset=utf-8"),
        ("SHA256SUMS", "text/plain; charset=utf-8"),
        ("provenance.json", "application/json"),
        ("data.h5", None),
    ],
)
def test_a_file_is_shown_as_it_is_and_may_do_nothing(
    name: str, kind: str | None, runs: Path, panel: StubPanel
) -> None:
    answer = panel.get(f"/runs/20260101-complete/{name}")
    assert answer.status_code == 200
    assert answer.content == (runs / "20260101-complete" / name).read_bytes()
    assert answer.headers["content-length"] == str(len(answer.content))
    assert answer.headers["content-security-policy"] == FILE_POLICY
    assert kind in (None, answer.headers["content-type"])
    head = panel.get(f"/runs/20260101-complete/{name}", "HEAD")
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-length"] == answer.headers["content-length"]


PATHS = [
    "/runs/../outside/secret.txt",
    "/runs/%2e%2e/outside/secret.txt",
    "/runs/%2e%2e%2foutside/secret.txt",
    "/runs/20260101-complete/../../outside/secret.txt",
    "/runs/20260101-complete/..%2f..%2foutside%2fsecret.txt",
    "/runs/20260101-complete/..",
    "/runs/20260101-complete/%2e%2e",
    "/runs/../",
    "/runs/./",
    "/runs/%2e/beside.txt",
    "/runs//beside.txt",
    "/runs//etc/passwd",
    "/runs/20260101-complete//etc/passwd",
    "/runs/20260101-complete/%2fetc%2fpasswd",
    "/runs/20260101-complete/..\\..\\outside\\secret.txt",
    "/runs/C:/secret.txt",
    "/runs/20260101-complete/events.jsonl%00.html",
    "/runs/20260101-complete/.lock",
    "/runs/20260101-complete/none",
    "/runs/20260101-complete/folder",
    "/runs/beside.txt/",
    "/runs/beside.txt",
    "/runs/.hidden/events.jsonl",
    "/runs/.hidden/",
    "/runs/none/",
    "/runs/linked/secret.txt",
    "/runs/linked/",
    "/runs/20260101-complete/linked.txt",
    "/runs/20260101-complete/pipe",
    "/static/../app.py",
    "/static/%2e%2e/app.py",
    "/static/..%2fapp.py",
    "/app.py",
]


@pytest.mark.parametrize("path", PATHS)
def test_what_is_not_a_run_s_own_is_not_shown(path: str, runs: Path, panel: StubPanel) -> None:
    run = runs / "20260101-complete"
    (run / ".lock").write_text(SECRET, encoding="utf-8")
    (run / "folder").mkdir()
    shutil.copytree(run, runs / ".hidden")
    (runs / "linked").symlink_to(runs.parent / "outside", target_is_directory=True)
    (run / "linked.txt").symlink_to(runs.parent / "outside" / "secret.txt")
    os.mkfifo(run / "pipe")
    answer = panel.get(path)
    assert answer.status_code == 404
    assert SECRET.encode() not in answer.content
    assert answer.json()["ok"] is False


def test_whoever_leaves_in_the_middle_leaves_no_file_open(runs: Path, panel: StubPanel) -> None:
    """A file that is not closed would be a warning, and so an error here."""
    (runs / "20260101-complete" / "large.txt").write_bytes(bytes(10_000_000))
    path = "/runs/20260101-complete/large.txt"
    scope = {
        "type": "http",
        "http_version": "1.1",
        "method": "GET",
        "path": path,
        "query_string": b"",
        "root_path": "",
    }
    begun = asyncio.Event()

    async def receive() -> dict[str, str]:
        await begun.wait()
        return {"type": "http.disconnect"}

    async def send(message: object) -> None:
        begun.set()
        await asyncio.sleep(0)

    asyncio.run(panel.app({**scope, "headers": [(b"host", OWN["host"].encode())]}, receive, send))
    gc.collect()
