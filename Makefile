.PHONY: demo test test-all torture check setup clean

demo: setup
	.venv/bin/testfield run scenes/stitched_wall.toml

test: setup check
	.venv/bin/python -m pytest -q -m "not slow"

test-all: setup check
	.venv/bin/python -m pytest -q

torture: setup
	.venv/bin/python tests/torture/run.py

check: setup
	.venv/bin/ruff format --check src tests
	.venv/bin/ruff check src tests
	.venv/bin/mypy

setup:
	@.ci/setup

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache
