"""Lock files, licenses, vendored files, bill of materials and wheels of other systems."""

import csv
import hashlib
import os
import re
import tomllib
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from studies.supply import licenses, sbom, wheels
from studies.supply.lock import EXTRAS, PROMISED
from studies.supply.locked import LOCKS, PROJECT, REQUIREMENTS, ROOT, Pin, all_locked, read_lock, required

VENDOR = sorted(path for path in (ROOT / "rig").rglob("vendor/*/*") if path.name != "README.md")
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def _project() -> Any:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def _lock(name: str) -> dict[str, Pin]:
    return read_lock(REQUIREMENTS / f"{name}.txt")


def _asked(names: Iterable[str]) -> list[Requirement]:
    return [Requirement(one) for one in names]


# --- lock files ---


@pytest.mark.parametrize("lock", LOCKS)
def test_every_lock_file_pins_every_requirement_to_an_exact_version(lock: str) -> None:
    pins = _lock(lock)
    extras = _project()["optional-dependencies"]
    asked = _asked([*_project()["dependencies"], *(one for extra in EXTRAS[lock] for one in extras[extra])])
    assert [one.name for one in asked if one.name not in pins] == []
    assert [one.name for one in asked if pins[one.name].version not in one.specifier] == []
    assert all(pin.hashes for pin in pins.values())


@pytest.mark.parametrize("lock", LOCKS)
def test_every_lock_file_contains_the_requirements_of_its_packages(lock: str) -> None:
    """Whatever an installed package requires here is locked, in a version that it accepts."""
    pins = _lock(lock)
    seen = 0
    for pin in pins.values():
        try:
            if version(pin.name) != pin.version:
                continue  # another version may require something else
        except PackageNotFoundError:
            continue
        for one in _asked(requires(pin.name) or ()):
            if one.marker is None or one.marker.evaluate({"extra": ""}):
                name = canonicalize_name(one.name)
                assert name in pins, f"{pin.name} requires {name}"
                assert one.specifier.contains(pins[name].version, prereleases=True), f"{pin.name} requires {one}"
                seen += 1
    assert seen or os.environ.get("LOCKED") == "no"


def test_every_optional_dependency_is_locked() -> None:
    names = {*all_locked()}
    assert [
        one.name
        for extra in _project()["optional-dependencies"].values()
        for one in _asked(extra)
        if one.name not in names
    ] == []


def test_a_package_locked_twice_is_refused(tmp_path: Path) -> None:
    text = (REQUIREMENTS / "setup.txt").read_text(encoding="utf-8")
    (tmp_path / "setup.txt").write_text(text, encoding="utf-8")
    (tmp_path / "dev.txt").write_text(f"-r setup.txt\n{text}", encoding="utf-8")
    with pytest.raises(ValueError, match=r"setup\.txt locks"):
        read_lock(tmp_path / "dev.txt")


@pytest.mark.parametrize(
    ("file", "locked"),
    [
        ("made-1.0-py3-none-any.whl", True),
        ("made-1.0-py2.py3-none-any.whl", True),
        ("made-1.0.tar.gz", True),
        ("made-1.0-cp39-abi3-win_amd64.whl", True),
        ("made-1.0-py3-none-manylinux1_x86_64.whl", True),
        ("made-1.0-cp314-cp314-manylinux_2_27_x86_64.manylinux_2_28_x86_64.whl", True),
        ("made-1.0-cp311-cp311-manylinux2014_aarch64.manylinux_2_17_aarch64.whl", True),
        ("made-1.0-cp313-cp313-macosx_11_0_arm64.whl", True),
        ("made-1.0-cp314-cp314t-macosx_11_0_arm64.whl", False),
        ("made-1.0-cp310-cp310-win_amd64.whl", False),
        ("made-1.0-cp312-cp312-win32.whl", False),
        ("made-1.0-cp312-cp312-musllinux_1_2_x86_64.whl", False),
        ("made-1.0-pp311-pypy311_pp73-manylinux_2_28_x86_64.whl", False),
        ("made-1.0-cp312-cp312-manylinux_2_17_ppc64le.manylinux2014_ppc64le.whl", False),
    ],
)
def test_lock_files_contain_the_wheels_of_every_supported_system(file: str, locked: bool) -> None:
    assert bool(PROMISED.search(file)) is locked


