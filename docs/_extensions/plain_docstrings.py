"""The docstrings of this repository as reStructuredText.

A docstring here is plain text, as an editor or `help()` shows it: paragraphs, `code` in single
backticks, lines that are indented or hold columns, lists with hyphens. Nothing else is markup, so
`v_`, `*args` and `|x|` mean themselves. The fields of dataclasses and named tuples become a table:
type and range from the annotation, meaning from the comment behind or above the field.
"""

import ast
import inspect
import io
import re
import sys
import tokenize
from collections.abc import Iterator, Sequence
from functools import cache
from types import ModuleType
from typing import NamedTuple

CODE = re.compile(r'`([^`]+)`')
MARKUP = re.compile(r'([\\*_|`<>])')
COLUMNS = re.compile(r'\S {3,}\S')
ITEM = '- '


class Field(NamedTuple):
    """A field of a class as its source describes it."""

    name: str
    type: str
    meaning: str


def to_rest(lines: Sequence[str]) -> list[str]:
    """Return the lines of a docstring as reStructuredText."""
    text: list[str] = []
    for block in _blocks(lines):
        if block[0].startswith(' ') or any(map(COLUMNS.search, block)):
            indent = min(len(line) - len(line.lstrip()) for line in block)
            text += ['.. code-block:: text', '', *(f'   {line[indent:]}' for line in block)]
        elif block[0].startswith(ITEM):
            text += [escape(line) for line in block]
        else:
            text += [escape(' '.join(line.strip() for line in block))]
        text.append('')
    return text


def escape(line: str) -> str:
    """Return a line with its markup escaped and `code` as a literal."""
    parts = CODE.split(line)
    return ''.join(
        rf'\ ``{part.strip()}``\ ' if k % 2 else MARKUP.sub(r'\\\1', part)
        for k, part in enumerate(parts)
    )


def _blocks(lines) -> Iterator[list[str]]:
    """Yield the blocks between blank lines."""
    block: list[str] = []
    for line in [*lines, '']:
        if line.strip():
            block.append(line.rstrip())
        elif block:
            yield block
            block = []


@cache
def class_fields(module: ModuleType) -> dict[str, list[Field]]:
    """Return the annotated fields of the classes of a module, by the name of the class."""
    try:
        source = inspect.getsource(module)
    except (OSError, TypeError):  # a built-in one
        return {}
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    comments = {t.start[0]: t.string.lstrip('# ') for t in tokens if t.type == tokenize.COMMENT}
    lines = source.splitlines()
    found: dict[str, list[Field]] = {}
    for cls in (node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)):
        for node in cls.body:
            if isinstance(node, ast.AnnAssign) and not node.target.id.startswith('_'):
                kind, allowed = describe_type(node.annotation)
                comment = _comment(node, comments, lines)
                meaning = '; '.join(filter(None, (comment, allowed)))
                found.setdefault(cls.name, []).append(Field(node.target.id, kind, meaning))
    return found


def describe_type(annotation: ast.expr) -> tuple[str, str]:
    """Return the type of an annotation as text, and what `Annotated` says of it."""
    if isinstance(annotation, ast.BinOp):
        left, allowed = describe_type(annotation.left)
        return f'{left} | {ast.unparse(annotation.right)}', allowed
    if isinstance(annotation, ast.Subscript) and ast.unparse(annotation.value) == 'Annotated':
        kind, rule = annotation.slice.elts
        return ast.unparse(kind), _describe_rule(rule)
    return ast.unparse(annotation), ''


def _describe_rule(rule):
    if isinstance(rule, ast.Call) and ast.unparse(rule.func) == 'Range':
        low, high, unit = (ast.unparse(argument) for argument in rule.args)
        return f'{low} to {high} {ast.literal_eval(unit)}'
    return ast.unparse(rule)


def _comment(node, comments, lines):
    """Return the comment behind a field, or the whole lines above it."""
    if node.end_lineno in comments:
        return comments[node.end_lineno]
    above, line = [], node.lineno - 1
    while line in comments and lines[line - 1].lstrip().startswith('#'):
        above.insert(0, comments[line])
        line -= 1
    return ' '.join(above)


def field_table(fields: Sequence[Field]) -> list[str]:
    """Return a table of fields as reStructuredText."""
    rows = ['.. list-table::', '   :header-rows: 1', '   :class: fields', '']
    rows += ['   * - field', '     - type', '     - meaning']
    for name, kind, meaning in fields:
        rows += [f'   * - ``{name}``', f'     - ``{kind}``', f'     - {escape(meaning)}']
    return [*rows, '']


def _process(app, what, name, obj, options, lines):
    lines[:] = to_rest(lines)
    if what in ('class', 'exception') and inspect.isclass(obj):
        module = sys.modules.get(obj.__module__)
        fields = class_fields(module).get(obj.__qualname__) if module else None
        if fields:
            lines += field_table(fields)


def _signature(app, what, name, obj, options, signature, returns):
    """Leave out the arguments of a class whose fields are in its table."""
    is_record = hasattr(obj, '_fields') or hasattr(obj, '__dataclass_fields__')
    return ('', returns) if what == 'class' and is_record else None


def _skip(app, what, name, obj, skip, options):
    """Skip what a named tuple generates."""
    is_alias = (inspect.getdoc(obj) or '').startswith('Alias for field number')
    return True if is_alias else None


def setup(app):
    """Register the conversion of docstrings."""
    app.connect('autodoc-process-docstring', _process)
    app.connect('autodoc-process-signature', _signature)
    app.connect('autodoc-skip-member', _skip)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
