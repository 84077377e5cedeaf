# make setup | demo | test | lint | bench
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
TORCH ?= torch==2.13.0
PACKAGES := power_daq power_estimator power_lab sim_bridge policy_runner
STAMP := $(VENV)/.installed
WORKERS ?= 2

.PHONY: setup demo test lint bench clean
setup: $(STAMP)

$(STAMP): requirements.txt requirements-dev.txt $(PACKAGES:%=src/%/setup.py) embedded/pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q 'setuptools==79.0.1' wheel
	$(BIN)/pip install -q '$(TORCH)'
	$(BIN)/pip install -q -r requirements.txt -r requirements-dev.txt
	$(BIN)/pip install -q --no-build-isolation --no-deps $(PACKAGES:%=-e src/%) -e embedded
	touch $@

demo: setup
	$(BIN)/python demo.py

test: setup
	$(BIN)/python -m pytest -n $(WORKERS) -q

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	for package in $(PACKAGES); do $(BIN)/mypy src/$$package/$$package || exit 1; done
	$(BIN)/mypy embedded/rclpy

bench: setup
	$(BIN)/python bench/run.py

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache runs
