# make demo   what `suta-calib demo` shows: a measured UR5, the SUTA, two cameras
# make test   everything a change must pass
# make help   the rest
#
# PYTHON is the interpreter the environment .venv is made from, once: `make demo PYTHON=python3.12`.
# To change it later, run `make distclean` first.

PYTHON ?= python3
# One more than two cores: some tests wait for what an arm plays in real time, others for a notebook.
JOBS ?= 3

VENV := .venv
BIN := $(VENV)/bin
# Each file in one process, which makes what its tests share once; the longest first (conftest.py).
PYTEST := pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder
# Python counts the lines it runs nearly for nothing from 3.12 on; before, that is a quarter of the
# tests' time, which `make coverage` takes.
CHEAP_COVERAGE = $$($(BIN)/python -c 'import sys; print("--cov" * (sys.version_info >= (3, 12)))')
PIP_INSTALL := -m pip install --quiet --disable-pip-version-check
INSTALL := $(BIN)/python $(PIP_INSTALL) -c constraints.txt
INSTALLED := $(VENV)/.installed
INSTALLED_DEV := $(VENV)/.installed-dev
INSTALLED_BENCH := $(VENV)/.installed-bench
INSTALLED_DOCS := $(VENV)/.installed-docs
INSTALLED_RELEASE := $(VENV)/.installed-release
# The oldest versions of everything that pyproject.toml allows.
VENV_LOWEST := .venv-lowest
INSTALLED_LOWEST := $(VENV_LOWEST)/.installed

# What another package adds by entry points; the tests use it.
OUTSIDE := tests/support/outside_package

# What `make measured` compares with; further jobs for it.
VENV_FIGAROH := .venv-figaroh
INSTALLED_FIGAROH := $(VENV_FIGAROH)/.installed
PYBOTICS := .pybotics
INSTALLED_PYBOTICS := $(PYBOTICS)/.installed
FOLDERS ?=

# Every test process, and every command that a test starts, would compile the package again.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo thesis measured test coverage test-all test-lowest lint style format bench bench-device
.PHONY: clean distclean docs dist lock
.DELETE_ON_ERROR:

help:
	@echo "make demo       calibrate a measured UR5, the SUTA and two cameras from the data in this repository"
	@echo "make thesis     every table of the thesis beside ours, run and printed"
	@echo "make test       lint, types and tests, notebooks included; coverage from Python 3.12 on"
	@echo "make coverage   the tests, and whether they run 95 % of the package; any Python"
	@echo "make test-all   the same with the large studies"
	@echo "make test-lowest  the tests with the oldest versions allowed; Python 3.11 or 3.12"
	@echo "make bench      how long things take, and how well, beside others"
	@echo "make measured   measured arms, ours beside others: docs/measured.md; FOLDERS=… adds your jobs"
	@echo "make bench-device  the wire alone, at full length: 100 million bytes of noise, 60 s streams"
	@echo "make docs       the documentation site: docs/_build/html/index.html"
	@echo "make dist       what a release uploads: built, looked at, installed where nothing is, tried"
	@echo "make lock       requirements.lock from constraints.txt: the plain package's versions with hashes"
	@echo "make lint       ruff and mypy only"
	@echo "make format     let ruff format the code and mend what it can"
	@echo "make clean      remove caches and results"
	@echo "make distclean  remove .venv and .venv-lowest too"

demo: $(INSTALLED)
	$(BIN)/suta-calib demo
	@$(BIN)/python examples/ur5_laser_tracker/held_out.py suta-calib-demo/examples/ur5_laser_tracker/results

thesis: $(INSTALLED_DEV)
	$(BIN)/python notebooks/print_page.py notebooks/09_the_thesis.ipynb

# Types are checked while the tests run, and told below them. What was never imported is compiled
# before: every test process would compile all of it, 7 s each.
define tests_and_types
	@types=$$(mktemp); $(BIN)/mypy >"$$types" 2>&1 & mypy=$$!; \
	test -d tests/__pycache__ || $(BIN)/python -m pytest --collect-only -q >/dev/null; \
	COVERAGE_CORE=sysmon $(BIN)/python -m $(PYTEST) $(1); failed=$$?; \
	wait $$mypy || failed=1; echo "$(BIN)/mypy"; cat "$$types"; rm -f "$$types"; exit $$failed
endef

test: style
	$(call tests_and_types,-m "not slow" $(CHEAP_COVERAGE))

# Notebooks run in processes of their own, which nothing counts.
coverage: $(INSTALLED_DEV)
	$(BIN)/python -m $(PYTEST) -m "not slow and not notebook" --cov

# The large studies as well: some ten minutes.
test-all: style
	$(call tests_and_types)

test-lowest: $(INSTALLED_LOWEST)
	$(VENV_LOWEST)/bin/python -m $(PYTEST) -m "not slow and not notebook"

# From this repository alone; a warning is an error.
docs: $(INSTALLED_DOCS)
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo "Written: docs/_build/html/index.html"

# Some minutes: an empty environment for each Python that is here, with the newest and the oldest.
dist: $(INSTALLED_RELEASE)
	$(BIN)/python tools/dist.py

# For every system and Python; no index is named in it.
lock: $(INSTALLED_RELEASE)
	$(BIN)/uv pip compile pyproject.toml -c constraints.txt --universal --python-version 3.11 --quiet \
		--generate-hashes --no-emit-index-url --no-annotate --custom-compile-command "make lock" --output-file requirements.lock

