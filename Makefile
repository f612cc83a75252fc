# CoAdapt Edge. `make help` lists the targets; each is a short form of `coadapt ...`.
ROBOTS ?=
WORLD ?=
DATA ?=
EGOS ?=
EGO_STANDBY ?=
DATA_URL ?=
DATA_COMMIT ?=
DATA_TREE ?=
LIVE ?=
RUNTIME ?=
POLICY ?=
LLM ?=
MODEL ?=
GRAFANA ?=
SECURE ?=
LISTEN ?=
WORLD_ROBOTS ?=
EXTRA ?= $(if $(filter embedded,$(LLM)),llm)
SWARM ?= local
LINK ?=
RATE ?=
PROFILE ?=
TRACE ?=
ROBOT ?=
DIRECTION ?=
DURATION ?=
TIME_SCALE ?=
CONFIG ?= factory
ARGS ?=

# Two more than cores, as tests wait a lot; files stay whole, as their tests may share what is costly,
# in the order of tests/conftest.py.
PARALLEL = --numprocesses $(shell expr $$(nproc) + 2) --maxprocesses 8 --dist loadfile \
	--no-loadscope-reorder
COADAPT = .venv/bin/coadapt
PYTHON_ENV = .venv/bin/python
BENCHMARKS = sam codec detector compute peers roundtrip cycle shaping priority trace adapt capacity loop narrow controller gateway embedded deadline console trust egos scale machines
# Without what is C (perception/kernels/_coding.c ...).
DOCUMENTED = coadapt.api swarm perception worlds sensing robot_agent ego_agent network_controller llm_gateway deploy \
	'!perception.kernels._' '!worlds.factory._'

.DEFAULT_GOAL := help
.PHONY: help setup data up down list status logs metrics shape congest net record test test-all check lint types bench chaos train train-llm eval-llm eval-detector eval \
	pictures sbom fuzz docs lock clean

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-13s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@echo "  variables: ROBOTS=number WORLD=factory|road|opv2v|bag|scans|recording DATA=path RUNTIME=auto|docker|netns"
	@echo "             POLICY=coverage|llm|... LINK=20mbit EGOS=R1,R4|all EGO_STANDBY=R2 SWARM=$(SWARM) ARGS='more options'"
	@echo "             LLM=embedded|http://host:port/v1 MODEL=name GRAFANA=1"
	@echo "             LISTEN=address of this machine, for robots elsewhere; WORLD_ROBOTS=room for so many"
	@echo "             of shape: RATE=5mbit, or PROFILE=shift|trace|off TRACE=file TIME_SCALE=3600;"
	@echo "             of shape and congest: ROBOT=R3 DIRECTION=up|down|both DURATION=60s;"
	@echo "             of train: CONFIG=factory|road; of data: DATA_URL=repository DATA_COMMIT= DATA_TREE="

setup: ## Make .venv and install what the swarm needs (EXTRA=llm: an embedded model, too)
	@EXTRA='$(EXTRA)' sh deploy/setup.sh

data: setup ## Bring the public OPV2V sample to var/data (229 MB), for WORLD=opv2v and the tests
	@$(COADAPT) data $(if $(DATA_URL),--url '$(DATA_URL)') $(if $(DATA_COMMIT),--commit '$(DATA_COMMIT)') \
		$(if $(DATA_TREE),--tree '$(DATA_TREE)') $(ARGS)

up: setup ## Start a swarm: router, robots, ego, console (localhost:8080), Prometheus
	@$(COADAPT) up --swarm $(SWARM) $(if $(ROBOTS),--robots $(ROBOTS)) $(if $(WORLD),--world $(WORLD)) \
		$(if $(RUNTIME),--runtime $(RUNTIME)) $(if $(EGOS),--egos $(EGOS)) $(if $(EGO_STANDBY),--ego-standby $(EGO_STANDBY)) \
		$(if $(POLICY),--policy $(POLICY)) $(if $(LLM),--llm '$(LLM)') \
		$(if $(MODEL),--llm-model '$(MODEL)') $(if $(DATA),--data $(DATA)) $(if $(LINK),--link $(LINK)) \
		$(if $(GRAFANA),--grafana) $(if $(filter 0,$(SECURE)),--no-secure,$(if $(SECURE),--secure)) \
		$(if $(LISTEN),--listen $(LISTEN)) $(if $(WORLD_ROBOTS),--world-robots $(WORLD_ROBOTS)) $(ARGS)

down: setup ## Stop it and leave nothing behind
	@$(COADAPT) down --swarm $(SWARM)

list: setup ## Show your swarms on this machine
	@$(COADAPT) list $(ARGS)

status: setup ## Show robots, decision, bytes and link
	@$(COADAPT) status --swarm $(SWARM) $(ARGS)

logs: setup ## Show the processes' logs (ARGS='ego-R1 --follow')
	@$(COADAPT) logs --swarm $(SWARM) $(ARGS)

metrics: setup ## Show Prometheus' targets, alerts and key figures
	@$(COADAPT) metrics --swarm $(SWARM)

shape: setup ## Give a link RATE=5mbit or a PROFILE (see the variables)
	@$(COADAPT) net shape --swarm $(SWARM) $(if $(RATE),--rate '$(RATE)') \
		$(if $(PROFILE),--profile '$(PROFILE)') $(if $(TRACE),--trace '$(TRACE)') \
		$(if $(TIME_SCALE),--time-scale '$(TIME_SCALE)') $(if $(ROBOT),--robot '$(ROBOT)') \
		$(if $(DIRECTION),--direction '$(DIRECTION)') $(if $(DURATION),--for '$(DURATION)') $(ARGS)

