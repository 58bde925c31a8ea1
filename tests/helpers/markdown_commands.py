"""The shell commands in the fenced blocks of a Markdown page."""

import re
import shlex
from typing import NamedTuple

BLOCK = re.compile(r'^```(\w*)[^\n]*\n(.*?)^```', re.MULTILINE | re.DOTALL)
LANGUAGES = ('', 'sh', 'bash', 'shell', 'console')
ASSIGNMENT = re.compile(r'\w+=')
CONTINUED = re.compile(r'\s*\\\n\s*')


class Command(NamedTuple):
    """One command of a page."""

    text: str  # as it is printed, without its comment
    block: int  # index of its block among the blocks with commands

    @property
    def words(self) -> list[str]:
        """The program and its arguments, without assignments of environment variables."""
        words = shlex.split(self.text)
        while words and ASSIGNMENT.match(words[0]):
            words = words[1:]
        return words


def find_commands(page: str, programs: set[str]) -> list[Command]:
    """Return the commands of a page in order; `programs` are the names that begin one.

    A block with commands begins with such a name; other blocks are drawings or output. Every line
    of a block with commands is a command, or several joined by `&&`.
    """
    result, blocks = [], 0
    for language, block in BLOCK.findall(page):
        lines = CONTINUED.sub(' ', block).splitlines()
        texts = [part for line in lines for part in _parts(line)]
        if language in LANGUAGES and texts and _program(texts[0]) in programs:
            result += [Command(text, blocks) for text in texts]
            blocks += 1
    return result


def _program(text):
    return (Command(text, 0).words or [''])[0].rpartition('/')[2]


def _parts(line):
    """Return the commands of a line: without prompt and comment, apart at `&&`."""
    bare = re.sub(r'(^|\s)#\s.*$', '', line.removeprefix('$ ')).strip()
    return [part.strip() for part in bare.split('&&') if part.strip()] if _splits(bare) else []


def _splits(text):
    try:
        shlex.split(text)
    except ValueError:  # a quote without its end: no command
        return False
    return True
