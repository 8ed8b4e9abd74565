"""Old module names, which work for one release with a warning, and for good in pickled results."""

import sys
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any

_NEW = """\
choice cheapest_model
coding.all_sites coding.raju_table_6_1
coding.borne coding.pressure
coding.contacts coding.contact_search
coding.decoded coding.decoder_results
coding.decoding coding.decoder_results
coding.energy coding.section
coding.fitted_receptor coding.bayes
coding.frictionless coding.pressure
coding.impulse coding.operators
coding.mixture coding.model_averaging
coding.other_searches coding.decoders_by_search
coding.point_loads coding.point_loaded_finger,coding.power_law
coding.point_spread.all_sites coding.raju_table_6_1
coding.point_spread.kept_sites coding.raju_table_6_1
coding.point_spread.loaded_finger coding.point_loaded_finger
coding.point_spread.moved_response coding.point_spread
coding.point_spread.power_law coding.power_law
coding.point_spread.sites coding.point_loaded_finger
coding.point_spread.spreads coding.point_spread
coding.profile_decoder coding.bayes
coding.profiles -
coding.profiles.climb coding.contact_search
coding.profiles.contact coding.contact_search
coding.profiles.evidence coding.evidence
coding.profiles.felt_shape coding.shape_class
coding.profiles.imagined coding.model_averaging
coding.profiles.mixture coding.model_averaging
coding.profiles.seen coding.contact_search
coding.profiles.smooth_fit coding.bayes
coding.profiles.table coding.model_averaging
coding.readings coding.receptor_readings
coding.sampled_section coding.section
coding.search coding.decoders_by_search,coding.decoder_results
coding.search_decoders coding.decoders_by_search,coding.decoder_results
coding.sheets -
coding.sheets.axial_row coding.sheet
coding.sheets.felt_skin coding.sheet
coding.sheets.felt_solid coding.shape_class
coding.sheets.sheet_decoder coding.sheet
coding.sheets.sheet_operator coding.sheet
coding.skin_line coding.section
coding.univariate coding.decoders_by_search
config.csv_table tables
config.fingertip_config config
config.measured_skin config
config.stiffness config
config.units units
contact.compiled.chords contact.compiled.points_between_nodes
contact.compiled.compiling compiling
contact.compiled.curves contact.compiled.profile_curves
contact.compiled.elastic contact.compiled.skin_compliance
contact.compiled.gaps contact.compiled.planes_and_residual
contact.compiled.kept compiling
contact.compiled.ready contact.warmup
contact.control contact.force_control
contact.touch contact.first_contact
devices.balance devices.mtsics
devices.cell devices.line
devices.drive_motion devices.leadshine
devices.grbl.blocks devices.grbl.planner
devices.grbl.commands devices.grbl.realtime_commands,devices.grbl.system_commands
devices.grbl.homing devices.grbl.settings
devices.grbl.lines devices.grbl.gcode
devices.grbl.motion devices.grbl.planner
devices.grbl.offsets devices.grbl.gcode
devices.grbl.overrides devices.grbl.core
devices.grbl.realtime devices.grbl.realtime_commands
devices.grbl.report devices.grbl.core
devices.grbl.system devices.grbl.system_commands
devices.told devices.line
fem.assembly fem.elements
fem.dense fem.dissection
fem.shape_functions fem.elements
fem.strain fem.elements
finger.fit finger.surface
finger.grading finger.mesh
finger.layers finger.mesh
finger.quality finger.mesh
finger.section finger.surface
finger.skin finger.mesh
identification.bands identification.uncertainty_bands
identification.design identification.next_press
identification.forward identification.predicted_forces
identification.shape_table identification.force_table
measures.reach measures.receptors
models.discretised models.condensed
models.errors errors
models.field models.strain_at_points
models.finger models.finger_3d
models.inside -
models.inside.adjoint models.adjoint
models.inside.anywhere models.strain_at_points
models.inside.columns models.condensed
models.inside.interior models.factored_interior
models.many models.many_indentations
models.meeting -
models.meeting.foreseen identification.predicted_forces
models.meeting.given identification.predicted_forces
models.meeting.in_numbers identification.prior
models.meeting.learned identification.posterior
models.meeting.misfit identification.posterior
models.meeting.next_press identification.next_press
models.meeting.prior identification.prior
models.meeting.shape_table identification.force_table
models.meeting.shipped identification.force_table
models.meeting.width identification.uncertainty_bands
models.moduli -
models.moduli.families models.interpolation
models.moduli.interpolated models.interpolation
models.moduli.node_builds models.interpolation
models.moduli.packed models.interpolation
models.moduli.weights models.interpolation_weights
models.patches models.sources
models.plane_section models.section
models.processes -
models.processes.finger_process finger_process
models.processes.many models.many_indentations
models.processes.recipe models.sources
models.processes.workers workers
models.relaxing -
models.relaxing.held models.relaxation
models.relaxing.in_time models.viscoelastic
models.relaxing.moves models.relaxation
models.relaxing.prony models.relaxation
models.results -
models.results.fields models.strain_at_points
models.results.indentation models.result
models.results.indentations models.result
models.results.outline models.pictures
models.results.pictures models.pictures
models.results.point_load models.result
models.results.small_strain models.small_strain_error
models.results.tables tables
models.small_strain models.small_strain_error
models.stiffening.at_finite_strain models.stiffening
models.stiffening.linear_alone models.stiffening
models.stiffening.overlap models.stiffening
models.stiffening.stiffened models.stiffening
models.strain_field models.factored_interior
models.tops models.cache
models.uncondensed -
models.uncondensed.deck models.full_mesh
models.uncondensed.strain_map models.full_mesh
models.weights models.interpolation_weights
models.whole_finger models.finger_3d
plant.plant plant
plant.relaxing_plant plant
plant.sampled plant
serve.ahead serve.prefetch
serve.clock serve.real_time_loop
serve.press_ahead serve.prefetch
serve.press_process serve.force_process
serve.wall_clock serve.real_time_loop
serve.way_ahead serve.prefetch
serve.way_process serve.force_process
speed_and_error -
speed_and_error.calculix benchmark
speed_and_error.candidates benchmark
speed_and_error.choice cheapest_model
speed_and_error.expected cheapest_model
speed_and_error.measure benchmark
speed_and_error.reference benchmark
speed_and_error.reference_computation benchmark
speed_and_error.rows benchmark
speed_and_error.scenes benchmark
speed_and_error.situation cheapest_model
"""
"""Old modules and the modules that have their names now; - for a removed package."""


