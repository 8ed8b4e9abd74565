"""`rig decode`: pressures, presses and files of readings in, pressures with their band out, and what is refused."""

import pickle
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rig.cli import encode
from rig.cli.decode import receptor_of
from sim.coding import decoders_by_search, task
from sim.coding.bayes import FittedReceptor
from sim.coding.encoding import Receptor, noise_sd
from sim.coding.operators import influence
from sim.coding.readings_file import pa_per_pseudo
from sim.coding.section import ReceptorSection, receptor_section
from sim.coding.task import CUT_OFF
from sim.config import FingertipConfig
from tests.program import Program, program_of
from tests.sim.coarse_mesh import as_toml, coarse_mesh

COARSE = coarse_mesh(0.3, 0.5)
DEPTH_MM = np.tile([0.6, 0.76, 0.9], 4)
TWO = ("decode", "--pressure", "20,14", "--config", "coarse.toml", "--half-length", 10)
PA = pa_per_pseudo(FingertipConfig())
WORKED = (*TWO, "--start", "10,10", "--range", "0,30")


@pytest.fixture(scope="module", autouse=True)
def _built_once() -> Iterator[None]:
    """Commands of this file ask for the same few sections, which take tenths of a second to build."""
    kept: dict[tuple[bytes, bytes], Any] = {}

    def once(build: Callable[..., Any]) -> Callable[..., Any]:
        def built(config: FingertipConfig, *about: Any) -> Any:
            key = config.model_dump_json().encode(), pickle.dumps((build.__name__, about))
            if key not in kept:
                kept[key] = build(config, *about)
            return kept[key]

        return built

    with pytest.MonkeyPatch.context() as patch:
        for name in ("sampled_section", "receptor_section"):
            patch.setattr(task, name, once(getattr(task, name)))
        patch.setattr(encode, "sampled_section", task.sampled_section)
        yield


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Program:
    monkeypatch.chdir(tmp_path)
    Path("coarse.toml").write_text(as_toml(COARSE), encoding="utf-8")
    program = program_of(monkeypatch, capsys)
    return lambda *words, **more: program(
        *words, *(() if "--config" in words else ("--config", "coarse.toml")), **more
    )


@pytest.fixture(scope="module")
def section() -> ReceptorSection:
    """Irregular receptors, 0.2 to 0.9 mm apart, at several depths."""
    place = np.array([-2.3, -1.7, -1.5, -0.9, -0.5, -0.3, 0.1, 0.6, 0.8, 1.4, 1.9, 2.1])
    return receptor_section(FingertipConfig(mesh=COARSE), place, DEPTH_MM)


def dome_felt_by(section: ReceptorSection) -> np.ndarray:
    """SED under a dome of pressure 1.5 mm wide about 0.2 mm, 300 pseudo-units high."""
    place = np.linspace(-1.0, 1.4, 25)
    dome = 300 * np.sqrt(np.maximum(0.0, 1 - ((place - 0.2) / 0.75) ** 2))
    return influence(section, place, np.full(25, 0.1), "finite").sed(np.append(dome, np.zeros(25)))


@pytest.fixture(scope="module")
def felt(section: ReceptorSection) -> np.ndarray:
    return dome_felt_by(section)


