"""Tests that cannot pass with POSIX hidden from the product (sitecustomize.py), each with the reason."""

_MODES = "modes and owners of a POSIX folder; Windows has the profile of a user"
_UNIX = "Unix sockets"
_UNNAMED = "Windows does not name the owner of a port"
_NO_LOOK = "Windows finds a missing port when it opens it"
_PTYS = "pseudo-terminals"
_PIPES = "Windows does not say what a pipe holds"
_SIGNALS = "signals that Windows lacks"
_ALARMS = "alarms of POSIX; test_without_posix.py has the limit on a thread"
_NICE = "niceness and sessions of POSIX"
_HEAP = "settings of the C library's memory"
_LOCKS = "POSIX record locks and their owner; test_without_posix.py has the locks of Windows"
CANNOT = {
    "rig/real_time/test_asked_from_elsewhere.py::test_a_run_whose_finger_is_lost_is_lifted_and_says_so": _NICE,
    "rig/real_time/test_bench_verbs.py::test_a_stage_is_owned_by_whoever_has_the_port_of_one_of_its_drives": _UNNAMED,
    "rig/real_time/test_bench_verbs.py::test_status_of_ports_that_are_not_there_and_of_one_that_is_owned": _UNNAMED,
    "rig/real_time/test_bluesky.py::test_no_promise_is_lost_below_bluesky[a person mounts]": _PIPES,
    "rig/real_time/test_by_hand_commands.py::test_without_a_sensor_nothing_moves": _PTYS,
    "rig/real_time/test_by_hand_process.py::test_two_drives_on_a_bus_are_stopped_in_a_step": _PTYS,
    "rig/real_time/test_by_hand_process.py::test_manual_control_that_does_not_begin_gives_one_line": _UNNAMED,
    "rig/real_time/test_calibrate.py": _PTYS,
    "rig/real_time/test_jog_command.py": _PTYS,
    "rig/real_time/test_keys_of_a_terminal.py::test_it_lifts_first[SIGTSTP]": _SIGNALS,
    "rig/real_time/test_panel_served.py::test_the_program_prints_its_address_and_logs_no_token[1]": "SIGHUP",
    "rig/real_time/test_run_on_wires.py::test_run_needs_ports_that_are_there_and_leaves_nothing_otherwise": _NO_LOOK,
    "rig/real_time/test_who_gives_way.py::test_a_served_finger_gives_way_to_nobody": _NICE,
    "rig/real_time/test_who_gives_way.py::test_a_session_s_niceness": _NICE,
    "rig/real_time/test_who_gives_way.py::test_each_gives_way": _NICE,
    "rig/test_at_work.py::test_status_and_doctor_name_the_owner_of_both_ports": _UNNAMED,
    "rig/test_control_socket.py": _UNIX,
    "rig/test_every_end.py::test_every_early_ending_tells_position_and_resume_command[SIGHUP": _SIGNALS,
    "rig/test_every_end.py::test_every_early_ending_tells_position_and_resume_command[rig stop, or Ctrl-C": _SIGNALS,
    "rig/test_every_signal.py::test_every_command_that_runs_a_protocol_handles_every_signal": _SIGNALS,
    "rig/test_every_signal.py::test_every_bench_command_that_moves_handles_signals": _SIGNALS,
    **{
        f"rig/test_every_signal.py::test_the_first_signal_lifts_and_the_second_stops_at_once[{times}-{name}": _SIGNALS
        for times in (1, 2)
        for name in ("SIGTSTP", "SIGQUIT")
    },
    "rig/test_how_it_ends.py::test_a_run_whose_terminal_closes_lifts_and_can_be_resumed": _SIGNALS,
    "rig/test_init_command.py::test_probing_a_port_in_use_sends_nothing_and_names_its_owner": _UNNAMED,
    "rig/test_kills.py::test_killed_runs_are_resumed_without_missing_or_repeated_presses": _SIGNALS,
    "rig/test_modbus_counterparties.py::test_minimalmodbus": _PTYS,
    "rig/test_modbus_counterparties.py::test_modbus_tk_reads_and_writes_a_drive_on_a_serial_line": _PTYS,
    "rig/test_ownership.py": _LOCKS,
    "rig/test_page.py::test_a_run_that_is_refused_before_it_begins_reports_that_it_did_not_move[no port": _NO_LOOK,
    "rig/test_patience.py": _ALARMS,
    "rig/test_stopping_needs_nothing.py::test_a_stop_finds_the_owner_under_every_name_of_the_port": _SIGNALS,
    "rig/test_stop_matrix.py": _PTYS,
    "rig/test_stopping_needs_nothing.py::test_only_an_owner_of_this_account_is_signalled": _SIGNALS,
    "rig/test_sync_line.py::test_a_port_without_the_line_is_refused_before_a_motion": _PTYS,
    "rig/test_transport.py::test_opening_a_missing_port_is_refused_by_name[refuse_missing]": _NO_LOOK,
    "rig/test_transport.py::test_a_serial_port_has_one_owner": _UNNAMED,
    "rig/test_transport.py::test_a_tcp_port_sends_and_receives_and_has_one_owner": _UNNAMED,
    "rig/test_stop_button.py": "an input device of Linux",
    "rig/test_stopping_needs_nothing.py::test_the_bytes_go_out_through_it[lock cannot be taken]": _LOCKS,
    "sim/test_cache.py::test_a_hostile_cache_file_is_rebuilt_with_one_warning[a pipe]": "pipes in folders",
    "sim/test_finger_process.py::test_terminal_signals_do_not_reach_a_finger_process": _NICE,
    "sim/test_served_ports.py::test_a_pseudo_terminal_serves_one_client_after_another": _PTYS,
    "sim/test_workers.py::test_freed_memory_is_reused_without_page_faults": _HEAP,
    "sim/test_workers.py::test_worker_processes_ignore_ctrl_c": "masks of signals",
    "test_other_accounts.py": _MODES,
}
