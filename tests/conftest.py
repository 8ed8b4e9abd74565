"""What every test may use: the default fingertip, loaded once, and a count of the costly work done."""

import ast
import gc
import inspect
import linecache
import math
import multiprocessing.util
import os
import pkgutil
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import cache, lru_cache
from itertools import count
from pathlib import Path
from typing import Any

import pytest

import sim.models.cache as model_cache
from rig.cli import output
from rig.cli.program import LOOKED_THROUGH
from rig.data import Run
from rig.plan import fresh_passes
from rig.plan.config import Config
from rig.plan.plan import Plan
from rig.protocol.script import Script
from rig.session import rehearsal_summary, resume
from rig.session.rehearse import Rehearsed
from rig.study import parallel
from sim import benchmark
from sim.config import Contact, FingertipConfig
from sim.contact.warmup import make_ready
from sim.finger.surface import FingertipSurface
from sim.finger_process import Finger
from sim.measures import receptors
from sim.measures.receptors import ReceptorPlaces, ReceptorSet
from sim.models import fingertip
from sim.models.fingertip import Fingertip
from sim.workers import in_processes
from tests import preloaded
from tests.empty_figures import draw_nothing
from tests.kept_runs import make_stopped_run
from tests.portable.cannot import CANNOT

TESTS = Path(__file__).parent

# Processes, threads, ports and clocks of the real world: what `make shake` repeats beside a busy machine.
REAL_TIME = (
    "panel/",
    "portable/",
    "rig/real_time/",
    "rig/test_identification_ports.py",
    "rig/compare/test_parameter_study.py::test_processes_give_what_one_gives",
    "rig/compare/test_parameter_study.py::test_a_killed_process_is_told_of",
    "rig/compare/test_parameter_study.py::test_a_process_has_one_thread",
    "rig/compare/test_study_on_a_cluster.py",
    "rig/test_command_line.py::test_ctrl_c_stops_a_run_at_a_safe_point",
    "rig/test_command_line.py::test_a_killed_run_leaves_a_readable_journal",
    "rig/test_control_socket.py",
    "rig/test_every_end.py",
    "rig/test_first_second.py::test_a_command_imports_no_library_that_the_command_does_not_use",
    "rig/test_grbl_conformance.py",
    "rig/test_how_it_ends.py",
    "rig/test_init_command.py::test_probing_a_port_in_use_sends_nothing_and_names_its_owner",
    "rig/test_init_command.py::test_probing_a_port_tries_device_kinds_in_order_until_one_answers",
    "rig/test_journal_behind.py",
    "rig/test_kills.py",
    "rig/test_modbus_counterparties.py",
    "rig/panel/test_posts.py",
    "rig/test_damaged_journal.py::test_a_stop_during_the_report_after_a_trip_leaves_the_reason_of_the_trip",
    "rig/test_ownership.py",
    "rig/test_patience.py::test_planning_outside_the_main_thread_sets_no_timer",
    "rig/test_release.py::test_python_m_rig_runs_the_program_with_its_exit_code",
    "rig/test_release.py::test_every_module_can_be_imported_without_optional_packages",
    "rig/test_resume.py::test_ctrl_c_then_enter_at_a_terminal_pauses_and_continues_a_run",
    "rig/test_run_owner.py",
    "rig/test_runs_command.py::test_several_rig_runs_at_once_list_the_same",
    "rig/test_makers_clients.py",
    "rig/test_net_ft_clients.py",
    "rig/test_net_ft_driver.py::test_records_come_joined_and_another_datagram_alone",
    "rig/test_net_ft_driver.py::test_where_nothing_listens_it_is_an_error_and_then_goes_on",
    "rig/test_same_numbers.py::test_two_processes_give_the_same_results_as_one",
    "rig/test_safety.py::test_the_heartbeat_stops_the_stage_when_the_engine_is_silent",
    "rig/test_safety.py::test_the_heartbeat_does_not_stop_a_beating_or_resting_engine",
    "rig/test_stage_in_hand.py::test_a_stop_while_the_port_opens_is_the_only_byte_sent",
    "rig/test_stop_button.py::test_a_key_held_while_the_device_is_opened_counts_as_pressed",
    "rig/test_stop_gate.py",
    "rig/test_stop_from_another_thread.py",
    "rig/test_stop_matrix.py",
    "rig/test_stop_switch.py",
    "rig/test_stopping_needs_nothing.py",
    "rig/test_sync_line.py",
    "rig/test_transport.py",
    "rig/test_wall_clock.py",
    "rig/test_watch_command.py::test_ctrl_c_in_rig_watch_leaves_the_run_running",
    "sim/test_door.py::test_importing_sim_imports_no_library",
    "sim/test_finger_process.py",
    "sim/test_relaxing_plant.py::test_a_hold_on_a_served_finger_relaxes_in_real_time",
    "sim/test_many.py::test_a_pickled_finger_presses_in_forked_and_spawned_processes",
    "sim/test_many.py::test_a_lost_worker_process_is_reported",
    "sim/test_many.py::test_many_presses_in_two_processes_give_the_same_results_in_order",
    "sim/test_press_ahead.py",
    "sim/test_results.py::test_reading_a_pickled_result_loads_no_finger",
    "sim/test_served_ports.py",
    "sim/test_speed_and_error.py::test_speed_benchmark_measures_each_candidate_in_its_own_process",
    "sim/test_wall_clock.py",
    "sim/test_workers.py",
    "test_gallery.py::test_a_gallery_script_with_worker_processes_runs_once",
    "test_gallery.py::test_gallery_run_resumed_completes_four_presses",
    "test_gallery.py::test_gallery_study_on_a_cluster_solves_twelve_cases",
    "test_inherited_signals.py",
    "test_preloaded.py",
    "test_wheel.py",
)

