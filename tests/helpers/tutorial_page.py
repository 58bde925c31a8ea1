"""A Markdown page whose blocks a reader runs in order, and the folder in which they run.

A comment directly above a fenced block says what it is:

    <!-- file: NAME -->            the text of the file NAME
    <!-- append: NAME -->          lines at the end of the file NAME
    <!-- in FILE, after: TEXT -->  lines for FILE behind its first line with TEXT; also `before`,
                                   and `replace` for text in the place of TEXT
    <!-- program -->               Python in a process of its own
    <!-- exit code: N -->          the commands end with N, not 0
    <!-- on the wall clock -->     the commands may end with 1: a busy machine is late
    <!-- terminal -->              each line runs beside what follows, until the end of the page;
                                   from the first one on all run in a ROS domain of their own
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

from wait_until import wait_until

from experiments.run import domain

BLOCK = re.compile(
    r'(?:^<!-- (?P<comment>[^\n]*) -->\n)?'
    r'^(?P<fence>```+)(?P<language>\w*)[^\n]*\n(?P<text>.*?)^(?P=fence)$',
    re.MULTILINE | re.DOTALL,
)
KIND = re.compile(
    r'(file|append|exit code|not run): (.+)|(in) (\S+, (?:before|after|replace): .+)'
    r'|(program|terminal|on the wall clock|drawing)'
)
OF_LANGUAGE = {'sh': 'run', 'python': 'run', 'text': 'output'}
SILENT = {'file', 'append', 'in', 'drawing'}  # no output follows them
SHELL_S = 1200.0  # of wall time for one block
# reads a length and as many bytes of source, runs it among the names of the blocks before
PYTHON_LOOP = """
import sys, traceback
names = {'__name__': '__main__'}
while size := sys.stdin.buffer.readline():
    failed = 0
    try:
        exec(compile(sys.stdin.buffer.read(int(size)), '<page>', 'exec'), names)
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
    for match in BLOCK.finditer(page):
        comment, language, text = match.group('comment', 'language', 'text')
        line = page.count('\n', 0, match.start('fence')) + 1
        kind, value = OF_LANGUAGE.get(language, ''), ''
        if comment:
            words = KIND.fullmatch(comment)
            kind, value = [*filter(None, words.groups()), ''][:2] if words else ('', '')
        if not kind:
            raise ValueError(f'line {line}: no kind of block: {comment or language}')
        if kind == 'output' and not (blocks and blocks[-1].kind not in SILENT):
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
    """A reader with a folder, a shell, further terminals and a Python session.

    Leaving the context ends the terminals as Ctrl-C does; AssertionError for one that failed.
    """

    def __init__(self, folder: Path, environment: dict[str, str], prelude: str = ''):
        """Start in `folder`; `prelude` is read by the shell before each block."""
        self.folder = folder
        self._prelude = prelude
        self._environment = environment
        self._closing = contextlib.ExitStack()
        self._logs = Path(self._closing.enter_context(tempfile.TemporaryDirectory()))
        self._shell = self._logs / 'shell'  # what the next block starts from
        self._shell.write_text(f'cd {shlex.quote(str(folder))}\n')
        self._python = None
        self._printed: str | Path | None = ''  # by the last block; a file that grows; unknown
        self._domain = None
        self.terminals: list[subprocess.Popen] = []

    def __enter__(self):
        return self

    def __exit__(self, *raised):
        self._closing.close()

    def do(self, block: Block) -> None:
        """Do what a reader does with a block; raise AssertionError where it does not work."""
        match block.kind:
            case 'file':
                file = self.folder / block.value
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(block.text)
            case 'append':
                file = self.folder / block.value
                file.write_text(file.read_text() + block.text)
            case 'in':
                self._edit(block)
            case 'program':
                self._printed = self._finish([sys.executable, '-c', block.text], block.text)
            case 'terminal':
                for command in block.text.splitlines():
                    self._printed = self._start(command)
            case 'run' if block.language == 'python':
                self._printed = self._run_python(block.text)
            case 'run':
                self._printed = self._run(block.text)
            case 'exit code':
                self._printed = self._run(block.text, int(block.value))
            case 'on the wall clock':
                self._printed = self._run(block.text, 0, 1)
            case 'output':
                self._compare(block.text)
            case 'not run':
                self._printed = None

    def _compare(self, excerpt):
        printed = self._printed
        if isinstance(printed, Path):
            read = printed.read_text
            wait_until(lambda: missing_line(excerpt, read()) is None, SHELL_S, read)
        elif printed is not None:
            missing = missing_line(excerpt, printed)
            assert missing is None, f'no line {missing!r} in\n{printed}'

    def _edit(self, block):
        name, how, anchor = re.fullmatch(r'(\S+), (\w+): (.+)', block.value).groups()
        file = self.folder / name
        lines = file.read_text().splitlines(keepends=True)
        k = next((k for k, line in enumerate(lines) if anchor in line), None)
        assert k is not None, f'{name} has no line with {anchor!r}'
        if how == 'replace':
            lines[k] = lines[k].replace(anchor, block.text.strip())
        else:
            lines.insert(k + (how == 'after'), block.text)
        file.write_text(''.join(lines))

    def _run(self, text, *codes):
        kept = f'{{ export -p; printf "cd %q\\n" "$PWD"; }} > {self._shell}'
        script = f'set -e -o pipefail\n. {self._shell}\n{self._prelude}\n{text}\n{kept}'
        return self._finish(['bash', '-c', script], text, *codes)

    def _finish(self, command, text, *codes):
        process = self._popen(command, subprocess.PIPE)
        try:
            output, _ = process.communicate(timeout=SHELL_S)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
        code = process.returncode
        assert code in (codes or (0,)), f'exit code {code} of\n{text}\n{output}'
        assert 'Traceback' not in output, output
        return output

    def _popen(self, command, stdout):
        return subprocess.Popen(
            command,
            cwd=self.folder,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=stdout,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def _start(self, command):
        """Start the command of a terminal; return the file of what it prints."""
        if self._domain is None:  # `experiments run` takes a free one by itself
            self._domain = self._closing.enter_context(domain.reserved({}))
            with self._shell.open('a') as kept:
                kept.write(f'export ROS_DOMAIN_ID={self._domain}\n')
        log = self._logs / f'{len(self.terminals)}.log'
        with log.open('w') as file:
            process = self._popen(['bash', '-c', f'. {self._shell}\nexec {command}'], file)
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
            self._python = self._closing.enter_context(
                subprocess.Popen(
                    [sys.executable, '-c', PYTHON_LOOP.replace('{END}', END)],
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
        output = ''
        for line in self._python.stdout:
            output += line.decode()
            if END in output:
                break
        assert output.endswith(f'{END}0\n'), output
        return output.removesuffix(f'{END}0\n')
