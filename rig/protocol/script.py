"""Find and load protocol scripts, and set their parameters."""

import inspect
import random
import re
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, TypeVar

from pydantic import ValidationError

import rig
from rig.data.events import STREAMS
from rig.errors import BadInputError, RigError, first_problem
from rig.protocol.api import ProtocolParameters, Rig
from rig_shared.errors import code_of
from rig_shared.user_files import read_bytes


@dataclass(frozen=True)
class Script:
    """Loaded protocol: metadata, parameters and its function `run`."""

    path: Path
    name: str
    title: str
    source: str
    parameters: ProtocolParameters
    run: Callable[[Rig], None]
    beside: Mapping[str, bytes] = field(default_factory=dict)  # imported modules and METADATA["files"], by file name
    given: Mapping[str, Any] = field(default_factory=dict)  # values of parameters before they were validated
    texts: dict[str, bytes] | None = None  # of the script and its modules, by path; None if run is not theirs
    random_state: Any = field(default=None, compare=False, repr=False)  # before it was loaded

    def fresh(self) -> "Script":
        """Return the script loaded anew from the same texts, so that a pass begins as in a new process.

        What it draws from `random` or `numpy.random` without a seed is the same in every pass of this process.
        One whose `run` is the program's stays as it is.
        """
        if self.texts is None:
            return self
        _set_random_state(self.random_state)
        return script_with(self.path, self.name, self.given, self.texts)


def shipped_protocols() -> Path:
    """Return the folder of the protocols that come with the program."""
    package = Path(rig.__file__).parent
    installed = package / "shipped_protocols"
    return installed if installed.is_dir() else package.parent / "protocols"


def find_script(name: str) -> Path:
    """Return the file of a protocol, from its path or the name of a shipped one. Raises BadInputError."""
    path = Path(name)
    if path.is_file():
        return path.resolve()
    shipped = shipped_protocols() / f"{path.stem}.py"
    if path.parent == Path() and shipped.is_file():
        return shipped
    known = ", ".join(sorted(p.stem for p in shipped_protocols().glob("*.py")))
    raise BadInputError(f"protocol {name!r}: no such file, and not a shipped one ({known})", "no_such_protocol")


def load_script(name: str, assignments: Sequence[str] = ()) -> Script:
    """Load a protocol and set its parameters from "key=value" strings. Raises BadInputError."""
    path = find_script(name)
    return script_with(path, path.stem, _assigned(assignments))


def script_with(
    path: Path, name: str, parameters: Mapping[str, Any], texts: dict[str, bytes] | None = None
) -> Script:
    """Load the protocol in a file, under a name and with these parameters. Raises BadInputError.

    texts: of files, by path, that are not read again; what is read is added.
    """
    texts, random_state = {} if texts is None else texts, _random_state()
    module = _import(path, texts)
    run = getattr(module, "run", None)
    if not callable(run):
        raise BadInputError(f"protocol {path}: has no run(rig)", "no_run")
    kind = getattr(module, "Parameters", ProtocolParameters)
    if not (isinstance(kind, type) and issubclass(kind, ProtocolParameters)):
        raise BadInputError(
            f"protocol {path}: Parameters must be a subclass of rig.protocol.ProtocolParameters", "wrong_parameters"
        )
    try:
        checked = kind.model_validate(parameters)
    except ValidationError as error:
        known = ", ".join(kind.model_fields) or "none"
        found = first_problem("--set", error)
        raise BadInputError(f"{found} (parameters of {path.name}: {known})", found.code) from None
    metadata = _metadata(path, getattr(module, "METADATA", {}))
    title, source = str(metadata.get("title", name)), str(metadata.get("source", ""))
    imported = {Path(file).name: text for file, text in texts.items() if file != str(path)}
    beside = imported | _files(path, metadata.get("files", ()))
    return Script(path, name, title, source, checked, run, beside, parameters, texts, random_state)


