"""A process that simulates one draw after the other: it may hang or crash without harm."""

import json
import queue
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

PROGRAM = Path(__file__).with_name('drive_draws.py')
# s of wall time: a drive takes one or two, the first of a controller compiles its solver
LIMIT_S = 240.0


class Driver:
    """Simulates the draws of a series; a process that hangs or crashes gives a finding."""

    def __init__(self, seed: int):
        self.seed = seed
        self._process = None
        self._lines = None

    def drive(self, index: int) -> dict[str, Any]:
        """Return the result of `drive_draws.check` for a draw, or a finding without a result."""
        if self._process is None:
            self._start()
        self._process.stdin.write(f'{index}\n')
        self._process.stdin.flush()
        try:
            line = self._lines.get(timeout=LIMIT_S)
        except queue.Empty:
            self.end()
            return {'index': index, 'findings': [f'no end after {LIMIT_S:g} s']}
        if line is None:
            code = self._process.wait()
            self.end()
            return {'index': index, 'findings': [f'the process ended with code {code}']}
        return json.loads(line)

    def end(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def _start(self):
        self._process = subprocess.Popen(
            [sys.executable, str(PROGRAM), '--seed', str(self.seed)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._lines = queue.Queue()
        arguments = self._process.stdout, self._lines
        threading.Thread(target=_forward, args=arguments, daemon=True).start()


def _forward(stream, lines):
    for line in stream:
        lines.put(line)
    lines.put(None)
