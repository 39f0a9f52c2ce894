# One word a task; `make check` is what has to pass. Set PYTHON to use another interpreter.
# `.ci/checks.toml` lists the checks: each of them is a word here too.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
CHECK = $(BIN)/python .ci/checks.py --here

.PHONY: install check test end_to_end faults interop labs browser windows types notebooks postgres uvloop \
	site lint demo pictures slides soak mutants format bench clean

install:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --editable '.[dev]'

check:
	$(CHECK) lint types quick

test:
	$(CHECK) quick

end_to_end faults labs windows types postgres lint demo:
	$(CHECK) $@

browser interop notebooks:
	$(BIN)/pip install --quiet --editable '.[dev,$@]'
	$(CHECK) $@

uvloop:
	$(BIN)/pip install --quiet --editable '.[dev,fast]'
	$(CHECK) $@
	$(BIN)/pip uninstall --quiet --yes uvloop

site:
	$(BIN)/pip install --quiet --editable '.[docs]'
	$(CHECK) $@

pictures:
	$(BIN)/pip install --quiet --editable '.[dev,browser]'
	$(BIN)/python docs/pictures/make.py

slides: site
	npx --yes @marp-team/marp-cli --no-stdin docs/teach/slides.md --output build/site/docs/teach/show.html

soak:
	$(BIN)/pytest -m faults --soak

# `make mutants SAMPLE=0` for all of them, MODULES=taskrpc/retry.py for one module.
SAMPLE ?= 60
MODULES ?=

mutants:
	$(BIN)/pip install --quiet --editable '.[mutants]'
	$(BIN)/python tests/mutation/mutants.py --sample $(SAMPLE) $(MODULES)

format:
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# `make bench PYTHON=python3.12` for another Python; each has an environment of its own.
BENCH = .venv-bench/$(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
ARGS ?=

bench:
	$(PYTHON) -m venv $(BENCH)
	$(BENCH)/bin/pip install --quiet --editable '.[bench]'
	$(BENCH)/bin/python benchmarks/run.py $(ARGS)

clean:
	rm -rf $(VENV) .venv-bench .mutants .mypy_cache build/mypy .ruff_cache .pytest_cache .hypothesis
