"""The gallery's scripts run, give what their pages say, and draw a picture.

`make test` runs them on a coarse finger and with fewer poses; `make test-studies` and `make docs` as they stand.
"""

import contextlib
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest

from sim import MEASURES, Fingertip, FingertipConfig
from tests.preloaded import Popen
from tests.program import WHOLE, Program, program_of
from tests.sim.coarse_mesh import coarse_mesh

ROOT = Path(__file__).parents[1]
GALLERY = ROOT / "examples" / "gallery"
LIBRARY = sorted((GALLERY / "library").glob("*.py"))
SCRIPTS = sorted(GALLERY.glob("*/*.py"))
RIG = sorted((GALLERY / "rig").glob("*.py"))


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    matplotlib.use("agg")


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Program:
    """Run the program in this process."""
    return program_of(monkeypatch, capsys)


@pytest.fixture
def in_this_process(program: Program, empty_figures: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """A script's `python -m rig` is run in this process, and draws nothing on a page that is thrown away.

    test_gallery_run_resumed_completes_four_presses and test_gallery_device_added_measures_force begin real ones.
    """

    begun = subprocess.run

    def run(command: list[str], **options: Any) -> subprocess.CompletedProcess[Any]:
        if command[:3] != [sys.executable, "-m", "rig"]:
            return begun(command, **options)  # by the program, which asks git for its version
        with contextlib.chdir(options.get("cwd", ".")):
            ended = program(*command[3:])
        assert ended.code == 0, ended.err
        return subprocess.CompletedProcess(command, ended.code, ended.out, ended.err)

    monkeypatch.setattr(subprocess, "run", run)


class Undrawn(Popen):
    """A script's `python -m rig` is a process that draws nothing on a page that is thrown away."""

    def __init__(self, command: list[str], **options: Any) -> None:
        python, *words = command
        super().__init__([python, WHOLE, *words[2:]] if words[:2] == ["-m", "rig"] else command, **options)


COARSE = "coarse_mesh(0.3, 0.6)"
SMALLER = {
    "01_press_and_plot": {'MeshSpec(level="coarse")': COARSE},
    "02_sweep": {'MeshSpec(level="coarse")': COARSE},
    "03_own_indentor": {
        "Fingertip, MeasuredProfile": "Fingertip, FingertipConfig, MeasuredProfile, MeshSpec",
        "Fingertip.load()": f"Fingertip.load(FingertipConfig(mesh={COARSE}))",
    },
    "04_own_layers": {"MeshSpec(spacing_mm=0.4, axial_spacing_mm=0.6)": COARSE},
    "05_own_finger": {"MeshSpec(spacing_mm=0.4, axial_spacing_mm=0.6)": COARSE},
    "07_ssrp": {'MeshSpec(level="coarse")': COARSE},
    "08_fit_to_rates": {'MeshSpec(level="coarse")': COARSE},
    "09_many_poses": {'MeshSpec(level="coarse")': COARSE, "POSES = 80": "POSES = 12"},
    "10_parameter_study": {
        "(0.3, 0.4, 0.5), (0.26, 0.38)": "(0.3, 0.5), (0.26, 0.38)",
        "MeshSpec(spacing_mm=0.5, axial_spacing_mm=0.8)": COARSE,
    },
    "11_encode": {'MeshSpec(level="coarse")': COARSE},
    "03_letter": {
        '"--x-mm", "0", ': '"--x-mm", "0", "--model", "halfspace", ',
        '"--config", "coarse.toml", ': "",
    },
}
"""What is written otherwise in a script, to take less time."""


def _code(path: Path, smaller: bool = True) -> str:
    text = path.read_text(encoding="utf-8")
    for there, less in SMALLER.get(path.stem, {}).items() if smaller else ():
        assert text.count(there) == 1, f"{path.stem}: {there}"
        text = text.replace(there, less)
    return text


def _run(name: str, smaller: bool = True) -> dict[str, Any]:
    """The names that a script leaves; it has drawn one figure and written nothing beside it."""
    (path,) = (path for path in SCRIPTS if path.stem == name)
    main, before = ModuleType("__main__"), sys.modules["__main__"]  # no __file__, as sphinx-gallery runs a script
    try:
        sys.modules["__main__"] = main
        main.__dict__["coarse_mesh"] = coarse_mesh
        with mock.patch.object(sys, "argv", [str(path)]):
            exec(compile(_code(path, smaller), path, "exec"), main.__dict__)
        assert len(plt.get_fignums()) == 1
        assert all(axes.has_data() for axes in plt.gcf().axes)
    finally:
        sys.modules["__main__"] = before
        plt.close("all")
    assert not list(Path().iterdir())
    return main.__dict__


def test_gallery_press_and_plot_presses_to_half_a_millimeter() -> None:
    result = _run("01_press_and_plot")["result"]
    assert result.doi_mm == 0.5
    assert len(result.contact_regions_mm) == 1


def test_gallery_sweep_prints_the_pressure_at_nine_positions(capsys: pytest.CaptureFixture[str]) -> None:
    found = _run("02_sweep")["found"]
    assert found.problems == [""] * 9
    assert found.table()["force_gwt"] == pytest.approx(2.33, rel=1e-6)
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 9
    assert printed[0].startswith(f"x =  2.00 mm: {found[0].peak_pressure_kpa:5.1f} kPa, ")


def test_gallery_own_indentor_presses_a_profile_to_two_gwt() -> None:
    result = _run("03_own_indentor")["result"]
    assert result.indentor.name == "profile:rippled dome"
    assert result.force_gwt == pytest.approx(2.0, rel=1e-6)


def test_gallery_own_layers_softer_layers_give_less_force() -> None:
    default, soft = _run("04_own_layers")["force_gwt"].values()
    assert (soft < 0.8 * default).all()
    assert (np.diff(default) > 0).all()


def test_gallery_own_finger_presses_a_larger_finger() -> None:
    left = _run("05_own_finger")
    assert left["finger"].config.receptor_plane_mm == pytest.approx(7.6)
    assert left["finger"].apex_height_mm == pytest.approx(5.2, abs=0.2)
    assert (np.diff(left["table"]["force_gwt"]) > 0).all()


@pytest.mark.study  # sim/test_any_point.py
def test_gallery_strain_anywhere_maps_sed_over_depth() -> None:
    sed = _run("06_strain_anywhere")["sed"]
    assert sed.shape == (16, 33)
    assert sed[4].max() > 1.2 * sed[7].max()
    assert sed.min() > 0


def test_gallery_ssrp_equals_a_single_press() -> None:
    left = _run("07_ssrp")
    found, place = left["profiles"], 5
    assert tuple(found) == MEASURES
    alone = left["finger"].indent("step:1", left["x_mm"][place], force_gwt=2.33).receptor_measures
    assert found["sed"][place] == pytest.approx(alone["sed"][3], rel=1e-6)
    assert found["ep1"][place] == pytest.approx(-alone["ep1"][3], rel=1e-6)


def test_gallery_fit_to_rates_correlates_above_0_9() -> None:
    left = _run("08_fit_to_rates")
    highest = left["eps"].max()
    assert 0 < left["fit"].eps0 < highest
    assert 0 < left["fit"].k < 80 / (0.5 * highest)
    assert left["r"] > 0.9


def test_gallery_many_poses_solves_twelve_presses(capsys: pytest.CaptureFixture[str]) -> None:
    found = _run("09_many_poses")["found"]
    assert found.problems == [""] * 12
    printed = capsys.readouterr().out
    assert printed.startswith("<12 indentations, 0 with a problem>\n")
    assert printed.count("mm deep on average") == len(set(found.table()["shape"])) == 3


@pytest.mark.study  # rig/compare/test_parameter_study.py
def test_gallery_parameter_study_force_grows_with_both_parameters() -> None:
    study = _run("10_parameter_study")["study"]
    assert study["epidermis_mm"].tolist() == [0.3, 0.3, 0.5, 0.5]
    force_gwt = study["force_gwt"].reshape(2, 2)
    assert (np.diff(force_gwt, axis=0) > 0).all()
    assert (np.diff(force_gwt, axis=1) > 0).all()


def test_gallery_encode_adds_noise_and_silences_receptors() -> None:
    left = _run("11_encode")
    noisy, quiet = left["noisy"], left["quiet"]
    assert noisy.samples == len(left["sed"]) == 41
    assert np.linalg.norm(left["sed"] - quiet.sed) < 0.5 * np.linalg.norm(quiet.sed)
    assert 0 < int((noisy.rate == 0).sum()) < 41


@pytest.mark.study  # rig/test_decode_command.py, sim/test_decoding.py
def test_gallery_decode_converges_with_a_relative_error_below_half() -> None:
    left = _run("12_decode")
    assert left["found"].converged
    assert left["errors"].relative_l2 < 0.5


# --- the rig, rehearsed ---


def test_gallery_own_protocol_presses_three_times(in_this_process: None) -> None:
    samples = _run("01_own_protocol")["samples"]
    assert [max(_forces(samples, index)) > 1 for index in range(3)] == [True] * 3


@pytest.mark.study  # rig/test_schedule.py
def test_gallery_random_order_differs_between_two_blocks(in_this_process: None) -> None:
    started = _run("02_random_order")["recorded"].stream("indentation_start")
    order = {block: [one["value"] for one in started if one["block"] == block] for block in (1, 2)}
    assert sorted(order[1]) == sorted(order[2]) == [1.0, 2.0, 4.0]
    assert order[1] != order[2]


@pytest.mark.study  # rig/test_map_in_a_run.py
def test_gallery_letter_presses_to_0_3_mm(in_this_process: None) -> None:
    answer = _run("03_letter")["answer"]
    assert answer["doi_mm"] == pytest.approx(0.3)
    assert answer["force_gwt"] > 0.5


@pytest.mark.study  # the recorded bar, rig/compare/test_compare_command.py
def test_gallery_recording_compared_correlates_every_measure(in_this_process: None) -> None:
    left = _run("04_recording_compared")
    assert left["measures"] == list(MEASURES)
    assert np.nanmax(np.abs(left["r"])) > 0.9


@pytest.mark.study  # rig/test_identification.py
def test_gallery_finger_identified_in_four_to_eight_presses(in_this_process: None) -> None:
    left = _run("05_finger_identified")
    assert 4 <= len(left["presses"]) <= 8
    assert (left["low"] < left["middle"]).all()
    assert (left["middle"] < left["high"]).all()


@pytest.mark.study  # rig/test_resume.py, rig/test_command_line.py: Ctrl-C
def test_gallery_run_resumed_completes_four_presses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "Popen", Undrawn)
    left = _run("06_run_resumed")
    assert left["stopped"].missing > 0
    assert len(left["resumed"].done) == 4
    assert (left["resumed"].missing, left["resumed"].repeated) == (0, 0)


