# make setup | demo | demo QUICK=1 | test | test-fast | coverage | test-ros | lint | docs | wheels | bench | bench QUICK=1 | bench-lab | bench-real
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
TORCH ?= torch==2.13.0
PACKAGES := wattwalk_core power_recordings power_daq power_calibration sound_levels power_estimator \
	policy_runner drive_bench sim_bridge power_lab power_workbench power_fleet policy_training \
	wattwalk_bringup
STAMP := $(VENV)/.installed
ROS := .ros
ROS_VENV ?= $(ROS)/venv
ROS_STAMP := $(ROS_VENV)/.installed
ROS_BUILD := $(abspath $(ROS))
# On two cores a third fills the time in which live tests wait.
WORKERS ?= 3

.PHONY: setup demo test test-fast coverage build-ros test-ros lint docs wheels bench bench-lab bench-real clean
setup: $(STAMP)

$(STAMP): requirements.txt requirements-dev.txt requirements-docs.txt $(PACKAGES:%=src/%/setup.cfg) embedded/pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q 'setuptools==79.0.1' wheel
	$(BIN)/pip install -q '$(TORCH)'
	$(BIN)/pip install -q -r requirements.txt -r requirements-dev.txt -r requirements-docs.txt
	$(BIN)/pip install -q --no-build-isolation --no-deps $(PACKAGES:%=-e src/%) -e embedded
	touch $@

demo: setup
	$(BIN)/python demo.py $(if $(QUICK),--quick)

# Live tests may miss a deadline beside others on two cores: what fails runs once more, alone.
AGAIN := --last-failed --last-failed-no-failures none -m 'not alone'

# With ROS 2 sourced the tests run on its rclpy, else on the embedded one.
ifdef ROS_DISTRO
test: test-ros
else
test: setup
	code=0; $(BIN)/python -m pytest -n $(WORKERS) --dist loadgroup -q -m 'not alone' || \
	$(BIN)/python -m pytest -q $(AGAIN) || code=$$?; \
	$(BIN)/python -m pytest -q -m alone tests || code=$$?; exit $$code
endif

# While working: under two minutes on two cores.
test-fast: setup
	$(BIN)/python -m pytest -n $(WORKERS) -q --fast

# Lines that test-fast runs: 70 % when it was made, and a little less is the floor.
coverage: setup
	$(BIN)/python -m pytest -n $(WORKERS) -q --fast --cov=src --cov=embedded --cov-fail-under=68

# The Python that colcon runs with is the one that `ros2 run` will start nodes with.
$(ROS_STAMP): requirements.txt requirements-dev.txt
	$(PYTHON) -m venv --system-site-packages $(ROS_VENV)
	$(ROS_VENV)/bin/pip install -q 'setuptools==79.0.1' '$(TORCH)'
	$(ROS_VENV)/bin/pip install -q -r requirements.txt -r requirements-dev.txt
	$(ROS_VENV)/bin/pip install -q colcon-core==0.21.3 colcon-common-extensions==0.3.0 \
		catkin_pkg==1.1.1 empy==3.3.4 lark==1.3.1
	touch $@

build-ros: $(ROS_STAMP)
	@test "$$ROS_DISTRO" = jazzy || { echo 'source ROS 2 Jazzy first, such as /opt/ros/jazzy/setup.bash' >&2; exit 2; }
	. $(ROS_VENV)/bin/activate && python -m colcon --log-base $(ROS_BUILD)/log build --symlink-install \
		--merge-install --base-paths src --build-base $(ROS_BUILD)/build --install-base $(ROS_BUILD)/install
	printf '. %s\n' $(abspath $(ROS_VENV))/bin/activate $(ROS_BUILD)/install/setup.sh > $(ROS)/setup.sh

test-ros: build-ros
	. $(ROS)/setup.sh || exit; \
	code=0; python -m pytest -n $(WORKERS) --dist loadgroup -q -m 'not alone' || \
	python -m pytest -q $(AGAIN) || code=$$?; \
	python -m pytest -q -m alone tests || code=$$?; exit $$code

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m pytest -q tests/test_words_in_docs.py
# mypy does not follow editable installs: without the path, other packages are Any. The folder
# launch/ of the bring-up would hide ROS 2's package of that name.
	export MYPYPATH=$$(echo $(filter-out src/wattwalk_bringup,$(wildcard src/*)) | tr ' ' :); \
	for package in $(PACKAGES); do $(BIN)/mypy -p $$package || exit 1; done
	$(BIN)/mypy embedded/rclpy

# sdists, and the wheels that they make, of the distribution `wattwalk` and its packages.
# From a copy: building in the checkout changes the metadata of its editable installations.
wheels: setup
	rm -rf build/source && git archive --prefix build/source/ HEAD | tar x
	for source in . embedded $(PACKAGES:%=src/%); do \
		$(BIN)/python -m build --no-isolation --outdir build/wheels build/source/$$source || exit; done

docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

# Some of them: BENCHES=speed. QUICK=1: 30 s of acquisition, not 10 min, and a log of 100 MB, not 1 GB.
BENCHES ?= commands_start speed real_runtime estimator policies acquisition
bench: setup
	code=0; for name in $(BENCHES); do echo; echo "── $$name"; \
	case "$${name}$(QUICK)" in speed) how='--mb 1000';; acquisition1) how='--seconds 30';; *) how=;; esac; \
	$(BIN)/python bench/$$name.py $$how || { echo "failed: $$name" >&2; code=1; }; done; exit $$code

bench-lab: setup
	$(BIN)/python bench/reliability.py --sources plants robot logs blind

# Logs of real drives, where WATTWALK_REAL_DATA says that they lie: the library, and its page of results.
bench-real: setup
	$(BIN)/python bench/make_drives.py
	$(BIN)/python bench/real_drives.py

clean:
	rm -rf $(VENV) $(ROS) .pytest_cache .mypy_cache .ruff_cache runs
