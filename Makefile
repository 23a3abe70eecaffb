# Everything is installed into .venv; `make` alone lists the targets.
#   make install PYTHON=python3.12      another interpreter
#   make install EXTRAS=report,notebook,history,fleet,serve,docs,test,study,physics,laws,dev  without the ROS wheels (other platforms; a cell that has ROS from apt)
#   make test PYTEST_ARGS="-k delta"    a part of the tests

SHELL := /bin/bash
PYTHON ?= python3
EXTRAS ?= ros,report,notebook,history,fleet,serve,docs,test,study,physics,laws,dev
VENV := .venv
PY := $(VENV)/bin/python
STAMP := $(VENV)/.installed
WARM := $(VENV)/.warm
# What holds compiled code, or is a part of some: after an update it is compiled anew before a node needs it.
COMPILED := $(shell find delta_calibration/model delta_calibration/mechanisms delta_calibration/effects \
    delta_calibration/estimation delta_calibration/compensation delta_calibration/cell -name '*.py')
LOG := $(VENV)/install.log
# The tables of docs/performance.md, in its order; searches of the swarm that `make study` counts failures of.
BENCHMARKS ?= run commands export_c compensation table table_choices diagnosis node_rate
FAILURES ?= 200000

# .venv brings its own ROS. One sourced in this shell, or the library path that the wheels of another
# environment left behind, must not be mixed into it.
ifneq ($(AMENT_PREFIX_PATH)$(_ROS_WHEELS_BOOTSTRAP_COMPLETE),)
unexport LD_LIBRARY_PATH
endif
# Bytecode is kept: without it every process that a demo or a test starts compiles the package's source anew.
unexport PYTHONDONTWRITEBYTECODE
unexport PYTHONPATH AMENT_PREFIX_PATH COLCON_PREFIX_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE

.DEFAULT_GOAL := help
.PHONY: help install demo test lint laws docs bench methods study recovery soak clean

help: ## list the targets
	@sed -nE 's/^([a-z]+):.*## (.*)/  make \1|\2/p' $(MAKEFILE_LIST) | column -t -s '|' 2>/dev/null \
	    || sed -nE 's/^([a-z]+):.*## (.*)/  make \1  \2/p' $(MAKEFILE_LIST)

install: $(WARM) ## make .venv with the package, ROS, and all that tests and checks need

$(STAMP): setup.cfg setup.py pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	    || { echo "make: Python 3.10 or later is needed; name one with PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { \
	    package="python$$($(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')-venv"; \
	    if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	        echo "Installing $$package"; \
	        apt-get -qq update >/dev/null \
	            && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y "$$package" >/dev/null; \
	    else \
	        echo "make: $(PYTHON) cannot make environments; first: sudo apt install $$package" >&2; exit 1; \
	    fi; }
	@$(PY) -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	@echo "Installing into $(VENV), some minutes (log: $(LOG))"
	@$(PY) -m pip install --disable-pip-version-check --no-input -e '.[$(EXTRAS)]' >$(LOG) 2>&1 \
	    || { grep -v '^WARNING' $(LOG) | tail -n 20 >&2; exit 1; }
	@touch $@

$(WARM): $(STAMP) $(COMPILED)
	@$(PY) -m delta_calibration.cli.warm
	@touch $@

demo: install ## run a simulated cell: measure, fit, compensate (out/demo*; DEMO_ARGS="--robot cdpr8")
	@$(VENV)/bin/delta-cal demo $(DEMO_ARGS)

test: install ## run the tests on two workers, real ROS nodes on loopback
	@$(PY) -m pytest -n 2 --dist loadfile --no-loadscope-reorder $(PYTEST_ARGS)

lint: install ## ruff (rules and layout), mypy --strict on the package, codespell
	@$(PY) -m ruff check .
	@$(PY) -m ruff format --check --quiet .
	@$(PY) -m mypy
	@$(VENV)/bin/codespell

laws: install ## generate the code of mechanisms and effects anew, after a change of what they say in symbols
	@$(PY) -m delta_calibration.cli.laws

docs: install ## build the API reference, a page a module (out/docs); what is missing in it is an error
	@$(PY) docs/make_api.py out/docs
	@echo "written: out/docs/index.html"

study: install ## put swarm and diagnosis on trial on thousands of machines (hours; STUDY_ARGS="--help")
	@$(PY) benchmarks/compensation.py --failures $(FAILURES)
	@PYTHONPATH=test:benchmarks $(PY) -m study.bodies $(BODIES_ARGS)
	@PYTHONPATH=test:benchmarks $(PY) -m study $(STUDY_ARGS)

recovery: install ## count hidden values within their intervals, every effect on every robot (RECOVERY_ARGS="--help")
	@OPENBLAS_NUM_THREADS=1 $(PY) benchmarks/recovery.py $(RECOVERY_ARGS)

bench: install ## time kernels, fits, bags, tables, the node at 1 kHz; swarms of others (EXTRAS=bench,... for all)
	@mkdir -p out
	@set -o pipefail; for part in $(BENCHMARKS); do \
	    printf '\n`python benchmarks/%s.py`\n\n' $$part; $(PY) benchmarks/$$part.py || exit 1; \
	done | tee out/bench.md

methods: install ## fit every robot by every method, the table into docs/methods.md (METHODS_ARGS="--machines 5")
	@$(PY) benchmarks/methods.py $(METHODS_ARGS)

soak: install ## run the node for 10 minutes at 1 kHz under faults (SOAK_ARGS="--seconds 60")
	@$(PY) benchmarks/soak.py $(SOAK_ARGS)

clean: ## remove what was built and written, but not .venv
	@rm -rf build install log dist out *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -path ./$(VENV) -prune -o -name __pycache__ -type d -print0 | xargs -0 rm -rf
