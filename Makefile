# Two commands: `make run` opens the app, `make test` checks everything. Both set up what they need.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DATA ?= rallyscope-data

.PHONY: run test check bench clean

run: $(VENV)/.installed
	$(BIN)/rallyscope serve --data $(DATA) --open

test: $(VENV)/.installed-dev check
	$(BIN)/python tests/ensure_chromium.py
	$(BIN)/python -m pytest -n 2 --dist loadscope

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
	$(BIN)/pip install --quiet --constraint constraints.txt --editable .
	touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[dev]'
	$(BIN)/pip install --quiet --constraint constraints.txt --no-deps labelImg # its readers are checkers; not its Qt
	touch $@ $(VENV)/.installed

clean:
	rm -rf $(VENV) build dist *.egg-info
