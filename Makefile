# `make demo` and `make test` set everything up first; both are quick when it is already there.

VENV ?= .venv
PYTHON ?= $(shell command -v python3.11 || command -v python3)

BIN := $(abspath $(VENV))/bin
READY := $(VENV)/.ready
PYTEST := $(BIN)/python -m pytest
SOURCES := simrig plugins scenes evaluation tests

.PHONY: help install constraints demo test test-quick test-random coverage lint types format rooms \
	doctor docs clean

help:
	@echo "make demo        set up, then run the main job into output/demo"
	@echo "make test        set up, then everything: ruff, mypy and every test"
	@echo "make test-quick  the tests that take seconds"
	@echo "make test-random the property tests with new examples; SEED=n repeats a run"
	@echo "make coverage    the quick tests, and which lines they run"
	@echo "make lint        ruff and mypy"
	@echo "make format      let ruff rewrite the code"
	@echo "make rooms       draw who imports whom into the docs, count the lines of every room"
	@echo "make docs        build the manual as a site into output/docs"
	@echo "make doctor      say what is missing and how to get it"
	@echo "make install     set up only"
	@echo "make constraints write down the versions that are installed, as those to be tested"
	@echo "make clean       remove what these commands made"

install: $(READY)

# again only when the list of packages changed; libLLVM is looked for with simrig's own check
$(READY): pyproject.toml .ci/setup .ci/constraints.txt
	@.ci/setup "$(PYTHON)" "$(VENV)"
	@touch $@

constraints: $(READY)
	@{ sed '/^[^#]/d' .ci/constraints.txt; \
	$(BIN)/python -m pip freeze --all --exclude-editable --exclude pip | grep '=='; } \
	> $(VENV)/constraints && cp $(VENV)/constraints .ci/constraints.txt

demo: $(READY)
	$(BIN)/simrig demo --output output/demo

# the tests run even when the linters fail, so that one run shows everything
test: $(READY)
	@status=0; \
	$(MAKE) --no-print-directory lint || status=$$?; \
	$(PYTEST) || status=$$?; \
	exit $$status

test-quick: $(READY)
	@$(PYTEST) -m "not slow"

# everywhere else the examples are the same in every run
SEED ?= $(shell od -An -N4 -tu4 /dev/urandom | tr -d ' ')
test-random: $(READY)
	@seed=$(SEED); echo "again with these examples: make test-random SEED=$$seed"; \
	$(PYTEST) -m hypothesis --hypothesis-profile=random --hypothesis-seed=$$seed

coverage: $(READY)
	@$(PYTEST) -m "not slow" --cov --cov-report=term:skip-covered

lint: $(READY) types
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/ruff format --check $(SOURCES)

# mypy does not follow the package-dir map of pyproject.toml, so it is shown the installed layout
types: $(READY)
	@mkdir -p .types/simrig && find .types -type l -delete
	@ln -s $(addprefix ../../,$(wildcard simrig/*) plugins scenes evaluation) .types/simrig
	cd .types && $(BIN)/mypy --config-file ../pyproject.toml -p simrig

format: $(READY)
	$(BIN)/ruff check --fix $(SOURCES)
	$(BIN)/ruff format $(SOURCES)

rooms: $(READY)
	@$(BIN)/python tests/rooms.py --draw
	@$(BIN)/python tests/rooms.py

# warnings are errors
docs: $(READY)
	@mkdir -p output
	@$(BIN)/typer simrig.cli.app utils docs --name simrig --title Commands \
	--output docs/reference/every_command.md >/dev/null
	@$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going docs output/docs
	@$(BIN)/sphinx-build --quiet --fail-on-warning --builder singlehtml docs output/docs/single
	@sed -E -i 's/href="#document-[^"#]*#/href="#/g' output/docs/single/index.html # sphinx issue 14221
	@echo "output/docs/index.html; on one page: output/docs/single/index.html"

doctor: $(READY)
	$(BIN)/simrig doctor

clean:
	rm -rf $(VENV) .types build docs/reference/every_command.md *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage output
