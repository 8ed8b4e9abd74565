PYTHON ?= python3
BIN := .venv/bin
export OMP_NUM_THREADS ?= 2
REAL_TIME_WORKERS ?= 4

.PHONY: setup demo study study-bench study-coding studies docs test test-studies panel-test shake check bench mutants release-check clean

setup: .venv/.ready

.venv/.ready: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, this is " + sys.version.split()[0]) if sys.version_info < (3, 11) else 0'
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check -e .
	touch $@

.venv/.ready-dev: .venv/.ready
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $@

demo: setup
	$(BIN)/rig dry-run protocols/steps.py --set step=1 force_gwt=2.33

study: setup
	$(BIN)/python -m studies.source.pages study

study-bench: setup
	$(BIN)/python -m studies.source.bench_pages study

study-coding: setup
	$(BIN)/python -m studies.coding.pages study

studies: study-bench
	$(BIN)/python -m studies.source.pages study --sensitivity
	$(BIN)/python -m studies.source.allowed study
	$(BIN)/python -m studies.coding.pages study --draws 200
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.finite_strain.tables study/finite_strain
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.stiffening.fitted
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.stiffening.confirmed study/stiffening_calculix.jsonl
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.stiffening.in_time
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.meeting study/meeting.jsonl

docs: .venv/.ready-dev
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs build/site

check: .venv/.ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# What waits for the real world runs alone at the end, in more workers than there are cores. Both parts always run.
test: check
	$(BIN)/pytest -m "not study and not real_time" -n 3 --dist loadfile --no-loadscope-reorder --durations=20; \
	rest=$$?; \
	$(BIN)/pytest -m "real_time and not study" -n $(REAL_TIME_WORKERS) --dist loadfile --no-loadscope-reorder --durations=20 && exit $$rest

test-studies: .venv/.ready-dev
	$(MEASURE_STUDIES)

.venv/.ready-panel-test: .venv/.ready-dev
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[panel,panel-test]'
	touch $@

panel-test: .venv/.ready-panel-test
	$(BIN)/python -m studies.pictures.chromium
	$(BIN)/pytest -n 0 tests/panel

shake: .venv/.ready-dev
	$(BIN)/python -m tests.shake; shaken=$$?; $(MEASURE_STUDIES) && exit $$shaken

bench: .venv/.ready-dev
	$(BIN)/python -m studies.speed.timing
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.speed.demo
	$(BIN)/python -m studies.speed.planning
	$(BIN)/python -m studies.source.facts_by_parameter
	$(BIN)/python -m studies.source.impulse_choices
	$(BIN)/python -m studies.source.shift_choices
	$(BIN)/python -m studies.source.shift_by_shape
	$(BIN)/python -m studies.coding.two_samples
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.coding.profiles_read_back
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.coding.profiles_read_back 8 snr
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.coding.bands.drawn_presses
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.coding.bands.drawn_presses wider
	$(BIN)/python -m studies.coding.bands.model_error
	$(BIN)/python -m studies.coding.shapes_read_back
	$(BIN)/python -m studies.coding.curvature_read_back
	$(BIN)/python -m studies.coding.edge_place
	$(BIN)/python -m studies.coding.sheets_read_back
	$(BIN)/python -m studies.accuracy.random_poses
	$(BIN)/python -m studies.accuracy.sharp_sweep
	$(BIN)/python -m studies.accuracy.branches
	$(BIN)/python -m studies.accuracy.oracles
	$(BIN)/rig bench
	$(BIN)/python -m studies.speed.serve_latency
	$(BIN)/python -m studies.speed.looks
	$(BIN)/python -m studies.speed.panel_soak
	$(BIN)/python -m studies.speed.warm_contact
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.speed.many_presses
	$(BIN)/python -m studies.speed.commands
	$(BIN)/python -m studies.accuracy.strain_recovery
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.accuracy.another_finger
	OMP_NUM_THREADS=1 $(BIN)/python -m studies.verification.in_time
	$(BIN)/python -m studies.faults.kills --cables 60
	$(BIN)/python -m studies.faults.outcomes
	$(BIN)/python -m studies.faults.phases
	$(BIN)/python -m studies.accuracy.check_predictions

test test-studies shake mutants: export OMP_NUM_THREADS = 1  # of each worker
mutants: .venv/.ready-dev
	$(BIN)/python -m studies.mutants --fresh

release-check:
	$(PYTHON) -m studies.release_check

clean:
	rm -rf .venv .mutants runs study build dist docs/gallery
