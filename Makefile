# `make demo` and `make test` do all their set-up themselves on Debian and Ubuntu.
PYTHON ?= python3
BIN := .venv/bin
PYTEST := $(BIN)/python -m pytest
PYTEST_FLAGS ?=
JOBS ?= 2
# For tests that train policies and the person detector. PyPI has a build for x86-64 Linux with CUDA alone, of several GB: pip's settings or TORCH can name a smaller one.
TORCH ?= torch==2.13.0
# The versions with which the tests ran; CONSTRAINTS= installs the newest.
CONSTRAINTS ?= -c .ci/constraints.txt
PIP := $(BIN)/pip install -q --disable-pip-version-check
GL_CHECK := $(BIN)/python -c 'import sys, sim.rendering.gl_context; sys.tracebacklimit = 0; sim.rendering.gl_context.choose_gl()'

# Where Python may not keep bytecode, every start compiles all modules again: a fifth of a short command.
unexport PYTHONDONTWRITEBYTECODE

# Tests by what they need, as pyproject.toml names them: none of these markers are the unit tests.
NEEDS := command or render or data

.PHONY: demo test integration soak bench lint gl system rl constraints clean help

help:
	@echo "make demo         simulate, track, score and draw; pictures in runs/demo"
	@echo "make test         unit tests: no process, renderer or real data; under 5 minutes on 2 cores"
	@echo "make integration  tests of commands, rendering and real data"
	@echo "make soak         kills, mounts, clusters, long fuzz, statistics; SHARD=0/6 runs a sixth"
	@echo "make rl           torch, stable-baselines3, onnx: without them tests of learning are skipped"
	@echo "make bench        speed, beside other programs that do the same"
	@echo "make lint         ruff and mypy"

demo: .venv/installed gl
	$(BIN)/pilsim demo

test: .venv/installed-test
	$(PYTEST) $(PYTEST_FLAGS) -n $(JOBS) --dist worksteal -m "not ($(NEEDS) or soak)"

integration: .venv/installed-test system gl
	$(PYTEST) $(PYTEST_FLAGS) -n $(JOBS) --dist worksteal -m "($(NEEDS)) and not soak"

soak: .venv/installed-test system gl
	$(PYTEST) $(PYTEST_FLAGS) -n $(JOBS) --dist worksteal -m soak $(if $(SHARD),--shard $(SHARD))

# Peers of the benchmarks, without what they would drag in (jupedsim: PySide6 and VTK).
bench: .venv/installed-test gl
	$(PIP) --no-deps jupedsim pysocialforce py360convert shapely deprecated wrapt toml
	$(PIP) networkx ortools imageio gtsam
	$(BIN)/python -m tests.benchmarks

lint: .venv/installed-test
	$(BIN)/ruff check .
	$(BIN)/mypy

.venv/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "pilsim needs Python 3.11 or newer: make PYTHON=python3.12 …"; exit 1; }
	@$(PYTHON) -m venv .venv 2>/dev/null || { \
		rm -rf .venv; \
		if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
			apt-get update -q && apt-get install -q -y python3-venv && $(PYTHON) -m venv .venv; \
		else echo "this Python has no venv: install python3-venv (sudo apt-get install python3-venv)"; exit 1; fi; }

.venv/installed: pyproject.toml | .venv/bin/python
	$(PIP) $(CONSTRAINTS) -e .
	@touch $@

# motmetrics and trackeval are oracles for our scores (they need pandas and xmltodict); without --no-deps they drag a second OpenCV in.
# RecordVideo of gymnasium needs moviepy 2, which asks for an older Pillow.
.venv/installed-test: .venv/installed pyproject.toml
	$(PIP) $(CONSTRAINTS) -e '.[test]'
	$(PIP) $(CONSTRAINTS) --no-deps motmetrics trackeval moviepy imageio imageio-ffmpeg proglog python-dotenv decorator
	@touch $@

rl: .venv/installed-rl

# torch first: else stable-baselines3 would take the newest.
.venv/installed-rl: .venv/installed-test
	$(PIP) $(TORCH)
	$(PIP) $(CONSTRAINTS) -e '.[rl,train]'
	@touch $@

# EGL, OSMesa and Chromium: installed by root, named to others.
system: .venv/installed
	@.ci/system-packages

gl: .venv/installed
	@$(GL_CHECK) 2>/dev/null || { \
		if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
			apt-get update -q && { apt-get install -q -y libegl1 libgl1-mesa-dri || apt-get install -q -y libosmesa6; }; \
		fi; }
	@$(GL_CHECK)

# After a run of all tests with the newest versions (make CONSTRAINTS= …): keep those.
constraints: .venv/installed-rl
	{ head -1 .ci/constraints.txt; $(BIN)/pip freeze --exclude-editable | grep -v -i '^torch'; } > .ci/constraints.new
	mv .ci/constraints.new .ci/constraints.txt

clean:
	rm -rf .venv build runs *.egg-info .mypy_cache .ruff_cache .pytest_cache
