# Everything here needs Python 3.11 or later and make, no compiler: `make help` lists the targets.

PYTHON ?= python3
VENV ?= .venv
OUT ?= demo
BENCH ?= bench
LIVE ?= demo-live
# An editable install sees every change of the sources; EDITABLE=no installs as a plant would.
EDITABLE ?= yes
# LOCKED=yes takes only files whose hashes stand in the lock files.
LOCKED ?=
# How long make explore draws, and SEED=... for one round with the draws of an earlier one.
SECONDS ?= 600
SEED ?=
# How often make faults tries each fault.
ROUNDS ?= 4
# STRICT=1 turns skipped browser and database tests into failures.
STRICT ?=
# AGAIN=yes runs tests that failed once more, alone, and says so loudly; they fail where they fail twice.
AGAIN ?=
# Twice as many as two cores: tests that wait for a clock or a process leave theirs to others.
WORKERS ?= 4

# Wheels only: a plant computer has no compiler. The environment may say otherwise.
export PIP_ONLY_BINARY ?= :all:
export PIP_DISABLE_PIP_VERSION_CHECK ?= 1
export STRICT
# What is imported is compiled once and kept.
unexport PYTHONDONTWRITEBYTECODE
# Tests run side by side, neighbours in one process, so that what a module's tests share is made once; each process
# stays on its own core, and all share one cache of compiled kernels.
test test-ci test-all explore: export OMP_NUM_THREADS ?= 1
test test-ci test-all explore: export NUMBA_CACHE_DIR ?= $(abspath $(VENV))/numba-cache
PYTEST = $(BIN)/pytest -n $(WORKERS) --dist worksteal -q -rsfE --durations=10 --durations-min=1

# $(call alone,marker): what a failure is followed by. Alone on the machine, a test that only a busy machine upset passes,
# and is named; no failed test to repeat (a crash, nothing collected) stays a failure.
alone = $(if $(filter yes,$(AGAIN)), || { echo 'UNSTEADY? What failed runs once more and alone:'; \
	$(BIN)/pytest -m '$(1)' --last-failed --last-failed-no-failures=none -q -rfEp; })

