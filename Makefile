# Every target sets up what it needs in .venv by itself.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
FILE ?=
# Leave the service of the demo running, to look at its results: make demo OPEN=1
OPEN ?=
# The quick table of truth; its kept values for docs/truth.md; some of its rows: make truth ONLY="fit codec"
QUICK ?=
MARKDOWN ?=
# Which benchmarks; all of them by default: make bench ONLY="tradeoff codec"
ONLY ?=
# The compiled library is made when the package is installed.
SETUP := pyproject.toml constraints.txt tools/compile_library.py $(wildcard core/modalmotion/*/native/*.[ch])
# Three processes on two cores, for tests wait too: for services, workers, a browser.
SPREAD := -n 3 --dist loadfile --no-loadscope-reorder
# One thread for each process: threads of all would wait for one another. The tests start some hundred
# processes, each of which would compile all modules anew where bytecode is not kept.
LEAN := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

.PHONY: site sbom demo serve aarch64 view viewer wasm wheels test check format truth mutants bench soak openapi clean
.DEFAULT_GOAL := test

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or later is needed, this is " + sys.version.split()[0]) if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: $(SETUP) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[all]'
	@touch $@

$(VENV)/.dev: $(SETUP) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[service,plot,client,cluster,tables,notebook,browser,dev]'
	@touch $@ $(VENV)/.run

$(VENV)/.bench: $(VENV)/.dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]'
	@touch $@

demo: $(VENV)/.run
	$(BIN)/python tools/demo.py $(if $(OPEN),--open) $(if $(FILE),"$(FILE)")

# The same, and the service stays: look at the surface in a browser.
view: $(VENV)/.run
	$(BIN)/python tools/demo.py --open $(if $(FILE),"$(FILE)")

serve: $(VENV)/.run
	$(BIN)/modalmotion serve

test: $(VENV)/.dev
	$(LEAN) $(BIN)/python -m pytest $(SPREAD) -m "not soak and not thorough"

check: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m modalmotion_service.commands.openapi --check openapi/openapi.json

format: $(VENV)/.dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# What users get, beside what is kept in benchmarks/truth.toml; QUICK=1 takes at most 90 s.
truth: $(VENV)/.dev
	$(LEAN) $(BIN)/python benchmarks/truth.py $(if $(QUICK),--quick) $(if $(ONLY),--only $(ONLY)) $(if $(MARKDOWN),--markdown > docs/truth.md)

# Which rows of that table notice that the product is broken.
mutants: $(VENV)/.dev
	$(LEAN) $(BIN)/python benchmarks/mutate.py $(if $(ONLY),--only $(ONLY))

bench: $(VENV)/.bench
	$(BIN)/python benchmarks/run.py $(ONLY)

# All three parts, whatever one of them finds.
soak: $(VENV)/.dev
	@failed=0; \
	$(LEAN) $(BIN)/python -m pytest $(SPREAD) -m "thorough and not soak" || failed=1; \
	$(LEAN) $(BIN)/python -m pytest $(SPREAD) -m "soak and not alone" || failed=1; \
	$(BIN)/python -m pytest -m "soak and alone" || failed=1; \
	exit $$failed

# The bundle of the viewer from its sources, in viewer/; needs node and npm.
viewer:
	cd viewer && npm ci --silent --no-fund --no-audit && npm run --silent build

# For five kinds of machines from this one, and the sources, in dist/; each twice, to the same bytes.
wheels: $(VENV)/.wheels
	$(VENV)/wheels/bin/python tools/wheels.py

# The wheel for aarch64 in an aarch64 Python, emulated: the same bits. Needs Debian.
aarch64: $(VENV)/.run $(VENV)/.wheels
	tools/aarch64.sh

# The decoder that pages hold, from the library's sources.
wasm: $(VENV)/.wheels
	$(VENV)/wheels/bin/python tools/compile_library.py wasm32

$(VENV)/.wheels: constraints.txt | $(BIN)/python
	$(BIN)/python -m venv $(VENV)/wheels
	$(VENV)/wheels/bin/pip install --quiet --disable-pip-version-check -c constraints.txt hatchling ziglang lief
	@touch $@

# What the package with the extra `all` installs, with licences, and what the viewer contains, as CycloneDX.
sbom: | $(BIN)/python
	rm -rf $(VENV)/installed $(VENV)/sbom
	$(BIN)/python -m venv $(VENV)/sbom
	$(VENV)/sbom/bin/pip install --quiet --disable-pip-version-check -c constraints.txt cyclonedx-bom
	$(BIN)/python -m venv --without-pip $(VENV)/installed
	$(BIN)/pip --python $(VENV)/installed/bin/python install --quiet --disable-pip-version-check -c constraints.txt '.[all]'
	mkdir -p dist
	$(VENV)/sbom/bin/python tools/sbom.py $(VENV)/installed/bin/python dist

# The site in site/ of the sources in docs/; every example of the gallery runs. It opens from disk.
site: $(VENV)/.site
	MPLBACKEND=Agg $(BIN)/python -m sphinx --fail-on-warning --keep-going -b html docs site

$(VENV)/.site: $(SETUP) | $(VENV)/.run
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[service,plot,client,images,docs]'
	@touch $@

openapi: $(VENV)/.dev
	$(BIN)/python -m modalmotion_service.commands.openapi openapi/openapi.json

clean:
	rm -rf $(VENV) core/modalmotion/_native dist demo-output bench-output
