"""`rig panel`: a page of the run that goes on, or of the bench by hand, for a browser on this machine."""

import os
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli.options import JsonOption
from rig.cli.output import err, out, print_json, told_in_one_line
from rig.protocol.errors import BadInputError

if TYPE_CHECKING:
    from rig.panel.serving import Panel

_LOWEST_PORT = 1024


def command(
    config: Annotated[
        Path | None, typer.Option(metavar="TOML", help="Configuration of the rig, to move it by hand.")
    ] = None,
    out_dir: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="The folder in which runs have theirs.")
    ] = Path("runs"),
    port: Annotated[int, typer.Option(metavar="N", help="On this port of loopback; 0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
    as_json: JsonOption = False,
) -> None:
    """Print where the page is, and serve it until Ctrl-C; a run goes on without it."""
    with told_in_one_line(as_json=as_json):
        if port != 0 and not _LOWEST_PORT <= port <= 65535:
            raise BadInputError(
                "{option} {value}: expected {low} … {high}, or 0",
                code="outside_range", option="--port", value=port, low=_LOWEST_PORT, high=65535,
            )  # fmt: skip
        panel = _panel(config, out_dir, port)
        if as_json:
            print_json({"url": panel.url, "port": panel.port, "pid": os.getpid()})
        else:
            out.print(panel.url)
            err.print("Ctrl-C ends the panel; a run goes on without it")
        with _shown(panel.url) if browser and not as_json else _not_shown():
            panel.serve()


def _panel(config: Path | None, out_dir: Path, port: int) -> "Panel":
    try:
        from rig.panel.serving import Offered, Panel
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("starlette", "uvicorn"):
            raise
        raise BadInputError(
            "panel: needs {package}, expected pip install 'indentation-rig[panel]'",
            code="not_installed",
            package=error.name,
        ) from None
    return Panel(Offered(out_dir, config, port))


@contextmanager
def _shown(url: str) -> Iterator[None]:
    """In the browser, by way of a file that only this user reads: others see what programs are begun with."""
    from rig.session.control.announcements import runtime_folder

    leads_there = runtime_folder() / f"panel-{os.getpid()}.html"
    page = f'<!doctype html><meta http-equiv="refresh" content="0; url={url}"><a href="{url}">rig panel</a>\n'
    with open(os.open(leads_there, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as file:
        file.write(page)
    try:
        webbrowser.open(leads_there.as_uri())
        yield
    finally:
        leads_there.unlink(missing_ok=True)


@contextmanager
def _not_shown() -> Iterator[None]:
    yield
