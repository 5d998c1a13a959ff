PYTHON ?= python3
BIN := .venv/bin
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

.DEFAULT_GOAL := help
.PHONY: help venv demo browser test oldest rewritten check docs bench clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-9s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

venv: .venv/.installed  ## virtual environment in .venv, with everything that these targets need

.venv/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11))" || { \
		echo "zmp_sqp needs Python 3.11 or newer; name one: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	@$(PYTHON) -c "import ensurepip, venv" 2>/dev/null || { \
		echo "$(PYTHON) cannot make virtual environments (no ensurepip): on Debian and Ubuntu, apt install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev,docs,plots,sim]"
	@touch $@

demo: venv  ## plan test 1 of the paper: table on the terminal, trajectory and figures in out/paper_1
	$(BIN)/zmp-sqp plan paper_1 --out out/paper_1

browser:  ## Debian's chromium, in which pages are tested (as root); without it these tests are skipped
	@command -v chromium > /dev/null || { apt-get update -qq && \
		apt-get install -y -qq --no-install-recommends chromium > /dev/null; }

test: venv  ## the test suite, two workers with one thread each
	$(BIN)/python -m pytest -n 2

oldest: .venv-oldest/.installed  ## the test suite with the oldest releases that pyproject.toml allows
	.venv-oldest/bin/python -m pytest -n 2

.venv-oldest/.installed: pyproject.toml constraints-oldest.txt
	$(PYTHON) -m venv --clear .venv-oldest
	.venv-oldest/bin/python -m pip install --quiet --disable-pip-version-check -c constraints-oldest.txt -e ".[dev,plots,sim]"
	@touch $@

rewritten: venv  ## tests of planning on the feller-buncher with its root raised, turned (y forward), or both
	for how in raised y-forward both; do $(BIN)/python -m pytest -n 2 tests/planning --machine $$how || exit 1; done
	$(BIN)/python -m pytest -n 2 tests/mechanics tests/control tests/test_rigorous.py --machine raised

check: venv  ## linter, formatter, types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --strict zmp_sqp

docs: venv  ## the book, in out/docs; a warning is an error
	$(BIN)/sphinx-build -q -W --keep-going -d out/doctrees docs out/docs
	@echo "the book: out/docs/index.html"

bench: venv  ## speed, robustness, comparisons with other planners and MuJoCo, printed as tables
	$(BIN)/python -m benchmarks.startup
	$(BIN)/python -m benchmarks.speed
	$(BIN)/python -m benchmarks.random_problems
	$(BIN)/python -m benchmarks.driving_problems
	$(BIN)/python -m benchmarks.terrain_drives
	$(BIN)/python -m benchmarks.robust_problems
	$(BIN)/python -m benchmarks.machine_moves
	$(BIN)/python -m benchmarks.robots
	$(BIN)/python -m benchmarks.certificate
	$(BIN)/python -m benchmarks.rigorous
	$(BIN)/python -m benchmarks.memory
	$(BIN)/python -m benchmarks.many
	$(BIN)/python -m benchmarks.peer_ipopt
	$(BIN)/python -m benchmarks.peers
	$(BIN)/python -m benchmarks.replay
	$(BIN)/python -m benchmarks.replanning
	$(BIN)/python -m benchmarks.control_loop

clean:  ## remove the virtual environment and everything made by these targets
	rm -rf .venv .venv-oldest out dist build .pytest_cache .hypothesis .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
