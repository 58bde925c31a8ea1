#!/usr/bin/env bash
# Repeat the tests over DDS: test_node_graph.py GRAPH times, every other test under tests/ros OTHERS times.
# Counts what failed, and keeps its logs in a new folder of TMPDIR, by series and number.
#   tests/ros/repeat.sh [GRAPH [OTHERS]]
set -u
cd "$(dirname "$0")/../.."
python=${PYTHON:-.venv/bin/python}
logs=$(mktemp -d "${TMPDIR:-/tmp}/repeat.XXXXXX")
failed=0
repeat() {  # series, times, files and options
    local series=$1 times=$2 bad=0
    shift 2
    for ((k = 1; k <= times; k++)); do
        local log=$logs/$series.$k.log
        if timeout 1800 "$python" -m pytest -q -m ros "$@" >"$log" 2>&1; then
            rm "$log"
        else
            bad=$((bad + 1))
        fi
    done
    echo "$*: $((times - bad)) of $times passed"
    failed=$((failed + bad))
}
repeat node_graph "${1:-50}" tests/ros/test_node_graph.py
repeat others "${2:-10}" tests/ros --ignore tests/ros/test_node_graph.py
rmdir "$logs" 2>/dev/null || echo "logs of what failed: $logs"
exit $((failed > 0))