def _random_state() -> Any:
    """Return the states of the generators that scripts share, Python's and numpy's."""
    of_numpy = _numpy_random()
    return random.getstate(), of_numpy.get_bit_generator(), of_numpy.get_state(legacy=False)


def _set_random_state(state: Any) -> None:
    of_python, generator, its_state = state
    random.setstate(of_python)
    of_numpy = _numpy_random()
    of_numpy.set_bit_generator(generator)  # the script may have chosen another
    of_numpy.set_state(its_state)


def _numpy_random() -> Any:
    return import_module("numpy.random")  # numpy is slow to import, and its types lack the bit generator


_METADATA = ("title", "source", "files")


def _metadata(path: Path, found: Any) -> Mapping[str, Any]:
    """Return the METADATA of a script. Raises BadInputError for keys that mean nothing."""
    unknown = [key for key in found if key not in _METADATA] if isinstance(found, Mapping) else [type(found).__name__]
    if unknown:
        raise BadInputError(
            f"protocol {path}: METADATA has {unknown[0]!r}; it is a dictionary with the keys {', '.join(_METADATA)}",
            "unknown_metadata",
        )
    known: Mapping[str, Any] = found
    return known


def _files(path: Path, names: Any) -> dict[str, bytes]:
    """Return the files that a script names in METADATA["files"]. Raises BadInputError."""
    if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
        raise BadInputError(f'protocol {path}: METADATA["files"] must be a list of file names', "wrong_files")
    found = {}
    for name in names:
        if Path(name).name != name or _of_a_run(name):
            raise BadInputError(
                f'protocol {path}: METADATA["files"] names {name!r}; give a file beside the script, without a '
                "folder, whose name no file of a run has",
                "wrong_files",
            )
        try:
            found[name] = read_bytes(path.parent / name)
        except OSError as error:
            raise BadInputError(
                f'protocol {path}: METADATA["files"] names {name!r}: {error.strerror}', "wrong_files"
            ) from None
    return found


