# BEVTown. `make demo` and `make test` set up everything they need on a fresh machine.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
OUT    ?= runs/demo

.PHONY: help demo test lint types unit slow browser oldest speed splits pictures docs clean

help:  ## List the targets
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

demo: $(VENV)/.installed  ## The paper's ten episodes on the truth and on two predictors: table, maps, report
	$(BIN)/bev-bench run --suite paper --bev ground_truth cvt_kde ipm_unet_kde --agent bc --out $(OUT) --overwrite
	$(BIN)/bev-bench report $(OUT)

test: lint types unit  ## ruff, mypy and pytest

lint: $(VENV)/.tools
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.tools
	$(BIN)/mypy

unit: $(VENV)/.tools
	$(BIN)/python -m pytest -q -n 2 -m "not slow and not browser"

slow: $(VENV)/.tools $(VENV)/.docs  ## The tests that take long: several processes, whole suites
	$(BIN)/python -m pytest -q -n 2 -m slow

browser: $(VENV)/.tools  ## The report in headless Chromium; needs chromium and chromedriver
	@command -v chromium >/dev/null && command -v chromedriver >/dev/null || \
		{ echo "make browser needs Chromium: apt-get install chromium chromium-driver"; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[browser]'
	$(BIN)/python -m pytest -q -m browser tests

oldest: $(VENV)-oldest/.installed  ## The environment's tests with the oldest supported Gymnasium
	PYTHONPATH=$(abspath $(VENV)-oldest) $(BIN)/python -m pytest -q -n 2 \
		$(wildcard tests/bev_driving_env/test_*.py) \
		$(addprefix tests/agents/test_,expert.py policy.py sb3_agent.py adapters.py)

speed: $(VENV)/.installed  ## Steps per second beside highway-env, in one run
	$(BIN)/bev-bench speed --out runs/speed.json

splits: $(VENV)/.installed  ## Draw the val and test routes again, from their seeds
	$(BIN)/python -m bev_driving_env.towns.routebook

pictures: $(VENV)/.installed  ## Draw the pictures of README and docs again
	$(BIN)/python docs/draw_pictures.py
	$(BIN)/python docs/draw_predictors.py

docs: $(VENV)/.docs  ## Build README, guides and API reference as a site into site/
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# --editable, so that the sources in this folder are what runs
$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; v = sys.version_info; (3, 10) <= v < (3, 14) or sys.exit(f"BEVTown needs Python 3.10 to 3.13, this is {v[0]}.{v[1]}: make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.tools: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

$(VENV)/.docs: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	@touch $@

# the old Gymnasium alone, in a folder that comes before the virtual environment's
$(VENV)-oldest/.installed: pyproject.toml constraints.txt $(VENV)/.tools
	rm -rf $(VENV)-oldest
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps \
		--target $(VENV)-oldest 'gymnasium==1.2.0'
	@touch $@

clean:  ## Remove virtual environments, caches and results
	rm -rf $(VENV) $(VENV)-oldest runs build site *.egg-info .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
