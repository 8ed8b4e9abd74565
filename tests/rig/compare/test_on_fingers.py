"""What other fingers say of a run, and `rig compare --fingers`, on a coarse mesh."""

import hashlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig.compare.exceptions import FingersError
from rig.compare.plausible_fingers import PlausibleFingers, on_plausible_fingers
from rig.compare.recordings.synthetic import afferent_for, record, write_synthetic
from rig.compare.stimuli import stimuli
from rig.data import Run
from sim.config import FingertipConfig
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.program import Ended, Program, text_of_page
from tests.rig.compare.conftest import dry_run_of
from tests.sim.coarse_mesh import coarse_mesh

PRESSES = """\
from rig.protocol import Rig

def run(rig: Rig) -> None:
    rig.mount("cylinder:9")
    rig.home()
    rig.zero()
    for x_mm in (-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9):
        rig.move_to(x_mm=x_mm)
        rig.indent(force_gwt=1.0, hold_s=0.2)
    rig.mount("cylinder:3")
    for x_mm in (-0.3, 0.3):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.3, hold_s=0.2)
"""

ALLOWED = Path(__file__).parents[3] / "examples" / "plausible_fingers" / "allowed_by_the_source.toml"
RANGES = "[finger.tissue]\nepidermis_mm = [0.3, 0.5]\n"


@pytest.fixture(scope="module")
def coarse() -> Fingertip:
    """A finger of some thousand nodes."""
    return Fingertip.load(FingertipConfig(mesh=coarse_mesh(0.5, 0.5, patch_x_mm=2.5, patch_z_mm=2.5)))


@pytest.fixture(scope="module")
def run(coarse: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A cylinder to a force at seven places and another to a depth at two, on the coarse finger."""
    return dry_run_of(PRESSES, coarse, tmp_path_factory.mktemp("presses"))


def test_force_or_depth_stays_as_it_was_controlled(run: Run, coarse: Fingertip) -> None:
    """On the design's thickest finger, against presses made here; the run's own finger is in the middle of it."""
    pressed = stimuli(run, coarse)
    plausible = PlausibleFingers("--fingers x.toml", {"tissue.epidermis_mm": (0.3, 0.5)})
    found = on_plausible_fingers(run, pressed, coarse, plausible)
    thick = Fingertip.load(coarse.config.model_copy(update={"tissue": coarse.config.tissue.model_copy(
        update={"epidermis_mm": 0.5})}))  # fmt: skip
    for stimulus in found:
        assert stimulus.on_fingers is not None
        assert stimulus.on_fingers.shape == (3, *stimulus.measures.shape)
        # The middle is the run's own finger, pressed to the force or depth that it had: solved to 1e-8.
        np.testing.assert_allclose(
            stimulus.on_fingers[1], stimulus.measures, rtol=1e-5, atol=1e-6 * np.abs(stimulus.measures).max()
        )
        to_force = stimulus.kind == "force_gwt"
        target = {"force_gwt": stimulus.force_gwt[0]} if to_force else {"doi_mm": stimulus.doi_mm[0]}
        alone = thick.indent(stimulus.indentor, stimulus.x_mm[0], **target)
        sed = stimulus.on_fingers[2, MEASURES.index("sed"), 0]
        np.testing.assert_allclose(sed, alone.receptor_measures["sed"], rtol=1e-9)


def test_a_finger_that_cannot_be_pressed_like_that_is_named(run: Run, coarse: Fingertip) -> None:
    plausible = PlausibleFingers(
        "--fingers x.toml", {"tissue.epidermis_mm": (0.4, 0.4), "receptor_depth_mm": (0.7, 3)}
    )
    finger = "tissue.epidermis_mm = 0.4, receptor_depth_mm = 3"
    with raises(FingersError, "not_pressed", where="--fingers x.toml", finger=finger):
        on_plausible_fingers(run, stimuli(run, coarse), coarse, plausible)


@pytest.fixture
def compared(
    run: Run, coarse: Fingertip, tmp_path: Path, program: Program, empty_figures: None
) -> Callable[..., Ended]:
    """`rig compare` of the run and a synthetic recording."""
    by_force = next(stimulus for stimulus in stimuli(run, coarse) if stimulus.kind == "force_gwt")
    afferent = afferent_for([by_force], "sed", 5, peak=60.0, silent=0.3)
    rates = write_synthetic(tmp_path, record(afferent, by_force, np.linspace(-0.9, 0.9, 9), np.random.default_rng(1)))

    def command(*options: object) -> Ended:
        ended = program("compare", run.folder.path, "--recorded", f"cylinder:9={rates}", *options)
        assert ended.code == 0, ended.err
        return ended

    return command


def test_the_command(compared: Callable[..., Ended], tmp_path: Path, work: Counter[str]) -> None:
    """Ranges in answer and report, the same bytes twice, and no work once the fingers are in the cache."""
    ranges = tmp_path / "fingers.toml"
    ranges.write_text(RANGES, encoding="utf-8")
    a, b, plain = (tmp_path / name for name in ("a.html", "b.html", "plain.html"))
    answer = compared("--fingers", ranges, "--out", a, "--json").json
    work.clear()
    compared("--fingers", ranges, "--out", b)
    assert not work
    assert a.read_bytes() == b.read_bytes()
    page = a.read_text(encoding="utf-8")
    assert "Plausible fingers" in page
    assert hashlib.sha256(ranges.read_bytes()).hexdigest() in page
    assert f"--fingers={ranges}" in text_of_page(page)
    assert answer["fingers"]["ranges"] == [{"name": "tissue.epidermis_mm", "low": 0.3, "high": 0.5, "unit": "mm"}]
    assert answer["fingers"]["built"] == 3
    row = next(row for row in answer["fingers"]["joint"] if row["measure"] == "sed")
    assert {"k_interval", "eps0_interval", "best_finger", "on_this_finger"} <= set(row)
    without = compared("--out", plain, "--json").json
    assert "fingers" not in without
    other = {
        "report": "",
        "fingers": 0,
        "answers": 0,
    }  # an answer allows for what fingers differ by where that is stated
    assert answer["answers"] != without["answers"]
    assert {**answer, **other} == {**without, **other}
    assert "plausible fingers" not in plain.read_text(encoding="utf-8")


def test_the_shipped_fingers_that_the_source_allows_are_compared_with(
    compared: Callable[..., Ended], tmp_path: Path
) -> None:
    told = compared("--fingers", ALLOWED, "--exact", "--out", tmp_path / "a.html", "--json").json["fingers"]
    assert told["built"] == 9
    assert {one["name"] for one in told["ranges"]} == {"tissue.e_dermis", "tissue.e_fat"}
