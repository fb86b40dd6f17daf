# ropefit: `make demo` shows what it does, `make test` proves it. Both install what they need.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
RUN    ?= run

.PHONY: demo test bounds check install schemas results exporters wheel audit docs batch clean
.DEFAULT_GOAL := demo

install: $(STAMP)

# Remade only when what is to be installed changes: a second make installs nothing.
$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "ropefit: Python 3.11 or newer is needed, $(PYTHON) is older; give another: make PYTHON=python3.11"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || \
	  { echo "ropefit: cannot make a virtual environment; install it: sudo apt-get install python3-venv"; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	$(BIN)/python -m ropefit.system --install
	$(BIN)/ropefit warm-up
	@touch $@

demo: $(STAMP)
	$(BIN)/ropefit run --run $(RUN)
	@echo "report: $(abspath $(RUN))/report.html"

test: $(STAMP)
	$(BIN)/python -m pytest -n 2

# Everything that calls compiled code, with index checks compiled in: a cache of its own, since
# the compiler's does not tell the two apart.
BOUNDED := test_kernel_bounds test_compiled test_start test_equilibrium_gradients test_dynamics_gradients \
  test_dynamics_contact test_equilibrium_planar test_equilibrium_robustness test_memory test_friction \
  test_contact_proposals test_diagnosis test_diagnosis_motion test_diagnose_stage
# Index checks change rounding; after 500 steps its differences are no longer good to 1e-6.
ROUNDED := tests/test_dynamics_gradients.py::test_adjoint_against_differences[500]
bounds: $(STAMP)
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(abspath build/bounds) \
	  $(BIN)/python -m pytest -n 2 $(BOUNDED:%=tests/%.py) --deselect '$(ROUNDED)'

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

# The JSON Schema of every artifact, from the pydantic models; every option, from the command line.
schemas: $(STAMP)
	$(BIN)/python -m ropefit.artifacts.export schemas
	$(BIN)/python -m benchmarks.robustness.commands --write docs/commands.md

# The tables of docs/results.md, docs/real.md and docs/robustness.md, and those of docs/paper.md that are not of its experiments.
results: $(STAMP)
	$(BIN)/python -m benchmarks.accuracy.recordings --write docs/paper.md
	$(BIN)/python -m benchmarks.accuracy.equilibrium --write docs/results.md
	$(BIN)/python -m benchmarks.robustness.stress --write docs/robustness.md
	$(BIN)/python -m benchmarks.felt --write docs/scale.md
	$(BIN)/python -m benchmarks.speed --write docs/results.md
	$(BIN)/python -m benchmarks.speed.devices --write docs/results.md
	$(BIN)/python -m benchmarks.accuracy.dynamics --write docs/results.md
	$(BIN)/python -m benchmarks.real --write docs/real.md
	$(BIN)/python -m benchmarks.perception --write docs/results.md

# An environment for each simulator under build/simulators, then how far exported ropes are off.
exporters: $(STAMP)
	$(BIN)/python -m benchmarks.accuracy.exporters --setup --write docs/results.md

# The wheel in an environment of its own; known vulnerabilities of the versions that are tested.
wheel: $(STAMP)
	$(BIN)/python -m benchmarks.robustness.wheel --write docs/dependencies.md

audit: $(STAMP)
	$(BIN)/python -m benchmarks.robustness.audit --write docs/dependencies.md

# The documents as a site in build/site; a broken link fails.
docs: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

include pipelines/batch.mk
include pipelines/paper.mk

clean:
	rm -rf $(VENV) $(RUN) .pytest_cache .ruff_cache .hypothesis
