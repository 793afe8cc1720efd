# Every target sets up its own environment in $(VENV); it needs Python 3.11 or later with venv,
# make, and a C compiler (the native FMUs and one reference tool of the tests are compiled). What
# is installed is what the target needs: $(READY) marks what flies, $(DEV) the tests' tools as well.

PYTHON ?= python3
VENV ?= .venv
JOBS ?= 2

BIN := $(VENV)/bin
READY := $(VENV)/.ready
DEV := $(VENV)/.ready-dev

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test lint bench chaos docs fmus clean release install-size

help: ## show this list
	@echo "make <target>   [PYTHON=$(PYTHON)] [VENV=$(VENV)] [JOBS=$(JOBS)]"
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-12s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

demo: $(READY) ## fly two designs over the same late link, from design to trace
	$(BIN)/cosim demo
	@echo
	@echo "The command is $(BIN)/cosim. Call it so, or put it on the path of this shell:"
	@echo "  . $(BIN)/activate && cosim"

test: $(DEV) ## run the tests, all but the slow ones [ORDER=NUMBER: in another order]
	$(BIN)/python -m pytest -n $(JOBS) --dist worksteal -m "not slow" \
		$(if $(ORDER),--random-order-bucket=module --random-order-seed=$(ORDER))

lint: $(DEV) ## check style, formatting and types, workflows and Containerfile
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/zizmor --offline --quiet .github/workflows
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.github-workflows \
		.github/workflows/*.yml
	$(BIN)/hadolint Containerfile

bench: $(DEV) ## run every benchmark; each prints its table and its JSON
	@# the masters to compare with, where they can be had
	-@$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		-c constraints.txt -e '.[toolchains]'
	@set -e; for script in tests/benchmarks/[!_]*.py; do \
		echo "== $$script"; $(BIN)/python -m tests.benchmarks.$$(basename $$script .py); \
	done

chaos: $(DEV) ## trouble at random through every door [SEED=NUMBER MINUTES=20]
	$(BIN)/python -m tests.chaos --jobs $(JOBS) \
		$(if $(SEED),--seed $(SEED)) $(if $(MINUTES),--minutes $(MINUTES))

docs: $(READY) ## build the documentation into site/, which needs no network
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		-c constraints.txt -e '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict
	$(BIN)/python -m docs_site.offline site

fmus: $(READY) ## build every FMU into fmus/
	$(BIN)/python build_fmu.py

release: $(READY) ## make dist/: wheel, sdist, FMUs and SSPs, SBOM, checksums; twice the same
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		-c constraints.txt -e '.[release]'
	$(BIN)/python .ci/release.py

install-size: $(DEV) ## install the wheel afresh, list each distribution with its MB [WHEEL=FILE JSON=1]
	@AUV_COSIM_PREBUILT=$(abspath build/prebuilt) \
		$(BIN)/python -m tests.benchmarks.install $(WHEEL) --size $(if $(JSON),--json)

clean: ## remove what the other targets made, traces excepted
	rm -rf .venv .venv-ci fmus dist build site .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find cosim fmu_src tests -type d -name __pycache__ -prune -exec rm -rf {} +

# The environment is hidden from git and from ruff wherever it stands.
$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		echo "Python 3.11 or later with its venv and ensurepip modules is needed."; \
		echo "  got: $(PYTHON), $$($(PYTHON) --version 2>&1)"; \
		echo "  try: make PYTHON=python3.11 $(MAKECMDGOALS)"; \
		exit 1; } >&2
	@echo "== 1 of 2: an environment in $(VENV)"
	$(PYTHON) -m venv $(VENV)
	@echo '*' > $(VENV)/.gitignore
	@echo "== 2 of 2: auv-cosim and what it needs to fly and draw, some 700 MB"
	$(BIN)/python -m pip install --disable-pip-version-check -c constraints.txt -e '.[plot,report]'
	@$(BIN)/python -m compileall -q cosim fmu_src # the first command starts as fast as the next
	@touch $@

$(DEV): $(READY)
	@echo "== what tests, benchmarks and checks need besides, another gigabyte"
	$(BIN)/python -m pip install --disable-pip-version-check \
		-c constraints.txt -e '.[plot,test,lint,bench]'
	@touch $@