@pytest.mark.study  # rig/compare/test_study_on_a_cluster.py
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_gallery_study_on_a_cluster_solves_twelve_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "Popen", Popen)
    rows = _run("07_study_on_a_cluster")["rows"]
    assert len(rows) == 12
    assert [row["problem"] for row in rows] == [""] * 12


@pytest.mark.study  # test_third_party_device.py
def test_gallery_device_added_measures_force() -> None:
    samples = _run("08_device_added")["samples"]
    assert max(_forces(samples, 1)) > 1


@pytest.mark.study  # rig/real_time/test_bluesky.py
def test_gallery_bluesky_reads_the_journaled_forces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "Popen", Popen)
    left = _run("10_bluesky")
    assert [one["rig_hold_end_force_gwt"] for one in left["holds"]] == pytest.approx([1.0, 2.0], abs=0.05)
    journalled = [one["force_gwt"] for one in left["journal"].stream("sample") if one["index"] >= 0]
    assert [one["rig_sample_force_gwt"] for one in left["samples"] if one["rig_sample_index"] >= 0] == journalled


def _forces(samples: list[dict[str, Any]], index: int) -> list[float]:
    return [one["force_gwt"] for one in samples if one["index"] == index]


# --- all of them ---


@pytest.mark.study  # the tests above
@pytest.mark.parametrize("name", SMALLER)
def test_every_gallery_script_runs_unchanged(name: str, in_this_process: None) -> None:
    _run(name, smaller=False)


