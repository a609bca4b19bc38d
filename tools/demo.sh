#!/bin/sh
# Enrol three actions, classify a known and an unknown clip. Usage: demo.sh FOLDER_OF_ACTIONCLI
set -eu
PATH="$(cd "$1" && pwd):$PATH"
cd "$(dirname "$0")/.."

# A support set of its own, thrown away at the end.
ACTIONCLI_HOME=$(mktemp -d)
export ACTIONCLI_HOME
trap 'rm -rf "$ACTIONCLI_HOME"' EXIT

run() {
    printf '\n$ %s\n' "$*"
    "$@"
}

echo "Synthetic clips from examples/; the support set lies in $ACTIONCLI_HOME for the while."
run actioncli enroll wave_right examples/wave_right/ada.npz
run actioncli enroll squat examples/squat/ada.npz
run actioncli enroll jumping_jack examples/jumping_jack/ada.npz
run actioncli list-support

echo
echo "A child waves, whom the tool has not seen; waving was enrolled:"
run actioncli classify examples/wave_right/cleo.npz || {
    echo "The wave should have been accepted." >&2
    exit 1
}

echo
echo "A tall man bows; nobody enrolled bowing (exit code 1 says rejected):"
status=0
run actioncli classify examples/bow/ben.npz || status=$?
if [ "$status" -ne 1 ]; then
    echo "The bow should have been rejected with exit code 1, not $status." >&2
    exit 1
fi
