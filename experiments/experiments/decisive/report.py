"""What the rows of the study say: text and tables, and a figure for each estimand."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console

from bags.command_line import print_paths, print_text
from bags.errors import BagError
from experiments.decisive import analysis, figures, picture, verdicts
from experiments.decisive.analysis import Results
from experiments.decisive.arms import FACTORIAL
from experiments.families.lane_change_task import DEMAND

TABLES = ('tuned', 'trials', 'drives', 'picture')
TEXT = 'decided.txt'


def analyse(plan: Mapping[str, Any], tables: Mapping[str, pd.DataFrame]) -> Results:
    """Return the estimates and verdicts of the replicates in the table `drives`."""
    drives = tables['drives']
    # drives of searches have no values of their tasks
    whole = {'stratum': int, 'latency_ms': int}
    judged = drives[drives['judged']].infer_objects().astype(whole)
    is_factorial = judged['arm'].str.startswith(FACTORIAL)
    rules = verdicts.read_rules(plan)
    return analysis.analyse(judged[~is_factorial], judged[is_factorial], rules)


def write(plan: Mapping[str, Any], folder: Path, out: Path, console: Console) -> None:
    """Show what the tables in `folder` say, and write it with its figures into `out`.

    Raises BagError for a folder without the tables.
    """
    tables = {name: _read(folder / f'{name}.parquet') for name in TABLES}
    results = analyse(plan, tables)
    lines = [analysis.to_text(results), '', 'picture']
    for row in picture.marginals(tables['picture'], plan['picture']):
        before, after = (' '.join(f'{value:10.4g}' for value in v) for v in row[1:3])
        lines.append(f'  {row.name:40}{before} ->{after}  p {row.p_value:.3f}')
    text = '\n'.join(lines)
    print_text(console, text)
    out.mkdir(parents=True, exist_ok=True)
    (out / TEXT).write_text(f'{text}\n', encoding='utf-8')
    paths = figures.write_all(
        results, tables['trials'], verdicts.read_rules(plan), DEMAND, out / 'figures'
    )
    print_paths(console, {'figures': paths[0].parent})


def _read(path):
    try:
        return pd.read_parquet(path)
    except OSError as error:
        raise BagError(
            f'{path}: {error.strerror or "cannot be read"}; `experiments study run` writes it'
        ) from None
