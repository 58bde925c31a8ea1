"""Install packages with uv, from where pip would take them.

    .venv/bin/python .ci/install.py -r requirements.txt

The arguments are those of `uv pip install`; they apply to the environment of this interpreter. The
uv on the PATH is taken, otherwise pip installs one here first. It gets what pip is set up with:
index, folders of packages, proxy, certificates. What it shows is shown, but not the list of all
packages; that a server was not reached is said in one line. The exit code is that of uv.
"""

import ast
import os
import pty
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlsplit

UV = 'uv==0.13.9'
# options of pip and the variables of uv for them; what the environment has stays
VARIABLES = {
    'index-url': 'UV_DEFAULT_INDEX',
    'extra-index-url': 'UV_INDEX',
    'find-links': 'UV_FIND_LINKS',
    'no-index': 'UV_NO_INDEX',
    'trusted-host': 'UV_INSECURE_HOST',
    'default-timeout': 'UV_HTTP_TIMEOUT',
    'timeout': 'UV_HTTP_TIMEOUT',
    'cert': 'SSL_CERT_FILE',
    'proxy': 'HTTPS_PROXY',
}
DEFAULTS = {'UV_INDEX_STRATEGY': 'unsafe-best-match'}  # as pip: the best version of all indexes
ESCAPES = re.compile(r'\x1b\[[0-9;?]*[A-Za-z]')
PACKAGE = re.compile(r'[-+~] \S+==|Using Python |Audited ')
# of uv, and of pip
NOT_REACHED = re.compile(r'Request failed after|Failed to fetch|error sending request|Retrying \(')
REASONS = (
    re.compile(r'\[Errno -?\d+\] ([^\'")]+)'),
    re.compile(r'.*(?:cause|Caused by): ([^\n]+)', re.DOTALL),  # the last one
    re.compile(r'broken by [\'"](\w+)'),
)
URL = re.compile(r'https?://[^\s`\'")]+')
ADVICE = (
    'where the packages come from: connect to the network (behind a proxy set HTTPS_PROXY, for a '
    'mirror PIP_INDEX_URL), then give the same command again'
)


def uv_environment() -> dict[str, str]:
    """Return the environment for uv, with the configuration of pip."""
    asked = subprocess.run(
        [sys.executable, '-m', 'pip', 'config', 'list'], capture_output=True, text=True
    )
    given = {}
    lines = asked.stdout.splitlines()  # global.index-url='https://...'
    for line in sorted(lines, key=lambda line: line.startswith(':env:')):  # overrides the files
        name, _, value = line.partition('=')
        section, _, option = name.rpartition('.')
        if option in VARIABLES and section in ('global', 'install', ':env:'):
            given[VARIABLES[option]] = ' '.join(str(ast.literal_eval(value)).split())
    if 'UV_FIND_LINKS' in given:
        given['UV_FIND_LINKS'] = given['UV_FIND_LINKS'].replace(' ', ',')
    return DEFAULTS | given | dict(os.environ)


def find_uv(environment: dict[str, str]) -> str:
    """Return the path of uv; install it if there is none. Raises CalledProcessError."""
    own = Path(sys.executable).with_name('uv')
    found = shutil.which('uv') or (str(own) if own.exists() else None)
    if not found:
        pip = [sys.executable, '-m', 'pip', 'install', '--quiet', '--retries', '1', UV]
        subprocess.run(pip, check=True, stderr=subprocess.PIPE, text=True, env=environment)
    return found or str(own)


class Output:
    """What uv prints on stderr: shown at once, but for packages and an error."""

    def __init__(self):
        self.error = ''
        self._open = ''

    def read(self, text: str) -> None:
        """Take a piece of the output."""
        *lines, self._open = (self._open + text).split('\n')
        for line in lines:
            self._line(f'{line}\n')
        if self._open.startswith(('\r', '\x1b')) and not self.error:  # a line that changes
            self._show(self._open)
            self._open = ''

    def close(self) -> None:
        """Take the end of the output."""
        self._line(self._open)

    def _line(self, line):
        plain = ESCAPES.sub('', line).strip()
        if self.error or plain.startswith(('error:', '×')):
            self.error += line
        elif not PACKAGE.match(plain):
            self._show(line)

    def _show(self, text):
        sys.stderr.write(text)
        sys.stderr.flush()


def run(command: Sequence[str], environment: dict[str, str]) -> tuple[int, str]:
    """Run uv, on a terminal of its own where this program has one; return exit code and error."""
    ours, its = pty.openpty() if sys.stderr.isatty() else os.pipe()
    if sys.stderr.isatty():
        size = os.get_terminal_size(sys.stderr.fileno())
        subprocess.run(['stty', 'rows', str(size.lines), 'cols', str(size.columns)], stdin=its)
    process = subprocess.Popen(command, stderr=its, env=environment)
    os.close(its)
    output = Output()
    try:
        while piece := os.read(ours, 4096):
            output.read(piece.decode(errors='replace').replace('\r\n', '\n'))
    except OSError:  # Linux says so at the end of a terminal
        pass
    output.close()
    return process.wait(), output.error


def describe(error: str, environment: dict[str, str]) -> str:
    """Return an error of uv or pip; in one line, without passwords, if a server was not reached."""
    plain = ESCAPES.sub('', error).strip()
    if not NOT_REACHED.search(plain):
        return plain
    url = URL.search(plain) or [environment.get('UV_DEFAULT_INDEX', '')]
    host = urlsplit(url[0]).hostname or 'the package index'
    matches = (reason.search(plain) for reason in REASONS)
    reason = next((match[1] for match in matches if match), 'no connection')
    return f'error: could not reach {host} ({reason:.80}), {ADVICE}'


def main(arguments: Sequence[str]) -> int:
    """Install; return the exit code."""
    environment = uv_environment()
    try:
        uv = find_uv(environment)
        command = [uv, 'pip', 'install', '--python', sys.executable, *arguments]
        code, error = run(command, environment)
    except subprocess.CalledProcessError as failed:
        code, error = failed.returncode, failed.stderr
    if code:
        print(describe(error, environment), file=sys.stderr)
    return code


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
