"""A Markdown page whose blocks a reader runs in order, and the folder in which they run.

A comment directly above a fenced block says what it is:

    <!-- file: NAME -->            the text of the file NAME
    <!-- append: NAME -->          lines at the end of the file NAME
    <!-- in FILE, after: TEXT -->  lines for FILE; also `before` and `replace`, see `recipe_steps`
    <!-- run as: COMMAND -->       a command that runs in its place, for the same at less cost
    <!-- exit code: N -->          the commands end with N, not 0
    <!-- on the wall clock -->     the commands may end with 1: a busy machine is late
    <!-- terminal -->              runs beside what follows, until the end of the page; from the
                                   first one on all run in a ROS domain of their own
    <!-- not run: REASON -->       only the reader can run it; the tests count these blocks
    <!-- drawing -->               neither a command nor a file

Without one, ```sh and ```python are run: shell blocks share working directory and variables, Python
blocks their names. ```text is an excerpt of what the block above it printed: its lines appear in
that order, `...` stands for any text, and the width of blanks does not count.
"""

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import recipe_steps
from wait_until import wait_until

from experiments.run import domain

BLOCK = re.compile(
    r'(?:^<!-- (?P<comment>[^\n]*) -->\n)?'
    r'^(?P<fence>```+)(?P<language>\w*)[^\n]*\n(?P<text>.*?)^(?P=fence)$',
    re.MULTILINE | re.DOTALL,
)
KIND = re.compile(
    r'(file|append|run as|exit code|not run): (.+)|(in) (.+)'
    r'|(terminal|on the wall clock|drawing)'
)
RUN = {'sh', 'python'}
PRINTING = {'run', 'run as', 'exit code', 'on the wall clock', 'terminal', 'not run', 'output'}
SHELL_S = 600.0  # of wall time for one block
# reads a length and as many bytes of source, runs it among the names of the blocks before
PYTHON_LOOP = """
import sys, traceback
names = {'__name__': '__main__'}
while size := sys.stdin.buffer.readline():
    failed = 0
    try:
        exec(compile(sys.stdin.buffer.read(int(size)), PAGE, 'exec'), names)
    except Exception:
        traceback.print_exc()
        failed = 1
    print(f'{END}{failed}', flush=True)
"""
END = '<end of the block> '


class Block(NamedTuple):
    """A fenced block of a page."""

    kind: str  # of its comment; `run` and `output` without one
    value: str  # of its comment: a name, a place, a command, a reason
    language: str
    text: str
    line: int  # of the page


def find_blocks(page: str) -> list[Block]:
    """Return the blocks of a page in order; raise ValueError for one that has no meaning."""
    blocks = []
    for found in BLOCK.finditer(page):
        comment, language, text = found.group('comment', 'language', 'text')
        line = page.count('\n', 0, found.start('fence')) + 1
        if comment:
            known = KIND.fullmatch(comment)
            kind, value = [*filter(None, known.groups()), ''][:2] if known else ('', '')
        else:
            kind = 'run' if language in RUN else 'output' if language == 'text' else ''
            value = ''
        if not kind:
            raise ValueError(f'line {line}: no kind of block: {comment or language}')
        if kind == 'output' and not (blocks and blocks[-1].kind in PRINTING):
            raise ValueError(f'line {line}: output, but no command above it')
        blocks.append(Block(kind, value, language, text, line))
    return blocks


def missing_line(excerpt: str, output: str) -> str | None:
    """Return the first line of an excerpt that `output` does not contain behind the ones before."""
    rest = iter([' '.join(line.split()) for line in output.splitlines()])
    for line in excerpt.splitlines():
        words = ' '.join(line.split())
        if words in ('', '...'):
            continue
        pattern = re.compile('.*'.join(map(re.escape, words.split('...'))))
        if not any(pattern.search(printed) for printed in rest):
            return line
    return None


