# Every target sets up what it needs: a Python 3.11 (or later) and a C compiler are enough. The environment lives in .venv and is
# installed once; after that no target but `lock` needs a network.

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-all check safety audit fuzz lint types layers protos-check docs-check leftovers docs reference format protos lock clean distclean
SHELL := /bin/bash

# One thread for each numerical library: processes share the cores, and a spinning pool would steal them from the loop.
export OMP_NUM_THREADS := 1
export OMP_WAIT_POLICY := PASSIVE
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export NO_MKDOCS_2_WARNING := 1

PYTHON ?= $(shell for p in python3.11 python3 python3.12 python3.13; do \
	if $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then echo $$p; break; fi; done)
RUN := .venv/bin/python
INSTALLED := .venv/.installed
# One more than two cores: many tests wait for a robot in real time.
PYTEST_WORKERS ?= 3

help: ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-10s %s\n", $$1, $$2 }' Makefile

setup: $(INSTALLED) ## Create .venv and install everything, as locked

demo: .venv/.demo ## Walk the fake robot, write a log, a summary and a page with plots
	@".venv/bin/spot-rl" demo $(ARGS)

test: $(INSTALLED) ## Run the tests that protect a change: all but those marked slow
test-all: $(INSTALLED) ## Run all tests, as .ci/run does
test: WHICH := -m "not slow"
# Programs that tests start find their modules compiled, whatever the shell says.
test test-all: | reference
test test-all:
	@unset PYTHONDONTWRITEBYTECODE && folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && \
	$(RUN) -m pytest -n $(PYTEST_WORKERS) --dist worksteal -ra --basetemp "$$folder/t" $(WHICH) $(ARGS)

safety: $(INSTALLED) ## Every line, branch and, for 90 s, mutant of the safety core; ARGS=--all tries all mutants
	$(RUN) scripts/check_safety.py $(ARGS)

audit: $(INSTALLED) ## Pins, licences and digests of all dependencies; writes build/sbom.cdx.json
	$(RUN) scripts/audit.py --sbom build/sbom.cdx.json $(ARGS)

fuzz: $(INSTALLED) ## Fuzz every parser with atheris to 1,000,000 inputs; goes on where it was; ARGS='--jobs 4 --seconds 3600'
	@mkdir -p build/fuzz && cd build/fuzz && ../../$(RUN) ../../tests/fuzz/run.py all $(ARGS)

check: $(INSTALLED) ## Lint, format, types, layers, generated protos, leftovers
	@$(MAKE) --no-print-directory --keep-going lint types layers protos-check docs-check leftovers

lint: $(INSTALLED)
	$(RUN) -m ruff check
	$(RUN) -m ruff format --check

types: $(INSTALLED)
	$(RUN) -m mypy

layers: $(INSTALLED)
	"$(CURDIR)/.venv/bin/lint-imports" --no-logo

protos-check: $(INSTALLED)
	$(RUN) scripts/generate_protos.py --check

docs-check: $(INSTALLED)
	$(RUN) scripts/write_docs.py --check
	$(RUN) -m mkdocs build --quiet --strict

# Tests read the pages that the code writes.
reference: $(INSTALLED)
	@$(RUN) scripts/write_docs.py --check

leftovers: $(INSTALLED)
	$(RUN) scripts/check_leftovers.py

docs: $(INSTALLED) ## Write the reference and build the site into build/site (no network)
	$(RUN) scripts/write_docs.py
	$(RUN) -m mkdocs build --quiet --strict

format: $(INSTALLED) ## Format the code and mend what the linter can mend
	$(RUN) -m ruff format
	$(RUN) -m ruff check --fix

protos: $(INSTALLED) ## Regenerate spot_protos/ from protos/
	$(RUN) scripts/generate_protos.py

lock: $(INSTALLED) ## Resolve all versions anew and write requirements.lock (needs a network)
	$(RUN) scripts/make_lock.py

clean: ## Remove caches and build outputs; keep the environment and the runs
	rm -rf build dist .cache .coverage .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache *.egg-info
	find . -path ./.venv -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean ## Remove the environment too
	rm -rf .venv

.venv/bin/python:
	@if ! "$(PYTHON)" -c '' 2>/dev/null; then \
		echo "spot-rl needs Python 3.11 or later, and $(or $(PYTHON),none on PATH) cannot be run." \
			"Install one, or name it: make PYTHON=/path/to/python3.11" >&2; exit 1; fi
	@"$(PYTHON)" -c 'import sys; v = sys.version_info; sys.exit(None if v >= (3, 11) else \
		f"spot-rl needs Python 3.11 or later, and $(PYTHON) is {v.major}.{v.minor}. Name another: make PYTHON=/path/to/python3.11")'
	"$(PYTHON)" -m venv .venv

# What the demo needs, a tenth of everything.
.venv/.demo: pyproject.toml requirements.lock | .venv/bin/python
	@test -e $(INSTALLED) || { echo "Installing what the demo needs into .venv: a minute, and 0.3 GB." && \
		$(RUN) -m pip install --quiet -c requirements.lock setuptools && \
		$(RUN) -m pip install --quiet -c requirements.lock --no-build-isolation -e '.[fake]'; }
	@touch $@

# setuptools first: the package itself is then built without fetching a builder, also when there is no network.
$(INSTALLED): pyproject.toml lab/pyproject.toml requirements.lock | .venv/bin/python
	$(RUN) -m pip install --quiet -c requirements.lock setuptools
	@echo "Installing the locked packages into .venv: some minutes, and 3.0 GB."
	$(RUN) -m pip install -c requirements.lock --no-build-isolation -e '.[all,dev]' -e lab
	@touch $(INSTALLED)
