# Two commands matter: `make demo` (set-up and the main job) and `make test` (set-up and tests).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: setup demo test test-fast check docs lock interop page-pictures worked-example bench bench-identification bench-job bench-peers bench-discrepancy-peers bench-discrepancy-cost bench-regression bench-simulation bench-posterior bench-live paper-tables campaign campaign-equation-error campaign-bench campaign-fuzz campaign-load campaign-crash campaign-attack campaign-api campaign-faults campaign-soak campaign-recorder campaign-clock campaign-jsbsim campaign-jsbsim-effects campaign-bad-flights campaign-mistakes campaign-discrepancy campaign-design campaign-live campaign-live-field campaign-live-failures campaign-page campaign-fleet campaign-field clean

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test]'
	touch $@

demo: setup
	$(BIN)/gcs demo

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# In the order of the folders: those with few tests, whole flows, take longest and so come first.
# Three workers on two cores: flights watched live wait for their own seconds, not for a processor.
test: check
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

# Without whole flights and whole services: for the time between two changes. A minute and a half.
test-fast: check
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not whole_flight"

$(VENV)/.docs: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[docs]'
	touch $@

# What the image runs, locked by version and hash, and its parts with their licences. Made anew when dependencies change.
lock:
	$(PYTHON) -m venv .lock
	.lock/bin/python -m pip install --quiet --disable-pip-version-check uv cyclonedx-bom
	.lock/bin/uv pip compile --quiet --extra fleet --generate-hashes --no-header --no-annotate --python-version 3.11 --python-platform linux --constraint constraints.txt --output-file deploy/requirements.lock pyproject.toml deploy/requirements.in
	$(PYTHON) -m venv .lock/runs
	.lock/runs/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement deploy/requirements.lock
	.lock/bin/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible --output-format JSON --output-file deploy/sbom.cdx.json .lock/runs/bin/python
	rm -r .lock

# The documentation as a site in site/: every link checked, nothing fetched from outside when it is read.
docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

$(VENV)/.interop: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[interop]'
	# MAVProxy's terminal needs none of what its maps and windows depend on (vtk, opencv: 200 MB).
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --no-deps MAVProxy
	touch $@

interop: $(VENV)/.interop $(VENV)/.docs
	@(command -v chromium && command -v firefox-esr) >/dev/null || (apt-get update -q && apt-get install -q -y --no-install-recommends chromium firefox-esr)
	$(BIN)/python -m pytest tests/interop

# The pictures of docs/page.md, made anew by the browser tests.
page-pictures: $(VENV)/.interop
	PAGE_PICTURES=docs/images $(BIN)/python -m pytest tests/interop/test_page.py tests/interop/test_signal_page.py tests/interop/test_aircraft_page.py

$(VENV)/.bench: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[bench]'
	touch $@

# The example of docs/howto/missing-effect.md: its commands run as they stand there, its pictures made anew (20 s, a minute the first time).
worked-example: setup
	$(BIN)/python tools/worked_example.py

bench: $(VENV)/.bench
	$(BIN)/python benchmarks/framing.py
	$(BIN)/python benchmarks/recording.py
	$(BIN)/python benchmarks/udp.py
	$(BIN)/python benchmarks/regression.py
	$(BIN)/python benchmarks/simulation.py

bench-identification: $(VENV)/.bench
	$(BIN)/python benchmarks/output_error.py

bench-job: setup
	$(BIN)/python benchmarks/job.py

bench-peers: $(VENV)/.bench
	$(BIN)/python benchmarks/peers.py

# Eight hidden effects in calm air and in turbulence, a minute each; what is there is kept. For less: EFFECTS=stall SEEDS=1.
bench-discrepancy-peers: $(VENV)/.bench
	$(BIN)/python benchmarks/discrepancy_peers.py $(if $(EFFECTS),--effects $(EFFECTS)) $(if $(SEEDS),--seeds $(SEEDS))

bench-discrepancy-cost: setup
	$(BIN)/python benchmarks/discrepancy_cost.py

bench-posterior: setup
	$(BIN)/python benchmarks/posterior.py

bench-simulation: setup
	$(BIN)/python benchmarks/simulation.py

bench-regression: setup
	$(BIN)/python benchmarks/regression.py

# CPU and latency of live identification over a minute of flight: a minute and a half.
bench-live: setup
	$(BIN)/python benchmarks/live.py

# Tables III and IV of the paper over 100 flights; for more: make paper-tables SEEDS=400. What is there is kept.
paper-tables: setup
	$(BIN)/python benchmarks/paper_tables.py --keep campaign-output/paper-tables $(if $(SEEDS),--seeds $(SEEDS))

# How near to the bound identification comes: 400 flights of each scenario take hours; what is there is kept. For less:
# make campaign SEEDS=20 SCENARIOS=pulse,six-axis; METHOD=map asks the estimator for flights as the field gives them.
SCENARIOS ?= all

campaign: setup
	$(BIN)/python tests/campaign/identification.py $(if $(SEEDS),--seeds $(SEEDS)) --scenarios $(SCENARIOS) $(if $(METHOD),--method $(METHOD))

campaign-equation-error: setup
	$(BIN)/python tests/campaign/equation_error.py

campaign-fuzz: setup
	$(BIN)/python tests/campaign/fuzz.py

campaign-bench: setup
	$(BIN)/python tests/campaign/bench.py