lint: style
	$(BIN)/mypy

style: $(INSTALLED_DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

format: $(INSTALLED_DEV)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# One thread for everybody: with more, the linear algebra of small problems mostly waits.
bench: export OPENBLAS_NUM_THREADS = 1
bench: export OMP_NUM_THREADS = 1
bench: $(INSTALLED_DEV) $(INSTALLED_BENCH)
	@set -e; for script in benchmarks/bench_*.py; do \
		test -e "$$script" || { echo "make bench: found no benchmarks/bench_*.py" >&2; exit 1; }; \
		echo "== $$script"; $(BIN)/python "$$script"; \
	done

# Minutes, not seconds: what `make bench` runs in little.
bench-device: export OPENBLAS_NUM_THREADS = 1
bench-device: $(INSTALLED_DEV)
	$(BIN)/python benchmarks/bench_device.py --megabytes 100 --seconds 60

# With figaroh in an environment of its own and pybotics in a folder, where they can be installed.
measured: $(INSTALLED) $(INSTALLED_FIGAROH) $(INSTALLED_PYBOTICS)
	$(BIN)/python benchmarks/measured.py $(FOLDERS) --figaroh $(VENV_FIGAROH)/bin/python --pybotics $(PYBOTICS)

clean:
	rm -rf build dist suta-calib-demo docs/_build docs/generated ./*.egg-info $(OUTSIDE)/build $(OUTSIDE)/*.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis .coverage .coverage.*
	rm -rf data/*/results data/*/results-* examples/*/results examples/*/results-*
	find . -path "./.venv*" -prune -o -name __pycache__ -type d -exec rm -rf {} +

distclean: clean
	rm -rf $(VENV) $(VENV_LOWEST) $(VENV_FIGAROH) $(PYBOTICS)

# ── The environment: installed again only when what it depends on has changed ──────────────────
$(INSTALLED): pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing suta_calib into $(VENV); the first time this takes a few minutes."
	$(INSTALL) -e .
	@touch $@

# Not compiled file by file, half a minute on one core: what is used of it is, when it is imported.
$(INSTALLED_DEV): pyproject.toml constraints.txt $(OUTSIDE)/pyproject.toml | $(BIN)/python
	@echo "Installing suta_calib and its developer tools into $(VENV); the first time this takes a few minutes."
	$(INSTALL) --no-compile -e ".[dev,robots]" -e $(OUTSIDE)
	@touch $@ $(INSTALLED)

# The benchmarks run without the peers too, and say so. A peer brings another cv2, over ours.
$(INSTALLED_BENCH): pyproject.toml constraints.txt | $(INSTALLED_DEV)
	@echo "Installing what the benchmarks compare with."
	@if $(INSTALL) -e ".[bench]" && $(INSTALL) --force-reinstall --no-deps opencv-python-headless; then touch $@; else \
		echo "make bench: the peers cannot be installed; ours runs alone" >&2; fi

$(INSTALLED_DOCS): pyproject.toml constraints.txt | $(INSTALLED)
	@echo "Installing what the documentation is made with."
	$(INSTALL) -e ".[docs]"
	@touch $@

$(INSTALLED_RELEASE): pyproject.toml | $(INSTALLED)
	@echo "Installing what a release is built with."
	$(INSTALL) -e ".[release]"
	@touch $@

$(INSTALLED_LOWEST): pyproject.toml constraints-lowest.txt $(OUTSIDE)/pyproject.toml | $(VENV_LOWEST)/bin/python
	@echo "Installing suta_calib and the oldest versions it allows into $(VENV_LOWEST)."
	$(VENV_LOWEST)/bin/python $(PIP_INSTALL) -c constraints-lowest.txt -e ".[test,robots]" -e $(OUTSIDE)
	@touch $@

$(INSTALLED_FIGAROH): | $(VENV_FIGAROH)/bin/python
	@if $(VENV_FIGAROH)/bin/python $(PIP_INSTALL) figaroh==1.0.2; then touch $@; else \
		echo "make measured: figaroh cannot be installed; the page says so" >&2; fi

# It asks for NumPy below 2 and runs with 2 as well: ours is used, and SciPy too.
$(INSTALLED_PYBOTICS): | $(BIN)/python
	@if $(BIN)/python $(PIP_INSTALL) --no-deps --target $(PYBOTICS) pybotics==3.1.2 attrs==26.1.0; then touch $@; else \
		echo "make measured: pybotics cannot be installed; the page says so" >&2; fi

# Debian's python3 comes without ensurepip, and says so only after leaving half a .venv behind.
$(BIN)/python $(VENV_LOWEST)/bin/python $(VENV_FIGAROH)/bin/python:
	@command -v "$(PYTHON)" >/dev/null || { \
		echo "make: found no '$(PYTHON)'; Python 3.11 or later is needed: make $(MAKECMDGOALS) PYTHON=/path/to/python3" >&2; \
		exit 2; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "make: '$(PYTHON)' is $$("$(PYTHON)" --version 2>&1); Python 3.11 or later is needed: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; \
		exit 2; }
	@"$(PYTHON)" -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "make: '$(PYTHON)' cannot create environments (no venv or ensurepip); on Debian and Ubuntu: apt install python3-venv" >&2; \
		exit 2; }
	"$(PYTHON)" -m venv $(@D:/bin=) || { rm -rf $(@D:/bin=); exit 2; }