# Files of these that workers take whole: their tests share what takes seconds to make, or are short. Of the others,
# most of whose time is waiting, a worker takes one test at a time (tests/dealt_out.py).
TOGETHER = (
    "panel/",
    "portable/",
    "rig/real_time/test_bluesky.py::test_documents",
    "rig/real_time/test_bluesky.py::test_a_plan_of_bluesky",
    "rig/real_time/test_bluesky.py::test_devices",
    "rig/real_time/test_bluesky.py::test_no_promise_is_lost_below_bluesky[confirmed ",
    "rig/real_time/test_bluesky.py::test_no_promise_is_lost_below_bluesky[a number]",
    "rig/real_time/test_bluesky.py::test_no_promise_is_lost_below_bluesky[no other key]",
    "rig/test_control_socket.py",
    "rig/test_grbl_conformance.py",
    "rig/test_identification_ports.py",
    "rig/panel/test_posts.py",
    "rig/test_ownership.py",
    "rig/test_run_owner.py",
    "rig/test_same_numbers.py",
    "rig/test_stop_from_another_thread.py",
    "rig/test_stop_switch.py",
    "rig/test_sync_line.py",
    "rig/test_transport.py",
    "sim/",
    "test_preloaded.py",
    "test_wheel.py",
)

# What measures a study again: many fingers built, statistics drawn, emulators learned, references pressed once more;
# and what takes long and is held by shorter tests. `make test-studies` runs it, `make test` does not. Pages and kept
# files of studies are checked in `make test`.
# Behind each stands the test that guards the same code in `make test`.
# A single test may be marked `@pytest.mark.study` instead; of a large table, `@pytest.mark.quick(rows=lambda one: …)`
# says which rows stay in `make test`.
STUDIES = (
    "studies/test_identified_random_fingers.py",  # rig/test_identification.py, studies/test_identification_study.py
    # How large the boxes of the oracle must be; the recovery of strain is held by the other tests of the file.
    "sim/oracles/test_halfspace.py::test_the_truncation_error_of_a_line_load_falls_with_the_box_size",
    "sim/oracles/test_halfspace.py::test_the_truncation_error_of_a_point_load_falls_with_the_box_size",
    "sim/oracles/test_halfspace.py::test_point_load_strain_converges_with_element_size",
    "sim/oracles/test_layered_halfspace.py::test_the_sed_exponent_on_elements_converges_with_element_size",
    "sim/oracles/test_membrane.py::test_the_reference_of_cooks_membrane_has_converged",
    # its table of closed forms
    "sim/oracles/test_contact.py::test_the_depth_of_a_round_flat_punch_converges_at_first_order",
    "sim/oracles/test_contact.py::test_the_depth_error_is_of_first_order_in_the_box_size",
    # Means over draws; bands: sim/test_within_contacts.py.
    "sim/test_decoding.py::test_the_bayes_band_covers_two_pressures_as_often_as_stated",
    "sim/test_decoding.py::test_bayes_beats_the_univariate_search_in_loud_noise",
    # of the finger
    "sim/test_speed_and_error.py::test_the_stated_errors_of_the_half_space_hold_in_nine_of_ten_scenes",
    "sim/test_axial_row.py::test_a_pressed_cylinder_is_decoded_under_the_contact_length_that_fits_best",
    "sim/test_sharp_sweep.py::test_every_random_pose_of_a_sharp_indentor_converges",  # its other tests
    # Rows of a table whose other rows stay.
    "sim/test_friction.py::test_a_press_with_friction_does_not_depend_on_the_increment[bar:3.0]",
    "sim/test_friction.py::test_a_press_with_friction_does_not_depend_on_the_increment[sphere:4]",
    "sim/test_hard_cases.py::test_force_control_converges_where_the_stiffness_changes_abruptly[profile2-",
    "sim/test_sheets.py::test_a_sheet_of_readings_is_decoded_to_the_pressed_sphere[20.0-0.5]",
    "sim/test_friction.py::test_every_press_obeys_coulombs_law[0.05-",
    "sim/test_friction.py::test_every_press_obeys_coulombs_law[0.6-",
    "sim/test_friction.py::test_every_press_obeys_coulombs_law[10.0-",
    "sim/test_nerve_population.py::test_a_population_has_the_published_density_and_spacing[monkey",
    "sim/test_own_finger.py::test_more_of_a_stiffer_layer_makes_a_stiffer_finger[e_fat-",
    "sim/test_own_finger.py::test_more_of_a_stiffer_layer_makes_a_stiffer_finger[nail_arc_deg-",
    "sim/test_hard_cases.py::test_a_force_found_as_depth_gives_the_same_force_from_rest[0.5-",
    "sim/test_hard_cases.py::test_a_force_found_as_depth_gives_the_same_force_from_rest[5.0-",
    "sim/test_uncondensed.py::test_the_uncondensed_solution_is_in_equilibrium[default]",
    "sim/test_uncondensed.py::test_condensed_and_uncondensed_patch_displacements_agree[default]",
    "sim/test_uncondensed.py::test_the_contact_conditions_hold_on_the_uncondensed_solution[default]",
    "sim/test_uncondensed.py::test_condensed_and_uncondensed_receptor_strain_agree[default]",
    # Fingers of their own, built for one row of a table whose other rows stay.
    "sim/test_hard_cases.py::test_extreme_tissue_is_in_equilibrium[poisson 0.4999, bone rigid 10000, dermis 0.1]",
    "sim/test_hard_cases.py::test_extreme_tissue_is_in_equilibrium[poisson 0.48, bone rigid 10000, dermis 0.001]",
    "sim/test_hard_cases.py::test_extreme_tissue_is_in_equilibrium[poisson 0.48, bone elastic 1000,",
    "sim/test_hard_cases.py::test_extreme_tissue_is_in_equilibrium[poisson 0.48, bone elastic 10000,",
    "sim/test_hard_cases.py::test_extreme_tissue_is_in_equilibrium[poisson 0.48, bone elastic 1e+06,",
    "sim/test_own_finger.py::test_contact_is_found_on_a_finger_off_center[1.0]",
    # its section is
    "sim/test_quadratic_finger.py::test_a_quadratic_finger_presses_like_linear_elements_of_half_the_size",
    "sim/test_patches.py::test_a_press_that_leaves_the_patch_is_solved_on_a_larger_one[bar:3-",
    "sim/test_patches.py::test_a_press_that_leaves_the_patch_is_solved_on_a_larger_one[sphere:2-place1-",
    "rig/test_kills.py::test_runs_whose_cables_were_pulled_are_resumed_completely",  # killed ones, rig/test_resume.py
    # A board's other input, which it answers as it does its door; [door-*] and [di1-*] are every phase.
    "rig/test_stop_button.py::test_a_press_of_the_boards_input_stops_the_stage_whatever_it_does_and_ends_the_run[hold-",
    # rig/test_identification.py; stopped, it is on these wires in rig/real_time/test_stopped_from_elsewhere.py
    "rig/real_time/test_identify_a_random_finger.py",
    # Whole pages, scripts and sites: what they name and type is checked in `make test`.
    # [empty], and rig/compare/test_report_sections.py::test_a_figure_has_the_same_bytes_each_time
    "rig/compare/test_compare_command.py::test_the_same_input_gives_the_same_bytes[drawn]",
    # its test_the_command
    "rig/compare/test_on_fingers.py::test_the_shipped_fingers_that_the_source_allows_are_compared_with",
    "rig/compare/test_place_fit.py::test_intervals_hold_the_truth_as_often_as_they_say",  # its other tests, once each
    # rig/compare/test_stimuli.py: a run over more than one patch; this file's own ranges
    "rig/compare/test_wider_run.py::test_presses_on_patches_of_two_widths_are_compared",
    "rig/compare/test_interpolated_study.py",  # sim/test_moduli.py
    # sim/test_sheets.py
    "rig/test_decode_finger.py::test_a_sheet_of_readings_gives_pressures_over_x_and_z_with_band_and_contact_extent",
    # Rows of a table whose other rows stay.
    "rig/test_figures_without_settings.py::test_the_program_starts_with_any_matplotlib_settings[TeX-variable]",
    "rig/test_figures_without_settings.py::test_the_program_starts_with_any_matplotlib_settings[noise-",
    "rig/test_nerve_command.py::test_check_announces_silent_afferents_and_the_speed_at_which_they_fire[RA@0]",
    "rig/test_nerve_command.py::test_the_nwb_inspector_accepts_a_file_of_simulated_spikes[3]",
    "rig/test_run_state.py::test_all_views_of_a_run_agree_after_every_document[complete_with_a_schedule]",
    "rig/test_same_numbers.py::test_cache_and_order_of_requests_change_no_result[rig compare --fingers]",
    "rig/test_same_numbers.py::test_cache_and_order_of_requests_change_no_result[rig identify, a table]",
    "rig/test_same_numbers.py::test_cache_and_order_of_requests_change_no_result[rig study]",
    "rig/test_small_strain_said.py::test_every_output_says_that_another_finger_was_not_compared[rig check]",
    "rig/test_every_block.py::test_the_commands_on_every_page_run[comparison]",  # rig/compare/test_compare_command.py
    "rig/test_every_block.py::test_the_commands_on_every_page_run[find_finger]",  # rig/test_json_answers.py: `find`
    "rig/test_every_block.py::test_the_commands_on_every_page_run[identify]",  # rig/test_identification.py
    # rig/compare/test_afferents_table.py
    "rig/test_every_block.py::test_the_commands_on_every_page_run[own_recordings]",
    "rig/test_every_block.py::test_the_commands_on_every_page_run[schedules]",  # rig/test_schedule.py
    # its other tests, on exact geometry
    "rig/test_find.py::test_find_locates_a_displaced_and_rotated_finger_by_nine_touches",
    # rig/test_decode_command.py
    "rig/test_followed_pages.py::test_every_how_to_page_can_be_followed_literally[coding]",
    # rig/test_nerve_command.py: a dry run with spikes, and rates of them; [tutorial]
    "rig/test_followed_pages.py::test_every_how_to_page_can_be_followed_literally[nerve]",
    # the page's other block, on a half-space; rig/test_nerve_command.py
    'rig/test_every_block.py::test_python_on_every_page_runs_or_is_excused[nerve: finger = load("finger")]',
    # rig/compare/test_parameter_study.py::test_a_killed_process_is_told_of
    "rig/compare/test_study_on_a_cluster.py::test_a_worker_killed_at_a_case_changes_no_byte",
    "test_site.py",  # `make docs`
)

