# Everything happens in .venv, which is built once and again when what it needs changes.

VENV := .venv
READY := $(VENV)/.ready
PYTHON := $(VENV)/bin/python

.PHONY: help setup demo test verify lint clean

help:
	@echo 'make demo    set everything up, solve the dense pipe, print the pressure drop'
	@echo 'make test    set everything up, run the tests, some of them on two ranks'
	@echo 'make verify  run the slow tests too, up to an hour'
	@echo 'make lint    check style and types'
	@echo 'make setup   only build .venv'
	@echo 'make clean   remove .venv and everything that was generated'

setup: $(READY)

KERNEL := CMakeLists.txt $(wildcard fem_tfm/cpp/*)

$(READY): pyproject.toml .ci/constraints.txt .ci/setup .ci/find-python $(KERNEL)
	@echo 'setting up $(VENV), once'
	@.ci/setup
	@touch $@

demo: $(READY)
	$(VENV)/bin/fem-tfm run demos/dense_pipe/case3.toml --out results/dense_pipe --overwrite

test: $(READY)
	$(PYTHON) -m pytest -n 2 --dist loadfile
	$(VENV)/bin/mpirun -n 2 $(PYTHON) -m pytest -q -p no:cacheprovider -m 'mpi and not slow'

verify: $(READY)
	$(PYTHON) -m pytest -n 2 --dist loadfile -m slow

lint: $(READY)
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m mypy

clean:
	rm -rf $(VENV) .uv build results .pytest_cache .ruff_cache *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
