"""Protocol scripts: found, loaded and given their parameters."""

import importlib.util
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import Any

from pydantic import ValidationError

import rig
from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.errors import BadInputError, first_problem


@dataclass(frozen=True)
class Script:
    """A loaded protocol: its metadata, its parameters and `run`."""

    path: Path
    name: str
    title: str
    source: str
    parameters: ProtocolParameters
    run: Callable[[Rig], None]


def shipped_protocols() -> Path:
    """Folder of the scripts that come with the program."""
    package = Path(rig.__file__).parent
    installed = package / "shipped_protocols"
    return installed if installed.is_dir() else package.parent / "protocols"


def find_script(name: str) -> Path:
    """A path, or the name of a shipped script. Raises BadInputError."""
    path = Path(name)
    if path.is_file():
        return path.resolve()
    shipped = shipped_protocols() / f"{path.stem}.py"
    if path.parent == Path() and shipped.is_file():
        return shipped
    known = ", ".join(sorted(p.stem for p in shipped_protocols().glob("*.py")))
    raise BadInputError(f"protocol {name!r}: no such file, and not a shipped one ({known})")


def load_script(name: str, assignments: Sequence[str] = ()) -> Script:
    """Load a protocol and set its parameters from "key=value" strings. Raises BadInputError."""
    path = find_script(name)
    return script_with(path, path.stem, _assigned(assignments))


def script_with(path: Path, name: str, parameters: Mapping[str, Any]) -> Script:
    """The protocol in a file, under a name and with these parameters. Raises BadInputError."""
    module = _import(path)
    run = getattr(module, "run", None)
    if not callable(run):
        raise BadInputError(f"protocol {path}: has no run(rig)")
    kind = getattr(module, "Parameters", ProtocolParameters)
    if not (isinstance(kind, type) and issubclass(kind, ProtocolParameters)):
        raise BadInputError(f"protocol {path}: Parameters must be a subclass of rig.protocol.ProtocolParameters")
    try:
        checked = kind.model_validate(parameters)
    except ValidationError as error:
        known = ", ".join(kind.model_fields) or "none"
        raise BadInputError(f"{first_problem('--set', error)} (parameters of {path.name}: {known})") from None
    metadata = getattr(module, "METADATA", {})
    title = str(metadata.get("title", name)) if isinstance(metadata, Mapping) else name
    source = str(metadata.get("source", "")) if isinstance(metadata, Mapping) else ""
    return Script(path, name, title, source, checked, run)


def where_in_script(path: Path, error: BaseException) -> str:
    """ "file.py, line N" of the script's own innermost frame."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) == path]
    return f"{path}, line {frames[-1].lineno}" if frames else str(path)


def in_words(error: BaseException) -> str:
    """What a script did wrong; of a verb that is none, or is not called as it should be, what there is instead."""
    words = f"{type(error).__name__}: {error}"
    if isinstance(error, AttributeError) and isinstance(error.obj, Rig):
        verbs = [name for name in vars(Rig) if not name.startswith("_")]
        near = get_close_matches(str(error.name), verbs)
        meant = f"did you mean rig.{near[0]}?" if near else f"expected one of {', '.join(verbs)}"
        return f"{words}: there is no rig.{error.name}, {meant}"
    called = re.match(r"Rig\.(\w+)\(\) ", str(error)) if isinstance(error, TypeError) else None
    if called and hasattr(Rig, called[1]):
        signature = inspect.signature(getattr(Rig, called[1]))
        names = [f"{p.name}=" if p.kind is p.KEYWORD_ONLY else p.name for p in signature.parameters.values()][1:]
        return f"{words}: expected rig.{called[1]}({', '.join(names)})"
    return words


def _import(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"protocol_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise BadInputError(f"protocol {path}: not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # pydantic looks postponed annotations up there
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise BadInputError(f"protocol {path}, line {error.lineno or 1}: {error.msg}") from None
    except (Exception, SystemExit) as error:
        raise BadInputError(f"protocol {where_in_script(path, error)}: {type(error).__name__}: {error}") from None
    return module


def _assigned(assignments: Sequence[str]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for text in assignments:
        key, _, value = text.partition("=")
        if not (key and value):
            raise BadInputError(f"--set {text!r}: expected KEY=VALUE")
        if key in values:
            raise BadInputError(f"--set {text!r}: {key} is given twice")
        values[key] = value
    return values
