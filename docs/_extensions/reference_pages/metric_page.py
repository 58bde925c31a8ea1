"""The page about the metrics of a comparison."""

import inspect
import sys

from bags.evaluation import metrics
from bags.evaluation.metrics.registry import METRICS, Metric
from reference_pages.markdown import code, table, text

GOOD = {True: 'yes', False: 'no', None: ''}


def page() -> str:
    """Return the page."""
    assert metrics  # importing it registers them
    by_module: dict[str, list[Metric]] = {}
    for metric in METRICS.values():
        by_module.setdefault(metric.function.__module__, []).append(metric)
    parts = [
        '# Metrics',
        'What a comparison computes of every drive: the keys in `comparison.json`, in '
        '`comparison.csv`, in result tables of batches and studies, and in `expect` of a scenario. '
        'A metric with a title has a row in the printed table and in the report. `bags compare '
        '--list-metrics` prints the same. [Extending](../../extending.md) shows how to add one.',
    ]
    for module, members in by_module.items():
        summary = (inspect.getdoc(sys.modules[module]) or '').partition('\n')[0]
        rows = [
            (
                code(metric.name),
                text(metric.title.strip()),
                text(metric.unit),
                GOOD[metric.good_when],
                text(metric.meaning),
            )
            for metric in members
        ]
        heads = ('key', 'row', 'unit', 'good when', 'meaning')
        parts += [f'## {text(summary.rstrip("."))}', table(heads, rows)]
    return '\n\n'.join(parts) + '\n'
