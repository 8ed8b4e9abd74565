"""Every block of every page: what can be run is run, all else stands here with the reason why it is not."""

import re
import shlex
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer

from rig.cli import program as the_program
from rig.compare.plausible_fingers import read_plausible
from rig.plan.config import load_config
from rig.study.parameter_study import read_study
from sim.models.fingertip import Fingertip
from tests.program import Program
from tests.rig.test_followed_pages import NOT_RUN as NOT_FOLLOWED
from tests.rig.test_followed_pages import PAGES as FOLLOWED
from tests.rig.test_followed_pages import expanded

ROOT = Path(__file__).parents[2]
GENERATED = (
    *("columns.md", "commands.md", "device_interface.md", "json_output.md"),
    *("python_names.md", "settings.md", "studies.md"),
)
"""Read off the program when the site is built."""
PAGES = sorted(
    path
    for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("*.md")]
    if path.name not in GENERATED and "gallery" not in path.parts
)
DRAWN = {"mermaid", "{toctree}", "{eval-rst}", "{literalinclude}", "{csv-table}"}

HARDWARE, SLOW, NETWORK, SETUP = "needs a rig", "takes long", "needs the network", "what every test begins with"
PRINTED, SKETCH = "what is printed", "shown in part"
NERVE, DESIGN = "tests/rig/test_nerve_command.py", "tests/rig/design/test_design_command.py"
ADAPTIVE = "tests/rig/design/test_adaptive_run.py"
NOT_RUN = {
    # --- commands, a line each ---
    "make setup": SETUP,
    ". .venv/bin/activate": SETUP,
    "cp examples/tutorial/synthetic_afferent.csv .": "tests/rig/test_followed_pages.py",
    "make demo": f"{SETUP}; its dry-run is tests/rig/test_dry_run.py's",
    "make test": SETUP,
    "make docs": SLOW,
    "pytest -n 0 tests/contracts tests/rig/test_catalogue.py tests/rig/test_NAME_driver.py": "these are tests",
    "rig config --markdown > docs/configuration.md": "tests/rig/test_config_command.py",
    "rig serve": "tests/rig/real_time/test_serve_command.py",
    "rig serve --stage leadshine --tcp 5020": "tests/rig/real_time/test_serve_command.py",
    "rig identify --config rig.toml --to finger.toml": HARDWARE,
    "rig identify --dry-run --config rehearsal.toml --to rehearsed.toml": "tests/rig/test_identification.py",
    "rig check steps --config rig.toml --finger finger.toml": "tests/rig/test_identification.py",
    "rig run steps --config rig.toml --finger finger.toml": HARDWARE,
    "rig serve --random-finger 2 --tcp 5000 --indentor bar:3.0": (
        "tests/rig/real_time/test_identify_a_random_finger.py"
    ),
    "rig identify --config practice.toml --shapes bar:3.0 --to practice_finger.toml": (
        "tests/rig/real_time/test_identify_a_random_finger.py"
    ),
    "rig serve --reveal 2 --beside practice_finger.toml": "tests/rig/test_stranger_command.py",
    "rig init": HARDWARE,
    "rig init --port /dev/pts/3 --port /dev/pts/4": "tests/rig/real_time/test_init_finds_devices.py",
    "rig init --yes --travel-mm 60,30,40 --steps-per-mm none --range-gwt 200 --trip-n 1.5 --finger none": (
        "tests/rig/test_init_command.py"
    ),
    "rig doctor --config rig.toml": HARDWARE,
    "rig home --config rig.toml": HARDWARE,
    "rig status --config rig.toml": HARDWARE,
    "rig run steps --config rig.toml --subject S07": HARDWARE,
    "rig resume RUN": "tests/rig/test_resume.py",
    "rig run first_press --config rig.toml": HARDWARE,
    "rig pulse --config rig.toml": "tests/rig/test_sync_line.py",
    "rig pulse --config rig.toml --loopback": "tests/rig/test_sync_line.py",
    "rig jog --config rig.toml": HARDWARE,
    "rig jog --config rig.toml --axis z --by-mm -5 --speed-mm-s 1": HARDWARE,
    "rig calibrate steps --config rig.toml --axis z --by-mm -20": HARDWARE,
    "rig calibrate force --config rig.toml --mass-g 50": HARDWARE,
    "rig calibrate compliance --config rig.toml --to-gwt 100": HARDWARE,
    "rig panel": "a server: tests/panel",
    "rig panel --config rig.toml": HARDWARE,
    "rig compare rehearsals/*-steps-* --recorded step:1=examples/tutorial/synthetic_afferent.csv "
    "--place --offset-mm=-0.3,0.3": SLOW,
    "rig compare rehearsals/*-steps-* --recorded step:1=examples/tutorial/synthetic_afferent.csv "
    "--fingers examples/plausible_fingers/fingers.toml": "tests/rig/compare/test_on_fingers.py",
    "rig finger --config examples/own_finger/points.toml": "tests/rig/test_finger_command.py",
    "rig indent --config examples/own_finger/points.toml --shape bar:3.0 --x-mm 0 --doi-mm 0.5": SLOW,
    "rig study mine.toml --scheduler tcp://scheduler:8786": "tests/rig/compare/test_study_on_a_cluster.py",
    "dask scheduler": "tests/rig/compare/test_study_on_a_cluster.py",
    "dask worker tcp://scheduler:8786 --nthreads 1": "tests/rig/compare/test_study_on_a_cluster.py",
    "rig dry-run bars --out rehearsals --afferents 3xSA1,5xRA": NERVE,
    "rig nerve RUN --afferents SA1@0,RA@0.5:1 --seed 3": NERVE,
    (
        "rig dry-run bars --set doi_mm=0.8 increments=1 from_mm=2.4 to_mm=-2.4 spacing_mm=0.4 --out rehearsals "
        "--afferents SA1@0"
    ): "tests/rig/test_followed_pages.py",
    "RUN=$(ls -d rehearsals/*-bars-*)": "tests/rig/test_followed_pages.py",
    'rig compare $RUN --recorded "bar:3.0=$RUN/synthetic_spikes.nwb#0" --out sa1.html': (
        "tests/rig/test_followed_pages.py"
    ),
    "rig design --candidates ep1,sed,e12,s22,e11,mean --shapes step:1,bar:3.0,cylinder:3 --minutes 10": DESIGN,
    "rig check designed.py --config rig.toml counts=counts.csv": ADAPTIVE,
    "rig run designed.py --config rig.toml counts=counts.csv": ADAPTIVE,
    (
        "rig design --candidates ep1,sed,e22 --shapes bar:3.0,cylinder:3 --depths-mm 0.25,0.5,1 --minutes 3 --quick"
    ): ADAPTIVE,
    "rig dry-run designed.py counts=virtual:ep1@3": ADAPTIVE,
    "rig check designed.py": DESIGN,
    "rig dry-run designed.py": DESIGN,
    "rig design --candidates ep1,sed,e12,s22,e11,mean --shapes step:1,bar:3.0,cylinder:3 --counts counts.csv": DESIGN,
    'rig compare RUN --recorded "step:1=session.nix#unit 1" --columns sync=TTL': "tests/rig/compare/test_neo_file.py",
    "rig compare RUN --recorded afferents.csv --out group.html": "tests/rig/compare/test_afferents_table.py",
    "pip install examples/rig_line_scale": "tests/test_third_party_device.py",
    "pip install 'indentation-rig[cluster]'": NETWORK,
    "pip install 'indentation-rig[lsl]'": NETWORK,
    "pip install 'indentation-rig[bluesky]'": NETWORK,
    "rig stream --out runs": "tests/rig/real_time/test_lsl_inlet.py",
    "python my_plan.py": "tests/rig/real_time/test_bluesky.py",
    'with BlueskyBench("rig.toml", indentor="bar:3.0", force_gwt=2.33, presses=10) as rig:': HARDWARE,
    "pip install build && python -m build --wheel": f"{NETWORK}; tests/test_wheel.py makes one without",
    "python -m venv elsewhere && elsewhere/bin/pip install dist/indentation_rig-*.whl": "tests/test_wheel.py",
    "elsewhere/bin/python examples/gallery/library/01_press_and_plot.py": "tests/test_wheel.py",
    "mbpoll -m tcp -p 5020 -a 1 -t 4:hex -0 -r 25088 -c 8 -1 127.0.0.1": "tests/rig/test_modbus_counterparties.py",
    "mkdir -m 755 /scratch/me/cache && export RIG_CACHE_DIR=/scratch/me/cache": "tests/sim/test_cache.py",
    "python -m pip install --require-hashes -r requirements/setup.txt": "tests/test_supply_chain.py",
    "py -m venv .venv": "a command of Windows",
    r".venv\Scripts\pip install -e .": "a command of Windows",
    r".venv\Scripts\rig doctor": "a command of Windows",
    # --- blocks, by their first line ---
    "auto chose finger, level coarse: force and contact, no receptors; patch ± 3.30 × ± 3.50 mm; "
    "about 2.6 s of processor time …": PRINTED,
    "21 indentations, 0:05:43 left": PRINTED,
    "design    28 presses in 10 minutes fail in 1.4 ± 0.7 % of experiments, and the best usual design, random "
    "presses, in 1.1 ± 0.6 %, so this simulation shows no gain from the choice of presses.": PRINTED,
    "pulse  requested (s)  confirmed (s)  uncertainty (ms)  width (ms)  input (ms)": PRINTED,
    "3 indentations, 102 s of bench time in 2.6 s": PRINTED,
    "skin     99 points": PRINTED,
    "press 1 of at most 8: flat:3 at +1.2 mm to 0.30 mm, trips at 8.8 gwt …": PRINTED,
    "def read(self) -> ForceReading:": SKETCH,
    "def test_a_weight_is_a_magnitude_with_its_sign_in_the_status(transmitter: Make) -> None:": SKETCH,
    "DEVICE = ForceKind(": SKETCH,
    "afferent,shape,force_gwt,file": SKETCH,
    "shape,x_mm,doi_mm,count": SKETCH,
    "for e_fat in (0.03, 0.05, 0.1, 0.2):": f"{SLOW}: sixteen fingers; tests/sim/test_moduli.py builds smaller ones",
    "force_gwt = h5read('data.h5', '/sample/force_gwt');": "not tried in MATLAB",
}
"""Nothing else is shown that no test runs. A study is run by hand, and test_house sees that it is there."""


