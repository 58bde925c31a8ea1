"""A controller file with other weights: its text, comments included, and where they come from."""

import re
import textwrap
from collections.abc import Mapping, Sequence

import yaml

ROOT = ('/**', 'ros__parameters')
WIDTH = 100
# in a comment: the old value again, in degrees
RESTATED = re.compile(r', [\d.]+ deg(/s)?')
DIGITS = 4  # more would claim a precision that a search among chaotic drives does not have


def rounded(value: float) -> float:
    """Return a weight with DIGITS significant digits."""
    return float(f'{value:.{DIGITS}g}')


def text(base: str, values: Mapping[str, float], header: Sequence[str]) -> str:
    """Return the text of a controller file with `values` by dotted name in place of its own.

    Every other line stays as it is, but for the comments at its head, which `header` replaces.
    Raises KeyError for a name that the file does not have.
    """
    places = dict(_scalars(_root(yaml.compose(base))))
    for name in values:
        if name not in places:
            raise KeyError(name)
    written = base
    # from the end: what lies before stays where it is
    for name in sorted(values, key=lambda one: -places[one].start_mark.index):
        start, end = (mark.index for mark in (places[name].start_mark, places[name].end_mark))
        shown = yaml_float(values[name])
        # the comment behind it stays in its column
        gap = re.match(' *', written[end:]).end()
        padding = ' ' * max(1, gap + end - start - len(shown)) if gap else ''
        comment, newline, rest = written[end + gap :].partition('\n')
        comment = RESTATED.sub('', comment)
        written = written[:start] + shown + padding + comment + newline + rest
    body = written.splitlines(keepends=True)
    while body and body[0].startswith('#'):
        body.pop(0)
    lines = [line for paragraph in header for line in textwrap.wrap(paragraph, WIDTH - 2)]
    return ''.join(f'# {line}\n' for line in lines) + ''.join(body)


def yaml_float(value: float) -> str:
    """Return a float as YAML 1.1 reads one: with a point, also before an exponent."""
    shown = repr(float(value))
    mantissa, e, exponent = shown.partition('e')
    return shown if '.' in mantissa else f'{mantissa}.0{e}{exponent}'


def _root(node):
    for key in ROOT:
        node = next(value for name, value in node.value if name.value == key)
    return node


def _scalars(node, prefix=''):
    for key, value in node.value:
        if isinstance(value, yaml.MappingNode):
            yield from _scalars(value, f'{prefix}{key.value}.')
        else:
            yield f'{prefix}{key.value}', value