def where_in_script(path: Path, error: BaseException) -> str:
    """Return "file.py, line N" of the innermost frame in the script itself."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) == path]
    return f"{path}, line {frames[-1].lineno}" if frames else str(path)


def failed_in_script(path: Path, error: BaseException) -> BadInputError:
    """Return the error for an exception in a script; it corrects a misspelled or wrongly called verb."""
    problem = f"{type(error).__name__}: {error}"
    if isinstance(error, AttributeError) and isinstance(error.obj, Rig):
        verbs = [name for name in vars(Rig) if not name.startswith("_")]
        near = get_close_matches(str(error.name), verbs)
        meant = f"did you mean rig.{near[0]}?" if near else f"expected one of {', '.join(verbs)}"
        return BadInputError(f"{problem}: there is no rig.{error.name}, {meant}", "unknown_verb")
    called = re.match(r"Rig\.(\w+)\(\) ", str(error)) if isinstance(error, TypeError) else None
    if called and hasattr(Rig, called[1]):
        signature = inspect.signature(getattr(Rig, called[1]))
        names = [f"{p.name}=" if p.kind is p.KEYWORD_ONLY else p.name for p in signature.parameters.values()][1:]
        return BadInputError(f"{problem}: expected rig.{called[1]}({', '.join(names)})", "wrong_arguments")
    if isinstance(error, FileNotFoundError):
        advice = 'name the file in METADATA["files"] and open it as Path(__file__).parent / NAME'
        return BadInputError(f"{problem}; {advice}", "exception_in_script")
    if isinstance(error, ModuleNotFoundError) and (advice := _module_advice(path.parent, str(error.name))):
        return BadInputError(f"{problem}; {advice}", "module_beside_script")
    return BadInputError(problem, "exception_in_script")


def _module_advice(folder: Path, name: str) -> str:
    """Return what to do about a module that lies beside the script and was not found, or an empty text."""
    name = name.partition(".")[0]
    if (folder / f"{name}.py").is_file():
        return f"import {name} at the top of the script, so that the run keeps a copy"
    if (folder / name).is_dir():
        return f"{name} is a folder; put what the script needs into one .py file beside the script"
    return ""


_Error = TypeVar("_Error", bound=RigError)


def script_error(
    kind: type[_Error], path: Path, error: BaseException, verbatim: tuple[type[BaseException], ...]
) -> _Error:
    """Return an error that names the line of the script, and for classes other than `verbatim` the class."""
    problem = error if isinstance(error, verbatim) else failed_in_script(path, error)
    return kind(f"{where_in_script(path, error)}: {problem}", code_of(problem))


_RUN_FILES = {
    "protocol.py",
    "config.toml",
    "data.h5",
    "run.nwb",
    "report.html",
    "presses.csv",
    "choice.csv",
    "sha256sums",
}
_RUN_PREFIXES = (".", "shape_", "model_", "synthetic_", "identification", "finger_after")


def _of_a_run(name: str) -> bool:
    """Return whether a run folder may have a file of this name, which a copy would replace."""
    name = name.lower()
    stem, _, suffix = name.partition(".")
    table = suffix == "csv" and stem in STREAMS
    return table or suffix in ("json", "jsonl") or name in _RUN_FILES or name.startswith(_RUN_PREFIXES)


class _ScriptLoader(SourceFileLoader):
    """Loader that reads each file once: a later pass runs the same text, even if the file was edited since."""

    def __init__(self, fullname: str, path: str, texts: dict[str, bytes]) -> None:
        super().__init__(fullname, path)
        self._texts = texts

    def get_data(self, path: str) -> bytes:
        """Return the text of a file."""
        if path not in self._texts:
            self._texts[path] = super().get_data(path)
        return self._texts[path]

    def get_code(self, fullname: str) -> CodeType:
        """Compile the text; bytecode beside it, which another account may have written, is not used."""
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)


class _Beside(MetaPathFinder):
    """Finder of the modules beside a script. It comes last, so that `random.py` there hides no library."""

    def __init__(self, folder: Path, texts: dict[str, bytes]) -> None:
        self._folder, self._texts, self.found = folder, texts, list[str]()

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Return the spec of a single file; packages are not looked for."""
        file = self._folder / f"{fullname}.py"
        if path is not None or not (str(file) in self._texts or file.is_file()):
            return None
        if _of_a_run(file.name):
            raise ImportError(f"rename {file.name}: a run has a file of this name")
        self.found.append(fullname)
        return spec_from_file_location(fullname, file, loader=_ScriptLoader(fullname, str(file), self._texts))


def _import(path: Path, texts: dict[str, bytes]) -> ModuleType:
    """Import a script and the modules beside it anew, with these texts of files by path; read what is missing."""
    if path.suffix.lower() != ".py":
        raise BadInputError(f"protocol {path}: not a Python file; its name must end in .py", "no_python_file")
    loader, finder = _ScriptLoader(f"protocol_{path.stem}", str(path), texts), _Beside(path.parent, texts)
    spec = spec_from_file_location(loader.name, path, loader=loader)
    assert spec is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # pydantic resolves postponed annotations there.
    sys.meta_path.append(finder)
    try:
        loader.exec_module(module)
        return module
    except SyntaxError as error:
        raise BadInputError(
            f"protocol {error.filename or str(path)}, line {error.lineno or 1}: {error.msg}", "no_python"
        ) from None
    except (Exception, SystemExit) as error:
        found = failed_in_script(path, error)
        raise BadInputError(f"protocol {where_in_script(path, error)}: {found}", found.code) from None
    finally:
        sys.meta_path.remove(finder)
        for name in finder.found:  # another script, as of another run, has a module of this name
            sys.modules.pop(name, None)


def _assigned(assignments: Sequence[str]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for text in assignments:
        key, _, value = text.partition("=")
        if not (key and value):
            raise BadInputError(f"--set {text!r}: expected KEY=VALUE", "no_assignment")
        if key in values:
            raise BadInputError(f"--set {text!r}: {key} is given twice", "given_twice")
        values[key] = value
    return values
