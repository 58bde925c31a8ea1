"""Small shell programs in place of the nodes, which fail in the way that a test needs."""

from contextlib import suppress
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


def left_over(folder, word=''):
    """Return the running processes that log below a folder: their commands, with `word`, by id."""
    commands = {}
    for process in Path('/proc').glob('[0-9]*'):
        with suppress(OSError):
            command = (process / 'cmdline').read_bytes().decode(errors='replace')
            is_ours = f'ROS_LOG_DIR={folder}'.encode() in (process / 'environ').read_bytes()
            if is_ours and word in command:
                commands[int(process.name)] = command
    return commands
