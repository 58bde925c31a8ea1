"""The claims table between two comments of a Markdown file, generated from claims.json.

It is the short form: medians without ranges, no shares and no causes; claims.md has these.
"""

import json
import re
from pathlib import Path

from bags.errors import BagError
from experiments.study import claim_evaluation, tables

BEGIN, END = '<!-- claims -->', '<!-- /claims -->'
COLUMNS = {
    'claim': 'claim',
    'paper': 'paper',
    'ours': 'ours: median',
    'verdict': 'verdict',
}
RANGE = re.compile(r' \[[^],]+, [^],]+\]')


def build_block(file: Path) -> str:
    """Return the text between the comments for a claims.json. Raises BagError."""
    try:
        rows = json.loads(file.read_text())
        point = rows[0]['operating_point']
        lines = [[_cell(row[name]) for name in COLUMNS] for row in rows]
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise BagError(f'{file}: holds no claims: {error}') from None
    table = tables.markdown_table(list(COLUMNS.values()), lines)
    reasons = claim_evaluation.undecided_list(rows)
    return f'\nAt {point}:\n\n{table}\n{reasons}' + ('\n' if reasons else '')


def _cell(text):
    return RANGE.sub('', str(text)).replace('|', r'\|').replace('\n', ' ')


def split(file: Path) -> tuple[str, str, str]:
    """Return a file's text before, between and after the comments. Raises BagError."""
    text = file.read_text()
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise BagError(f'{file}: needs the lines {BEGIN} and {END}, once each and in this order')
    before, _, rest = text.partition(BEGIN)
    between, _, after = rest.partition(END)
    return before + BEGIN, between, END + after


def rewrite(file: Path, claims_file: Path) -> None:
    """Replace the text between the comments of a file. Raises BagError."""
    before, _, after = split(file)
    file.write_text(before + build_block(claims_file) + after)
