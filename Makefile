# Two commands do everything on a fresh machine: 'make demo' and 'make test'.
PYTHON ?= python3.11
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed

.PHONY: help install demo test check bench fuzz soak soak-kill deb sandboxed-demo fixtures models format lock clean

help:  ## show the commands
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

install: $(STAMP)  ## make .venv with the locked dependencies and irsd in it

$(STAMP): requirements.lock pyproject.toml
	@command -v $(PYTHON) >/dev/null || { echo "no $(PYTHON): apt-get install python3.11 python3.11-venv, or make PYTHON=python3.x"; exit 1; }
	@echo "[1/4] virtual environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV) || { echo "venv failed: apt-get install python3.11-venv"; exit 1; }
	@echo "[2/4] locked dependencies (about 350 MB to download the first time)"
	@$(BIN)/python -m pip install --disable-pip-version-check --no-deps -r requirements.lock
	@echo "[3/4] irsd itself"
	@$(BIN)/python -m pip install --disable-pip-version-check -q --no-deps --no-build-isolation -e .
	@echo "[4/4] compiling kernels, once (half a minute)"
	@$(BIN)/python -m irsd.warm
	@touch $@

demo: install  ## the main job on the embedded world: explore, build the graph, drive to the TV
	$(BIN)/irsctl demo --out demo

test: install  ## all tests
	$(BIN)/python -m pytest

check: install  ## formatting, lint, types, architecture
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m pytest tests/test_architecture.py

fuzz: install  ## hostile input for every decoder and question, SECONDS (600) each
	$(BIN)/python tests/fuzz/run.py $(or $(SECONDS),600)

soak-kill: install  ## kill -9 of irsd at KILLS (200) random instants during play, and what is left each time
	$(BIN)/python benchmarks/kill.py --kills $(or $(KILLS),200)

soak: install  ## MINUTES (20) of looped play at real time: slope of memory, files, threads, CPU
	$(BIN)/python benchmarks/soak.py --minutes $(or $(MINUTES),20)

deb: install  ## a Debian package with everything in it, for robots without a network
	PYTHON=$(PYTHON) sh systemd/build-deb.sh

sandboxed-demo: install  ## the demo under exactly the environment, limits and sandbox of irsd.service (as root)
	$(BIN)/python systemd/as_unit.py systemd/irsd.service --state build/sandbox --write demo -- $(BIN)/irsctl demo --out demo

bench: install  ## print the benchmark tables (needs the recordings; see benchmarks/)
	$(BIN)/python benchmarks/replay.py

fixtures: .venv-fixtures/.installed  ## make the contract tests' tiny models and reference results anew (torch, in its own environment)
	cd tests/contract && OMP_NUM_THREADS=1 ../../.venv-fixtures/bin/python make_fixtures.py $(FAMILIES)

.venv-fixtures/.installed: tests/contract/fixture_makers/requirements.txt tests/contract/fixture_makers/requirements-alone.txt
	$(PYTHON) -m venv .venv-fixtures
	.venv-fixtures/bin/python -m pip install --disable-pip-version-check -q -r $<
	.venv-fixtures/bin/python -m pip install --disable-pip-version-check -q --no-deps -r $(word 2,$^)
	@touch $@

models: .venv-models/.installed  ## train the shipped models anew: 1.5 hours of two cores; goes on where it was interrupted
	@ls /usr/share/sweethome3d/furniture/*.sh3f >/dev/null || { echo "no 3D models: apt-get install sweethome3d-furniture"; exit 1; }
	$(MAKE) -j2 -f training/models.mk
	.venv-models/bin/python -m training.evaluate

.venv-models/.installed: training/requirements.txt requirements.lock
	$(PYTHON) -m venv .venv-models
	.venv-models/bin/python -m pip install --disable-pip-version-check -q --no-deps -r requirements.lock
	.venv-models/bin/python -m pip install --disable-pip-version-check -q -r training/requirements.txt
	.venv-models/bin/python -m pip install --disable-pip-version-check -q --no-deps --no-build-isolation -e .
	@touch $@

format: install  ## apply the formatter
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lock:  ## resolve pyproject.toml anew into requirements.lock
	rm -rf $(VENV)/lock && $(PYTHON) -m venv $(VENV)/lock
	$(VENV)/lock/bin/python -m pip install -q ".[dev]" setuptools wheel
	(echo "# Exact versions of everything the product and its tests run with; made by 'make lock'."; \
	 $(VENV)/lock/bin/python -m pip freeze --all --exclude irsd --exclude pip) > requirements.lock
	rm -rf $(VENV)/lock

clean:  ## remove everything that was built
	rm -rf $(VENV) .venv-fixtures .venv-models build demo *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
