# make demo    install actioncli in .venv-demo and take its tour
# make test    install it for development in .venv; format, lint, types, tests
# make nightly the tests that take minutes or hours
# make fuzz    look for files that readers cannot take, FUZZ_SECONDS (an hour) for each reader
# make bench   time it (see tests/benchmarks)
# make dist    archives, SBOM and licences for a release
# make docs    build the documentation as a site, in site/, to be opened from there
# make clean   remove all that these made
#
# Needs Python 3.11 or newer with its venv module; PYTHON=... picks another one than is found.

ifndef PYTHON
PYTHON := $(shell for p in python3.11 python3.12 python3.13 python3.14 python3 python; do \
	$$p -c 'import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
	&& echo $$p && break; done)
endif

PIP_INSTALL := -m pip install --quiet --disable-pip-version-check

.PHONY: demo test nightly fuzz bench dist docs clean
.DEFAULT_GOAL := test

demo: .venv-demo/installed
	@.venv-demo/bin/actioncli tour

test: .venv/installed
	.venv/bin/ruff format --check .
	.venv/bin/ruff check .
	.venv/bin/mypy
	OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n auto --maxprocesses 4

# Every test, the slow ones too, with coverage; property tests with more examples; mutants of what
# decides; old and new versions.
# Ray gives up where it does not start within half a minute: its tests run alone.
nightly: .venv/release
	OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n auto --maxprocesses 4 -m 'nightly or not nightly' \
		--ignore tests/cli/test_batch.py --cov --cov-fail-under 0
	OMP_NUM_THREADS=1 .venv/bin/python -m pytest -m 'nightly or not nightly' tests/cli/test_batch.py \
		--cov --cov-append
	PROPERTY_TIMES=20 OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n auto --maxprocesses 4 -m hypothesis
	rm -rf mutants && OMP_NUM_THREADS=1 .venv/bin/mutmut run
	! .venv/bin/mutmut results | grep -v killed
	sh tools/matrix.sh .venv-matrix

FUZZ_SECONDS ?= 3600
fuzz: .venv/installed
	FUZZ_SECONDS=$(FUZZ_SECONDS) OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n auto --maxprocesses 4 tests/fuzz

# What is uploaded: both archives, the licences of what a user installs with them, and an SBOM.
dist: .venv/release .venv-demo/installed
	rm -rf build dist
	.venv/bin/python -m build
	.venv/bin/cyclonedx-py environment --pyproject pyproject.toml -o dist/actioncli.cdx.json \
		.venv-demo/bin/python
	{ printf '# Licences\n\nWhat a user installs:\n\n'; $(LICENCES) .venv-demo/bin/python; \
		printf '\nWhat development installs, all extras included:\n\n'; \
		$(LICENCES) .venv/bin/python; } > THIRD_PARTY.md
LICENCES = .venv/bin/pip-licenses --format markdown --with-urls --no-version \
	--ignore-packages actioncli pip setuptools --python

docs: .venv/installed
	NO_MKDOCS_2_WARNING=1 .venv/bin/python -m mkdocs build --strict --quiet
	@echo "Open site/index.html."

bench: .venv/installed
	.venv/bin/python tests/benchmarks/startup.py
	.venv/bin/python tests/benchmarks/query.py
	.venv/bin/python tests/benchmarks/size.py
	.venv/bin/python tests/benchmarks/batch.py
	.venv/bin/python tests/benchmarks/training.py
	.venv/bin/python tests/benchmarks/video.py

clean:
	rm -rf .venv .venv-demo .venv-matrix build dist site mutants actioncli.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .fuzz

# `installed` is written last and removed first: an environment without it was left half made, and
# is made anew.
define environment
	@[ -n "$(PYTHON)" ] || { echo "No Python 3.11 or newer with venv was found: install one, or add" \
		"PYTHON=/path/to/python." >&2; exit 1; }
	@[ -e $@ ] && $(@D)/bin/python -c '' || { echo "Making $(@D) with $(PYTHON)"; \
		$(PYTHON) -m venv --clear $(@D); }
	@rm -f $@
endef

# Tests run against the checkout.
.venv/installed: pyproject.toml
	$(environment)
	@echo "Installing the checkout and its development tools in .venv; torch makes this long, once."
	.venv/bin/python $(PIP_INSTALL) --editable '.[dev]'
	@sh tools/install_chromium.sh
	@touch $@

.venv/release: .venv/installed
	.venv/bin/python $(PIP_INSTALL) --editable '.[release]'
	@touch $@

# The demo runs what a user gets.
.venv-demo/installed: pyproject.toml $(shell find actioncli examples weights -type f -not -name '*.pyc')
	$(environment)
	@echo "Installing actioncli in .venv-demo; this downloads about 100 MB, once."
	@rm -rf build
	.venv-demo/bin/python $(PIP_INSTALL) .
	@touch $@
