# Two commands: `make run` opens the app, `make test` checks everything. Both set up what they need.
# `make quick` is for the inner loop.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DATA ?= rallyscope-data
PORT ?= 8080

.PHONY: run test quick check bench clean

run: $(VENV)/.installed
	$(BIN)/rallyscope serve --data "$(DATA)" --port $(PORT) --open

test: $(VENV)/.installed-dev check
	$(BIN)/python tests/ensure_chromium.py
	$(BIN)/python -m pytest -n 2 --dist loadscope --no-loadscope-reorder

# The inner loop: what is slow (SLOW in tests/conftest.py) is left to `make test`.
quick: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m pytest -q -n 2 -m "not slow and not browser"

check: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/pyright

bench: $(VENV)/.installed
	$(BIN)/rallyscope bench detection

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "Installing what Rallyscope needs into $(VENV), once; this takes a minute or two ..."
	$(BIN)/pip install --constraint constraints.txt --editable .
	touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "Installing what Rallyscope and its tests need into $(VENV), once; this takes a minute or two ..."
	$(BIN)/pip install --constraint constraints.txt --editable '.[dev]'
	$(BIN)/pip install --quiet --constraint constraints.txt --no-deps labelImg # its readers are checkers; not its Qt
	touch $@ $(VENV)/.installed

clean:
	rm -rf $(VENV) build dist *.egg-info
