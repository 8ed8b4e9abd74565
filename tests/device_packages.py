"""Packages that offer devices, as an installer would leave them: for tests of the catalogue."""

import sys
import tomllib
import venv
import zipfile
from collections.abc import Mapping
from pathlib import Path

EXAMPLE = Path(__file__).parents[1] / "examples" / "rig_line_scale"


def dist_info(name: str, version: str, points: Mapping[str, str]) -> dict[str, str]:
    """The files that make a package known, by path."""
    folder = f"{name.replace('-', '_')}-{version}.dist-info"
    entries = "".join(f"{point} = {place}\n" for point, place in points.items())
    return {
        f"{folder}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n",
        f"{folder}/WHEEL": "Wheel-Version: 1.0\nGenerator: by hand\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{folder}/entry_points.txt": f"[rig.devices]\n{entries}",
    }


def offer(folder: Path, name: str, points: Mapping[str, str], modules: Mapping[str, str] | None = None) -> None:
    """Leave a package of version 1.0 in a folder."""
    files = dist_info(name, "1.0", points) | {f"{module}.py": text for module, text in (modules or {}).items()}
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")


def wheel(project: Path, folder: Path) -> Path:
    """A project with one plain package as a wheel, made without its build system: nothing has to be fetched."""
    told = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))
    about, (package,) = told["project"], told["tool"]["setuptools"]["packages"]
    files = dist_info(about["name"], about["version"], about["entry-points"]["rig.devices"])
    files |= {
        path.relative_to(project).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted((project / package).rglob("*.py"))
    }
    record = next(iter(files)).replace("METADATA", "RECORD")
    files[record] = "".join(f"{path},,\n" for path in (*files, record))
    made = folder / f"{about['name'].replace('-', '_')}-{about['version']}-py3-none-any.whl"
    with zipfile.ZipFile(made, "w") as archive:
        for path, text in files.items():
            archive.writestr(path, text)
    return made


def scratch(folder: Path, *sources: Path) -> None:
    """Make an environment without pip, in which the packages of this one and these source trees can be imported."""
    venv.create(folder, with_pip=False)
    (there,) = (path for path in folder.rglob("site-packages") if not path.is_symlink())
    borrowed = [*map(str, sources), *(path for path in sys.path if path.endswith("-packages"))]
    (there / "borrowed.pth").write_text("\n".join(borrowed) + "\n", encoding="utf-8")


def interpreter(folder: Path) -> str:
    """Return the Python of an environment."""
    return str(folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python"))


def forget(prefix: str) -> None:
    """Take modules of such packages out of this process."""
    for name in [name for name in sys.modules if name.startswith(prefix)]:
        del sys.modules[name]
