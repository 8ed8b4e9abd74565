PYTHON ?= python3
BIN := .venv/bin
export OMP_NUM_THREADS ?= 2
BY_FILE := --dist loadfile --no-loadscope-reorder
# As many as there are cores: tests compute, and each worker spends seconds on collecting them.
WORKERS ?= -n auto --maxprocesses 4 $(BY_FILE)
REAL_TIME_WORKERS ?= 10
# yes: the versions in requirements/, by their hashes; no: the newest that pyproject.toml allows
LOCKED ?= yes
# yes: make lock moves every package to its newest version
NEWEST ?= no
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check

.PHONY: setup demo docs test suite compiled-tests test-portable test-studies panel-test shake check lint types check-platforms bench mutants release-check clean lock check-wheels licenses clients

setup: .venv/.ready

LOCK = setup
EXTRAS =
ifeq ($(LOCKED),no)
install = $(PIP) install -e '.$(EXTRAS)'
else
install = $(PIP) install --require-hashes -r requirements/$(LOCK).txt \
	&& $(PIP) install --no-deps --no-build-isolation -e . \
	|| { echo "make: pip refused requirements/$(LOCK).txt for the reason above; see docs/releasing.md" >&2; exit 1; }
endif
.venv/.ready: LOCK = setup
.venv/.ready: EXTRAS =
.venv/.ready-dev: LOCK = dev
.venv/.ready-dev: EXTRAS = [dev]
.venv/.ready-panel-test: LOCK = panel-test
.venv/.ready-panel-test: EXTRAS = [panel-test]

.venv/.ready: pyproject.toml requirements/setup.txt
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, this is " + sys.version.split()[0]) if sys.version_info < (3, 11) else 0'
	$(PYTHON) -m venv .venv
	$(install)
	touch $@

.venv/.ready-dev: .venv/.ready requirements/dev.txt
	$(install)
	touch $@

# Makers' clients that do not fit beside the other packages; each has an environment of its own.
CLIENTS ?= .clients
clients: $(patsubst requirements/clients/%.txt,$(CLIENTS)/%/.ready,$(wildcard requirements/clients/*.txt))

$(CLIENTS)/%/.ready: requirements/clients/%.txt
	$(PYTHON) -m venv $(@D)
	$(@D)/bin/python -m pip --quiet --disable-pip-version-check install --require-hashes -r $<
	touch $@

demo: setup
	$(BIN)/rig dry-run protocols/steps.py --set step=1 force_gwt=2.33

docs: .venv/.ready-dev
	$(BIN)/python -m sphinx -E -W --keep-going -q -b html docs build/site

check: lint types

lint: .venv/.ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: .venv/.ready-dev
	$(BIN)/mypy
	$(BIN)/lint-imports

# Types alone, as on the systems that this machine is not.
check-platforms: .venv/.ready-dev
	$(BIN)/mypy --platform win32
	$(BIN)/mypy --platform darwin

# What waits for the real world runs alone at the end, in more workers than there are cores. Both parts always run.
RUN_SUITE = $(BIN)/pytest -m "not study and not real_time" $(WORKERS) --durations=20; \
	rest=$$?; \
	$(BIN)/pytest -m "real_time and not study" -n $(REAL_TIME_WORKERS) $(BY_FILE) --durations=20 && exit $$rest

# Types are checked beside the suite, whose beginning and end leave a core idle. Tests are compiled once, not by each worker.
test: lint
	$(MAKE) --no-print-directory -j2 types suite

suite: compiled-tests
	$(RUN_SUITE)

compiled-tests: .venv/.ready-dev
	@$(BIN)/pytest --collect-only -qq -m "not study" >/dev/null || true  # the suite says what is wrong

# POSIX-only modules and attributes are hidden from the product (tests/portable); a few tests cannot (cannot.py there).
test-portable: export PYTHONPATH = $(CURDIR)/tests/portable
test-portable: .venv/.ready-dev
	$(RUN_SUITE)

MEASURE_STUDIES = $(BIN)/pytest -m study $(WORKERS) --durations=20

test-studies: .venv/.ready-dev
	$(MEASURE_STUDIES)

.venv/.ready-panel-test: .venv/.ready-dev requirements/panel-test.txt
	$(install)
	touch $@

panel-test: .venv/.ready-panel-test
	$(BIN)/python -m studies.pictures.chromium
	$(BIN)/pytest -n 0 tests/panel

shake: .venv/.ready-dev
	$(BIN)/python -m tests.shake; shaken=$$?; $(MEASURE_STUDIES) && exit $$shaken

bench: .venv/.ready-dev
	$(BIN)/python -m studies run --set bench

docs test suite test-portable test-studies shake mutants: export OMP_NUM_THREADS = 1  # of each worker
# Where nothing compiled is written, every worker and every program that a test starts compiles all it imports.
test suite test-portable test-studies shake: export PYTHONDONTWRITEBYTECODE =
mutants: .venv/.ready-dev
	$(BIN)/python -m studies.mutants --fresh

lock:
	$(PYTHON) -m studies.supply.lock $(if $(filter yes,$(NEWEST)),--newest)

licenses: .venv/.ready-panel-test
	$(BIN)/python -m studies.supply.licenses

check-wheels: .venv/.ready-dev
	CHECK_WHEELS=yes $(BIN)/pytest -n 0 tests/test_supply_chain.py

release-check:
	$(PYTHON) -m studies.release_check

clean:
	rm -rf .venv .mutants runs study build dist docs/gallery *.egg-info
