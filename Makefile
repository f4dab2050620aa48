# Two commands do all the set-up on a fresh machine:
#   make mission   fly the demo inspection here
#   make test      format, lint, types, import layers and the whole test suite
# The environment in .venv is made by the first of them, from requirements.lock.

BIN := .venv/bin
SCENARIO ?= demo
PYTEST_ARGS ?=
FAULTS ?=
FUZZ_S ?= 60
SOAK_MEMORY ?= 20
SOAK_WIRE ?= 2
KILLS ?= 10
SEED ?= 1
export PYTHON

.DEFAULT_GOAL := help
.PHONY: help env mission test test-flight test-parts faults safety fuzz mutants soak kills flights lint format lock image clean

help: ## show the targets
	@sed -n 's/^\([a-z]*\):.*## /make \1\t/p' Makefile | expand -t 16

env: ## create or renew .venv
	@sh deploy/bootstrap.sh

mission: env ## fly an inspection in simulation (SCENARIO=demo)
	@$(BIN)/bladescout simulate $(SCENARIO)

lint: env ## format, lint, types, import layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: lint ## lint, then the whole test suite
	@$(MAKE) --no-print-directory -j2 --output-sync=target test-flight test-parts
	$(BIN)/pytest tests/system $(PYTEST_ARGS)

# Two halves side by side; what flies in real processes has the machine to itself afterwards.
test-flight:
	$(BIN)/pytest tests/faults tests/mission --ignore=tests/mission/cli $(PYTEST_ARGS)

test-parts:
	$(BIN)/pytest tests -p no:cacheprovider --ignore=tests/faults --ignore=tests/mission/flight \
	  --ignore=tests/mission/processes --ignore=tests/mission/records --ignore=tests/mission/remote \
	  --ignore=tests/mission/replay --ignore=tests/system $(PYTEST_ARGS)

faults: env ## the long cases of the fault table: real processes, many draws (FAULTS="words of a row; of another" picks)
	$(BIN)/pytest -m faults tests/faults --figures tests/faults/measured.json --rows "$(FAULTS)"
	$(BIN)/python -m tests.faults.safety

safety: env ## measure the quick cases anew and render SAFETY.md
	$(BIN)/pytest tests/faults/test_faults.py -k it_is_noticed --figures tests/faults/measured.json
	$(BIN)/python -m tests.faults.safety

fuzz: env ## fuzz everything that parses outside bytes, guided by coverage (FUZZ_S=60 a target)
	$(BIN)/python -m tests.faults.fuzzing --seconds $(FUZZ_S)

mutants: env ## mutate the guard; its tests must notice each mutant (MUTANTS_S=seconds bounds it)
	$(BIN)/python -m tests.faults.mutants $(if $(MUTANTS_S),--seconds $(MUTANTS_S))
	$(BIN)/python -m tests.faults.safety

soak: env ## missions one after the other, in memory and on the wire; goes on where it was left
	$(BIN)/python -m tests.faults.soak --memory $(SOAK_MEMORY) --wire $(SOAK_WIRE)

kills: env ## kill the daemon at random moments of simulated missions; each is completed by resume
	KILLS=$(KILLS) $(BIN)/pytest tests/mission/flight/test_resumption.py -k killed
	$(BIN)/python -m tests.faults.killing --kills $(KILLS) --seed $(SEED)

flights: env ## fly the twelve sides of 86 m blades in memory, by as many flights as it takes
	$(BIN)/python -m tests.faults.splitting

format: env ## rewrite the sources in the house format
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lock: ## renew requirements.lock (needs uv)
	@sh deploy/lock.sh

image: ## build the container image
	docker build --tag bladescout .

clean: ## remove the environment and what tools left
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis *.egg-info