def written(name: str, columns: dict[str, np.ndarray]) -> str:
    rows = [",".join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    Path(name).write_text("\n".join([",".join(columns), *rows]) + "\n", encoding="utf-8")
    return name


# --- pressures ---


def test_decode_reproduces_the_worked_example_of_raju_6_7(rig: Program) -> None:
    """Raju (1998, §6.7): [20 14] from [10 10]; exact along each coordinate it arrives, on a grid of 1 it sticks."""
    found = rig(*WORKED, "--decoder", "univariate", "--json").json
    assert found["pressure_pseudo"] == pytest.approx([20, 14], abs=1e-3)
    assert found["true_pseudo"] == [20, 14]
    assert found["errors"]["eq_6_8"] < 1e-8
    assert (found["converged"], found["problems_text"], found["range_pseudo"]) == (True, [], [0, 30])
    assert found["moves"] > 500
    assert (found["operator"], found["samples"], found["sd_pseudo"], found["band_90"]) == (
        "convolution",
        22,
        None,
        None,
    )
    assert found["place_mm"] == pytest.approx([-0.085, 0.085])
    stuck = rig(*WORKED, "--decoder", "grid", "--json").json
    assert stuck["pressure_pseudo"] == [24, 10]  # where the source's first move goes
    assert stuck["converged"]
    misfit, expected = map(float, re.findall(r" (\d\S*\d)\b", stuck["problems_text"][0]))
    assert misfit > 100 * expected
    assert expected == stuck["samples"]
    coarser = rig(*WORKED, "--decoder", "grid", "--grid-step", 3, "--json").json
    assert coarser["pressure_pseudo"] == [24, 9]


def test_the_bayes_decoder_measures_the_noise_and_repeats_with_its_seed(rig: Program) -> None:
    options = ("decode", "--pressure", "20,14", "--half-length", 10, "--snr-db", 25)
    ended = rig(*options, "--seed", 5, "--json")
    found = ended.json
    assert rig(*options, "--seed", 5, "--json").json | {"search_ms": 0} == found | {"search_ms": 0}
    assert rig(*options, "--seed", 6, "--json").json["pressure_pseudo"] != found["pressure_pseudo"]
    low, high = found["band_90"]["low_pseudo"], found["band_90"]["high_pseudo"]
    assert (np.array(low) < found["pressure_pseudo"]).all()
    assert_allclose((np.array(high) - found["pressure_pseudo"]) / found["sd_pseudo"], 1.645)
    signal = rig("encode", *options[1:5], "--json").json["sed_pseudo"]
    told = noise_sd(np.array(signal), 25)
    assert found["noise"]["known_text"] == "measured from 22 receptors at rest"
    assert found["noise"]["sd"][0] == pytest.approx(told, rel=0.5)
    assert found["noise"]["sd"][0] != pytest.approx(told, rel=1e-6)
    assert found["noise"]["left_of_sed_pseudo"] == pytest.approx(told, rel=0.5)
    assert found["errors"]["relative_l2"] == pytest.approx(np.sqrt(found["errors"]["eq_6_8"]))


def test_decode_recovers_pressures_from_rates_through_the_receptor(rig: Program) -> None:
    options = ("decode", "--pressure", "20,14", "--half-length", 10, "--snr-db", 30, "--noise", "output")
    threshold = 0.2 * max(rig("encode", *options[1:5], "--json").json["sed_pseudo"])
    found = rig(*options, "--gain", 1000, "--threshold", threshold, "--json").json
    assert 0 in found["reading"]
    assert found["errors"]["relative_l2"] < 0.3
    assert found["noise"]["known_text"] == "given"
    assert found["problems_text"] == []
    wide = rig(*options, "--gain", "1000±100", "--threshold", threshold, "--json").json
    assert wide["pressure_pseudo"] == found["pressure_pseudo"]
    added = np.sqrt(np.square(wide["sd_pseudo"]) - np.square(found["sd_pseudo"]))
    assert 0.3 < added.mean() / (0.05 * np.mean(found["pressure_pseudo"])) < 3  # half of the gain's own 10 %, about


def test_decode_with_the_influence_operator_recovers_normal_pressures(rig: Program) -> None:
    options = ("decode", "--pressure", "20,14,5", "--operator", "influence", "--half-length", 10, "--json")
    found = rig(*options).json
    assert (found["operator"], found["samples"], len(found["pressure_pseudo"])) == ("influence", 21, 3)
    assert found["errors"]["relative_l2"] < 0.25
    assert len(rig(*options[:2], "20", *options[3:]).json["pressure_pseudo"]) == 1


# --- a press ---


def test_decode_of_a_press_uses_the_sed_of_finite_elements(rig: Program) -> None:
    press = ("--shape", "cylinder:9", "--x-mm", 0.5, "--doi-mm", 0.4, "--half-length", 10, "--json")
    found = rig("decode", *press, "--operator", "influence").json
    assert (found["samples"], len(found["pressure_pseudo"])) == (21, 17)  # 0.8 of the half length
    assert_allclose(found["receptor_mm"], 0.17 * np.arange(-10, 11), atol=1e-12)
    assert found["place_mm"][0] == pytest.approx(-8 * 0.17)
    assert_allclose(found["reading"], rig("encode", *press, "--operator", "influence").json["sed_pseudo"])
    true = np.array(found["true_pseudo"])
    assert 0.05 < found["place_mm"] @ true / true.sum() < 0.45  # between the pad's apex, −0.1, and the cylinder's
    assert found["noise"]["left_of_sed_pseudo"] < 0.1 * max(found["reading"])
    assert np.corrcoef(true, found["pressure_pseudo"])[0, 1] > 0.4


# --- readings ---


def test_decode_takes_readings_at_any_places_in_any_order(
    rig: Program, section: ReceptorSection, felt: np.ndarray
) -> None:
    sd = noise_sd(felt, 30)
    noise = np.random.default_rng(2).normal(size=(2, 12)) * sd
    columns = {
        "place_mm": section.place_mm, "depth_mm": DEPTH_MM, "sed": felt + noise[0], "at_rest": noise[1]
    }  # fmt: skip
    found = rig("decode", "--readings", written("r.csv", columns), "--json").json
    assert found["true_pseudo"] is None
    assert found["errors"] is None
    ends = np.linspace(-2.3, 2.1, 27)  # samples about 0.17 mm wide, from one outermost receptor to the other
    assert_allclose(found["place_mm"], 0.5 * (ends[1:] + ends[:-1]))
    middle = np.array(found["place_mm"]) @ found["pressure_pseudo"] / np.sum(found["pressure_pseudo"])
    assert middle == pytest.approx(0.2, abs=0.15)
    assert np.sum(found["pressure_pseudo"]) * np.diff(ends)[0] == pytest.approx(300 * 0.75 * np.pi / 2, rel=0.15)
    assert found["noise"]["known_text"] == "measured from 12 receptors at rest"
    assert found["noise"]["sd"][0] == pytest.approx(noise[1].std(ddof=1))
    assert (found["operator"], found["converged"]) == ("influence", True)

    line = section.line
    turned = {
        "sd": np.full(12, sd * PA), "sed_pa": columns["sed"] * PA, "depth_mm": columns["depth_mm"],
        "x_mm": line.below(line.angles(section.place_mm), columns["depth_mm"][:, None])[:, 0],
    }  # fmt: skip
    shuffled = {name: values[np.random.default_rng(1).permutation(12)] for name, values in turned.items()}
    other = rig("decode", "--readings", written("x.csv", shuffled), "--json").json
    assert_allclose(other["receptor_mm"], found["receptor_mm"], atol=1e-5)
    assert_allclose(other["reading"], found["reading"], rtol=1e-9)
    assert other["noise"]["known_text"] == "given in the file"
    assert_allclose(other["noise"]["sd"], sd)
    assert_allclose(other["pressure_pseudo"], found["pressure_pseudo"], atol=0.2 * max(found["pressure_pseudo"]))
    assert "1 pseudo-unit = 18.63 Pa" in rig("decode", "--readings", "x.csv").out


def test_decode_gives_an_uncertain_reading_little_weight(
    rig: Program, section: ReceptorSection, felt: np.ndarray
) -> None:
    wrong, sd = felt.copy(), np.full(12, 0.01 * felt.max())
    wrong[3] *= 3
    columns = {"place_mm": section.place_mm, "depth_mm": DEPTH_MM, "sed": felt, "sd": sd}
    right = rig("decode", "--readings", written("r.csv", columns), "--json").json
    sure = rig("decode", "--readings", written("s.csv", columns | {"sed": wrong}), "--json").json
    doubted = columns | {"sed": wrong, "sd": np.where(np.arange(12) == 3, 1e4 * sd, sd)}
    unsure = rig("decode", "--readings", written("u.csv", doubted), "--json").json
    assert sure["problems_text"]
    assert not right["problems_text"]
    assert not unsure["problems_text"]
    off = [np.abs(np.subtract(found["pressure_pseudo"], right["pressure_pseudo"])).max() for found in (sure, unsure)]
    assert off[1] < 0.5 * off[0]


@pytest.mark.parametrize(("spacing", "receptors"), [(0.17, 25), (1.2, 5)])
def test_decode_locates_a_press_at_any_receptor_spacing(rig: Program, spacing: float, receptors: int) -> None:
    """1.2 mm: near the density of slowly adapting afferents."""
    place = spacing * (np.arange(receptors) - (receptors - 1) / 2)
    section = receptor_section(FingertipConfig(mesh=COARSE), place, np.full(receptors, 0.76))
    sed = dome_felt_by(section)
    columns = {"place_mm": place, "depth_mm": np.full(receptors, 0.76), "sed": sed, "sd": np.full(receptors, 0.1)}
    found = rig("decode", "--readings", written("r.csv", columns), "--json").json
    middle = np.array(found["place_mm"]) @ found["pressure_pseudo"] / np.sum(found["pressure_pseudo"])
    assert middle == pytest.approx(0.2, abs=0.3)
    assert len(found["pressure_pseudo"]) == round(spacing * (receptors - 1) / 0.17)
    other = rig("decode", "--readings", "r.csv", "--decoder", "table", "--json").json
    assert len(other["pressure_pseudo"]) == receptors


# --- nothing goes wrong silently ---


def test_decode_reports_a_search_cut_off_or_ended_at_its_range(rig: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    narrow = rig(*TWO, "--start", "10,10", "--range", "0,15", "--decoder", "univariate", "--json").json
    assert narrow["problems_text"][0] == "2 of 2 pressures are at the upper end of the range, 15"
    monkeypatch.setattr(decoders_by_search, "MOST_SWEEPS", 3)
    cut = rig(*WORKED, "--decoder", "univariate", "--json").json
    assert (cut["converged"], cut["moves"]) == (False, 6)
    assert cut["problems_text"][0] == CUT_OFF
    told = rig(*WORKED, "--decoder", "univariate").out
    assert "not converged, 6 moves" in told
    assert f"warning: {CUT_OFF}" in told


# --- a receptor of the command line ---


@pytest.mark.parametrize(
    ("gain", "threshold", "expected"),
    [
        (None, "0", FittedReceptor(Receptor(1.0, 0.0), 0.0, 0.0)),
        ("30", "1.5", FittedReceptor(Receptor(30.0, 1.5), 0.0, 0.0)),
        ("30±2", "1.5±0.25", FittedReceptor(Receptor(30.0, 1.5), 2.0, 0.25)),
        ("3e1+-2e0", "-1.5", FittedReceptor(Receptor(30.0, -1.5), 2.0, 0.0)),
        (None, None, None),
    ],
)
def test_gain_and_threshold_options_are_read_with_their_errors(
    gain: str | None, threshold: str | None, expected: FittedReceptor | None
) -> None:
    assert receptor_of(gain, threshold) == expected
