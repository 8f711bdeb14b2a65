# Two commands do everything: `make demo` and `make test`. Each sets up .venv from the lock first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
FRESH := $(VENV)/.kernels
SOURCES := $(wildcard models/*.py models/*/*.py placement/*.py placement/*/*.py placement/*/*/*.py)

.DEFAULT_GOAL := help
.PHONY: help demo test test-slow lint types check lock clean

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/'

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "placement needs Python 3.11 or newer; '$(PYTHON)' is $$($(PYTHON) --version 2>&1). Try: make PYTHON=python3.12 demo"; exit 2; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "This Python has no venv or ensurepip module. On Debian or Ubuntu: apt install python3-venv"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $(READY)

# Numba's cache looks at a function's own file alone, not at the kernels it calls from others.
$(FRESH): $(READY) $(SOURCES)
	@find models placement benchmarks reports -name '*.nb[ic]' -delete
	@touch $(FRESH)

demo: $(FRESH)  ## solve and validate the embedded instance into out/demo/
	$(BIN)/placement demo

test: $(FRESH)  ## the default test suite: eight minutes of processor time the first time, half of that on two cores
	$(BIN)/python -m pytest -n auto --dist loadfile

test-slow: $(FRESH)  ## the long tests: closed-loop statistics, full-size instances
	$(BIN)/python -m pytest -m slow

lint: $(READY)  ## ruff: style and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)  ## mypy, strict
	$(BIN)/mypy

check: lint types test  ## everything CI runs

lock:  ## resolve anew (needs uv); the lock names no registry host, so any index or mirror serves it
	uv lock --upgrade
	sed -E -i 's#registry = "[^"]*"#registry = ".wheels"#; s#\{ url = "[^"]*/([^"/]+)"#{ path = "\1"#' uv.lock
	uv export --frozen --extra dev --extra cluster --no-emit-project --no-header --output-file requirements.lock > /dev/null

clean:  ## remove the environment and every output
	rm -rf $(VENV) out .pytest_cache .mypy_cache .ruff_cache .hypothesis