def test_every_gallery_script_has_a_test() -> None:
    assert [path.stem[:3] for path in LIBRARY] == [f"{n:02}_" for n in range(1, 13)]
    assert [path.stem[:3] for path in RIG] == [f"{n:02}_" for n in range(1, 11)]
    tests = [name for name in globals() if name.startswith("test_gallery_")]
    assert [path for path in SCRIPTS if not any(f"test_gallery_{path.stem[3:]}_" in name for name in tests)] == []


def test_every_gallery_script_has_at_most_40_lines() -> None:
    lines = {path.stem: path.read_text(encoding="utf-8").splitlines() for path in SCRIPTS}
    assert {name for name, text in lines.items() if len([line for line in text if line.strip()]) > 40} == set()


def test_a_gallery_script_with_worker_processes_runs_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is imported again in a process does not begin anew."""
    script = tmp_path / "sweep.py"
    text = (GALLERY / "library" / "02_sweep.py").read_text(encoding="utf-8")
    script.write_text(text.replace("-3.2, 9)", "-3.2, 3)").replace("cores=1", "cores=2"), encoding="utf-8")
    monkeypatch.setattr(subprocess, "Popen", Popen)
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert np.array(done.stdout.splitlines()).shape == (3,)


@pytest.mark.study  # the next one, and rig/compare/test_recorded_example.py
def test_gallery_recorded_bar_keeps_ep1_and_sed_in_the_confidence_set(in_this_process: None) -> None:
    static, dynamic = _run("09_recorded_bar")["phases"]
    assert (static["positions_recorded"], dynamic["positions_recorded"]) == (36, 36)
    assert static["sed_r"] == pytest.approx(0.92, abs=0.01)
    assert dynamic["sed_r"] == pytest.approx(0.937, abs=0.01)
    kept = [row["candidate"] for row in static["rows"] if row["in_set"]]
    assert set(kept) == {"ep1", "sed"}
    assert not any(row["in_set"] for row in dynamic["rows"])
    low, high = static["rows"][0]["held_out_interval"]
    assert low < static["rows"][0]["held_out"] < high


def test_gallery_recorded_bar_draws_both_phases_on_a_coarse_finger(
    in_this_process: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    coarse = Fingertip.load(FingertipConfig(mesh=coarse_mesh(0.5, 0.5)), receptor_x_mm=(-0.5, 0.0))
    monkeypatch.setattr(Fingertip, "load", lambda *_, **__: coarse)
    monkeypatch.setattr("rig.compare.example._RAMP_STEPS", 2)
    left = _run("09_recorded_bar")
    phases, panels = left["phases"], left["figure"].axes
    for axes in panels:  # the measures of the set and the control, then the recording and where it is 0
        *predicted, recorded, zero = (len(line.get_xdata()) for line in axes.lines)
        assert (set(predicted), recorded, zero) == ({281}, 36, 2)
        assert len(predicted) >= 2
    assert [one["phase"] for one in phases] == ["static", "dynamic"]
    assert [one["positions_recorded"] for one in phases] == [36, 36]
    assert all(one["sed_r"] > 0.85 for one in phases)
