# Daily commands. Another interpreter: make fast PYTHON=python3.12
PYTHON ?= $(if $(wildcard .venv/bin/python),.venv/bin/python,python3)

.PHONY: fast full docs bench lint types
fast: ; $(PYTHON) -m pytest -m "not slow"
smoke: ; $(PYTHON) -m pytest -n 0 -m "not slow" $$(cat tests/smoke.txt)
full: ; $(PYTHON) -m pytest
docs: ; $(PYTHON) docs/generate.py && $(PYTHON) -m sphinx -W --keep-going -q docs docs/_build/html
bench: ; $(PYTHON) -m benchmarks --out docs
lint: ; $(PYTHON) -m ruff check . && $(PYTHON) -m ruff format --check .
types: ; $(PYTHON) -m mypy
