PYTHON ?= python3
BIN := .venv/bin
export OMP_NUM_THREADS ?= 2

.PHONY: setup demo study test check bench clean

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
	$(BIN)/python bench/study.py study

check: .venv/.ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: check
	$(BIN)/pytest -n 2 --dist loadgroup

bench: .venv/.ready-dev
	$(BIN)/python bench/timing.py
	$(BIN)/python bench/facts.py
	$(BIN)/python bench/random_poses.py
	$(BIN)/python bench/sharp_sweep.py
	$(BIN)/python bench/branches.py
	$(BIN)/python bench/oracles.py
	$(BIN)/rig bench
	$(BIN)/python bench/serve_latency.py
	$(BIN)/python bench/warm_contact.py
	$(BIN)/python bench/recovery.py
	$(BIN)/python bench/kills.py
	$(BIN)/python bench/faults.py
	$(BIN)/python bench/check.py
	$(BIN)/python bench/coverage.py 100

clean:
	rm -rf .venv runs study build dist
