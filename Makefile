# One word a task; `make check` is what has to pass. Set PYTHON to use another interpreter.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin

.PHONY: install test faults browser notebooks interop pictures site slides postgres soak mutants lint types layers windows check format demo bench clean

install:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --editable '.[dev]'

test:
	$(BIN)/pytest

faults:
	$(BIN)/pytest -m faults

browser:
	$(BIN)/pip install --quiet --editable '.[dev,browser]'
	$(BIN)/pytest -m browser tests/browser tests/ros/turtlesim

notebooks:
	$(BIN)/pip install --quiet --editable '.[dev,notebooks]'
	$(BIN)/pytest -m notebooks tests/notebooks

pictures:
	$(BIN)/pip install --quiet --editable '.[dev,browser]'
	$(BIN)/python docs/pictures/make.py

site:
	$(BIN)/pip install --quiet --editable '.[docs]'
	$(BIN)/python docs/site/make.py build/site

slides: site
	npx --yes @marp-team/marp-cli --no-stdin docs/teach/slides.md --output build/site/docs/teach/show.html

interop:
	$(BIN)/pip install --quiet --editable '.[dev,interop]'
	$(BIN)/pytest -m interop tests/interop tests/core/transport/contract tests/core/transport/pubsub tests/ros/packages

postgres:
	$(BIN)/pytest -m postgres tests/robot/fleet

soak:
	$(BIN)/pytest -m faults --soak

# `make mutants SAMPLE=0` for all of them, MODULES=taskrpc/retry.py for one module.
SAMPLE ?= 60
MODULES ?=

mutants:
	$(BIN)/pip install --quiet --editable '.[mutants]'
	$(BIN)/python tests/mutation/mutants.py --sample $(SAMPLE) $(MODULES)

lint:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types:
	for system in linux win32 darwin; do $(BIN)/mypy --platform $$system || exit 1; done
	for folder in examples/0*/; do $(BIN)/mypy "$$folder" || exit 1; done
	$(BIN)/pytest -m types

windows:
	$(BIN)/python .ci/windows

layers:
	$(BIN)/lint-imports

check: lint types layers test

format:
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

demo:
	$(BIN)/taskrpc demo

bench:
	$(BIN)/pip install --quiet --editable '.[bench]'
	$(BIN)/python benchmarks/run.py

clean:
	rm -rf $(VENV) .mutants .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
