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
    "rig/panel/test_posts.py::test_a_stop_that_did_not_arrive_is_told": _SIGNALS,
    "rig/real_time/test_asked_from_elsewhere.py::test_a_run_whose_finger_is_lost_is_lifted_and_says_so": _NICE,
    "rig/real_time/test_bench_verbs.py::test_a_stage_is_owned_by_whoever_has_the_port_of_one_of_its_drives": _UNNAMED,
    "rig/real_time/test_bench_verbs.py::test_status_of_ports_that_are_not_there_and_of_one_that_is_owned": _UNNAMED,
    "rig/real_time/test_bluesky.py::test_no_promise_is_lost_below_bluesky[a person mounts]": _PIPES,
    "rig/real_time/test_by_hand_commands.py::test_without_a_sensor_nothing_moves": _PTYS,
    "rig/real_time/test_by_hand_process.py::test_two_drives_on_a_bus_are_stopped_while_they_jog": _PTYS,
    "rig/real_time/test_by_hand_process.py::test_why_it_does_not_begin_is_one_line": _UNNAMED,
    "rig/real_time/test_calibrate.py": _PTYS,
    "rig/real_time/test_jog_command.py": _PTYS,
    "rig/real_time/test_keys_of_a_terminal.py::test_it_lifts_first[SIGTSTP]": _SIGNALS,
    "rig/real_time/test_panel_served.py::"
    "test_the_program_prints_where_its_page_is_and_logs_nothing_of_what_is_asked[1]": "SIGHUP",
    "rig/real_time/test_run_on_wires.py::test_run_needs_ports_that_are_there_and_leaves_nothing_otherwise": _NO_LOOK,
    "rig/real_time/test_who_gives_way.py::test_a_served_finger_gives_way_to_nobody": _NICE,
    "rig/real_time/test_who_gives_way.py::test_a_session_s_niceness": _NICE,
    "rig/real_time/test_who_gives_way.py::test_each_gives_way": _NICE,
    "rig/test_at_work.py::test_status_and_doctor_name_the_owner_of_both_ports": _UNNAMED,
    "rig/test_control_socket.py": _UNIX,
    "rig/test_every_end.py::test_every_end_says_where_the_indentor_is_and_how_to_go_on[SIGHUP": _SIGNALS,
    "rig/test_every_end.py::test_every_end_says_where_the_indentor_is_and_how_to_go_on[rig stop, or Ctrl-C": _SIGNALS,
    "rig/test_every_signal.py::test_no_signal_suspends_or_ends": _SIGNALS,
    **{
        f"rig/test_every_signal.py::test_the_first_lifts_and_a_second_key_stops_at_once[{times}-{name}": _SIGNALS
        for times in (1, 2)
        for name in ("SIGTSTP", "SIGQUIT")
    },
    "rig/test_how_it_ends.py::test_a_run_whose_terminal_goes_away_lifts_and_can_be_taken_up": _SIGNALS,
    "rig/test_init_command.py::test_a_port_in_use_is_left_alone_and_its_owner_is_named": _UNNAMED,
    "rig/test_kills.py::test_killed_runs_are_taken_up": _SIGNALS,
    "rig/test_modbus_counterparties.py::test_minimalmodbus": _PTYS,
    "rig/test_modbus_counterparties.py::test_modbus_tk_on_a_serial_line": _PTYS,
    "rig/test_ownership.py": _LOCKS,
    "rig/test_page.py::test_what_ends_before_it_begins_says_that_nothing_was_moved[no port": _NO_LOOK,
    "rig/test_patience.py": _ALARMS,
    "rig/test_stopping_needs_nothing.py::test_an_owner_is_told_under_whatever_name_it_has_the_port": _SIGNALS,
    "rig/test_stop_matrix.py": _PTYS,
    "rig/test_stopping_needs_nothing.py::test_only_an_owner_of_this_account_is_signalled": _SIGNALS,
    "rig/test_transport.py::test_a_missing_port_is_named[refuse_missing]": _NO_LOOK,
    "rig/test_transport.py::test_one_owner_a_port": _UNNAMED,
    "rig/test_transport.py::test_tcp_both_ways_and_one_owner": _UNNAMED,
    "rig/test_stop_button.py": "an input device of Linux",
    "rig/test_stopping_needs_nothing.py::test_the_bytes_go_out_through_it[lock cannot be taken]": _LOCKS,
    "sim/test_cache.py::test_what_is_no_arrays_is_made_anew_with_one_line[a pipe]": "pipes in folders",
    "sim/test_finger_process.py::test_no_signal_of_a_terminal_reaches_it": _NICE,
    "sim/test_served_ports.py::test_a_pseudo_terminal_serves_one_client_after_another": _PTYS,
    "sim/test_workers.py::test_memory_that_is_kept_is_not_cleared_again": _HEAP,
    "sim/test_workers.py::test_they_leave_ctrl_c_to_us": "masks of signals",
    "test_other_accounts.py": _MODES,
}
