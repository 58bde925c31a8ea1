#!/usr/bin/env bash
# Repeat the tests over DDS: the ring RING times, the others OTHERS times. Counts what failed.
#   tests/ros/repeat.sh [RING [OTHERS]]
set -u
cd "$(dirname "$0")/../.."
python=${PYTHON:-.venv/bin/python}
failed=0
repeat() {  # times, files and options
    local times=$1 bad=0
    shift
    for ((k = 1; k <= times; k++)); do
        timeout 900 "$python" -m pytest -q "$@" >"${TMPDIR:-/tmp}/repeat.log" 2>&1 || {
            bad=$((bad + 1))
            cp "${TMPDIR:-/tmp}/repeat.log" "${TMPDIR:-/tmp}/repeat.failed.$k.log"
        }
    done
    echo "$*: $((times - bad)) of $times passed"
    failed=$((failed + bad))
}
repeat "${1:-50}" tests/ros/test_ring.py
repeat "${2:-10}" tests/ros/test_lives.py tests/ros/test_parameters_at_run_time.py
exit $((failed > 0))