# Begun first, so that what comes last is short and all workers end together; what waits for real time is dealt out
# among what computes, so that not all wait at once.
LONG = (
    "portable/test_without_posix.py",
    "rig/real_time/test_bluesky.py",
    "rig/real_time/test_choose_on_wires.py",
    "test_third_party_device.py",
    "test_wheel.py",
    "test_preloaded.py",
    "rig/real_time/test_asked_from_elsewhere.py",
    "rig/real_time/test_stopped_from_elsewhere.py",
    "rig/test_kills.py",
    "rig/real_time/test_run_on_wires.py",
    "test_gallery.py",
    "test_adding_a_part.py",
    "rig/real_time/test_keys_of_a_terminal.py",
    "rig/real_time/test_by_hand_commands.py",
    "rig/real_time/test_panel_by_hand.py",
    "rig/real_time/test_calibrate.py",
    "rig/real_time/test_stop_key_on_wires.py",
    "rig/test_stop_matrix.py",
    "rig/test_stopping_needs_nothing.py",
    "rig/compare/test_study_on_a_cluster.py",
    "sim/test_results.py",
    "rig/real_time/test_init_finds_devices.py",
    "rig/real_time/test_by_hand_process.py",
    "rig/test_makers_clients.py",
    "rig/real_time/test_panel_served.py",
    "rig/test_modbus_counterparties.py",
    "rig/real_time/test_bench_verbs.py",
    "rig/real_time/test_lsl_inlet.py",
    "rig/test_resume.py",
    "rig/test_release.py",
    "rig/compare/test_on_fingers.py",
    "studies/test_fault_campaign.py",
    "test_site.py",
    "rig/test_find.py",
    "studies/test_identified_random_fingers.py",
    "sim/test_hard_cases.py",
    "rig/test_json_answers.py",
    "rig/compare/test_compare_command.py",
    "rig/test_followed_pages.py",
    "rig/test_lost_journal.py",
    "rig/test_stop_button.py",
    "rig/test_every_block.py",
    "sim/test_strain_map.py",
    "rig/test_every_end.py",
    "sim/test_own_finger.py",
    "sim/test_speed_and_error.py",
    "sim/test_identification_forces.py",
    "rig/identify/test_identified_finger_in_a_run.py",
    "rig/real_time/test_identify_a_random_finger.py",
    "rig/test_how_it_ends.py",
    "sim/test_patches.py",
    "rig/real_time/test_jog_command.py",
    "sim/oracles/test_halfspace.py",
    "rig/test_grbl_conformance.py",
    "sim/oracles/test_contact.py",
    "sim/test_any_point.py",
    "sim/test_press_ahead.py",
    "sim/test_moduli.py",
    "sim/test_uncondensed.py",
    "sim/test_facts.py",
    "test_waits.py",
    "rig/test_drift_through_zero.py",
    "rig/test_page.py",
    "rig/test_map_in_a_run.py",
    "test_public_docstrings.py",
)
# What a shell, nohup or a terminal may have had ignored before the tests began.
INHERITED = ("SIGINT", "SIGQUIT", "SIGHUP", "SIGTERM", "SIGTSTP")
_flush, _fresh_pass = os.fsync, fresh_passes._pass
# A rehearsal is the same on every port.
_PORT = re.compile(r"port='[^']*'")
# Scripts whose steps differ between processes only if these begin anew: by hash seed, and by what random was seeded.
UNLIKE_WHEN_ANEW = ("[a loop over a set]", "[an unseeded shuffle]", "[numpy's generator]")
# Files of the cache, of up to 80 MB each.
MOST_KEPT = 12


