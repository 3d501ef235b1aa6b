# Every target makes what it needs; nothing but Python (3.11 or newer) has to be there.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Wheels alone; Python compiles the modules that are used when they are, and not all that there are.
PIP := $(BIN)/pip install --quiet --disable-pip-version-check --only-binary :all: --no-compile

.PHONY: demo test test-all bench golden lint docs dist lock clean

demo: $(VENV)/.run
	$(BIN)/palpate demo

# The workers' matrices are small: threads of several of them would only wait for each other.
test: $(VENV)/.dev
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n auto --dist loadfile -m "not long"

# Those, and what takes long: large scenarios, a libfranka server on loopback, studies.
test-all: test
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n auto --dist loadfile -m long

bench: $(VENV)/.dev
	$(BIN)/python -m bench speed

# Every scenario at every noise against the table of what it measured before; some minutes.
golden: $(VENV)/.dev
	$(BIN)/python bench/golden/golden.py compare

lint: $(VENV)/.dev
	$(BIN)/ruff check src tests bench examples
	$(BIN)/ruff format --check src tests bench examples
	$(BIN)/pyright

$(VENV)/.run: pyproject.toml requirements.txt
	$(PYTHON) -m venv $(VENV)
	$(PIP) --require-hashes -r requirements.txt
	$(PIP) --no-deps --no-build-isolation -e .
	touch $@

$(VENV)/.dev: $(VENV)/.run requirements-dev.txt
	$(PIP) --require-hashes -r requirements-dev.txt
	touch $@

# The documentation site, in site/; what is wrong with it is an error.
docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

$(VENV)/.docs: $(VENV)/.run requirements-docs.txt
	$(PIP) --require-hashes -r requirements-docs.txt
	touch $@

# Sdist and wheel, in dist/. The wheel is built from the sdist, and runs the demo in an environment of its own, in an
# empty folder.
dist: $(VENV)/.run
	rm -rf dist build && mkdir -p build/empty
	$(BIN)/python -m hatchling build -t sdist -d dist
	$(BIN)/pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation -w dist dist/*.tar.gz
	$(PYTHON) -m venv build/.venv
	build/$(PIP) --require-hashes -r requirements.txt
	build/$(PIP) --no-deps dist/*.whl
	cd build/empty && env -u PYTHONPATH ../$(BIN)/palpate --version && env -u PYTHONPATH ../$(BIN)/palpate demo --fast

# Pins with hashes, from pyproject.toml. Needs uv.
lock:
	uv pip compile --quiet --universal --generate-hashes --no-emit-index-url --no-strip-extras --no-annotate --no-header \
		--python-version 3.11 --group build pyproject.toml -o requirements.txt
	uv pip compile --quiet --universal --generate-hashes --no-emit-index-url --no-strip-extras --no-annotate --no-header \
		--python-version 3.11 --extra vlm --extra ray --extra franky --extra live --extra see --extra export --extra logs --group build --group dev -c requirements.txt pyproject.toml -o requirements-dev.txt
	uv pip compile --quiet --universal --generate-hashes --no-emit-index-url --no-strip-extras --no-annotate --no-header \
		--python-version 3.11 --group docs -c requirements-dev.txt pyproject.toml -o requirements-docs.txt

clean:
	rm -rf $(VENV) site dist build .pytest_cache .ruff_cache .hypothesis
