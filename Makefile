# make demo   watch a task being solved
# make test   every check that decides whether a change is good
#
# make docs   the documentation as a searchable site
#
# Everything is installed into .venv; remove it, or run `make clean`, to start again.

PYTHON ?= python3
VENV ?= .venv

BIN := $(VENV)/bin
SCALE := $(VENV)/scale
LEROBOT := $(VENV)/lerobot
OLDEST := 3.11
VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
# A stamp per Python version: another PYTHON creates a new environment.
MADE := $(VENV)/made-with-python-$(VERSION)
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check \
	--constraint constraints.txt --editable

# One worker more than cores, each with whole files: what the tests of a file share is made once. At
# most four, because some tests use all cores themselves. tests/conftest.py orders the files.
IN_PARALLEL := --numprocesses auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder --memory

export PYTHONUNBUFFERED = 1
# Tests start hundreds of processes, each of which would compile the package again.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo docs test test-browser test-rest test-slow test-exactness test-training test-minari \
	test-lerobot test-scale test-gpu lint format clean check-python
.DELETE_ON_ERROR:

help:  ## Show this list
	@echo "usage: make [PYTHON=python3.12] TARGET"
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-14s %s\n", $$1, $$2 }' Makefile

demo: $(VENV)/installed-demo  ## Let the planner bring a ball home; video, report and numbers in demo/
	$(BIN)/limberjack solve manipulator bring_ball --seeds 1003 --out demo
	@echo "Open $(CURDIR)/demo/report.html to see it."

docs: $(VENV)/installed-docs  ## Build the documentation as a site in site/
	$(BIN)/python tools/build_site.py
	@echo "To read it: $(BIN)/python -m http.server --directory site, then open http://localhost:8000"

test: $(VENV)/installed-test  ## Run ruff, pyright and all tests but the slow ones
	$(MAKE) --jobs 2 test-browser test-rest

# First those of the viewer, beside ruff and pyright alone: they click in real time. The site's end
# beside the first of the other tests.
test-browser: $(VENV)/installed-test  ## Run the tests that open the viewer and pages in a browser
	$(BIN)/python -m pytest tests/browser/test_viewer*.py tests/browser/test_[!v]*.py

test-rest: lint  ## Run ruff, pyright and all tests but the slow ones and those in a browser
	$(BIN)/python -m pytest $(IN_PARALLEL) --ignore tests/browser

test-slow: $(VENV)/installed-test  ## Run the slow tests
	$(BIN)/python -m pytest -m slow -o faulthandler_timeout=3600

test-exactness: $(VENV)/installed-test  ## Compare every task with dm_control at length; resumable
	$(BIN)/python -m tests.exactness
	$(BIN)/python -m pytest -m 'slow or not slow' $(IN_PARALLEL) tests/oracle tests/laws

# Loaders fork their workers, of which JAX warns once it is imported: their tests run by themselves.
test-training: $(VENV)/installed-training  ## Run the tests of training, Stable-Baselines3, PyTorch's loaders and the examples
	$(BIN)/python -m pytest tests/training tests/cli/test_train.py tests/adapters/test_sb3.py \
		tests/evaluation/test_saved_models.py tests/policies/test_exporting.py tests/examples \
		tests/docs/test_notebooks.py
	$(BIN)/python -m pytest tests/docs/test_pages.py tests/episodes/test_torch_datasets.py -k torch

test-minari: $(VENV)/installed-minari  ## Run the tests of datasets in Minari's format
	$(BIN)/python -m pytest -m 'slow or not slow' tests/episodes/test_to_minari.py \
		tests/cli/test_datasets.py tests/cli/test_collect.py

test-lerobot: $(VENV)/installed-test $(VENV)/installed-lerobot  ## Let LeRobot open a converted dataset; installs LeRobot and PyTorch
	LEROBOT_PYTHON=$(LEROBOT)/bin/python $(BIN)/python -m pytest tests/episodes/test_to_lerobot.py

test-scale: $(VENV)/installed-scale  ## Run the tests of Ray: on this machine, and a cluster of three nodes
	$(SCALE)/bin/python -m pytest -m ray tests/workers/test_ray_tasks.py

test-gpu:  ## Run tasks on MuJoCo Warp, on the processor; installs PyTorch into an environment of its own
	$(MAKE) VENV=$(VENV)-gpu $(VENV)-gpu/installed-gpu
	$(VENV)-gpu/bin/python -m pytest -m gpu tests/gpu tests/adapters tests/test_gpu.py \
		tests/examples tests/benchmarks
	$(VENV)-gpu/bin/python -m pytest tests/docs/test_pages.py -k gpu.md

lint: $(VENV)/installed-test  ## Check style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python

format: $(VENV)/installed-test  ## Rewrite files in the project's style
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:  ## Remove what make, the tests and the demo have written
	rm -rf $(VENV) $(VENV)-gpu demo site build dist .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

check-python:
	@$(PYTHON) -c 'pass' 2>/dev/null || { \
		echo "make: there is no working '$(PYTHON)'; install Python $(OLDEST) or newer, or name" \
		"one: make PYTHON=python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < tuple(map(int, "$(OLDEST)".split("."))))' || { \
		echo "make: Limberjack needs Python $(OLDEST) or newer, and '$(PYTHON)' is $(VERSION);" \
		"name another: make PYTHON=python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "make: '$(PYTHON)' cannot make virtual environments; on Debian and Ubuntu:" \
		"apt install python3-venv" >&2; exit 1; }

$(MADE): | check-python
	@echo "Installing into $(VENV); the first time this takes a few minutes."
	$(PYTHON) -m venv --clear $(VENV)
	@touch $@

$(VENV)/installed-demo: $(MADE) pyproject.toml constraints.txt
	$(INSTALL) '.[video]'
	@touch $@

$(VENV)/installed-docs: $(MADE) pyproject.toml constraints.txt
	$(INSTALL) '.[docs]'
	@touch $@

$(VENV)/installed-test: $(MADE) pyproject.toml constraints.txt
	$(INSTALL) '.[test]'
	@touch $@ $(VENV)/installed-demo $(VENV)/installed-docs

$(VENV)/installed-minari: $(VENV)/installed-test
	$(INSTALL) '.[test,minari]'
	@touch $@

# PyTorch for the CPU is enough. Where pip's index has only the CUDA build, which is several GB, name
# one that has it: make PIP_EXTRA_INDEX_URL=... test-training
$(VENV)/installed-training: $(VENV)/installed-test
	$(INSTALL) '.[test,train,sb3,torchrl]'
	@touch $@

# In an environment of its own: no other test may depend on the packages that Ray brings.
$(VENV)/installed-scale: $(MADE) pyproject.toml constraints.txt
	$(PYTHON) -m venv --clear $(SCALE)
	$(SCALE)/bin/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints.txt --editable '.[ray,data]' pytest
	@touch $@

# In an environment of its own, without our constraints: it needs older versions, and Python 3.12.
$(VENV)/installed-lerobot: $(MADE)
	$(PYTHON) -m venv --clear $(LEROBOT)
	$(LEROBOT)/bin/python -m pip install --quiet --disable-pip-version-check 'lerobot[dataset]==0.6.1'
	@touch $@

# The first test compiles MuJoCo Warp's kernels, which takes minutes; they are kept.
$(VENV)/installed-gpu: $(VENV)/installed-test
	$(INSTALL) '.[test,rsl-rl,unilab-rl]'
	@touch $@