def test_lock_files_name_no_package_index() -> None:
    for lock in LOCKS:
        text = (REQUIREMENTS / f"{lock}.txt").read_text(encoding="utf-8")
        assert not re.search(r"://|^-(?!r [\w-]+\.txt$)|/tmp", text, re.M)


@pytest.mark.parametrize(
    "text",
    [
        "numpy>=2\n",
        "numpy==2.4.6\n",
        "-e .\n",
        "numpy==2.4.6 \\\n    --hash=md5:12\n",
        "numpy==2.4.6 \\\n    --hash=sha256:12\n",
    ],
)
def test_a_lock_line_without_exact_version_and_hash_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "loose.txt").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"loose\.txt"):
        read_lock(tmp_path / "loose.txt")


def test_the_makefile_installs_by_hash() -> None:
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    for lock in LOCKS:
        ready = ".venv/.ready" if lock == "setup" else f".venv/.ready-{lock}"
        assert f"{ready}: LOCK = {lock}\n" in text
        assert re.search(rf"^{ready}: .*requirements/{lock}\.txt$", text, re.M)
    assert "install --require-hashes -r requirements/$(LOCK).txt" in text
    assert "pip install" not in text.replace("$(PIP) install", "")


# --- licenses and vendored files ---


def test_every_locked_package_has_a_license() -> None:
    rows = licenses.stored()
    assert rows.keys() == all_locked().keys()
    assert [name for name, text in rows.items() if not text] == []


def test_the_stored_licenses_are_those_of_the_installed_packages() -> None:
    rows = licenses.stored()
    there = {name: licenses.stated(name) for name, pin in all_locked().items() if _installed(name) == pin.version}
    assert {name: rows[name] for name in there} == there


