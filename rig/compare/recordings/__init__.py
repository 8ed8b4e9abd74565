"""Recordings that users name, read as rates against position.

    file → table_cells, workbook, matlab_file → table (header, roles, units, numbers) → presses_table → Recording
    file → spike_files (NWB, neo, table) → UnitSpikes → spike_checks → run_clock → spikes → Recording

Each fact about inputs has one place:

- a column, its role, its units and its names: `column_units.COLUMNS`
- a question about the presses of a table: `presses_table.CHECKS`; what is no measurement: `rig_shared.summary_rows`
- a way in which a workbook shows something else than its numbers: `workbook._UNCLEAR`
- a kind of file with spikes: `spike_files.SPIKE_FILES`; its reader fills `spike_times.UnitSpikes`
- a question about spikes, whatever their file: `spike_checks.CHECKS`, and on the run's clock `RUN_CHECKS`
"""
