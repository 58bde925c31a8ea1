"""Run a pip command: show how far it is, and say in one line what could not be reached.

    .venv/bin/python .ci/pip_progress.py .venv/bin/pip install -r requirements.txt

On a terminal a single line changes, in a log there is a line per 20 packages. What pip says of its
attempts to reach a server is left out, that a folder of packages is missing is said once; any other
warning and error of pip is shown as it is. The exit code is that of pip.
"""

import contextlib
import itertools
import os
import re
import subprocess
import sys
import sysconfig
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import urlsplit

STEP = 20  # packages between two lines of a log
POLL_S = 1.0  # between two looks at what is unpacked
LOCAL = './'  # how the folder of a package is given
# why a server was not reached, in what pip prints before it tries again
RETRY = re.compile(r'WARNING: Retrying \(Retry\(total=(\d+)')
REASONS = (
    re.compile(r'\[Errno -?\d+\] ([^\'")]+)'),
    re.compile(r'((?:Read|Connect|connection) timed out|SSL: \w+|Cannot connect to proxy)', re.I),
    re.compile(r'broken by [\'"](\w+)'),
)
# once for each package; those that are there already are named again for each that needs them
PACKAGE = re.compile(
    r'(?:(?:Collecting|Processing)|Requirement already satisfied:(?=.*\(from -r)) (\S+)'
)
DOWNLOAD = re.compile(r'\s+Downloading \S+ \(([0-9.]+) (kB|MB|GB)\)')
# what pip says where it reached no server: of a package that it looked for, of one that it fetched
NOT_FOUND = re.compile('ERROR: (No matching distribution|Could not find a version)')
NOT_FETCHED = re.compile('Max retries exceeded|timed out|[Cc]onnection')
# of a pip that is set up with folders: one for every package, where there is no such folder
NO_FOLDER = re.compile("WARNING: Location '.*' is ignored: it is neither a file nor a directory")
IN_MB = {'kB': 1e-3, 'MB': 1.0, 'GB': 1e3}


