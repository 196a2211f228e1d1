# Two commands matter: `make demo` (set-up and the main job) and `make test` (set-up and tests).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# Modules stay compiled, whatever the machine says: a run starts hundreds of processes that would compile them again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup demo test test-fast check docs lock interop page-pictures worked-example bench paper-tables campaign clean

setup: $(VENV)/.ready  ## the environment in .venv, loops compiled; every target sets it up as far as it needs it
	@$(BIN)/python tools/compile_loops.py

$(VENV)/.ready: pyproject.toml deploy/constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint deploy/constraints.txt --editable '.[test]'
	touch $@

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "%-16s %s\n", $$1, $$2}' Makefile
	@echo
	@$(PYTHON) tools/long_runs.py

demo: setup  ## a flight of the simulator, identified: the main job in one command
	$(BIN)/gcs demo

check: setup  ## lint, format, types and dead code
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/vulture

# In the order of the folders: those with few tests, whole flows, take longest and so come first.
# Three workers on two cores: flights watched live wait for their own seconds, not for a processor.
test: check  ## everything but what `make interop` tests (12 min)
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

test-fast: check  ## without whole flights and services, between two changes (a minute and a half)
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not whole_flight"

$(VENV)/.docs: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint deploy/constraints.txt --editable '.[docs]'
	touch $@

lock:  ## what the image runs, locked by version and hash, and its parts with their licences; when dependencies change
	$(PYTHON) -m venv .lock
	.lock/bin/python -m pip install --quiet --disable-pip-version-check uv cyclonedx-bom
	.lock/bin/uv pip compile --quiet --extra fleet --generate-hashes --no-header --no-annotate --python-version 3.11 --python-platform linux --constraint deploy/constraints.txt --output-file deploy/requirements.lock pyproject.toml deploy/requirements.in
	$(PYTHON) -m venv .lock/runs
	.lock/runs/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement deploy/requirements.lock
	.lock/bin/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible --output-format JSON --output-file deploy/sbom.cdx.json .lock/runs/bin/python
	rm -r .lock

docs: $(VENV)/.docs  ## the documentation as a site in site/, every link checked, nothing fetched from outside when it is read
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

$(VENV)/.interop: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint deploy/constraints.txt --editable '.[interop]'
	# MAVProxy's terminal needs none of what its maps and windows depend on (vtk, opencv: 200 MB).
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint deploy/constraints.txt --no-deps MAVProxy
	touch $@

interop: $(VENV)/.interop $(VENV)/.docs  ## browser, MAVProxy and readers that are not ours
	@(command -v chromium && command -v firefox-esr) >/dev/null || (apt-get update -q -o Acquire::Retries=5 && apt-get install -q -y --no-install-recommends chromium firefox-esr)
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder tests/interop

page-pictures: $(VENV)/.interop  ## the pictures of docs/howto/page.md, made anew by the browser tests
	PAGE_PICTURES=docs/images $(BIN)/python -m pytest tests/interop/test_page.py tests/interop/test_signal_page.py tests/interop/test_aircraft_page.py

$(VENV)/.bench: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint deploy/constraints.txt --editable '.[bench]'
	touch $@

worked-example: setup  ## the example of docs/howto/missing-effect.md: its commands run, its pictures made anew (20 s, the first time a minute)
	$(BIN)/python tools/worked_example.py

bench: $(VENV)/.bench  ## the benchmarks of speed against other libraries; make bench-peers runs one by its name
	$(BIN)/python benchmarks/framing.py
	$(BIN)/python benchmarks/recording.py
	$(BIN)/python benchmarks/udp.py
	$(BIN)/python benchmarks/regression.py
	$(BIN)/python benchmarks/simulation.py

# One benchmark, as bench-peers: tools/long_runs.py has the table. `+`: under make -n it shows what it would run.
bench-%: setup
	@+$(PYTHON) tools/long_runs.py --venv $(VENV) bench $*

paper-tables: setup  ## Tables III and IV of the paper over 100 flights; SEEDS=400 for more; what is there is kept
	$(BIN)/python benchmarks/paper_tables.py --keep campaign-output/paper-tables $(if $(SEEDS),--seeds $(SEEDS))

# Under WSL the environment has a NAME, that of the computer: the command line's alone counts.
CAMPAIGN := $(if $(filter-out environment,$(origin NAME)),$(NAME))

# Without a name they are listed. Options are variables: make campaign NAME=discrepancy PART=off-list SEEDS=1
campaign: $(if $(CAMPAIGN),setup)  ## accuracy over many flights, minutes to hours: make campaign NAME=field; without NAME a list
	@+$(PYTHON) tools/long_runs.py --venv $(VENV) campaign $(CAMPAIGN)

# The same by another spelling, as campaign-field.
campaign-%:
	@+$(MAKE) --no-print-directory campaign NAME=$*

clean:  ## what the other targets made is removed
	rm -rf $(VENV) build dist site *.egg-info demo-output campaign-output
