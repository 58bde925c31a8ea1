"""The claims table between two comments of a Markdown file, made from claims.json.

It is the short one: medians without ranges, no shares and no causes; these are in claims.md.
"""

import json
import re
from pathlib import Path

from bags.errors import BagError
from experiments.study import claims, tables

BEGIN, END = '<!-- claims -->', '<!-- /claims -->'
COLUMNS = {
    'claim': 'claim',
    'paper': 'paper',
    'ours': 'ours: median',
    'verdict': 'verdict',
}
RANGE = re.compile(r' \[[^],]+, [^],]+\]')


def block(file: Path) -> str:
    """Return what stands between the comments for a claims.json. Raises BagError."""
    try:
        rows = json.loads(file.read_text())
        point = rows[0]['operating_point']
        lines = [[_cell(row[name]) for name in COLUMNS] for row in rows]
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise BagError(f'{file}: holds no claims: {error}') from None
    table = tables.markdown(list(COLUMNS.values()), lines)
    why = claims.undecided(rows)
    return f'\nAt {point}:\n\n{table}\n{why}' + ('\n' if why else '')


def _cell(text):
    return RANGE.sub('', str(text)).replace('|', r'\|').replace('\n', ' ')


def parts(file: Path) -> tuple[str, str, str]:
    """Return a file's text before, between and after the comments. Raises BagError."""
    text = file.read_text()
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise BagError(f'{file}: needs the lines {BEGIN} and {END}, once each and in this order')
    before, _, rest = text.partition(BEGIN)
    between, _, after = rest.partition(END)
    return before + BEGIN, between, END + after


def rewrite(file: Path, claims_file: Path) -> None:
    """Put the claims of a claims.json between the comments of a file. Raises BagError."""
    before, _, after = parts(file)
    file.write_text(before + block(claims_file) + after)