@dataclass(frozen=True)
class Block:
    """What a fence says that it holds, and what it holds."""

    page: Path
    kind: str
    text: str

    @property
    def first(self) -> str:
        """Its first line that imports nothing."""
        lines = (line for line in self.text.splitlines() if line.strip())
        return next((line for line in lines if not line.startswith(("from ", "import "))), "")

    def __str__(self) -> str:
        return f"{self.page.stem}: {self.first[:50]}"


def _blocks() -> list[Block]:
    fence = re.compile(r"^( *)```([^\n]*)\n(.*?)^\1```$", flags=re.MULTILINE | re.DOTALL)
    return [
        Block(page, kind.strip(), re.sub(f"^{indent}", "", text, flags=re.MULTILINE))
        for page in PAGES
        for indent, kind, text in fence.findall(page.read_text(encoding="utf-8"))
        if kind.partition(" ")[0].strip() not in DRAWN
    ]


BLOCKS = [block for block in _blocks() if block.page.stem not in FOLLOWED]
COMMANDS = [block for block in BLOCKS if not block.kind and block.first not in NOT_RUN]
"""Those that hold a command a line; a block that is excused as one is excused by its first line."""


def _lines(block: Block) -> list[str]:
    """Commands without what is said of them."""
    found = (re.sub(r"\s+#.*$", "", line).strip() for line in block.text.splitlines())
    return [line for line in found if line and not line.startswith("#")]


