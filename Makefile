# Every target makes .venv and installs facetcam into it by itself; a second call starts at once.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RUN := $(BIN)/python -m
NATIVE := $(wildcard cpp/*)
INPUTS := pyproject.toml CMakeLists.txt $(NATIVE)
ARGS ?=

.DEFAULT_GOAL := help
.PHONY: help install demo test test-all bench docs lint format clean

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

install: $(VENV)/.test  ## make .venv and install facetcam with its test tools

demo: $(VENV)/.test  ## run the whole line on a built-in scene; ARGS=--quick for a short drive
	$(BIN)/facetcam demo $(ARGS)

test: $(VENV)/.test  ## the quick tests
	$(RUN) pytest -n auto

test-all: $(VENV)/.test  ## all tests, the long ones too
	$(RUN) pytest -n auto -m ""

bench: $(VENV)/.test  ## all benchmarks; FACETCAM_DATA=folder says where the films are
	@for script in benchmarks/[a-z]*.py; do echo "== $$script"; $(BIN)/python "$$script" || exit 1; done

docs: $(VENV)/.docs  ## build the documentation into site/
	NO_MKDOCS_2_WARNING=1 $(RUN) mkdocs build --strict --quiet

lint: $(VENV)/.dev  ## ruff, mypy and clang-format, without changing anything
	$(RUN) ruff check
	$(RUN) ruff format --check
	$(RUN) mypy
	$(BIN)/clang-format --dry-run --Werror $(NATIVE)

format: $(VENV)/.dev  ## let ruff and clang-format rewrite the sources
	$(RUN) ruff check --fix
	$(RUN) ruff format
	$(BIN)/clang-format -i $(NATIVE)

clean:  ## remove everything that was built
	rm -rf $(VENV) build dist site

$(VENV)/.python: scripts/system_packages.sh
	sh scripts/system_packages.sh $(PYTHON)
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.test: $(VENV)/.python $(INPUTS)
	$(RUN) pip install --quiet --disable-pip-version-check --editable ".[test]"
	@touch $@

# The tools of the other extras, without compiling the core once more for each.
$(VENV)/.dev $(VENV)/.docs: $(VENV)/.%: $(VENV)/.test
	$(BIN)/python scripts/requirements_of.py $* > $@.txt
	$(RUN) pip install --quiet --disable-pip-version-check --requirement $@.txt
	@touch $@
