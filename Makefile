# The few verbs of this project; `make help` lists them.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.DEFAULT_GOAL := help
.PHONY: help run demo-arm serve test test-short nightly check notebooks notebooks-shown docs site bench bench-server soak clean

help: ## list the verbs
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

run: $(VENV)/base.stamp ## plan a figure eight, run it, and write out/plan.json and out/report.html
	@mkdir -p out
	$(BIN)/slide-plan examples/figure_eight.csv -o out/plan.json
	$(BIN)/slide-run out/plan.json --report out/report.html

demo-arm: $(VENV)/arm.stamp ## plan, execute on the simulated arm in closed loop, and write out/arm.mp4 and out/arm.html
	@mkdir -p out
	$(BIN)/slide-plan examples/figure_eight.csv -o out/plan.json
	@echo "the arm in $$(cat $(VENV)/arm.stamp)"
	$(BIN)/slide-run out/plan.json --simulator $$(cat $(VENV)/arm.stamp) --closed-loop --video out/arm.mp4 --report out/arm.html

serve: $(VENV)/server.stamp ## serve plans and the page on http://127.0.0.1:8000
	$(BIN)/slide-serve

test: $(VENV)/dev.stamp ## run every test
	$(BIN)/python -m pytest

test-short: $(VENV)/short.stamp ## run the tests of planning, programs and arms, in an environment without training and server
	$(BIN)/python -m pytest tests/runtime/arm tests/runtime/arms tests/runtime/cli tests/runtime/test_recorded.py

nightly: $(VENV)/dev.stamp ## the governor against 100,000 sequences of accelerations of each kind, 10,000 stops, and what streams are told
	SLIDE_SEQUENCES=100000 SLIDE_PLANS=10000 $(BIN)/python -m pytest -v tests/runtime/safety --durations 5 --timeout 14400
	SLIDE_BROWSER_PLANS=200 SLIDE_BROWSER_SEQUENCES=20000 $(BIN)/python -m pytest tests/browser --timeout 3600
	SLIDE_STEPS=100000 SLIDE_FALSE_READINGS=10000 $(BIN)/python -m pytest tests/runtime/test_sight.py --timeout 14400

check: $(VENV)/dev.stamp $(if $(shell command -v npm),site,docs) notebooks ## lint, formatting, types, the notebooks, and the site with its links
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

notebooks: $(VENV)/dev.stamp ## run the notebooks of examples/notebooks, and write them to out/notebooks
	NOTEBOOK_EPOCHS=1 $(BIN)/python -m nbconvert --log-level WARN --to notebook --execute --output-dir out/notebooks \
	  examples/notebooks/*.ipynb

MKDOCS := NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

notebooks-shown: $(VENV)/dev.stamp ## run the notebooks in full, ten minutes, and keep in them what they show
	$(BIN)/python -m nbconvert --log-level WARN --to notebook --execute --inplace \
	  --ExecutePreprocessor.record_timing=False --ExecutePreprocessor.coalesce_streams=True examples/notebooks/*.ipynb

docs: $(VENV)/dev.stamp ## the documentation as a site, in out/site
	$(MKDOCS)

site: $(VENV)/dev.stamp browser/node_modules ## the documentation and, in out/site/plan, the page that plans by itself, for any static host
	npm run --silent check --prefix browser
	SITE_PLANS=1 $(MKDOCS)
	node browser/build.mjs

browser/node_modules: browser/package.json browser/package-lock.json
	npm ci --prefix browser --no-audit --no-fund --ignore-scripts
	@touch $@

bench: $(VENV)/dev.stamp ## accuracy, speed, control, refinement, long commands and training, beside their targets
	$(BIN)/slide-bench

bench-server: $(VENV)/dev.stamp ## the server under load, beside its targets
	$(BIN)/slide-bench server

soak: $(VENV)/dev.stamp ## the same for half an hour, longer attacks, and 200 examples an operation of the API
	SLIDE_EXAMPLES=200 $(BIN)/python -m pytest tests/server/http/test_openapi.py --timeout 7200
	SLIDE_ATTACKERS=1100 SLIDE_ATTACK_SECONDS=60 $(BIN)/python -m pytest tests/server/test_attacks.py \
		tests/server/http/test_connections.py --timeout 7200
	$(BIN)/slide-bench server --soak

clean: ## remove the environment and what was built
	rm -rf $(VENV) build out *.egg-info

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/base.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP) --editable .
	@touch $@

$(VENV)/arm.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	@# MuJoCo where it installs and can render, else pybullet; the stamp says which.
	if $(PIP) --editable '.[mujoco]' && $(BIN)/python -m runtime.arm.mujoco.library; \
	then echo mujoco > $@; \
	else $(PIP) --editable '.[pybullet]' && echo pybullet > $@; fi
	@touch $(VENV)/base.stamp

$(VENV)/short.stamp: $(VENV)/arm.stamp
	$(PIP) pytest pytest-timeout hypothesis onnx
	@touch $@

$(VENV)/server.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP) --editable '.[server]'
	@touch $@ $(VENV)/base.stamp

$(VENV)/dev.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP) --editable '.[dev]'
	@touch $@ $(VENV)/base.stamp $(VENV)/server.stamp
