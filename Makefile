# make demo   an environment with the core packages, then the main job on an embedded, simulated session (out/demo)
# make test   an environment with everything, then lint, types and all tests
# make fuzz   damaged files put to every reader, guided by coverage: SECONDS each (60: more than an hour in all)
# A second call reuses the environment; a changed pyproject.toml or constraints.txt renews it.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CORE := $(VENV)/.installed-core
FULL := $(VENV)/.installed-all
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

# Tests in as many processes as there are cores, at most four: each takes some 2 GiB.
WORKERS := $(shell n=$$(nproc 2>/dev/null || echo 2); echo $$((n < 4 ? n : 4)))

.PHONY: demo test lint types unit fuzz format environment clean

demo: $(CORE)
	$(BIN)/jaxgeo demo --out out/demo

test: lint types unit

lint: $(FULL)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(FULL)
	$(BIN)/pyright

unit: $(FULL)
	$(BIN)/python -m pytest --numprocesses $(WORKERS)

SECONDS ?= 60

fuzz: $(FULL)
	$(PIP) --editable '.[fuzz]'
	$(BIN)/python -m benchmarks.fuzz --all --seconds $(SECONDS) --out out/fuzz

format: $(FULL)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

environment: $(FULL)

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "error: $(PYTHON) is older than Python 3.11; name another: make PYTHON=python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) \
	  || { echo "error: $(PYTHON) -m venv failed; on Debian and Ubuntu: apt-get install python3-venv" >&2; \
	       rm -rf $(VENV); exit 1; }

$(CORE): pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) --editable .
	@touch $@

# System libraries first: they fail fast, the packages take minutes.
$(FULL): pyproject.toml constraints.txt tools/system_libraries.sh | $(BIN)/python
	tools/system_libraries.sh $(BIN)/python
	$(PIP) --editable '.[all,test]'
	@touch $(CORE) $@

clean:
	rm -rf out build dist .pytest_cache .ruff_cache .hypothesis
