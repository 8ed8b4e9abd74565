"""Modules of 0.1 answer under their old names, and so do the pickles that name them."""

import pickle
import re
from importlib import import_module

import pytest

import rig._moved
import sim._moved

ROWS = {
    f"{package}.{old}": tuple(f"{package}.{one}" for one in new.split(",") if one != "-")
    for package, moved in (("rig", rig._moved), ("sim", sim._moved))
    for old, new in map(str.split, moved._NEW.splitlines())
}


@pytest.mark.parametrize("package", ["rig", "sim"])
def test_an_old_module_has_the_names_of_the_new_ones(package: str) -> None:
    for old in [old for old in ROWS if old.startswith(f"{package}.")]:
        there = import_module(old)
        if not ROWS[old]:  # a package of modules that have moved
            assert [module for module in ROWS if module.startswith(f"{old}.")], old
            continue
        for now in map(import_module, ROWS[old]):
            name = next(name for name in reversed(vars(now)) if not name.startswith("__"))
            with pytest.warns(DeprecationWarning, match=rf"^{re.escape(old)} is .* now$"):
                assert getattr(there, name) is getattr(now, name), f"{old}: {name}"
        with pytest.raises(AttributeError, match=re.escape(old)):
            there.__path__  # noqa: B018


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("sim.models.results.indentation", "IndentationResult"),
        ("sim.models.results.point_load", "PointLoadResult"),
        ("sim.config.fingertip_config", "FingertipConfig"),
        ("sim.models.errors", "ModelRangeError"),
        ("rig.compare.parameter_study.cases", "Case"),
        ("rig.data.reader", "Run"),
        ("sim.coding.decoded", "Decoded"),
        ("sim.coding.readings", "Readings"),
        ("sim.coding.encoding", "Readings"),
        ("sim.coding.search_decoders", "DecodingError"),
        ("sim.coding.point_loads", "PowerLaw"),
    ],
)
@pytest.mark.filterwarnings("ignore:.* now:DeprecationWarning")
def test_a_pickle_of_0_1_is_read(module: str, name: str) -> None:
    assert pickle.loads(f"c{module}\n{name}\n.".encode()).__name__ == name


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("sim.coding.encoding", "Readings", "sim.coding.receptor_readings.Readings"),
        ("sim.coding.pressure", "borne_by", "sim.coding.pressure.contact_pressure"),
        ("sim.coding.section", "felt_section", "sim.coding.section.receptor_section"),
        ("sim.devices.line", "ForceTold", "sim.devices.line.VirtualForceSpec"),
        ("sim.devices.line", "StageTold", "sim.devices.line.VirtualStageSpec"),
    ],
)
def test_an_old_name_in_a_module_that_stays_is_the_new_one(module: str, old: str, new: str) -> None:
    with pytest.warns(DeprecationWarning, match=rf"^{re.escape(module)}\.{old} is {re.escape(new)} now$"):
        found = getattr(import_module(module), old)
    home, _, name = new.rpartition(".")
    assert found is getattr(import_module(home), name)
    with pytest.raises(AttributeError, match=re.escape(module)):
        import_module(module).nothing_of_this_name  # noqa: B018
