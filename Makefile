.PHONY: demo docs test test-all torture regress check mutants mutation setup clean

# Two tests at once, each with one thread of linear algebra: more would only wait for each other.
PYTEST = OMP_NUM_THREADS=1 .venv/bin/python -m pytest -q -n 2 --durations 15

demo: setup
	.venv/bin/testfield run scenes/stitched_wall.toml

test: setup check
	$(PYTEST) -m "not slow"

test-all: setup check
	$(PYTEST)

torture: setup
	.venv/bin/python tests/torture/run.py

# The project's own figures against their committed baselines; `make test` runs the quick part.
regress: setup
	OMP_NUM_THREADS=1 .venv/bin/testfield regress check scenes/regress/quick.toml
	OMP_NUM_THREADS=1 .venv/bin/testfield regress check scenes/regress/all.toml

# Defects that were planted by hand: each must turn the test red that it names (tests/mutants/README.md).
mutants: setup
	.venv/bin/python tests/mutants/run.py

# Defects that cosmic-ray knows, over the rooms that score, judge and key: the DRAWth sample of SAMPLE, in a copy.
SAMPLE = 300
DRAW = 0
JOBS = 2
MUTATE = OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONPATH=src PATH="$$PWD/../.venv/bin:$$PATH"
mutation: setup
	.venv/bin/python -m pip install --quiet --disable-pip-version-check -c .ci/constraints.txt -e '.[mutation]'
	rm -rf .mutation && mkdir .mutation && cp -r src tests scenes pyproject.toml Makefile .mutation/
	cd .mutation && ../.venv/bin/cosmic-ray init pyproject.toml session.sqlite
	cd .mutation && ../.venv/bin/python tests/mutants/sample.py session.sqlite $(SAMPLE) $(DRAW)
	cd .mutation && $(MUTATE) python tests/mutants/narrow.py
	cd .mutation && $(MUTATE) python tests/mutants/mutate.py session.sqlite $(JOBS)
	cd .mutation && ../.venv/bin/cr-report session.sqlite --surviving-only --show-diff
	cd .mutation && ../.venv/bin/cr-rate session.sqlite --fail-over 10

# What `import testfield as tf` offers, as pages, in renders/docs.
docs: setup
	.venv/bin/pdoc --no-show-source --docformat google -o renders/docs testfield.api

check: setup
	.venv/bin/ruff format --check src tests
	.venv/bin/ruff check src tests
	.venv/bin/mypy

setup:
	@.ci/setup

clean:
	rm -rf .mutation .venv .mypy_cache .ruff_cache .pytest_cache