congest: setup ## Send competing telemetry, at RATE or 85 % of the link
	@$(COADAPT) net congest --swarm $(SWARM) $(if $(RATE),--rate '$(RATE)') \
		$(if $(ROBOT),--robot '$(ROBOT)') $(if $(DURATION),--for '$(DURATION)') $(ARGS)

net: setup ## Show the shapes in force and what links carry
	@$(COADAPT) net show --swarm $(SWARM) $(ARGS)

record: setup ## Record the swarm as MCAP for Foxglove and for WORLD=recording (ARGS='--seconds 30 --live')
	@$(COADAPT) record --swarm $(SWARM) $(ARGS)

test: setup ## Run the tests that need neither root, data nor a model; build/test.json says how it went
	@OMP_NUM_THREADS=1 $(PYTHON_ENV) -m pytest $(PARALLEL) -m 'not data and not model and not slow' --summary=build/test.json $(ARGS)

FIRST_HOUR = --first-hour=build/first_hour.json

test-all: setup ## Run all tests: also in namespaces, Docker and a browser, on real data, with a model
	@rm -f build/first_hour.json
	@OMP_NUM_THREADS=1 $(PYTHON_ENV) -m pytest $(PARALLEL) --summary=build/test-swarm.json $(FIRST_HOUR) tests/unit tests/swarm $(ARGS); \
		first=$$?; $(PYTHON_ENV) -m pytest --summary=build/test-system.json $(FIRST_HOUR) tests/system $(ARGS) && exit $$first

lint: setup ## Check style and formatting
	@$(PYTHON_ENV) -m ruff check .
	@$(PYTHON_ENV) -m ruff format --check .

types: setup ## Check types
	@$(PYTHON_ENV) -m mypy

check: lint types test ## Everything that must be green before a commit

bench: EXTRA = llm
bench: setup ## Run all benchmarks (BENCHMARKS='sam codec': those); each writes build/bench/<name>.json
	@$(PYTHON_ENV) -m research.benchmarks $(BENCHMARKS)

train: setup ## Train a detector (CONFIG=road ARGS='--device cuda'); again: goes on
	@$(COADAPT) train --config $(CONFIG) $(ARGS)

eval-detector: setup ## Measure every fusion algorithm: build/eval/detector.json
	@$(COADAPT) eval-detector $(ARGS)

train-llm: EXTRA = llm
train-llm: setup ## Train the small model on wishes and decisions (ARGS='--device cuda'): build/train-llm/adapter.gguf
	@$(PYTHON_ENV) -m research.training.wishes.train $(ARGS)

eval-llm: EXTRA = llm
eval-llm: setup ## Measure how wishes are understood and decisions made (MODEL=name@http://host:port/v1): build/eval/wishes.json, llm.json
	@$(PYTHON_ENV) -m research.evaluation.wishes $(if $(MODEL),--model $(MODEL)) $(ARGS)
	@$(PYTHON_ENV) -m research.evaluation.decisions.run $(or $(MODEL),smollm2-135m)

chaos: setup ## Play faults on a real swarm (ARGS='--seed 7 --minutes 60'): build/chaos.json
	@$(PYTHON_ENV) -m research.chaos $(ARGS)

eval: setup ## Compare all policies (DATA=dir: on a recorded world; LIVE=1: in a swarm): build/eval/
	@$(COADAPT) eval $(if $(LIVE),live,policies $(if $(DATA),--data $(DATA))) $(ARGS)
	@$(if $(LIVE)$(DATA)$(ARGS),true,$(COADAPT) eval driven && $(COADAPT) eval ways)

pictures: setup ## Make the documents' pictures anew (DATA=dir: that of OPV2V, too)
	@$(PYTHON_ENV) -m research.benchmarks.pictures
	@$(COADAPT) picture factory --seed 1000008 --frame 700 --ego R3 --algorithm intermediate-sparse \
		--output docs/pictures/factory.svg
	@$(COADAPT) picture road --seed 1000001 --frame 10 --algorithm intermediate-codebook \
		--output docs/pictures/road.svg
	@$(if $(DATA),$(COADAPT) picture opv2v --data $(DATA) --frame 4 --ego 311 --only-found \
		--algorithm intermediate-codebook --output docs/pictures/opv2v.svg)

sbom: setup ## List what is installed, with licences, as CycloneDX: build/sbom.json
	@$(PYTHON_ENV) -m research.sbom $(ARGS)

fuzz: setup ## Fuzz what reads bytes of others: build/fuzz.json (ARGS='--seconds 600 --target points')
	@$(PYTHON_ENV) -m research.fuzz $(ARGS)

docs: setup ## Build the API reference from docstrings: build/docs/index.html
	@$(PYTHON_ENV) -W error::UserWarning -m pdoc --docformat google --no-show-source --output-directory build/docs $(DOCUMENTED)

lock: setup ## Pin the newest versions that pyproject.toml allows
	@sh deploy/lock.sh

clean: ## Remove what was built (not var/)
	@rm -rf build .pytest_cache .mypy_cache .ruff_cache
