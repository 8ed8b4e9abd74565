"""Mistakes of a configuration; all others: tests/refusals."""

from pathlib import Path

import pytest

from rig.bench.checks import bench_problems
from rig.errors import BadInputError
from rig.plan.config import Config, keys, load_config


@pytest.mark.parametrize(
    ("text", "key", "near"),
    [
        ("[limits]\nmax_dio_mm = 1.0\n", "limits.max_dio_mm", ["max_doi_mm"]),
        ("[stage]\nclearance_mm = 1.0\n", "stage.clearance_mm", ["habits.clearance_mm", "limits.search_mm"]),
        ("[stage.drives.x]\ndevice_id = 1\nprot = 'a'\n", "stage.drives.x.prot", ["port"]),
        ("[stage]\nqqqqqq = 1\n", "stage.qqqqqq", []),
    ],
)
def test_a_configuration_file_with_an_unknown_key_is_refused_with_similar_keys(
    tmp_path: Path, text: str, key: str, near: list[str]
) -> None:
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    with pytest.raises(BadInputError) as refused:
        load_config(tmp_path / "rig.toml")
    place, _, line = str(refused.value).removeprefix(f"config {tmp_path / 'rig.toml'}: ").partition(": ")
    assert place == key
    known = {key.place for key in keys(Config())} | {key.name for key in keys(Config())} | {"limits", "port"}
    assert [word.strip("?,") for word in line.split() if word.strip("?,") in known] == near


def test_doctor_reports_one_device_configured_under_two_port_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "device").touch()
    (tmp_path / "link").symlink_to("device")
    config = Config.model_validate({"stage": {"port": "link"}, "force": {"port": "device"}})
    assert bench_problems(Config()) == []
    (problem,) = bench_problems(config)
    assert "link" in problem
