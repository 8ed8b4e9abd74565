"""Figures are the same whatever matplotlib settings the user has."""

import os
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest

from rig.report.plot import Plot, Subplot, guide

PANELS = [Subplot("time (s)", "force (gwt)", [guide("plot", [0.0, 1.0], [1.0, 0.0])])]


SETTINGS: dict[str, dict[str, object]] = {
    "TeX": {"text.usetex": True},
    "large letters": {"font.size": 30, "font.family": "serif"},
    "dark": {"axes.facecolor": "black", "savefig.facecolor": "black", "text.color": "white"},
    "other map": {"image.cmap": "gray", "lines.linewidth": 9.0},
}


@pytest.mark.parametrize("name", SETTINGS)
def test_a_figure_ignores_the_matplotlib_settings_of_the_user(name: str) -> None:
    plain = Plot((3, 2), PANELS).svg
    with mpl.rc_context(SETTINGS[name]):  # type: ignore[arg-type]
        of_the_user = dict(mpl.rcParams)
        assert Plot((3, 2), PANELS).svg == plain
        assert dict(mpl.rcParams) == of_the_user


ENVIRONMENTS = {
    "no such backend": {"MPLBACKEND": "nosuch"},
    "TeX": {"MATPLOTLIBRC": "text.usetex: True\n"},
    "noise": {"MATPLOTLIBRC": "\udcff\n: ::\n"},
}
SAVE = """\
import sys
from tests.rig.test_figures_without_settings import PANELS, Plot
sys.stdout.write(Plot((3, 2), PANELS).svg)
"""


@pytest.mark.parametrize(
    ("name", "where"),
    [
        ("no such backend", "variable"),
        ("TeX", "variable"),
        ("noise", "working folder"),
        ("TeX", "home"),
    ],
)
def test_the_program_starts_with_any_matplotlib_settings(name: str, where: str, tmp_path: Path) -> None:
    env = {**os.environ, **ENVIRONMENTS[name], "PYTHONPATH": str(Path(__file__).parents[2])}
    if (text := env.get("MATPLOTLIBRC")) is not None:
        file = tmp_path / "matplotlibrc"
        file.write_bytes(text.encode("utf-8", "surrogateescape"))
        if where == "variable":
            env["MATPLOTLIBRC"] = str(file)
        else:
            del env["MATPLOTLIBRC"]
    if where == "home":
        env["MPLCONFIGDIR"] = str(tmp_path)
    cwd = tmp_path if where == "working folder" else Path(__file__).parents[2]
    program = "import rig.report\n" + SAVE
    done = subprocess.run([sys.executable, "-c", program], env=env, cwd=cwd, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == Plot((3, 2), PANELS).svg