def pytest_configure(config: pytest.Config) -> None:
    """The contact's loops are compiled before workers and commands would each do it at once.

    Garbage is looked for as rarely as the program does it: a third of collecting the tests went into it.
    """
    _signals_as_in_the_foreground()
    gc.set_threshold(*LOOKED_THROUGH)
    if not hasattr(config, "workerinput"):
        make_stopped_run()
        make_ready()


def pytest_unconfigure() -> None:
    preloaded.close()


def _signals_as_in_the_foreground() -> None:
    """Programs that tests begin inherit what is ignored or blocked here, and some tests send such a signal.

    In the background of a script and under nohup they would never come.
    """
    numbers = [getattr(signal, name) for name in INHERITED if hasattr(signal, name)]
    for number in numbers:
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes() -> None:
    if preloaded.POSSIBLE:
        preloaded.fork_workers()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Deal out the tests that wait one by one, where `--dist loadfile` is asked for."""
    if config.option.dist != "loadfile":
        return None
    from tests.dealt_out import Dealt  # xdist is there

    return Dealt(config, log, REAL_TIME, TOGETHER)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """No worker imports a file whose tests all belong to the other half of `make test`, or to `make test-studies`."""
    if collection_path.suffix != ".py":
        return None
    name = collection_path.relative_to(TESTS).as_posix()
    asked = config.option.markexpr.split(" and ")
    for marker, places in (("real_time", REAL_TIME), ("study", STUDIES)):
        wholly = name.startswith(tuple(place for place in places if "::" not in place))
        if wholly and f"not {marker}" in asked:
            return True
        partly = wholly or any(place.startswith(f"{name}::") for place in places)
        if marker in asked and not partly and not (marker == "study" and _has_studies(collection_path)):
            return True
    return None


def _has_studies(path: Path) -> bool:
    text = path.read_bytes()
    return b"pytest.mark.quick(" in text or b"pytest.mark.study" in text


def pytest_collection_finish() -> None:
    """What was imported and collected stays: it is not looked through for garbage while the tests run."""
    gc.freeze()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first, the others as they come; mark what runs in real time and what measures a study."""
    named = [(item.nodeid.removeprefix("tests/"), item) for item in items]
    named.sort(key=lambda pair: _place_in_line(pair[0].partition("::")[0]))
    items[:] = [item for _, item in named]
    for name, item in named:
        for marker, places in (("real_time", REAL_TIME), ("study", STUDIES)):
            if name.startswith(places):
                item.add_marker(marker)
        quick = item.get_closest_marker("quick")
        if quick is not None and not quick.kwargs["rows"](**item.callspec.params):  # type: ignore[attr-defined]
            item.add_marker("study")
        if hasattr(sys.modules.get("sitecustomize"), "HIDDEN"):  # tests/portable
            for place, reason in CANNOT.items():
                if name.startswith(place):
                    item.add_marker(pytest.mark.skip(reason=reason))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Work that a command shares out between processes is done in this one, except in real time.

    Each of them takes a second to begin. Nor does a record wait for the disk, some milliseconds for each of the
    hundred and more of a run; that it is flushed is tested where the call is watched.
    """
    real = item.get_closest_marker("real_time") is not None
    for module in (parallel, benchmark):
        module.in_processes = in_processes if real else _one_by_one  # type: ignore[assignment]
    os.fsync = _flush if real else _unflushed  # type: ignore[assignment]
    if preloaded.POSSIBLE:
        multiprocessing.util.spawnv_passfds = preloaded.spawnv_passfds if real else preloaded.SPAWN_ANEW
        anew = real or item.name.endswith(UNLIKE_WHEN_ANEW)
        fresh_passes._pass = _fresh_pass if anew else _forked_pass


def _forked_pass(_: str) -> "subprocess.Popen[bytes]":
    """`rig check` begins two Pythons for its passes, half a second each; hash seeds are tested where they matter."""
    words, pipe = [sys.executable, "-m", "rig.plan.fresh_passes"], subprocess.PIPE
    return preloaded.Popen(words, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL)


def _unflushed(_: Any) -> None:
    """Leave it to the system when the disk is written."""


def _one_by_one(function: Callable[..., Any], items: Sequence[Any], processes: int | None = None) -> Iterator[Any]:
    return map(function, items)


@cache
def _place_in_line(file: str) -> int:
    return LONG.index(file) if file in LONG else len(LONG)


@pytest.fixture(scope="module")
def _folders(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Names of folders in one for the tests of a file."""
    folder = tmp_path_factory.mktemp(request.path.stem)
    return (folder / str(number) for number in count())


