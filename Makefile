# make demo   sets everything up in .venv and runs the main job      make test   the same, and passes all tests
# make bench  figures that describe this machine                     make check  style and types, without tests

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ready
# One thread a process: our matrices are small, and idle spinning threads cost the cycle its time.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1
export MKL_NUM_THREADS := 1

.PHONY: demo test check bench verdict setup clean
.DELETE_ON_ERROR:

demo: setup
	$(BIN)/stillgrasp demo $(ARGS)

# Tests in real time run by themselves: beside others they would measure the machine's load.
REAL_TIME := $(wildcard tests/system/test_*daemon*.py) tests/system/test_simulate.py \
	tests/system/test_motor_load_calibration.py

test: check
	$(BIN)/python -m pytest -n 2 --dist loadfile $(addprefix --ignore=,$(REAL_TIME)) $(ARGS)
	$(BIN)/python -m pytest $(REAL_TIME)

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup
	$(BIN)/python -m benchmarks.bench_cycle $(ARGS)
	$(BIN)/python -m benchmarks.bench_tables
	$(BIN)/python -m benchmarks.bench_can
	$(BIN)/python -m benchmarks.bench_motors
	$(BIN)/python -m benchmarks.bench_motor_bus
	$(BIN)/python -m benchmarks.bench_tactile

# The figures of docs/index.md and docs/contact.md: the best part of an hour of two cores.
verdict: setup
	$(BIN)/python -m benchmarks.index_study --write
	$(BIN)/python -m benchmarks.contact_study --write

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "stillgrasp needs Python 3.11 or later; $(PYTHON) is $$($(PYTHON) --version). Try: make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
		{ echo "This Python has no venv. On Debian or Ubuntu: apt install python3-venv (or python3.12-venv, as the version)"; exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[sim,cluster,tracker-usb,dev]'
	@touch $@

clean:
	rm -rf build $(VENV)
