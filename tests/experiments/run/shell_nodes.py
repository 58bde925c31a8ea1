"""Small shell programs in place of the nodes, which fail in the way that a test needs."""

from pathlib import Path

WAIT = 'trap "exit 0" INT; while :; do sleep 0.05; done\n'
RECORD = """out=$(sed -n 's/^ *out: //p' "$last")
trap 'mkdir -p "$out"; touch "$out/metadata.yaml"; exit 0' INT
touch "${last%/*}/recording"
while :; do sleep 0.05; done
"""
# beside the parameter file, the last argument
AWAIT_RECORDER = 'until [ -e "${last%/*}/recording" ]; do sleep 0.05; done\n'
NODES = {
    'bags/recorder_node': RECORD,
    'scenario_publisher/scenario_node': WAIT,
    'mpcc_controller/controller_node': WAIT,
    'vehicle_plant/plant_node': AWAIT_RECORDER
    + 'echo "[INFO] [1.5] [plant]: finish line crossed"; sleep 0.5\n',
}


def left_over(folder):
    """Return the running processes that log below a folder."""
    wanted = f'ROS_LOG_DIR={folder}'.encode()
    found = []
    for process in Path('/proc').glob('[0-9]*'):
        try:
            if wanted in (process / 'environ').read_bytes():
                found.append((process / 'cmdline').read_bytes())
        except OSError:
            continue
    return found