def _installed(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def test_the_license_table_states_what_needs_each_package() -> None:
    rows = list(licenses.table(all_locked(), licenses.stored()))
    with licenses.TABLE.open(encoding="utf-8", newline="") as file:
        written = list(csv.reader(file))
    assert [row[2] for row in written[1:]] == [row[2] for row in rows]
    assert {row[2] for row in rows} == {"program", "build", "extras"}


def test_a_locked_package_without_a_license_row_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pins = {"not-installed-anywhere": Pin("not-installed-anywhere", "1", "", frozenset(), ())}
    monkeypatch.setattr(licenses, "all_locked", lambda: pins)
    with pytest.raises(SystemExit, match="not-installed-anywhere"):
        licenses.main()


def test_vendored_files_are_unchanged() -> None:
    rows = {row["file"]: row for row in sbom.vendored()}
    assert all(all(row.values()) for row in rows.values())
    assert {path.relative_to(ROOT).as_posix() for path in VENDOR} <= rows.keys()
    found = {name: hashlib.sha256((ROOT / name).read_bytes()).hexdigest() for name in rows}
    assert found == {name: row["sha256"] for name, row in rows.items()}
    script = next(path for path in VENDOR if path.suffix == ".js")
    assert f"(v{rows[script.relative_to(ROOT).as_posix()]['version']})" in script.read_text(encoding="utf-8")


# --- bill of materials ---


def test_the_bill_of_materials_names_the_whole_program(tmp_path: Path) -> None:
    bom = sbom.bill()
    assert (bom["bomFormat"], bom["specVersion"], bom["version"]) == ("CycloneDX", "1.6", 1)
    assert re.fullmatch(r"urn:uuid:[\da-f]{8}(-[\da-f]{4}){3}-[\da-f]{12}", bom["serialNumber"])
    setup = _lock("setup")
    program = required(setup)
    packages = {
        one["name"]: one["version"] for one in bom["components"] if one.get("purl", "").startswith("pkg:pypi")
    }
    assert packages == {name: setup[name].version for name in program if name != PROJECT}
    refs = [bom["metadata"]["component"]["bom-ref"], *(one["bom-ref"] for one in bom["components"])]
    assert len(refs) == len({*refs})
    assert {one for row in bom["dependencies"] for one in (row["ref"], *row["dependsOn"])} == {*refs}
    for one in (bom["metadata"]["component"], *bom["components"]):
        assert one["type"] in {"application", "library", "data"}
        assert one["name"]
        (license_,) = one["licenses"]
        assert license_.get("expression") or license_["license"]["name"]
    files = {file["name"]: file["hashes"] for one in bom["components"] for file in one.get("components", ())}
    assert files.keys() == {row["file"] for row in sbom.vendored()}
    assert all(alg == {"alg": "SHA-256", "content": alg["content"]} for (alg,) in files.values())
    path = sbom.write_bill(tmp_path)
    assert path.name == f"{PROJECT}-{_project()['version']}.cdx.json"
    assert sbom.write_bill(tmp_path).read_bytes() == path.read_bytes()


def test_the_bill_of_materials_contains_every_requirement() -> None:
    direct = required(_lock("setup"))[PROJECT]
    assert direct == sorted(one.name for one in _asked(_project()["dependencies"]))


# --- wheels ---

PURE = ["made-1.0-py3-none-any.whl"]
COMPILED = [
    f"made-1.0-cp{python.replace('.', '')}-cp{python.replace('.', '')}-{platform}.whl"
    for python in wheels.PYTHONS
    for platform in ("manylinux_2_17_x86_64.manylinux2014_x86_64", "win_amd64", "macosx_11_0_arm64")
]


@pytest.mark.parametrize(
    ("marker", "files", "lacking"),
    [
        ("", PURE, {}),
        ("", [], {system: [*wheels.PYTHONS] for system in wheels.SYSTEMS}),
        ("", COMPILED, {"macOS x86-64": list(wheels.PYTHONS)}),
        ("sys_platform != 'darwin'", COMPILED, {}),
        ("python_full_version < '3.12'", COMPILED, {"macOS x86-64": ["3.11"]}),
        (
            "",
            ["made-1.0-cp39-abi3-win_amd64.whl", *COMPILED[1:]],
            {"Linux x86-64": ["3.11"], "macOS x86-64": list(wheels.PYTHONS)},
        ),
    ],
)
def test_a_missing_wheel_of_a_supported_system_is_found(
    marker: str, files: list[str], lacking: dict[str, list[str]]
) -> None:
    found = wheels.missing([Pin("made", "1.0", marker, frozenset(), ())], {"made": files})
    assert {system: pythons for (_, system), pythons in found.items()} == lacking
    assert wheels.unexpected(found) == [("made", system) for system in lacking]


@pytest.mark.skipif(os.environ.get("CHECK_WHEELS") != "yes", reason="asks the package index: make check-wheels")
def test_every_locked_package_has_wheels_for_other_systems() -> None:
    try:
        files = wheels.published()
    except wheels.NoIndexError as error:
        pytest.skip(f"{error}")
    assert wheels.unexpected(wheels.missing(all_locked().values(), files)) == []


# --- workflows ---


def test_workflows_pin_every_action_to_a_version() -> None:
    assert {path.name for path in WORKFLOWS} == {"ci.yml", "newest.yml"}
    for path in WORKFLOWS:
        for used in re.findall(r"uses: (\S+)", path.read_text(encoding="utf-8")):
            assert re.fullmatch(r"[\w.-]+/[\w./-]+@(v\d+|[\da-f]{40})", used), f"{path.name}: {used}"


def test_the_suite_runs_on_three_systems() -> None:
    yaml = pytest.importorskip("yaml")
    jobs = {name: job for path in WORKFLOWS for name, job in yaml.safe_load(path.read_text("utf-8"))["jobs"].items()}
    systems = {re.split(r"[-]", one)[0] for job in jobs.values() for one in _systems(job)}
    assert systems >= {"ubuntu", "windows", "macos"}


def _systems(job: Any) -> list[str]:
    return [*job.get("strategy", {}).get("matrix", {}).get("system", ()), job["runs-on"]]
