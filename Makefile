# The commands of the README; make help lists them. PYTHON=python3.12 make setup selects another interpreter.
PYTHON ?=
VENV := .venv
BIN := $(VENV)/bin

.PHONY: setup demo view test check bench figures docs help

setup: ## make .venv and install into it
	@python="$(or $(PYTHON),python3)"; \
	command -v "$$python" >/dev/null || { \
	  echo "set-up: no '$$python' on the PATH; install Python 3.11 to 3.13 or name one with PYTHON=..." >&2; exit 1; }; \
	"$$python" tools/setup_env.py $(if $(PYTHON),--selected)

demo: setup ## run head and reconstruction, check the depth, write demo/report.html; CAPTURE=folder plays a capture
	@$(BIN)/python -m tools.warm_kernels
	@$(BIN)/python -m tools.demo.run $(if $(CAPTURE),--capture "$(CAPTURE)")

view: setup ## virtual head, reconstruction and their live view as a web page, until Ctrl-C; SCENE=room PORT=8080
	@$(BIN)/python -m tools.warm_kernels
	@$(BIN)/python -m tools.view $(if $(SCENE),--scene "$(SCENE)") $(if $(PORT),--port "$(PORT)")

check: setup ## lint and types
	$(BIN)/ruff check .
	$(BIN)/mypy

# Two test processes; tests that start nodes run in one of them (test/conftest.py). A machine of two cores is full.
test: check ## lint, types and all tests
	@$(BIN)/python -m tools.warm_kernels
	$(BIN)/pytest -n 2

# BENCH="--parts scenes --scenes waves" measures a part; BENCH=--help tells all options.
bench: setup ## accuracy and speed beside other methods, into docs/bench.md
	@$(BIN)/python -m tools.bench.run $(BENCH)

# A warning fails the build: every link and anchor holds. The theme's own notice is about its successor, no fault of ours.
docs: setup ## write docs/reference.md from the code, and all pages as a site: site/index.html
	@$(BIN)/python -m tools.docs.reference
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

help: ## this list
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' Makefile | sort | expand -t 10

# CAPTURE=folder shows a recorded capture instead, in demo/figures.
figures: setup ## the paper's experiments, into docs/figures.md, and the other pictures of the documentation
	@$(BIN)/python -m tools.figures.run $(if $(CAPTURE),--capture "$(CAPTURE)")
	$(if $(CAPTURE),,@$(BIN)/python -m tools.docs.pictures)
