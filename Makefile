# make demo      set up .venv on first use, drive what the paper's figures show and an emergency, compare
# make test      what a change is to pass: all tests that need no DDS, a smoke test of the nodes
# make check     what the continuous integration runs: lint, site, tests, of pages those that changed
# make budget    lines, files and megabytes: are they within .ci/budget.txt?
# make nightly   2,000 fresh emergencies, exceptions in a tick, faults of processes, every page and build
# make paper     both experiments of the paper, driven and drawn, into paper/
# make study     both studies to their verdicts: from the rows that are kept, driving what is missing
# make setup     .venv with what driving needs; our packages run from their source: edits count at once
# make studies   what tuning, batches and studies need, too
# make bench     benchmarks as tables
# make realtime  ten thousand ticks on the wall clock, twice: 20 Hz without, with priority? (22 minutes)
# make faults    every fault of the fault suite; logs and bags into build/faults
# make soak      an hour of simulated time, ten minutes of the wall clock: does anything grow?
# make repeat    the tests over DDS ten times, until one fails (TIMES=50: so many times)
# make golden    the recordings that replay-check holds every change against
# make coverage  is every line of gates, ladder, watchdogs and braking run by its tests?
# make coverage_whole  how many lines of all packages are run by all tests? (half an hour)
# make notebooks  execute docs/notebooks and keep their output in them
# make docs      the documentation site, into build/docs/html: open index.html there
# make identify  the controller's tyre parameters from circular driving of the plant
# make wheels    a wheel of each package, into dist/
# make wheels_test  do these wheels, in an environment with nothing else, drive and compare?
# make version   write the newest version of CHANGELOG.md into every file that repeats it
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help demo test check budget docs notebooks coverage coverage_whole nightly paper study studies \
  bench realtime faults soak repeat golden identify lint setup side_by_side requirements wheels \
  wheels_test version clean

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# wheels, never `setup.py install`: the pip of Debian 12 would put the commands elsewhere
PIP := $(BIN)/pip --disable-pip-version-check --no-input
INSTALL := $(BIN)/python .ci/install.py
PACKAGES := msgs_yaml node_runtime stage_solver scenario_publisher state_estimator mpcc_controller vehicle_plant bags experiments
# what an installation reads of them; code and data run from their source
MANIFESTS := $(wildcard $(foreach name,setup.cfg setup.py package.xml scripts/* resource/*,\
  $(addsuffix /$(name),$(PACKAGES))))
# a sourced ROS installation and another virtual environment must not leak into this one
unexport PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE VIRTUAL_ENV PYTHONHOME
# every process of every test would compile again what it imports
unexport PYTHONDONTWRITEBYTECODE
export OPENBLAS_NUM_THREADS := 1
export MPLBACKEND := Agg

help:
	@sed -n 's/^# \(make .*\)/\1/p' Makefile

setup: $(VENV)/.packages

$(VENV)/.requirements: requirements.txt
	@$(PYTHON) -c 'import sys; sys.exit(0 if (3, 10) <= sys.version_info[:2] <= (3, 14) else \
	  "Python 3.10 to 3.14 is needed (the ROS 2 wheels exist for these); this is " \
	  + sys.version.split()[0] + ". Choose another with: make demo PYTHON=python3.12")'
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "Python's venv module is missing. On Debian and Ubuntu: apt install python3-venv"; exit 1; }
	@echo "[1/2] Creating $(VENV) and installing ROS 2 Jazzy, CasADi and the rest: once, over the network"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(INSTALL) -r requirements.txt
	@touch $@

# each holds what the one before does
$(VENV)/.studies: requirements-studies.txt $(VENV)/.requirements
$(VENV)/.tests: requirements-test.txt $(VENV)/.requirements
# what only the site needs; Sphinx reads the installed packages
$(VENV)/.docs: docs/requirements.txt $(VENV)/.studies
$(VENV)/.studies $(VENV)/.tests $(VENV)/.docs:
	@echo "Installing $<"
	@$(INSTALL) -r $<
	@touch $@

studies: setup $(VENV)/.studies

INDEX := $(VENV)/share/ament_index/resource_index/packages
# data and programs are links, where ROS looks for them.
# --no-build-isolation: setuptools is pinned in requirements.txt, nothing else may be fetched here.
# compat: paths in a .pth file, which come before the folders of the same names in the root
$(VENV)/.packages: $(VENV)/.requirements $(MANIFESTS)
	@echo "[2/2] Installing the packages into $(VENV)"
	@$(INSTALL) --no-deps --no-build-isolation --reinstall --config-settings editable_mode=compat \
	  $(foreach package,$(PACKAGES),--editable ./$(package))
	@rm -rf $(addsuffix /build,$(PACKAGES)) $(addsuffix /*.egg-info,$(PACKAGES))
	@for name in $(PACKAGES); do \
	  rm -rf $(VENV)/share/$$name $(VENV)/lib/$$name; mkdir -p $(VENV)/lib/$$name $(INDEX); \
	  ln -s $(CURDIR)/$$name $(VENV)/share/$$name; ln -sf $(CURDIR)/$$name/resource/$$name $(INDEX); \
	  for file in $$name/scripts/*; do \
	    test ! -e $$file || ln -s $(CURDIR)/$$file $(VENV)/lib/$$name; done; done
	@touch $@

# a warning is an error, and every one is shown: dead links, pages in no table of contents
docs: setup $(VENV)/.docs
	@echo 'Building the site (about 1.5 minutes, silent); meanwhile: docs/tutorials/01_first_run.md'
	$(BIN)/python -m sphinx --jobs auto --fail-on-warning --keep-going --quiet docs build/docs/html
	@echo "build/docs/html/index.html"

notebooks: setup $(VENV)/.docs
	test -d bags/runs/double_lane_change/frenet || $(BIN)/experiments run double_lane_change \
	  --controller mpcc --controller frenet
	$(BIN)/python docs/notebooks/execute.py

demo: setup
	@$(BIN)/experiments demo

# three workers for two cores: tests of nodes wait half of their time; loadscope keeps the tests of a
# module, which share what is costly, in one worker, in the order of tests/conftest.py
WORKERS ?= $(shell expr \( $$(nproc) \* 3 + 1 \) / 2)
PYTEST := $(BIN)/python -m pytest
PARALLEL = $(PYTEST) --numprocesses $(WORKERS) --maxprocesses 8 --dist loadscope \
  --no-loadscope-reorder --durations 20

# of the tests over Fast DDS a ring, nodes in one process, and a recording that is played and
# recorded again
test: setup $(VENV)/.tests
	$(PARALLEL) -m '(smoke or not (ros or slow or site or nightly)) and not alone'

lint: $(VENV)/.tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

budget:
	@$(PYTHON) .ci/budget.py

# the last lines of defence: every line and every branch of them is run by their own tests
SAFE := */gate.py,*/fallback.py,*/braking.py,*/last_resort.py,*/recovery.py,$\
  */stop_plan.py,*/parallel_solves.py,*/run_time_parameters.py,*/car_file.py,*/input_monitor.py,*/clocks.py,$\
  */watchdog.py,*/vehicle_plant/health.py,*/vehicle_plant/stepping.py
SAFE_TESTS := $(foreach name,gate fallback braking last_resort recovery stop_plan parallel_solves watchdog,$\
    tests/mpcc_controller/driving/test_$(name).py) \
  tests/mpcc_controller/test_run_time_parameters.py tests/mpcc_controller/model/test_car_file.py \
  $(foreach name,gate stepping,tests/vehicle_plant/test_$(name).py) \
  tests/node_runtime/test_input_monitor.py tests/node_runtime/test_clocks.py
COVER_SAFE := $(BIN)/python -m coverage run --branch --include='$(SAFE)' -m pytest -q $(SAFE_TESTS) && \
  $(BIN)/python -m coverage report --fail-under=100
coverage: setup $(VENV)/.tests
	$(COVER_SAFE)

# of all packages, nodes included; what a SIGKILL ends is not counted. Traced nodes are slow: a test
# on the wall clock may fail for that alone
coverage_whole: setup $(VENV)/.tests
	rm -rf build/coverage && mkdir -p build/coverage
	export COVERAGE_RCFILE=$(CURDIR)/tests/whole.coveragerc; failed=0; \
	  $(BIN)/python -m coverage run -m pytest -q || failed=1; \
	  $(BIN)/python -m coverage combine -q build/coverage; \
	  $(BIN)/python -m coverage report --fail-under=90 || failed=1; exit $$failed

# Every test in one of three parts: those of the safety modules, traced; those that must have the
# machine for themselves or look at the built site; all others. The site is built and the first part
# runs beside the last one, and each runs, whatever failed before it. Of the second part only the
# files are read that have such a test: to collect all takes as long as some of them. What failed in
# the other parts is named again at the end. Where nodes may not be given real-time priority, drives
# on the wall clock (`wall_clock`) are in it, too.
ALONE = $(shell grep -rlwE --include='test_*.py' 'mark\.alone|mark\.site|wall_clock' tests)
# Pages, notebooks, wheels, builds by colcon and what processes over DDS add to the nodes are tested
# where something that they read differs from this commit: the last one that was pulled or, on it, the
# one before; empty: always
CHANGED_SINCE ?= $(shell git merge-base HEAD @{upstream} 2>/dev/null | grep -v "$$(git rev-parse HEAD)" \
  || echo HEAD~1)
check: setup $(VENV)/.tests $(VENV)/.docs lint budget
	failed=0; mkdir -p build; \
	  $(MAKE_COMMAND) --keep-going --jobs 2 side_by_side docs coverage 2>&1 | tee build/check.log \
	    || failed=1; \
	  CHANGED_SINCE=$(CHANGED_SINCE) $(PYTEST) -m 'alone or site' --durations 10 $(ALONE) || failed=1; \
	  grep -E '^(FAILED|ERROR)|WARNING:|\*\*\*' build/check.log || true; \
	  exit $$failed

side_by_side: setup $(VENV)/.tests
	CHANGED_SINCE=$(CHANGED_SINCE) \
	  $(PARALLEL) -m 'not (alone or site or nightly)' \
	  $(addprefix --ignore=,$(SAFE_TESTS))

# with all pages, notebooks, wheels, builds and processes over DDS
nightly: setup $(VENV)/.tests
	failed=0; \
	  CHANGED_SINCE= $(PYTEST) -m 'nightly or reads' tests/faults tests/ros || failed=1; \
	  CHANGED_SINCE= $(PYTEST) -m 'reads and alone' tests/docs/test_pages.py || failed=1; \
	  CHANGED_SINCE= $(PARALLEL) -m '(nightly or reads) and not alone' \
	    --ignore=tests/faults --ignore=tests/ros || failed=1; \
	  exit $$failed

bench: setup $(VENV)/.tests
	$(BIN)/python stage_solver/benchmark.py
	$(BIN)/python bench/solver_comparison.py
	$(BIN)/python bench/plant.py
	$(BIN)/python bench/plant.py --node
	$(BIN)/python bench/recordings.py

realtime: setup $(VENV)/.tests
	failed=0; $(BIN)/python bench/realtime.py || failed=1; \
	  $(BIN)/python bench/realtime.py --fifo || failed=1; exit $$failed

faults: setup $(VENV)/.tests
	$(PYTEST) tests/faults --basetemp=build/faults -o tmp_path_retention_policy=all

soak: setup $(VENV)/.tests
	$(BIN)/python bench/soak.py
	$(BIN)/python bench/soak.py --mode realtime --minutes 10

TIMES ?= 10
repeat: setup $(VENV)/.tests
	for k in $$(seq $(TIMES)); do $(PYTEST) -q -m 'ros and not nightly' tests/ros tests/faults; done

paper: setup
	@$(BIN)/experiments paper

# a study that has ended is driven no more; STUDY=build/study drives all of it anew (hours)
STUDY ?= paper/study
study: studies
	@$(BIN)/experiments study recompute paper/settings
	@$(BIN)/experiments study run paper/study --out $(STUDY)
	@$(BIN)/experiments study decide $(STUDY)
	@$(BIN)/experiments study explain $(STUDY)

golden: setup
	@$(BIN)/experiments golden

identify: setup
	$(BIN)/identify --out mpcc_controller/config/car.yaml --figure docs/identified_tyres.png

wheels: $(VENV)/.requirements
	@rm -rf dist $(addsuffix /build,$(PACKAGES))
	@$(PIP) wheel --use-pep517 --quiet --no-deps --no-build-isolation --wheel-dir dist \
	  $(addprefix ./,$(PACKAGES))
	@rm -rf $(addsuffix /build,$(PACKAGES)) $(addsuffix /*.egg-info,$(PACKAGES))
	@ls dist/*.whl

# from a registry, as a user installs them; pip of its own, the one of an old Python may not do
FRESH := build/wheels_test
wheels_test: wheels
	rm -rf $(FRESH)
	$(PYTHON) -m venv $(FRESH)
	$(FRESH)/bin/pip --disable-pip-version-check --no-input install --quiet dist/*.whl 'node_runtime[ros]'
	cd $(FRESH) && bin/experiments run double_lane_change && bin/bags info bags/runs/double_lane_change/mpcc

version:
	@$(PYTHON) .ci/set_version.py

# universal resolution: one file for Python 3.10 to 3.14; that it is for Linux on x86-64 goes without
# saying. The largest first, with the versions of which the others have a part
RESOLVE := uv pip compile --universal --python-version 3.10 --no-emit-index-url --no-annotate \
  --no-header --quiet
requirements:
	$(RESOLVE) requirements-test.in -o requirements-test.txt
	rm -f requirements-studies.txt requirements.txt
	$(RESOLVE) -c requirements-test.txt requirements-studies.in -o requirements-studies.txt
	$(RESOLVE) -c requirements-test.txt requirements.in -o requirements.txt
	$(RESOLVE) docs/requirements.in -o docs/requirements.txt
	sed -i -E "s/ (;|and) platform_machine == 'x86_64' and sys_platform == 'linux'//" \
	  requirements*.txt docs/requirements.txt

clean:
	rm -rf $(VENV) build dist install log
