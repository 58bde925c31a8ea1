#!/usr/bin/env bash
# Repeat the tests over DDS: test_ring.py RING times, every other test under tests/ros OTHERS times.
# Counts what failed, and keeps its last words.
#   tests/ros/repeat.sh [RING [OTHERS]]
set -u
cd "$(dirname "$0")/../.."
python=${PYTHON:-.venv/bin/python}
failed=0
repeat() {  # times, files and options
    local times=$1 bad=0
    shift
    for ((k = 1; k <= times; k++)); do
        timeout 1800 "$python" -m pytest -q -m ros "$@" >"${TMPDIR:-/tmp}/repeat.log" 2>&1 || {
            bad=$((bad + 1))
            cp "${TMPDIR:-/tmp}/repeat.log" "${TMPDIR:-/tmp}/repeat.failed.$k.log"
        }
    done
    echo "$*: $((times - bad)) of $times passed"
    failed=$((failed + bad))
}
repeat "${1:-50}" tests/ros/test_ring.py
repeat "${2:-10}" tests/ros --ignore tests/ros/test_ring.py
exit $((failed > 0))
