"""Common parts of the coverage-guided fuzzers: atheris, limits, a seed corpus, mutations.

Atheris is no requirement of the project: it has wheels for some versions of Python only.
"""

import contextlib
import random
import re
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

try:
    import atheris
except ImportError:
    sys.exit('atheris is missing: `python -m pip install atheris==3.0.0` (CPython 3.11 to 3.13)')

# an input that takes longer, or more memory, is a finding; flags of the command line go before
LIMITS = ('-timeout=20', '-rss_limit_mb=2048', '-len_control=0', '-print_final_stats=1')
PLAIN = 0.15  # share of inputs that are changed byte by byte, without regard to their structure
TOKEN = re.compile(r'\s+|[\w.]+|.')


def instrumented(*packages: str) -> contextlib.AbstractContextManager:
    """Return a context in which imported packages are instrumented for branch coverage."""
    return atheris.instrument_imports(include=list(packages))


def run(
    look: Callable[[bytes], None],
    mutate: Callable[[bytes, random.Random], bytes],
    seeds: Iterable[bytes],
) -> None:
    """Call `look` with inputs that `mutate(data, choose)` derives from the corpus; never returns.

    The command line is libFuzzer's: flags, then folders of inputs, the first of which grows, or
    files to look at once. An input that ends in an exception is kept where the last line says.
    """
    folder = Path(tempfile.mkdtemp(prefix=f'{Path(sys.argv[0]).stem}-'))
    given = list(seeds)
    (folder / 'corpus').mkdir()
    for number, seed in enumerate(given):
        (folder / 'corpus' / f'seed_{number:02d}').write_bytes(seed)
    longest = 2 * max(map(len, given))
    arguments = [*LIMITS, f'-max_len={longest}', f'-artifact_prefix={folder}/', *sys.argv[1:]]
    if not any(Path(argument).is_file() for argument in sys.argv[1:]):
        arguments.append(str(folder / 'corpus'))

    def mutated(data, max_size, seed):
        choose = random.Random(seed)
        if choose.random() >= PLAIN:
            return mutate(data, choose)[:max_size]
        return atheris.Mutate(data, max_size)

    atheris.Setup([sys.argv[0], *arguments], look, custom_mutator=mutated)
    atheris.Fuzz()


def scratch() -> Path:
    """Return a new folder for the file under test, in memory where possible.

    libFuzzer ends the process without a chance to remove it: `look` has to leave it empty.
    """
    memory = Path('/dev/shm')
    prefix = f'{Path(sys.argv[0]).stem}-'
    return Path(tempfile.mkdtemp(prefix=prefix, dir=memory if memory.is_dir() else None))


def mutate_bytes(data: bytes, choose: random.Random, room: int = 16) -> bytes:
    """Return bytes changed by libFuzzer itself, which tries what the program compares them with."""
    return atheris.Mutate(data, len(data) + choose.randrange(1, room))


def mutate_text(text: str, words: Sequence[str], choose: random.Random) -> str:
    """Return a text with some of its words or lines changed, moved, doubled or left out."""
    for _ in range(choose.choice((1, 1, 1, 2, 4))):
        parts = text.splitlines(keepends=True) if choose.random() < 0.3 else TOKEN.findall(text)
        if not parts:
            return choose.choice(words)
        at = choose.randrange(len(parts))
        alike = [part for part in (*words, *parts) if _kind(part) == _kind(parts[at])]
        new = (choose.choice(words), choose.choice(parts), '', parts[at] * 2, choose.choice(alike))
        which = choose.choices(range(len(new)), (2, 1, 1, 1, 10))[0]
        parts[at : at + (which > 0 or choose.randrange(2))] = [new[which]]
        text = ''.join(parts)
    return text


def _kind(part):
    """What a part begins with: a digit, a letter or the character itself."""
    first = part[:1]
    return '0' if first.isdigit() else 'a' if first.isalpha() else first
