"""Draw where the processor time of drives in process goes, as a flame graph.

    .venv/bin/python bench/flame.py [--repeats N] [--brief] [--out docs/loop_flame.png]

The stack is sampled every millisecond of processor time. A box is as wide as the share of the
samples in which its function ran; what it calls stands above it. C code counts for the Python
function that calls it.
"""

import argparse
import signal
from collections import Counter
from pathlib import Path

import matplotlib as mpl
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from experiments import simulation

mpl.use('Agg')
SCENARIO, CONTROLLER = 'double_lane_change', 'mpcc'
PERIOD_S = 1e-3
LEAST_SHARE = 0.004  # narrower boxes are left out
CHARACTERS = 150  # of a label over the whole width
COLOURS = {
    'mpcc_controller': '#4477aa',
    'stage_solver': '#ee6677',
    'vehicle_plant': '#228833',
    'msgs_yaml': '#ccbb44',
    'node_runtime': '#66ccee',
    'experiments': '#aa3377',
    'numpy': '#bbbbbb',
    'casadi': '#999999',
}
OTHER = '#dddddd'


def sample(call) -> Counter:
    """Return how often each stack of functions, outermost first, ran during a call."""
    stacks = Counter()

    def take(_, frame):
        names = []
        while frame is not None and frame.f_code.co_name != 'sample':
            names.append(_name(frame.f_code))
            frame = frame.f_back
        stacks[tuple(reversed(names))] += 1

    before = signal.signal(signal.SIGPROF, take)
    signal.setitimer(signal.ITIMER_PROF, PERIOD_S, PERIOD_S)
    try:
        call()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    return stacks


def _name(code):
    parts = Path(code.co_filename).with_suffix('').parts
    package = next((part for part in reversed(parts[:-1]) if part in COLOURS), '')
    return f'{package}:{parts[-1]}.{code.co_name}'


def draw(ax: Axes, stacks: Counter, total: int, left: float = 0.0, depth: int = 0) -> None:
    """Draw the boxes of stacks that share their first `depth` functions, from `left` on."""
    groups: dict[str, Counter] = {}
    for stack, count in stacks.items():
        if len(stack) > depth:
            groups.setdefault(stack[depth], Counter())[stack] += count
    for name, group in sorted(groups.items(), key=lambda item: -item[1].total()):
        share = group.total() / total
        if share < LEAST_SHARE:
            continue
        package, label = name.split(':')
        colour = COLOURS.get(package, OTHER)
        ax.barh(depth, share, 0.94, left, color=colour, edgecolor='white', linewidth=0.5)
        texts = (f'{label} {100 * share:.0f} %', label, label.split('.')[-1])
        text = next((text for text in texts if len(text) < CHARACTERS * share), '')
        ax.text(left + share / 2, depth, text, ha='center', va='center', fontsize=6)
        draw(ax, group, total, left, depth + 1)
        left += share


def main() -> None:
    """Sample drives, draw them, print the functions with the largest own shares."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--repeats', type=int, default=30, help='drives')
    parser.add_argument('--brief', action='store_true', help='without explaining the ticks')
    parser.add_argument('--out', type=Path, default=Path('docs/loop_flame.png'))
    options = parser.parse_args()
    setup = simulation.prepare(SCENARIO, CONTROLLER)
    simulation.run(setup)

    def drives():
        for _ in range(options.repeats):
            simulation.run(setup, explain=not options.brief)

    stacks = sample(drives)
    stacks = Counter({stack[1:]: count for stack, count in stacks.items()})  # without `drives`
    total = stacks.total()
    own = Counter()
    for stack, count in stacks.items():
        own[stack[-1] if stack else 'drives'] += count
    for name, count in own.most_common(20):
        print(f'{100 * count / total:5.1f} %  {name}')
    fig, ax = plt.subplots(figsize=(14, 6), layout='constrained')
    draw(ax, stacks, total)
    kind = 'without' if options.brief else 'with'
    ax.set_title(f'{SCENARIO} by {CONTROLLER}, {kind} explaining: share of the processor time')
    ax.set_xlim(0, 1)
    ax.set_axis_off()
    shown = [plt.Rectangle((0, 0), 1, 1, color=colour) for colour in COLOURS.values()]
    ax.legend(shown, COLOURS, loc='upper right', fontsize=7)
    fig.savefig(options.out, dpi=110)


if __name__ == '__main__':
    main()