@pytest.fixture
def tmp_path(_folders: Iterator[Path]) -> Path:
    """An empty folder of the test's own, as pytest's.

    pytest looks through the folders of all tests before for the next free number: 5 ms for the 4000th of a session.
    """
    folder = next(_folders)
    folder.mkdir(mode=0o700)
    return folder


@pytest.fixture(scope="session", autouse=True)
def _read_once() -> Iterator[None]:
    """What lies in the cache that all tests share is read and checked once, not by every command in this process.

    Caches that tests make for themselves are read as often as the program reads them.
    """
    shared, read = model_cache.cache_dir(), model_cache._read
    kept: dict[Path, model_cache.Arrays] = {}

    def once(path: Path, key: str, *more: Any) -> model_cache.Arrays | None:
        if path.parent != shared or not path.exists():
            return read(path, key, *more)
        if path not in kept:
            found = read(path, key, *more)
            if found is None:
                return None
            for array in found.values():
                array.flags.writeable = False  # or one test would write into another's
            if len(kept) == MOST_KEPT:
                kept.clear()
            kept[path] = found
        return dict(kept[path])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model_cache, "_read", once)
        yield


@pytest.fixture(scope="session", autouse=True)
def _worked_out_once() -> Iterator[None]:
    """What is the same in every run of this session costs each of some thousand of them a tenth of its time.

    These are the commit and the versions that a run records, and where a finger's receptors lie.
    """
    placed: dict[str, ReceptorSet] = {}
    foreseen: dict[tuple[str, ...], Rehearsed] = {}

    def receptors_at(config: FingertipConfig, surface: FingertipSurface, places: ReceptorPlaces) -> ReceptorSet:
        key = f"{config.model_dump_json()} {places!r}"
        if key not in placed:
            placed[key] = receptors.receptors_at(config, surface, places)
            for array in (placed[key].position_mm, placed[key].depths_mm):
                array.flags.writeable = False  # or one test would write into another's
        return placed[key]

    rehearse = rehearsal_summary.rehearsed

    def rehearsed(script: Script, config: Config, finger: Finger, plan: Plan, before: Run | None = None) -> Rehearsed:
        """A quarter of the time of a short run, and the same on every port."""
        if before is not None:
            return rehearse(script, config, finger, plan, before)
        key = (script.source, repr(script.parameters), _PORT.sub("", repr(config)), repr(plan), type(finger).__name__)
        if key not in foreseen:
            foreseen[key] = rehearse(script, config, finger, plan)
        return foreseen[key]

    found_by_python = inspect.findsource

    def findsource(found: Any) -> tuple[list[str], int]:
        """Python up to 3.12 parses a module for each of its classes: 0.1 s for the schema of a command."""
        lines = _lines_of_classes(inspect.getsourcefile(found)) if inspect.isclass(found) else {}
        if getattr(found, "__qualname__", None) not in lines:
            return found_by_python(found)
        return linecache.getlines(str(inspect.getsourcefile(found))), lines[found.__qualname__]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inspect, "findsource", findsource)
        patch.setattr(rehearsal_summary, "rehearsed", rehearsed)
        patch.setattr(resume, "commit", lru_cache(resume.commit))
        patch.setattr(resume, "version", lru_cache(resume.version))
        patch.setattr(fingertip, "receptors_at", receptors_at)
        yield