BIN := $(VENV)/bin
LOG := $(VENV)/log.txt
# Compiling all that is installed takes most of the time, and little of it is ever imported.
INSTALL := $(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt
# That little is imported once, side by side: the first run would compile it in several processes at a time.
IMPORT := { $(BIN)/python -P -c 'import stemwatch.service.run.worker_preload' & $(BIN)/python -P -c \
	'from stemwatch.service import cli, maintenance, report, run, store; from stemwatch.service.maintenance import pdf; \
	from stemwatch.service.report import xlsx_file; from stemwatch.service.run import engine; \
	from stemwatch.service.store.migrations import migrate' && wait; }
# $(call compiling,what pip installs): pip leaves a core idle, on which the checkout's kernels are compiled once what they
# need is there; what follows ends with wait.
KERNELS := $(if $(filter no,$(EDITABLE)),true,$(BIN)/python -m stemwatch.models.compile_kernels)
compiling = $(INSTALL) numba safetensors scipy torch && \
	{ $(KERNELS) FITS & $(KERNELS) MISMATCH SIMULATOR & $(INSTALL) $(1); }
# With what make live needs beside the product.
SOURCE := $(if $(filter no,$(EDITABLE)),,--editable )'.[live-demo]'
PACKAGE_FILES := $(if $(filter no,$(EDITABLE)),$(shell find stemwatch service models connectors -type f \
	-not -path '*/__pycache__/*'))
INPUTS := pyproject.toml constraints.txt setup.py $(PACKAGE_FILES)

# $(call step,what is done,command): one line with its seconds; the command's own words on failure.
define step
	@printf '%s ... ' '$(1)'; began=$$(date +%s); \
	if ( $(2) ) > $(LOG) 2>&1 < /dev/null; then echo "$$(( $$(date +%s) - began )) s"; \
	else echo 'failed:'; cat $(LOG); exit 1; fi
endef

STYLE = $(call step,Checking style (ruff),$(BIN)/ruff check . && $(BIN)/ruff format --check .)
RULES := $(BIN)/lint-imports --no-cache
TYPES := $(BIN)/mypy

.PHONY: demo test test-ci test-all explore faults check live bench lock supply-chain docs clean help
.DEFAULT_GOAL := help

demo: $(VENV)/can-run ## Simulate the demonstration plant, screen it, and write its report into demo/
	@$(BIN)/stemwatch demo --out $(OUT)

live: $(VENV)/can-run ## The live demo: a plant whose valve wears, the service, and its mails; Ctrl-C ends it
	@$(BIN)/stemwatch demo --live --out $(LIVE)

# Types are checked beside the tests, many of which wait, and give way to them. Before the tests, kernels that are not
# compiled yet are, and all tests are read once: test processes that begin together would each do it.
test: $(VENV)/can-test ## All checks and the tests that a change needs; sets up what they need
	$(STYLE)
	@echo 'Running the tests, and beside them checking types and which package may import which ...'
	@{ nice $(RULES) && nice $(TYPES); } > $(VENV)/types.txt 2>&1 || { cat $(VENV)/types.txt; false; } & types=$$!; \
	$(BIN)/python tests/prepare.py && { $(PYTEST) -m 'not long'$(call alone,not long); }; tests=$$?; \
	wait $$types || { echo 'Types or imports are wrong, see above; make check says it again.'; exit 1; }; exit $$tests

# What .ci/run calls: the long tests need services, browsers and kills; those of studies repeat shorter ones.
test-ci: test ## The same, and then the long tests without the studies
	@echo 'Running the long tests; the studies are left to make test-all ...'
	@$(PYTEST) -m 'long and not study'$(call alone,long and not study)

test-all: test-ci ## The same, and then the studies: statistics, hours of waiting, files of gigabytes
	@echo 'Running the studies ...'
	@$(PYTEST) -m study$(call alone,study)

explore: $(VENV)/can-test ## Property tests with new random draws for SECONDS=600, or again with SEED=...
	@$(BIN)/python tests/explore.py --seconds $(SECONDS) $(if $(SEED),--seed $(SEED)) -n $(WORKERS)

faults: $(VENV)/can-test ## Kill and cut off whatever the service needs, ROUNDS=4 times, and count what is lost
	@$(BIN)/python -m tests.faults --rounds $(ROUNDS)

check: $(VENV)/can-test ## Style, import rules and types, without the tests
	$(STYLE)
	$(call step,Checking the types (mypy) and which package may import which (lint-imports),\
	$(RULES) & rules=$$!; $(TYPES) --num-workers 2; types=$$?; wait $$rules; exit $$((types + $$?)))

bench: $(VENV)/can-test ## All benchmarks, with the machine named, into bench/; FULL=yes takes longer
	@$(BIN)/python tests/benchmarks/suite.py --out $(BENCH) $(if $(filter yes,$(FULL)),--full)

LOCK := $(VENV)/tools/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
	--only-binary :all: --constraint constraints.txt --all-extras --no-header --no-annotate

lock: $(VENV)/tools/made ## Write the lock files anew: the versions of constraints.txt with the index's hashes
	@$(if $(PIP_INDEX_URL),UV_DEFAULT_INDEX=$(PIP_INDEX_URL)) $(LOCK) -o requirements.lock pyproject.toml
	@$(if $(PIP_INDEX_URL),UV_DEFAULT_INDEX=$(PIP_INDEX_URL)) $(LOCK) --group dev -o requirements-dev.lock pyproject.toml

supply-chain: $(VENV)/can-test $(VENV)/tools/made ## Vulnerabilities, licences, and the bill of materials into dist/
	@$(BIN)/python -m tests.supply_chain --tools $(VENV)/tools/bin --out dist

# Not with --quiet: it drops the warnings that strict counts.
docs: $(VENV)/site/made ## The docs as a site in build/docs that needs no network; broken links end it
	$(call step,Building the docs,$(VENV)/site/bin/mkdocs build)
	@echo 'Open build/docs/index.html in a browser.'

clean: ## Remove the environment, caches and build folders
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

help: ## This list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1	\2/p' $(MAKEFILE_LIST)

$(VENV)/made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2> /dev/null || { \
	echo 'stemwatch needs Python 3.11 or later; $(PYTHON) is older or absent.'; \
	echo 'Say which to use: make PYTHON=python3.12'; exit 1; }
	@mkdir -p $(VENV)
	$(call step,Making the environment $(VENV),$(PYTHON) -m venv $(VENV) || \
	{ echo 'On Debian and Ubuntu: apt install python3-venv'; exit 1; })
	@touch $@

$(VENV)/tools/made: $(VENV)/made pyproject.toml constraints.txt
	$(call step,Making an environment for the tools of the supply chain,$(BIN)/python -m venv $(VENV)/tools && \
	$(VENV)/tools/bin/python -m pip install --quiet --no-compile --constraint constraints.txt pip && \
	$(VENV)/tools/bin/python -m pip install --quiet --no-compile --constraint constraints.txt --group supply-chain)
	@touch $@

$(VENV)/site/made: $(VENV)/made pyproject.toml
	$(call step,Making an environment for the docs,$(BIN)/python -m venv $(VENV)/site && \
	$(VENV)/site/bin/python -m pip install --quiet --no-compile --constraint constraints.txt pip && \
	$(VENV)/site/bin/python -m pip install --quiet --no-compile --constraint constraints.txt --group docs-site)
	@touch $@

$(VENV)/can-run: $(VENV)/made $(INPUTS)
	@rm -rf build
	$(call step,Installing stemwatch (minutes the first time),$(if $(LOCKED),\
	$(INSTALL) --require-hashes --no-deps --requirement requirements-dev.lock && $(INSTALL) --no-deps \
	--no-build-isolation $(SOURCE),$(call compiling,$(SOURCE))) && $(IMPORT))
	@touch $@

$(VENV)/can-test: $(VENV)/made $(INPUTS)
	@rm -rf build
	$(call step,Bringing pip up to date,$(INSTALL) pip setuptools)
	$(call step,Installing stemwatch and what checks it (minutes the first time),$(if $(LOCKED),\
	$(INSTALL) --require-hashes --no-deps --requirement requirements-dev.lock && $(INSTALL) --no-deps \
	--no-build-isolation $(SOURCE),$(call compiling,$(SOURCE) --group dev)) && wait)
	@touch $@ $(VENV)/can-run