class _Moved(ModuleType):
    """Module of an old name, which looks its names up in the new modules."""

    def __init__(self, name: str, new: tuple[str, ...]) -> None:
        super().__init__(name)
        self._new = new

    def __getattr__(self, name: str) -> Any:
        if not (name.startswith("__") and name.endswith("__")):
            for new in self._new:
                found = getattr(import_module(new), name, self)
                if found is not self:
                    warnings.warn(f"{self.__name__} is {new} now", DeprecationWarning, stacklevel=2)
                    return found
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")


def renamed(module: str, new: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a module whose old names answer with a warning; `new` has where each is now."""

    def find(name: str) -> Any:
        if name not in new:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        warnings.warn(f"{module}.{name} is {new[name]} now", DeprecationWarning, stacklevel=2)
        home, _, now = new[name].rpartition(".")
        return getattr(import_module(home), now)

    return find


def answer() -> None:
    """Register the old names; new modules are imported on first use."""
    package = __name__.rpartition(".")[0]
    shells = dict[str, _Moved]()
    for row in _NEW.splitlines():
        old, new = row.split()
        shell = _Moved(f"{package}.{old}", tuple(f"{package}.{one}" for one in new.split(",") if one != "-"))
        shells[old] = sys.modules[shell.__name__] = shell
        above, _, name = old.rpartition(".")
        if above in shells:
            setattr(shells[above], name, shell)
