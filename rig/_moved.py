"""Old module names, which work for one release with a warning, and for good in pickled results."""

import sys
import warnings
from importlib import import_module
from types import ModuleType
from typing import Any

_NEW = """\
cli.at_the_bench cli.bench
cli.by_hand cli.bench
cli.cache cli.installation
cli.carrying_out cli.script_execution
cli.check cli.run
cli.chosen_model cli.indent
cli.config cli.installation
cli.confirming cli.confirm
cli.decode_options cli.decode
cli.decode_said cli.decode
cli.doctor cli.installation
cli.dry_run cli.run
cli.execution cli.script_execution
cli.export cli.runs
cli.export_deck cli.finger
cli.find cli.identify_finger
cli.identify cli.identify_finger
cli.impulse cli.encode
cli.interrupts cli.signals
cli.json_output cli.json_schemas
cli.looking bench.checks
cli.meet cli.identify_finger
cli.meeting_said cli.identify_finger
cli.monitor cli.watch,cli.progress,cli.force_trace
cli.outcomes cli.error_exit_codes
cli.owning cli.panel
cli.pictures cli.options
cli.reporting cli.script_execution
cli.resume cli.run
cli.run_owner cli.script_execution
cli.sampling cli.coding_options
cli.screen cli.force_trace
cli.shift_invariance cli.encode
cli.show cli.runs
cli.speed cli.installation
cli.stranger cli.serve
cli.system cli.installation
compare.answers -
compare.answers.answer compare.verdict
compare.answers.answer_json compare.comparison_rows
compare.answers.candidates compare.candidate_measures
compare.answers.confidence_set compare.model_confidence_set
compare.answers.goodness compare.candidate_measures
compare.answers.judging compare.make_verdict
compare.answers.likeliest compare.likelihood
compare.answers.methods compare.verdict_text
compare.answers.observed compare.likelihood
compare.answers.power compare.model_confidence_set
compare.answers.prediction compare.model_confidence_set
compare.answers.profile_limits compare.intervals
compare.answers.wording compare.verdict_text
compare.candidates compare.candidate_measures
compare.cluster study.dask_cluster
compare.controls compare.stimuli
compare.dask_cluster study.dask_cluster
compare.errors compare.exceptions
compare.fingers compare.plausible_fingers
compare.fingers.finger_fit compare.plausible_fingers
compare.fingers.on_fingers compare.plausible_fingers
compare.judge compare.make_verdict
compare.left_out compare.comparison
compare.model_set compare.model_confidence_set
compare.parameter_study study.parameter_study
compare.parameter_study.cases study.parameter_study
compare.parameter_study.cluster study.dask_cluster
compare.parameter_study.errors study.exceptions
compare.parameter_study.interpolation study.parameter_study
compare.parameter_study.workers study.parallel
compare.place -
compare.place.place_fit compare.receptor_place
compare.place.place_grid compare.place_grid
compare.place.place_search compare.receptor_place
compare.place.placed compare.receptor_place
compare.place.whereabouts compare.place_grid
compare.plausible compare.plausible_fingers
compare.recordings.column_map compare.recordings.columns
compare.recordings.inputs compare.recordings.reading
compare.recordings.nwb_spikes compare.recordings.spikes
compare.recordings.position_table compare.recordings.reading
compare.recordings.recorded compare.recordings.recording
compare.recordings.shape_key compare.recordings.recording
compare.recordings.skin_deflection compare.recordings.deflection
compare.recordings.synthetic compare.recordings.spikes
compare.recordings.table_file compare.recordings.columns
compare.results compare.comparison_rows
compare.shape_chance compare.profile_shape_test
compare.shape_test compare.profile_shape_test
compare.statistics compare.fit
compare.stimulus_maps compare.stimuli
compare.table_5_2 compare.raju_table_5_2
compare.tables compare.comparison_rows
compare.workers study.parallel
control.server control.owner_socket
data.bench_time data.tables
data.following data.run
data.listed_journal data.journal
data.nwb data.export
data.reader data.run
data.run_index data.index
data.run_tables data.tables
data.scrubbed data.bug_report
data.summary data.tables
data.wanted data.index
devices.bench_settings settings
devices.catalogue devices.registry
devices.drivers devices.make_drivers
devices.force devices.base
devices.force.base devices.base
devices.force.laumas -
devices.force.laumas.laumas_force devices.laumas
devices.force.laumas.laumas_kind devices.laumas
devices.force.laumas.laumas_settings settings
devices.force.mtsics -
devices.force.mtsics.mtsics_force devices.mtsics
devices.force.mtsics.mtsics_kind devices.mtsics
devices.kinds devices.registry
devices.own_table devices.registry
devices.stage devices.base
devices.stage.base devices.base
devices.stage.grbl -
devices.stage.grbl.grbl_kind devices.grbl
devices.stage.grbl.grbl_link devices.grbl_link
devices.stage.grbl.grbl_settings devices.grbl_link
devices.stage.grbl.grbl_stage devices.grbl
devices.stage.grbl.grbl_words devices.grbl_link
devices.stage.grbl.work_zero devices.grbl_link
devices.stage.leadshine -
devices.stage.leadshine.leadshine_drive devices.leadshine_drive
devices.stage.leadshine.leadshine_kind devices.leadshine
devices.stage.leadshine.leadshine_settings settings
devices.stage.leadshine.leadshine_stage devices.leadshine
devices.stage.leadshine.leadshine_words devices.leadshine_drive
devices.stop_settings settings
devices.units units
engine.by_hand manual.jog,manual.guard,engine.dead_man
engine.by_hand.bench_memory engine.bench_memory
engine.by_hand.by_hand manual.jog
engine.by_hand.dead_man engine.dead_man
engine.by_hand.guard manual.guard
engine.by_hand.held manual.jog
engine.by_hand.pace engine.dead_man
engine.errors errors
engine.heartbeat engine.bench
engine.journal data.journal
engine.pressing -
engine.pressing.approach engine.indentation
engine.pressing.compliance engine.reference
engine.pressing.frozen engine.press
engine.pressing.indent engine.indentation
engine.pressing.press engine.press
engine.pressing.pulse engine.press
engine.pressing.reference engine.reference
engine.pressing.touch_fit engine.limits
engine.records records
engine.rig_settings settings
engine.stopping engine.limits
engine.streams data.schema
engine.touched engine.limits
identify.meeting_script identify.identification_script
identify.procedure identify.adaptive_presses
identify.result identify.finger_from_presses,identify.random_finger
line_file data.journal
manual.bench manual.home_and_zero
manual.requests manual.orders
manual.server manual.owner_process
panel.asked panel.requests
panel.by_hand_process panel.owners
panel.drawn -
panel.drawn.drawer panel.drawing
panel.drawn.drawing panel.drawing
panel.drawn.drawing_process panel.drawing
panel.drawn.foreseen panel.drawing
panel.drawn.job panel.drawing
panel.drawn.outlines panel.drawing
panel.few panel.requests
panel.gate panel.access
panel.outlet panel.stream
panel.posts panel.requests
panel.runs panel.run_files
panel.seen -
panel.seen.ages panel.run_view
panel.seen.growing panel.run_view
panel.seen.limits_told panel.run_view
panel.seen.seen_bench panel.watcher
panel.seen.seen_run panel.run_view
panel.seen_run panel.run_view
panel.serving panel.app
panel.state panel.watcher
panel.tabs panel.owners
plan.agenda data.run_state
plan.config_keys plan.config
plan.find identify.frame
plan.met -
plan.met.expected plan.finger_model
plan.met.finger_file plan.finger_file
plan.met.learned plan.finger_update
plan.met.left plan.finger_model
plan.met.promises plan.plan
plan.onlooker data.run_state
plan.patience protocol.handlers
plan.responses plan.finger_model
plan.shape_files plan.finger_model
plan.timeline data.run_state
plan.toml_file plan.config
protocol.errors errors
protocol.planned records
protocol.ranges protocol.schedule
protocol.refusals protocol.check
protocol.steps.base protocol.steps
protocol.steps.home_step protocol.steps
protocol.steps.indent_step protocol.steps
protocol.steps.mount_step protocol.steps
protocol.steps.move_to_step protocol.steps
protocol.steps.precondition_step protocol.steps
protocol.steps.presses protocol.steps
protocol.steps.reference_step protocol.steps
protocol.steps.rest_step protocol.steps
protocol.steps.retract_step protocol.steps
protocol.steps.touch_step protocol.steps
protocol.steps.words_step protocol.steps
protocol.steps.zero_step protocol.steps
protocol.taken_up protocol.handlers
protocol.walk protocol.check
report.blocks report.pdf
report.coding -
report.coding.decoded_figure report.coding_figures
report.coding.encoding_figure report.coding_figures
report.coding.impulse_figure report.coding_figures
report.coding.noise_figures report.coding_figures
report.coding.point_spread_figure report.coding_figures
report.coding.search_figures report.coding_figures
report.coding.sheet_figure report.coding_figures
report.comparison -
report.comparison.answer_figures report.verdict_figures
report.comparison.answer_sections report.verdict_section
report.comparison.comparison_figures report.comparison_report
report.comparison.comparison_report report.comparison_report
report.comparison.deflection report.recording_sections
report.comparison.fit_figures report.recording_sections
report.comparison.map_figures report.profile_figures
report.comparison.measures_section report.comparison_report
report.comparison.place_table report.comparison_report
report.comparison.profile_figures report.profile_figures
report.comparison.shape_section report.comparison_report
report.comparison.source_section report.recording_sections
report.comparison.strain_figures report.profile_figures
report.html report.page_parts
report.labels report.style
report.meeting_page report.identification_page
report.page report.page_parts
report.run -
report.run.conditions report.run_tables
report.run.contact_figures report.run_figures
report.run.contact_picture report.run_figures
report.run.force_figures report.run_figures
report.run.met_finger report.run_report
report.run.numbers report.run_tables
report.run.run_figures report.run_figures
report.run.run_report report.run_report
report.run.what_ran report.run_tables
report.speed_page report.benchmark_page
session.attendant session.session
session.bench_problems bench.checks
session.by_hand -
session.by_hand.at_hand manual.home_and_zero
session.by_hand.hand_answers manual.owner_process
session.by_hand.hand_log manual.status
session.by_hand.hand_owner manual.owner_process
session.by_hand.hand_readings manual.status
session.by_hand.hand_status manual.status
session.by_hand.holds manual.orders
session.by_hand.orders manual.orders
session.calibration bench.checks
session.control -
session.control.announcements control.client
session.control.at_work control.client
session.control.control_socket control.owner_socket
session.control.conversation control.messages
session.control.lenient_stage control.stop
session.control.recorded_stop session.session
session.control.sent_stop control.stop
session.control.stage_in_hand control.stop
session.control.stop_switch control.stop
session.ending session.early_ending
session.live session.execute
session.lost_run session.lost_files
session.meeting identify.adaptive_presses
session.meeting.journalled_press identify.press_record
session.meeting.meeting identify.adaptive_presses
session.meeting.meeting_script identify.identification_script
session.meeting.names data.folder
session.meeting.stranger identify.random_finger
session.meeting.written_finger identify.finger_from_presses
session.page session.rehearsal_summary
session.preflight session.rehearsal_summary
session.provenance session.resume
session.real_bench bench.real
session.rehearsal session.rehearse
session.running session.script_run
session.stop_button session.hardware_stop
session.subject bench.checks
session.virtual -
session.virtual.served_bench bench.served
session.virtual.twins bench.virtual
session.virtual.virtual_bench bench.virtual
session.virtual.virtual_devices bench.virtual
transport.base transport.wire
transport.byte_log data.journal
transport.clock clock
transport.identity transport.ownership
transport.lines transport.wire
transport.loopback transport.wire
transport.machine_lock transport.ownership
transport.opening transport.ports
transport.port_settings settings
transport.serial_port transport.ports
transport.tcp transport.ports
"""
"""An old module and the modules that have its names now, below the package; - for a package that is no more."""


class _Moved(ModuleType):
    """A module of an old name, which looks its names up where they are now."""

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


def answer() -> None:
    """Install the old names; a module is imported only when an attribute of its old name is used."""
    package = __name__.rpartition(".")[0]
    shells = dict[str, _Moved]()
    for row in _NEW.splitlines():
        old, new = row.split()
        shell = _Moved(f"{package}.{old}", tuple(f"{package}.{one}" for one in new.split(",") if one != "-"))
        shells[old] = sys.modules[shell.__name__] = shell
        above, _, name = old.rpartition(".")
        if above in shells:
            setattr(shells[above], name, shell)
