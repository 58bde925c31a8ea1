"""The table of the arguments of the launch file, a block of the page about it.

PYTHONPATH=docs/_extensions python -m reference_pages.launch_table    writes it
"""

from pathlib import Path

from experiments.run.launch_arguments import ARGUMENTS, BLOCK, PAGE
from reference_pages.markdown import code, table, text

BEGIN, END = f'<!-- {BLOCK} -->', f'<!-- /{BLOCK} -->'  # around the block, in the page


def block() -> str:
    """Return what is between the comments of the block."""
    rows = [
        (
            code(argument.name),
            code(argument.default),
            ', '.join(map(code, argument.choices or ())),
            text(argument.meaning),
        )
        for argument in ARGUMENTS
    ]
    return f'\n\n{table(("argument", "default", "allowed", "meaning"), rows)}\n'


if __name__ == '__main__':
    page = Path(__file__).parents[3] / PAGE
    before, _, rest = page.read_text(encoding='utf-8').partition(BEGIN)
    page.write_text(before + BEGIN + block() + END + rest.partition(END)[2], encoding='utf-8')