campaign-load: setup
	$(BIN)/python tests/campaign/load.py

campaign-crash: setup
	$(BIN)/python tests/campaign/crash.py

# 10,000 calls of the REST interface take half an hour; FUZZ_SECONDS=60 a minute.
campaign-api: $(VENV)/.interop
	FUZZ_SECONDS=$(or $(FUZZ_SECONDS),1800) $(BIN)/python -m pytest -s --timeout=3600 tests/interop/test_api_fuzz.py

campaign-attack: setup
	$(BIN)/python tests/campaign/attack.py

campaign-faults: setup
	$(BIN)/python tests/campaign/faults.py

# Two hours; --minutes for less.
campaign-soak: setup
	$(BIN)/python tests/campaign/soak.py

campaign-design: setup
	$(BIN)/python tests/campaign/design.py

campaign-jsbsim: setup
	$(BIN)/python tests/campaign/other_engine.py

# Hidden effects that JSBSim flies: a quarter of a minute each. make campaign-jsbsim-effects EFFECTS=stall,mass_error SEEDS=3
# SIZES=1,0.5: of half their sizes too. AIRCRAFT=1,2,3: other aircraft. UNLISTED=1: each effect taken out of the catalogue. FAMILIES=mild,typical: behind the servos, sensors and link of field flights, in gusts; EFFECTS=none: nothing is hidden.
campaign-jsbsim-effects: setup
	$(BIN)/python tests/campaign/effects_in_jsbsim.py --effects $(or $(EFFECTS),all) --sizes $(or $(SIZES),1) --seeds $(or $(SEEDS),1) --families $(or $(FAMILIES),textbook) --aircraft $(or $(AIRCRAFT),0) $(if $(UNLISTED),--unlisted)

campaign-bad-flights: setup
	$(BIN)/python tests/campaign/bad_flights.py

campaign-clock: setup
	$(BIN)/python tests/campaign/clock.py

campaign-recorder: setup
	$(BIN)/python tests/campaign/full_disk.py

campaign-mistakes: setup
	$(BIN)/python tests/campaign/mistakes.py

# Hidden effects over many flights: half a minute a case and worker, hundreds of cases; what is there is kept. For less:
# make campaign-discrepancy SEEDS=1 SIZES=1 EFFECTS=stall,vane_lag. FULL=1 flies 20 seeds of 3 sizes. PART=none: nothing hidden.
campaign-discrepancy: setup
	$(BIN)/python tests/campaign/discrepancy.py --seeds $(or $(SEEDS),$(if $(FULL),20,5)) \
	  --sizes $(or $(SIZES),$(if $(FULL),3,2)) --effects $(or $(EFFECTS),all) --part $(or $(PART),single) \
	  $(if $(MINUTES),--minutes $(MINUTES)) $(if $(WORKERS),--workers $(WORKERS))

# Live identification over many flights: about 20 s each and worker; what is there is kept. POST=1 compares with post-flight.
campaign-live: setup
	$(BIN)/python tests/campaign/live.py $(if $(SEEDS),--seeds $(SEEDS)) $(if $(WORKERS),--workers $(WORKERS)) $(if $(POST),--post)

# Aircraft and sensors that fail in flight, and flights in which nothing does: 4 s each, 136 with SEEDS=1.
# BOARD=1: servos that lag and commands stamped late, LIGHT=1: inputs half as large, JSBSIM=1: another engine behind
# sensors of the field.
campaign-live-failures: setup
	$(BIN)/python tests/campaign/live_failures.py $(if $(SEEDS),--seeds $(SEEDS)) $(if $(WORKERS),--workers $(WORKERS)) \
		$(if $(BOARD),--board) $(if $(LIGHT),--light) $(if $(JSBSIM),--jsbsim)

# Batches of flights on a Dask cluster; make campaign-fleet FLIGHTS=40, with NAMESPACES=1 (root) as on other machines
campaign-fleet: setup
	$(BIN)/python tests/campaign/fleet.py --flights $(or $(FLIGHTS),200) $(if $(NAMESPACES),--namespaces)

# An hour of the live page in a browser; make campaign-page MINUTES=6
campaign-page: $(VENV)/.interop
	$(BIN)/python tests/campaign/page_hour.py --minutes $(or $(MINUTES),60)

# Live estimates behind the sensors of the field: half a minute a flight. make campaign-live-field FAMILIES=mild SEEDS=2
campaign-live-field: setup
	$(BIN)/python tests/campaign/live_field.py $(if $(FAMILIES),--families $(FAMILIES)) $(if $(SEEDS),--seeds $(SEEDS))

comma := ,

# Flights as the field has them, identified: 120 flights; what is there is kept. SHORT=1 flies 14. For less:
# make campaign-field FAMILIES=typical,rough SEEDS=2 METHODS=auto,ls. STEPS=1: textbook flights, one imperfection at a time.
# RATES=1: aircraft that come with JSBSim, textbook sensors and measured surfaces at 20, 50 and 100 Hz.
campaign-field: setup
	$(BIN)/python tests/campaign/field.py --methods $(if $(METHODS),$(METHODS),auto$(comma)ls) --families $(or $(FAMILIES),all) \
	  $(if $(SEEDS),--seeds $(SEEDS)) $(if $(SHORT),--short) $(if $(STEPS),--steps) $(if $(RATES),--rates)

clean:
	rm -rf $(VENV) build dist site *.egg-info demo-output campaign-output