class Session:
    """A reader with a folder, a shell, further terminals and a Python session."""

    def __init__(self, folder: Path, environment: dict[str, str], prelude: str = ''):
        """Start in `folder`; `prelude` is read by the shell before each block."""
        self.folder = folder
        self._prelude = prelude
        self._environment = environment
        self._closing = contextlib.ExitStack()
        kept = Path(self._closing.enter_context(tempfile.TemporaryDirectory()))
        self._shell = kept / 'shell'  # what the next block starts from
        self._shell.write_text(f'cd {shlex.quote(str(folder))}\n')
        self._logs = kept
        self._python = None
        self._printed = ''
        self._domain = None
        self.terminals: list[subprocess.Popen] = []

    def __enter__(self):
        return self

    def __exit__(self, *raised):
        self.close()

    def close(self) -> None:
        """End the terminals as Ctrl-C does; raise AssertionError for one that failed."""
        self._closing.close()

    def do(self, block: Block) -> None:
        """Do what a reader does with a block; raise AssertionError where it does not work."""
        match block.kind:
            case 'file':
                self._write(block)
            case 'append':
                with (self.folder / block.value).open('r+') as file:
                    file.seek(0, os.SEEK_END)
                    file.write(block.text)
            case 'in':
                recipe_steps.apply(f'in {block.value}', block.text, self.folder)
            case 'terminal':
                self._printed = self._start(block.text)
            case 'run' if block.language == 'python':
                self._printed = self._run_python(block.text)
            case 'run' | 'run as':
                self._printed = self._run(block.value or block.text)
            case 'exit code':
                self._printed = self._run(block.text, int(block.value))
            case 'on the wall clock':
                self._printed = self._run(block.text, 0, 1)
            case 'output' if isinstance(self._printed, Path):
                log = self._printed
                wait_until(
                    lambda: missing_line(block.text, log.read_text()) is None,
                    SHELL_S,
                    log.read_text,
                )
            case 'output' if self._printed is not None:
                missing = missing_line(block.text, self._printed)
                assert missing is None, f'no line {missing!r} in\n{self._printed}'
            case 'not run':
                self._printed = None

    def _write(self, block):
        file = self.folder / block.value
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(block.text)

    def _run(self, text, *codes):
        kept = f'{{ export -p; printf "cd %q\\n" "$PWD"; }} > {self._shell}'
        script = f'set -e -o pipefail\n. {self._shell}\n{self._prelude}\n{text}\n{kept}'
        output, code = self._finish(self._bash(script, subprocess.PIPE))
        assert code in (codes or (0,)), f'exit code {code} of\n{text}\n{output}'
        assert 'Traceback' not in output, output
        return output

    def _bash(self, script, stdout):
        return subprocess.Popen(
            ['bash', '-c', script],
            cwd=self.folder,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=stdout,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def _finish(self, process):
        try:
            output, _ = process.communicate(timeout=SHELL_S)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
        return output, process.returncode

    def _start(self, text):
        """Start the commands of a terminal; return the file of what they print."""
        (command,) = text.strip().splitlines()
        if self._domain is None:  # `experiments run` takes a free one by itself
            self._domain = self._closing.enter_context(domain.reserved({}))
            with self._shell.open('a') as kept:
                kept.write(f'export ROS_DOMAIN_ID={self._domain}\n')
        log = self._logs / f'{len(list(self._logs.iterdir()))}.log'
        with log.open('w') as file:
            process = self._bash(f'. {self._shell}\nexec {command}', file)
        self.terminals.append(process)
        self._closing.callback(self._stop, process, log)
        return log

    def _stop(self, process, log):
        """End a terminal as Ctrl-C does."""
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
        try:
            code = process.wait(60)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
        assert code in (0, 130, -signal.SIGINT), f'exit code {code}\n{log.read_text()}'

    def _run_python(self, text):
        if self._python is None:
            loop = PYTHON_LOOP.replace('PAGE', repr('<page>')).replace('{END}', END)
            self._python = self._closing.enter_context(
                subprocess.Popen(
                    [sys.executable, '-c', loop],
                    cwd=self.folder,
                    env=self._environment,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                )
            )
            self._closing.callback(self._python.kill)
        source = text.encode()
        self._python.stdin.write(b'%d\n%s' % (len(source), source))
        self._python.stdin.flush()
        printed = []
        for line in self._python.stdout:
            printed.append(line.decode())
            if END in printed[-1]:
                break
        output = ''.join(printed)
        assert output.endswith(f'{END}0\n'), output
        return output.removesuffix(f'{END}0\n')