class Display:
    """One line that changes on a terminal, a few lines in a log."""

    def __init__(self, is_terminal: bool):
        self._is_terminal = is_terminal
        self._lock = threading.Lock()
        self._open = False

    def show(self, text: str, in_log: bool) -> None:
        """Show how far it is; in a log only what is worth a line."""
        with self._lock:
            if self._is_terminal:
                print(f'\r      {text:<70.70}', end='', flush=True)
                self._open = True
            elif in_log:
                print(f'      {text}'.rstrip(), flush=True)

    def say(self, text: str) -> None:
        """Print a line that stays."""
        with self._lock:
            self._close()
            print(text, file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the line that changes."""
        with self._lock:
            self._close()

    def _close(self):
        if self._open:
            print(flush=True)
            self._open = False


class Progress:
    """What pip is doing, from the lines that it prints."""

    def __init__(self, total: int, display: Display):
        self._total, self._display = total, display
        self._count, self._megabytes, self._name = 0, 0.0, ''
        self._installed = threading.Event()
        self._poll: threading.Thread | None = None

    def read(self, line: str) -> None:
        """Take a line of pip's standard output."""
        words = line.split()
        if package := PACKAGE.match(line):
            self._count += 1
            self._name = re.split(r'==|-\d', os.path.basename(package[1]))[0]
            self._show(self._count % STEP == 0)
        elif download := DOWNLOAD.match(line):
            self._megabytes += float(download[1]) * IN_MB[download[2]]
            self._show(False)
        elif line.startswith('Building wheel') and len(words) > 3:
            name = words[3]
            self._display.show(f'building {name}', False)
        elif line.startswith('Installing collected packages'):
            self._unpack(len(line.partition(':')[2].split(',')))

    def close(self) -> None:
        """End what watches."""
        self._installed.set()
        if self._poll is not None:
            self._poll.join()
        self._display.close()

    def _show(self, in_log):
        size = f'  {self._megabytes:.0f} MB' if self._megabytes else ''
        self._display.show(f'{self._count:3d} of {self._total}  {self._name}{size}', in_log)

    def _unpack(self, total):
        self._display.show(f'unpacking {total} packages', True)
        # pip is silent until the last one is there
        before = count_installed()
        watch = threading.Thread(target=self._watch, args=(before, total), daemon=True)
        self._poll = watch
        watch.start()

    def _watch(self, before, total):
        while not self._installed.wait(POLL_S):
            done = min(max(count_installed() - before, 0), total)
            self._display.show(f'unpacking {done} of {total}', False)


class Complaints:
    """What pip prints as warnings and errors."""

    def __init__(self, display: Display):
        self._display = display
        self._errors: list[str] = []
        self._reason = ''
        self._gave_up = False
        self._told_folder = False
        self._not_fetched = False  # whether an error tells of a connection

    def read(self, line: str) -> None:
        """Take a line of pip's standard error."""
        retry = RETRY.match(line)
        if retry:
            self._note(line, int(retry[1]))
        elif line.startswith('ERROR: '):
            self._errors.append(line)
            self._not_fetched |= bool(NOT_FOUND.match(line) or NOT_FETCHED.search(line))
        elif NO_FOLDER.match(line):
            if not self._told_folder:
                self._display.say(f'      {line} (once for all packages)')
            self._told_folder = True
        else:
            # with the lines of a traceback
            self._not_fetched |= bool(NOT_FETCHED.search(line))
            self._display.say(line)

    def _note(self, line, left):
        is_first = not self._reason
        matches = (reason.search(line) for reason in REASONS)
        self._reason = next((match[1].strip() for match in matches if match), 'no connection')
        self._gave_up = self._gave_up or left == 0
        if is_first:
            self._display.say(f'      no answer from {index_host()} ({self._reason}): trying again')

    def describe_end(self, code: int) -> list[str]:
        """Return what to print after pip ended with a code: its errors, or what they come from."""
        if not (code and self._gave_up and self._not_fetched):
            return self._errors
        others = [line for line in self._errors if not NOT_FOUND.match(line)]
        return [
            *others,
            f'error: could not reach {index_host()} ({self._reason}), where the packages come '
            'from: connect to the network (behind a proxy set HTTPS_PROXY, for a mirror '
            'PIP_INDEX_URL), then give the same command again',
        ]


def index_host() -> str:
    """Return the name of the server of packages, without what a user may have put before it."""
    url = os.environ.get('PIP_INDEX_URL', '')
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        asked = [sys.executable, '-m', 'pip', 'config', 'get', 'global.index-url']
        answer = subprocess.run(asked, capture_output=True, text=True, timeout=30)
        if not url and answer.returncode == 0:
            url = answer.stdout.strip()
    return urlsplit(url).hostname or 'the package index'


def count_installed() -> int:
    """Return how many packages this Python has."""
    return len(list(Path(sysconfig.get_paths()['purelib']).glob('*.dist-info')))


def count_wanted(command: Sequence[str]) -> int:
    """Return how many packages a pip command installs, those of other Pythons left out."""
    folders = sum(word.startswith(LOCAL) for word in command)
    lists = [Path(file) for option, file in itertools.pairwise(command) if option == '-r']
    wanted = [line for file in lists for line in file.read_text().splitlines() if '==' in line]
    return folders + sum(map(is_for_this_python, wanted))


def is_for_this_python(line: str) -> bool:
    """Return whether the condition behind a requirement holds here."""
    condition = line.partition(';')[2].strip()
    if not condition:
        return True
    try:
        from pip._vendor.packaging.markers import Marker
    except ImportError:
        return True
    return Marker(condition).evaluate({'extra': ''})


def main(command: Sequence[str]) -> int:
    """Run the command; return its exit code."""
    display = Display(sys.stdout.isatty())
    progress, complaints = Progress(count_wanted(command), display), Complaints(display)
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors='replace'
    )
    other = threading.Thread(target=_read_all, args=(process.stderr, complaints.read))
    other.start()
    try:
        _read_all(process.stdout, progress.read)
        code = process.wait()
        other.join()
    finally:
        progress.close()
    for line in complaints.describe_end(code):
        print(line, file=sys.stderr)
    return code


def _read_all(lines, take: Callable[[str], None]):
    for line in lines:
        take(line.rstrip('\n'))


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