def _is_study(line: str) -> bool:
    return re.match(r"(OMP_NUM_THREADS=1 )?\.venv/bin/python -m studies[. ]", line) is not None


STUDIES = sorted(
    {
        found
        for page in PAGES
        for found in re.findall(r"python -m (studies[^`#\n]*)", page.read_text(encoding="utf-8"))
    }
)


@pytest.mark.parametrize("command", STUDIES)
def test_every_study_has_the_options_that_a_page_names(command: str) -> None:
    module, *words = command.split()
    path = ROOT.joinpath(*module.split("."))
    source = (path / "__main__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8")
    assert [word for word in words if word.startswith("--") and f'"{word}"' not in source] == []


TO_RUN = {
    page: [
        line
        for block in [one for one in BLOCKS if one.page == page and not one.kind]
        for line in _lines(block)
        if line.startswith("rig ") and line not in NOT_RUN
    ]
    for page in PAGES
}


@pytest.mark.parametrize("block", [block for block in BLOCKS if not block.kind], ids=str)
def test_every_command_on_a_page_is_run_or_listed_as_not_run(block: Block) -> None:
    if block.first in NOT_RUN and not block.first.startswith(("rig ", "make ", "pip ", ".venv", "dask ")):
        return
    for line in _lines(block):
        assert line in NOT_RUN or _is_study(line) or line in TO_RUN[block.page], line


def test_every_block_listed_as_not_run_stands_on_a_page() -> None:
    shown = {block.first for block in BLOCKS} | {line for block in _blocks() for line in _lines(block)}
    assert not set(NOT_RUN) - shown
    assert {line for lines in NOT_FOLLOWED.values() for line in lines} <= set(NOT_RUN)


# --- what is shown is run, in the order of its page ---

RECORDED = [(-1.2, 8), (-0.8, 14), (-0.4, 22), (0.0, 35), (0.4, 26), (0.8, 12), (1.2, 7)]  # SYNTHETIC
RATES = "position_mm,rate,sd\n" + "".join(f"{x_mm},{rate},2\n" for x_mm, rate in RECORDED)
OTHER_UNITS = "Position (um),FR,SD,trial\n" + "".join(
    f"{1000 * x_mm:.0f},{rate / 1000 + trial / 1e4},0.002,{trial}\n" for x_mm, rate in RECORDED for trial in (1,)
)
CHECKED: set[str] = set()
"""Checks of a page before: nothing comes of a check, so that a second one says the same."""


