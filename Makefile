# make demo: set up and run the demo study.   make test: set up and run the tests.   make benchmark: the study behind the
# figures of the documentation.   Needs python3 (>= 3.11) and make.
PYTHON ?= python3
CORES ?= 2
BIN := .venv/bin
ONE_THREAD := OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1
READY := .venv/.gelforge-ready
# Compiled modules are kept: a process that compiles what it imports takes seconds longer to start.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup demo benchmark test test-thorough speed notebooks generated format lint types

setup: $(READY)

# The stamp is written last: an interrupted set-up starts again, a finished one does nothing. Of what is installed little is
# ever imported, so it is not compiled here: Python compiles a module when it is first imported.
$(READY): requirements.lock pyproject.toml setup.py
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "gelforge needs Python 3.11 or newer, found " + sys.version.split()[0])'
	@$(PYTHON) -m venv .venv || { echo "python3 -m venv failed; on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	$(BIN)/python -m pip install --quiet --no-compile --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	$(BIN)/python -m gelforge warm-up
	@touch $@

demo benchmark: $(READY)
	$(BIN)/python -m gelforge unlock
	$(BIN)/python -m snakemake --cores $(CORES) --rerun-incomplete --configfile config/$(if $(filter demo,$@),config,$@).yaml
	@echo "Open results/$@/report.html"

test: $(READY)
	$(ONE_THREAD) $(BIN)/python -m pytest --numprocesses $(CORES) --dist loadfile --no-loadscope-reorder

# The slow ones too, as before a release: an hour on two cores.
test-thorough: $(READY)
	$(ONE_THREAD) $(BIN)/python -m pytest --numprocesses $(CORES) --dist loadfile --no-loadscope-reorder --thorough

# What a site, its sensitivities, studies and memory cost, next to a state before: make speed BEFORE=TAG; then other codes
# where they are installed, and cost against unknowns and presses.
speed: $(READY)
	$(BIN)/python benchmarks/speed.py $(if $(BEFORE),--before $(BEFORE))
	$(BIN)/python benchmarks/where_time_goes.py
	$(BIN)/python benchmarks/against_peers.py --size 0.45 --limit 600
	$(BIN)/python benchmarks/cost_plot.py

# The gallery of the site: each notebook is executed and its page written; some ten minutes.
notebooks: $(READY)
	$(BIN)/python -m pip install --quiet --constraint requirements.lock jupytext nbclient ipykernel
	$(BIN)/python docs/notebooks/render.py

# What is written from the code: the configuration's schema, and the pages of reference.
generated: $(READY)
	$(BIN)/python -c 'import json; from gelforge.config import schema; print(json.dumps(schema(), indent=2))' > config/schema.json
	$(BIN)/python docs/models_table.py
	$(BIN)/python docs/mapping_table.py
	$(BIN)/python docs/effects_table.py
	$(BIN)/python -m validation trust
	$(BIN)/python docs/reference.py

format: $(READY)
	$(BIN)/ruff format . && $(BIN)/ruff check --fix . && $(BIN)/snakefmt Snakefile workflow

lint: types
	$(BIN)/ruff format --check . && $(BIN)/ruff check . && $(BIN)/snakefmt --check Snakefile workflow

# A minute the first time; then what has changed.
types: $(READY)
	$(BIN)/mypy

