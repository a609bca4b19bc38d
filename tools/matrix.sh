#!/bin/sh
# The tests on the oldest versions that pyproject.toml allows, and on the newest Python there is.
# Usage: matrix.sh FOLDER, which then holds an environment of each. OLDEST and NEWEST name the
# Pythons; the newest one runs without torch, of which only one version is allowed anyway.
set -eu
work=$(mkdir -p "$1" && cd "$1" && pwd)
cd "$(dirname "$0")/.."
OLDEST=${OLDEST:-python3.11}
if [ -z "${NEWEST:-}" ]; then
	for NEWEST in python3.14 python3.13 python3.12 python3.11; do
		"$NEWEST" -c 'import ensurepip' 2>/dev/null && break
	done
fi
testing="axe-playwright-python build hypothesis playwright pytest pytest-xdist setuptools>=77"

tests() {
	PYTHONPATH=. OMP_NUM_THREADS=1 "$@" -m pytest -n auto --maxprocesses 4 -p no:cacheprovider
}

echo "Oldest: $OLDEST"
"$OLDEST" -m venv "$work/oldest"
# shellcheck disable=SC2046,SC2086  # one word a requirement
"$work/oldest/bin/python" -m pip install --quiet $("$OLDEST" tools/lower_bounds.py) $testing
"$work/oldest/bin/python" -m pip install --quiet --no-deps --editable .
tests "$work/oldest/bin/python"
# Ray gives up where it does not start within half a minute: its tests run alone.
PYTHONPATH=. OMP_NUM_THREADS=1 "$work/oldest/bin/python" -m pytest -p no:cacheprovider -m nightly \
	tests/cli/test_batch.py

echo "Newest: $NEWEST"
"$NEWEST" -m venv "$work/newest"
# shellcheck disable=SC2086
"$work/newest/bin/python" -m pip install --quiet --upgrade --editable '.[report,studio]' $testing
tests "$work/newest/bin/python"
