# make demo    a photo in triangles, in out/triangulation
# make test    the tests         make fast    without the slow ones         make thorough    with the longest ones
# make bench   measurements      make lint    format, ruff, mypy
# make docs    the pages as a site with search, in out/docs; a warning is an error
# make fuzz    random programs against references of their own (N=5000; goes on where it was interrupted)
# make chart   the charts and the tables of docs/lean.md, docs/integration.md and docs/estimators.md, minutes; what is there already is kept (make chart FRESH=--fresh)
#
# The first of them creates .venv with the project (editable) and all extras. Another Python: make test PYTHON=python3.12

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
OUT := out/triangulation
N ?= 300
PARALLEL := -n auto --dist worksteal
export PYTHONDONTWRITEBYTECODE :=  # programs that tests start would compile the modules of teg again, each of them

.PHONY: demo test thorough fast fuzz bench chart docs lint
.DELETE_ON_ERROR:

demo: $(READY)
	$(BIN)/teg demo triangulation -o $(OUT)
	@echo "look at $(OUT)/before.png, $(OUT)/after.png and $(OUT)/loss.png"

test: $(READY)
	$(BIN)/python -m pytest $(PARALLEL) -m "not thorough"

thorough: $(READY)
	TEG_EXAMPLES=4 XLA_FLAGS= $(BIN)/python -m pytest $(PARALLEL)

fast: $(READY)
	$(BIN)/python -m pytest $(PARALLEL) -m "not slow"

fuzz: $(READY)
	$(BIN)/python -m tests.fuzz.run -n $(N) -o out/fuzz

bench: $(READY)
	$(BIN)/python tests/bench/run.py --page docs/performance.md

chart: $(READY)
	$(BIN)/teg chart lean -o docs/lean --page docs/lean.md --backend c $(FRESH)
	$(BIN)/teg chart stability -o docs/integration --page docs/integration.md $(FRESH)
	$(BIN)/teg chart integration -o docs/integration --page docs/integration.md $(FRESH)
	$(BIN)/teg chart estimators -o docs/estimators --page docs/estimators.md $(FRESH)
	$(BIN)/teg chart descents -o docs/estimators --page docs/estimators.md $(FRESH)
	$(BIN)/teg report stability -o docs/estimators --page docs/estimators.md --backend numpy $(FRESH)

docs: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[docs]'
	$(BIN)/python -m sphinx --fail-on-warning --fresh-env --quiet docs out/docs
	@echo "open out/docs/index.html"

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

$(READY): pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e '.[all]'  # a module is compiled when it is imported
	@touch $@
