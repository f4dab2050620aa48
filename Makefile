# Two commands do all the set-up on a fresh machine:
#   make mission   fly the demo inspection here
#   make test      format, lint, types, import layers and the whole test suite
# The environment in .venv is made by the first of them, from requirements.lock.

BIN := .venv/bin
SCENARIO ?= demo
PYTEST_ARGS ?=
export PYTHON

.DEFAULT_GOAL := help
.PHONY: help env mission test lint format lock image clean

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
	$(BIN)/pytest $(PYTEST_ARGS)

format: env ## rewrite the sources in the house format
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lock: ## renew requirements.lock (needs uv)
	@sh deploy/lock.sh

image: ## build the container image
	docker build --tag bladescout .

clean: ## remove the environment and what tools left
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis *.egg-info
