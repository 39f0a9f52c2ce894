# One word a task; `make check` is what has to pass. Set PYTHON to use another interpreter.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin

.PHONY: install test faults soak lint types layers check format demo bench clean

install:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --editable '.[dev]'

test:
	$(BIN)/pytest

faults:
	$(BIN)/pytest -m faults

soak:
	$(BIN)/pytest -m faults --soak

lint:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types:
	$(BIN)/mypy
	for folder in examples/0*/; do $(BIN)/mypy "$$folder" || exit 1; done
	$(BIN)/pytest -m types

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
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
