# Two commands: `make run` opens the app, `make test` checks everything. Both set up what they need.
# `make quick` is for the inner loop, `make docs` for those who would rather read a site.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DATA ?= rallyscope-data
PORT ?= 8080
# Where torch alone is installed from, if not from where all the rest is: its index of CPU builds spares a Linux machine
# without NVIDIA some gigabytes.
TORCH_INDEX ?=

.PHONY: run test test-all test-benchmarks durations quick lowest check chromium kernels bench docs film
.PHONY: install-hashed hashes clean

run: $(VENV)/.installed
	$(BIN)/rallyscope serve --data "$(DATA)" --port $(PORT) --open

# What every change has to pass. The static checks run beside the tests. With bytecode, which saves a second at each of
# the hundreds of starts of a process.
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 2 --dist loadscope --no-loadscope-reorder

test: $(VENV)/.installed-dev
	$(MAKE) -j2 check kernels chromium
	$(PYTEST) -m "not long"

# All tests but those of benchmarks, for whoever finishes a larger change.
test-all: $(VENV)/.installed-dev
	$(MAKE) -j2 check kernels chromium
	$(PYTEST)

# What each test takes, measured anew: tests/sizes.py makes three sizes of it.
durations: $(VENV)/.installed-dev kernels chromium
	$(PYTEST) --durations-to tests/durations.csv

# The benchmarks' own tests, with small counts.
test-benchmarks: $(VENV)/.installed-dev chromium
	$(BIN)/python -m pytest -n 2 --dist loadscope benchmarks/tests

# The inner loop: what is slow (tests/sizes.py) is left to `make test`.
quick: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m pytest -q -n 2 -m "not slow"

# The oldest versions that pyproject.toml allows, in an environment of their own, and the short tests with them.
lowest: $(VENV)/.installed-dev
	$(BIN)/pip install --quiet uv
	$(BIN)/python -m tests.lowest_versions $(if $(TORCH_INDEX),--torch-index "$(TORCH_INDEX)")

check: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/pyright

chromium: $(VENV)/.installed-dev
	$(BIN)/python tests/ensure_chromium.py

kernels: $(VENV)/.installed-dev
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m tests.compile_kernels

bench: $(VENV)/.installed
	$(BIN)/rallyscope bench detection

docs: $(VENV)/.installed-docs
	$(BIN)/zensical build --strict --clean
	@echo "The site is in build/docs. To look at it here: $(BIN)/zensical serve"

# The film at the top of the README: a simulated rally in the app, in headless Chromium; takes some minutes.
film: $(VENV)/.installed-dev
	$(BIN)/python tests/ensure_chromium.py
	$(BIN)/python -m docs.make_film

# Only wheels whose hashes are known, then the project alone: for those who trust no index. With CUDA on Linux.
install-hashed: | $(VENV)/bin/python
	$(BIN)/pip install --require-hashes --only-binary :all: --requirement constraints-hashed.txt
	$(BIN)/pip install --no-deps --no-build-isolation --editable .
	touch $(VENV)/.installed

# After a change of constraints.txt: the hashes of all wheels of these versions, for every platform.
hashes: | $(VENV)/bin/python
	$(BIN)/pip install --quiet uv
	(echo '# Every wheel that may be installed, by its hash: `make hashes` makes this file from constraints.txt.'; \
	 $(BIN)/uv pip compile pyproject.toml --extra dev --constraint constraints.txt --universal --python-version 3.11.5 \
	 --generate-hashes --only-binary :all: --no-emit-index-url --no-header --no-annotate --quiet) > constraints-hashed.txt

# Nothing but torch from that index: what it needs comes from where all the rest does.
INSTALL_TORCH = $(if $(TORCH_INDEX),$(BIN)/pip install --no-deps --constraint constraints.txt \
	--index-url "$(TORCH_INDEX)" torch)

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "Installing what Rallyscope needs into $(VENV), once; this takes a minute or two ..."
	$(INSTALL_TORCH)
	$(BIN)/pip install --constraint constraints.txt --editable .
	touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	@echo "Installing what Rallyscope and its tests need into $(VENV), once; this takes a minute or two ..."
	$(INSTALL_TORCH)
	$(BIN)/pip install --constraint constraints.txt --editable '.[dev]'
	$(BIN)/pip install --quiet --constraint constraints.txt --no-deps labelImg # its readers are checkers; not its Qt
	-$(BIN)/pip install --quiet --constraint constraints.txt mlcroissant # not in `dev`: a part of it has no wheel
	touch $@ $(VENV)/.installed

$(VENV)/.installed-docs: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(BIN)/pip install --constraint constraints.txt --editable '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info
