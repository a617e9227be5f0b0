# The commands of the README. PYTHON=python3.12 make setup selects another interpreter.
PYTHON ?=
VENV := .venv
BIN := $(VENV)/bin

.PHONY: setup demo test check bench

setup:
	@python="$(or $(PYTHON),python3)"; \
	command -v "$$python" >/dev/null || { \
	  echo "set-up: no '$$python' on the PATH; install Python 3.11 to 3.13 or name one with PYTHON=..." >&2; exit 1; }; \
	"$$python" tools/setup_env.py $(if $(PYTHON),--selected)

demo: setup
	@$(BIN)/python -m tools.demo.run $(if $(CAPTURE),--capture "$(CAPTURE)")

check: setup
	$(BIN)/ruff check .
	$(BIN)/mypy

test: check
	$(BIN)/pytest

# BENCH="--parts scenes --scenes waves" measures a part; BENCH=--help tells all options.
# Idle kernel threads sleep, as in the executables.
bench: setup
	@OMP_WAIT_POLICY=passive $(BIN)/python -m tools.bench.run $(BENCH)
