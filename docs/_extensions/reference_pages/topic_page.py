"""The page about the topics of the contract."""

from msgs_yaml import contract
from msgs_yaml.contract import MODES, Qos, Topic
from reference_pages.markdown import code, number, table, text


def page() -> str:
    """Return the page."""
    loaded = contract.load()
    topics, derived = loaded.topics.values(), loaded.derived.values()
    profiles = {
        name: topic.qos[mode]
        for topic in (*topics, *derived)
        for mode, name in topic.profiles.items()
    }
    parts = [
        '# Topics',
        'Written from `msgs_yaml/topics.yaml`, from which nodes take type, quality of service and '
        'ranges. Names are those in the root namespace; every topic is relative to the namespace '
        'of its node. Frames and axes: REP-103, REP-105, ISO 8855; SI units.',
        table(
            ('topic', 'type', 'publisher', *(f'rate [Hz], {mode}' for mode in MODES), 'frame'),
            map(_overview, topics),
        ),
        '## Quality of service',
        table(
            ('profile', 'reliability', 'durability', 'history', 'depth', 'deadline [ms]'),
            (_profile(name, qos) for name, qos in profiles.items()),
        ),
        *(_section(topic) for topic in topics),
        '## Derived topics',
        'For programs that expect them of every robot. They follow from the topics above and are '
        'not recorded.',
        *(_section(topic, level=3) for topic in derived),
    ]
    return '\n\n'.join(parts) + '\n'


def _overview(topic: Topic):
    rates = ('on request' if topic.on_request else number(topic.rate_hz[m]) for m in MODES)
    return code(topic.name), code(topic.type), code(topic.publisher), *rates, code(topic.frame)


def _profile(name: str, qos: Qos):
    depth = str(qos.depth) if qos.depth else 'all'
    deadline = number(qos.deadline_ms) if qos.deadline_ms is not None else ''
    return code(name), qos.reliability, qos.durability, qos.history, depth, deadline


def _section(topic: Topic, level: int = 2):
    qos = ', '.join(f'{mode}: `{topic.profiles[mode]}`' for mode in MODES)
    parts = [f'{"#" * level} `{topic.name}`', text(topic.meaning), f'`{topic.type}`; {qos}']
    if topic.child_frame:
        parts[-1] += f'; child frame `{topic.child_frame}`'
    fields = [
        (
            code(path),
            code(field.symbol),
            '' if field.unit == '-' else text(field.unit),
            '' if field.unit == contract.WORD else f'{number(field.low)} to {number(field.high)}',
            code(field.column),
            code(field.value),
        )
        for path, field in topic.fields.items()
    ]
    sizes = [(code(path), f'{size.low} to {size.high}') for path, size in topic.sizes.items()]
    columns = [(code(name), text(column.meaning)) for name, column in topic.columns.items()]
    tables = (
        (('field', 'symbol', 'unit', 'allowed', 'column', 'value'), fields),
        (('array', 'elements'), sizes),
        (('column', 'meaning'), columns),
    )
    parts += [table(heads, rows) for heads, rows in tables if rows]
    return '\n\n'.join(parts)
