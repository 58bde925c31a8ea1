"""A dask.distributed cluster of processes on the loopback interface, to be killed one by one."""

import json
import os
import subprocess
import sys
from pathlib import Path

from wait_until import wait_until

START_S = 120.0  # of a scheduler, on a busy machine
MODULES = ':'.join(filter(None, sys.path))


class Cluster:
    """A context: a scheduler at `address`, and the workers that are started."""

    def __init__(self, folder: Path):
        folder.mkdir()
        self.folder, self.workers = folder, []

    def __enter__(self):
        facts = self.folder / 'scheduler.json'
        self.scheduler = self._start('scheduler', '--port', '0', '--scheduler-file', facts)

        def is_there():
            return facts.exists() and facts.read_text().endswith('}')

        wait_until(is_there, START_S, self._log('scheduler').read_text)
        self.address = json.loads(facts.read_text())['address']
        return self

    def __exit__(self, *error):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def start_worker(self, *options: str) -> subprocess.Popen:
        """Start a worker with a thread and without a nanny, unless the options say otherwise."""
        options = options or ('--no-nanny',)
        own = ('--nthreads', '1', '--local-directory', self.folder)
        self.workers.append(self._start('worker', self.address, *own, *options))
        return self.workers[-1]

    def _start(self, what, *options):
        command = [sys.executable, '-m', f'distributed.cli.dask_{what}', *map(str, options)]
        with self._log(what).open('a') as log:
            return subprocess.Popen(
                [*command, '--host', '127.0.0.1', '--no-dashboard'],
                stdout=log,
                stderr=log,
                env=os.environ | {'PYTHONPATH': MODULES},
            )

    def _log(self, what):
        return self.folder / f'{what}.log'
