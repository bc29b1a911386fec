# rsgen: every target sets up what it needs; only Python 3.11 or newer has to be there.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready

# measured data that lie beside the checkout; an empty RSGEN_DATA leaves them out
ifeq ($(origin RSGEN_DATA),undefined)
RSGEN_DATA := $(wildcard $(abspath ../shared/data))
endif
export RSGEN_DATA

SPELLED := rsgen docs tests benchmarks cases $(wildcard *.md) Makefile pyproject.toml

# many tests start processes, and what one of them has compiled the others read
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help reports docs pages test types suite test-all test-wheel fast constraints bench attack faults clean

help: ## print this list
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/' | expand -t 12

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "rsgen needs Python 3.11 or newer; set PYTHON=python3.x")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test]'
	@touch $(READY)

reports: $(READY) ## run every case and leave reports/index.html
	$(BIN)/rsgen run cases
	$(BIN)/python -m benchmarks.table1

docs: $(READY) ## build docs/_build/html/index.html: tutorial, how-to, method, laws, gallery, API
	$(BIN)/python -m sphinx -W -n -q -b html docs docs/_build/html

pages: $(READY) ## renew what pages of docs/ say from the source: case file, commands, findings, laws, gallery
	$(BIN)/python -m docs.pages
	$(BIN)/python -m tests.capabilities

test: $(READY) ## run the checks: format, lint, types, imports, tests, doctests
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/codespell $(SPELLED)
	$(MAKE) --no-print-directory --jobs=2 types suite

types: $(READY)
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-issue-forms .github/ISSUE_TEMPLATE/[!c]*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-issue-config .github/ISSUE_TEMPLATE/config.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.citation-file-format CITATION.cff

suite: $(READY)
	$(BIN)/pytest -n 2 --dist worksteal

test-all: $(READY) ## the long tests that `make test` leaves out: browser, attacks, whole library, many random examples
	@tests/fetch_tools.sh .venv
	$(BIN)/pytest -n 2 --dist worksteal --hypothesis-profile=thorough -m "thorough or hypothesis" tests

fast: $(READY) ## the checks that take less than a minute
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/codespell $(SPELLED)
	$(BIN)/pytest -n 2 --dist worksteal -m "not slow" -q

test-wheel: $(READY) ## build wheel and sdist, use the wheel in empty environments of every Python found here
	$(BIN)/python tests/try_wheel.py

constraints: $(READY) ## renew constraints.txt: the versions of reproducible runs
	$(BIN)/uv pip compile pyproject.toml --extra tdms --extra xlsx --universal --upgrade --quiet \
		--custom-compile-command "make constraints" --no-annotate --output-file constraints.txt

bench: $(READY) ## measure speed, accuracy and verdicts into reports/*.md; BEFORE=COMMIT: beside an earlier version
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[bench]'
	$(BIN)/python -m benchmarks.speed
	$(BIN)/python -m benchmarks.accuracy
	$(BIN)/python -m benchmarks.across
	$(BIN)/python -m benchmarks.background
	$(BIN)/python -m benchmarks.ranking
	$(BIN)/python -m benchmarks.ranking_background
	$(BIN)/python -m benchmarks.wordings
	$(BIN)/python -m benchmarks.verdicts

attack: $(READY) ## kill, damage, fill up and forge what rsgen has, for hours, into reports/attacks.md
	$(BIN)/python -m tests.attacks

faults: $(READY) ## put small faults into a copy of the package, see which test catches each, into reports/faults.md; 20 minutes or more
	$(BIN)/python -m tests.faults

clean: ## remove the environment and all generated reports
	rm -rf docs/_build .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find reports -mindepth 1 ! -name '*.md' ! -path 'reports/pictures*' -delete