@pytest.mark.parametrize("page", [page for page in PAGES if TO_RUN[page]], ids=lambda page: page.stem)
def test_the_commands_on_every_page_run(
    page: Path,
    program: Program,
    finger: Fingertip,
    empty_figures: None,
    made_once: Callable[[str, Callable[[], object]], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text("", encoding="utf-8")
    shutil.copy(ROOT / "examples" / "plausible_fingers" / "fingers.toml", tmp_path)
    for name in ("tutorial", "afferents"):
        shutil.copytree(ROOT / "examples" / name, tmp_path / "examples" / name)
    run = made_once("steps", lambda: _run_of_steps(program)).relative_to(tmp_path)
    for line in TO_RUN[page]:
        if line in CHECKED:
            continue
        if line.startswith("rig check "):
            CHECKED.add(line)
        Path("mine.csv").write_text(OTHER_UNITS if "FR:1/ms" in line else RATES, encoding="utf-8")
        found = sorted(Path("runs").glob("*-find_finger-*"))
        names = {"RUN": run, "runs/…-find_finger-…": found[0] if found else run}
        words = [
            str(run) if re.fullmatch(r"runs/\d{8}T.*", word) else str(names.get(word, word))
            for word in shlex.split(line)
        ]
        ended = program(*(found for word in words[1:] for found in expanded(word)))
        assert ended.code == 0, f"{line}: {ended.err}"


def _run_of_steps(program: Program) -> None:
    positions = ["from_mm=1.2", "to_mm=-1.2", "spacing_mm=0.4"]
    assert program("dry-run", "steps", "--set", *positions, "--subject", "S07").code == 0


# --- whatever is named in running text can be typed ---


@cache
def _options(command: str) -> set[str]:
    found: Any = typer.main.get_command(the_program._app([command])).commands[command]
    below = [found, *getattr(found, "commands", {}).values()]
    return {name for one in below for param in one.params for name in (*param.opts, *param.secondary_opts)} | {
        "--help"
    }


def test_every_command_and_option_named_on_a_page_exists() -> None:
    for page in PAGES:
        if page.stem == "CHANGELOG":  # of versions that there were
            continue
        text = page.read_text(encoding="utf-8")
        named = re.findall(r"`(?:\.venv/bin/)?rig ([a-z][a-z-]*)([^`\n]*)`", text)
        named += re.findall(r"^ *(?:\.venv/bin/)?rig ([a-z][a-z-]*)(?= |$)([^\n#]*)", text, flags=re.MULTILINE)
        for command, rest in named:
            assert command in the_program.COMMANDS, (page, command)
            options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", rest))
            assert options <= _options(command), (page, command, options - _options(command))


# --- configurations and code ---

READ_BY: dict[str, Callable[[Path], object]] = {
    "parameter_studies": read_study,
    "comparison": read_plausible,
    "adding_a_device": lambda path: (
        (ROOT / "examples" / "rig_line_scale" / "pyproject.toml").read_text().index(path.read_text())
    ),
    "README": lambda path: None,  # of the example: tests/test_third_party_device.py
}
"""All others are configurations of the rig."""


@pytest.mark.parametrize("block", [block for block in BLOCKS if block.kind.startswith("toml")], ids=str)
def test_every_toml_block_on_a_page_can_be_loaded(block: Block, tmp_path: Path) -> None:
    path = tmp_path / "block.toml"
    drives = next(one.text for one in BLOCKS if 'kind = "leadshine"' in one.text)
    path.write_text((drives if 'output = "drive"' in block.text else "") + block.text, encoding="utf-8")
    READ_BY.get(block.page.stem, load_config)(path)


SHOWN_BY = {"data": "tests/rig/test_data_dictionary.py"}


@pytest.mark.parametrize("block", [block for block in BLOCKS if block.kind.startswith("python")], ids=str)
def test_python_on_every_page_runs_or_is_excused(
    block: Block, program: Program, finger: Fingertip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if block.page.stem in SHOWN_BY:
        assert block.page.name in (ROOT / SHOWN_BY[block.page.stem]).read_text(encoding="utf-8")
    elif "def run(rig: Rig)" in block.text:
        Path("mine.py").write_text(block.text, encoding="utf-8")
        assert program("check", "mine.py").code == 0
    elif block.first not in NOT_RUN:
        exec(compile(block.text, str(block.page), "exec"), {})