@cache
def _lines_of_classes(file: str | None) -> dict[str, int]:
    """Where the classes of a module begin that no other block holds."""
    text = "" if file is None else "".join(linecache.getlines(file))
    classes = [node for node in ast.parse(text).body if isinstance(node, ast.ClassDef)]
    return {node.name: min(one.lineno for one in (node, *node.decorator_list)) - 1 for node in reversed(classes)}


@pytest.fixture(scope="session", autouse=True)
def _no_clock_has_a_say() -> Iterator[None]:
    """No command in this process says that it takes long, on a machine of whatever speed.

    What it says, and when, is held by tests/rig/test_progress.py and tests/rig/test_nobody_waits.py.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(output, "FIRST_S", math.inf)
        patch.setattr(output, "EVERY_S", math.inf)
        yield


@pytest.fixture(scope="session", autouse=True)
def _announced_here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Runs that tests carry out are none of the user's, and are not seen by what looks for those."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIG_RUNTIME_DIR", str(tmp_path_factory.mktemp("runtime")))
        yield


@pytest.fixture(scope="session")
def finger() -> Fingertip:
    """The default fingertip, from the user's cache or built in seconds."""
    return Fingertip.load()


@pytest.fixture(scope="session")
def unwidened(finger: Fingertip) -> Fingertip:
    """The default fingertip, its models shared, that refuses what leaves the mesh's own patch."""
    other = copy(finger)
    other.config = finger.config.model_copy(update={"contact": Contact(patch_gb=0)})
    return other


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often this process built a model, solved a contact, factorised, and began processes to do so for it."""
    done: Counter[str] = Counter()

    def count(name: str, place: str) -> None:
        real = pkgutil.resolve_name(place)

        def counted(*arguments: Any, **options: Any) -> Any:
            done[name] += 1
            return real(*arguments, **options)

        monkeypatch.setattr(place.replace(":", "."), counted)

    count("models", "sim.models.sources:build_finger")
    count("contacts", "sim.models.pressing:solve_contact")
    count("factors", "sim.models.full_mesh:factorise")
    count("processes", "sim.workers:ProcessPoolExecutor")
    return done


@pytest.fixture
def rtu() -> Callable[[str], bytes]:
    """A Modbus RTU frame from its hex digits, with the CRC computed bit by bit here and nowhere else."""

    def frame(digits: str) -> bytes:
        content, crc = bytes.fromhex(digits), 0xFFFF
        for byte in content:
            crc ^= byte
            for _ in range(8):
                crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
        return content + crc.to_bytes(2, "little")

    return frame


@pytest.fixture
def empty_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages whose figures are empty: drawing them is most of a short run's time, and other tests look at them.

    A comparison does not solve the whole mesh for its figures of the strain under the skin, which takes 5 s a run.
    """
    draw_nothing(monkeypatch)
