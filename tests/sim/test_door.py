"""`from sim import …`: a handful of names, with types that hold without plugins; wrong arguments have one line."""

import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sim
from sim import Aim, Fingertip, Tissue, choose, load, to_pandas
from sim.errors import ArgumentError, ModelRangeError
from tests.error_codes import raises

ROOT = Path(__file__).parents[2]


def test_every_public_name_of_sim_is_importable() -> None:
    assert sim.__version__ == version("indentation-rig")
    assert set(sim.__all__) <= set(dir(sim))
    for name in sim.__all__:
        assert getattr(sim, name) is not None
    with pytest.raises(AttributeError, match="module 'sim' has no attribute 'Fingertop'"):
        sim.__getattr__("Fingertop")


def test_importing_sim_imports_no_library() -> None:
    code = "import sys, sim; dir(sim); assert not {'numpy', 'pydantic', 'sim.models'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def _checked(files: Sequence[Path], tmp_path: Path) -> str:
    """What mypy --strict says of a user's files, with no plugin and no configuration but an empty one."""
    empty = tmp_path / "mypy.ini"
    empty.write_text("[mypy]\n")
    options = ("--strict", "--follow-imports=silent", "--config-file", str(empty))
    cache = ("--cache-dir", str(ROOT / ".mypy_cache" / "without_plugins"))
    command = [sys.executable, "-m", "mypy", *options, *cache, *map(str, files)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


USER = """\
from sim import Fingertip, FingertipConfig, Geometry, MeshSpec, Tissue, __version__

config = FingertipConfig(
    tissue=Tissue(epidermis_mm=0.3), mesh=MeshSpec(level="fine"), geometry=Geometry(length_mm=13.0)
)
result = Fingertip.load(config).indent("bar:3.0", doi_mm=0.5)
reveal_type(result.force_n)
reveal_type(__version__)
"""


@pytest.mark.study  # `make check` types what is behind the door
def test_a_type_checker_without_plugins_accepts_the_gallery_and_finds_misuse(tmp_path: Path) -> None:
    right, wrong = tmp_path / "right.py", tmp_path / "wrong.py"
    right.write_text(USER)
    wrong.write_text("from sim import MeshSpec, Tissue\nTissue(epidermis=0.3)\nMeshSpec(level='finest')\n")
    said = _checked([right, wrong, *sorted((ROOT / "examples" / "gallery" / "library").glob("*.py"))], tmp_path)
    assert "(checked 14 source files)" in said
    assert 'right.py:7: note: Revealed type is "float"' in said.replace("builtins.float", "float")
    assert 'right.py:8: note: Revealed type is "str"' in said.replace("builtins.str", "str")
    assert "wrong.py:2: error" in said
    assert "wrong.py:3: error" in said
    assert said.count("error:") == 2, said


# --- arguments that only a Python caller can get wrong ---


ARRAY: Any = np.zeros((5, 5))
PATH: Any = "finger.toml"
TISSUE: Any = Tissue()


@pytest.mark.parametrize(
    ("call", "code", "kind"),
    [
        (lambda simple: simple.indent(ARRAY, doi_mm=0.2), "no_indentor", "ndarray"),
        (lambda _: Fingertip.load(PATH), "no_finger_config", "str"),
        (lambda _: load("halfspace", TISSUE), "no_finger_config", "Tissue"),
        (lambda _: choose("bar:3.0", doi_mm=0.2, config=TISSUE), "no_finger_config", "Tissue"),
        (lambda simple: to_pandas(simple.indent("sphere:4", doi_mm=0.2)), "no_table", "IndentationResult"),
    ],
)
def test_an_argument_of_a_wrong_type_is_refused_by_its_type(
    halfspace: Fingertip, call: Callable[[Fingertip], Any], code: str, kind: str
) -> None:
    with raises(ArgumentError, code, kind=kind):
        call(halfspace)


@pytest.mark.parametrize(("tolerance", "quantities"), [(0.0, ()), (1.0, ()), (float("nan"), ()), (0.1, ("s33",))])
def test_an_aim_refuses_an_impossible_tolerance_or_unknown_quantity(
    tolerance: float, quantities: tuple[str, ...]
) -> None:
    with raises(ModelRangeError, "unknown_quantity" if quantities else "bad_tolerance"):
        Aim(quantities or ("force",), tolerance)


def test_an_unknown_model_is_refused_with_the_known_ones() -> None:
    with raises(ArgumentError, "unknown_model", known="halfspace, section, finger"):
        load("fingr")  # type: ignore[arg-type]


def test_an_aim_accepts_one_quantity_without_a_tuple() -> None:
    assert Aim("force") == Aim(("force",))  # type: ignore[arg-type]
