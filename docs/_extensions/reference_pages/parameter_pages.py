"""Pages about parameters: what each node and file takes, and what each controller sets."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from bags.markers_node import ShapeParams
from bags.player_node import PlayerParams
from bags.storage.message_filing import RecorderParams
from mpcc_controller import run_time_parameters
from mpcc_controller.parameters import CarParams, ControllerParams
from msgs_yaml import share
from node_runtime import node_parameters, parameter_docs, parameters
from node_runtime.parameter_docs import GroupDoc
from reference_pages.markdown import code, table, text
from scenario_publisher.perceived_objects import ConverterParams
from scenario_publisher.scenario import NodeParams as ScenarioParams
from state_estimator.parameters import EstimatorParams
from vehicle_plant.circular_driving import CircleParams
from vehicle_plant.parameters import EXTRAS
from vehicle_plant.parameters import NodeParams as PlantParams
from vehicle_plant.tyre_coefficients import TyreCoefficients


class Kind(NamedTuple):
    """Parameters of one kind: of a node, or of a file that one names."""

    page: str
    title: str
    about: str
    cls: type
    package: str
    defaults: str  # file in config/


KINDS = (
    Kind(
        'parameters_controller',
        'Parameters of the controller',
        'Of `controller_node`, `mpcc_node` and `frenet_node`; the controller files hold them. In '
        '`experiments run` and `resolve`: `--set controller.NAME=VALUE`.',
        ControllerParams,
        'mpcc_controller',
        'mpcc.yaml',
    ),
    Kind(
        'parameters_car',
        'The car as the controller knows it',
        'In the file that the parameter `car_file` of the controller names; `identify` writes it.',
        CarParams,
        'mpcc_controller',
        'car.yaml',
    ),
    Kind(
        'parameters_plant',
        'Parameters of the plant',
        'Of `plant_node`. In `experiments run`: `--set plant.NAME=VALUE`.',
        PlantParams,
        'vehicle_plant',
        'bmw_545i.yaml',
    ),
    Kind(
        'parameters_estimator',
        'Parameters of the estimator',
        'Of `estimator_node`. In `experiments run`: `--set estimator.NAME=VALUE`.',
        EstimatorParams,
        'state_estimator',
        'estimator.yaml',
    ),
    Kind(
        'parameters_tyre',
        'A tyre of the plant',
        'Coefficients of the Magic Formula 6.1, in the file that the parameter `tyre_set` of the '
        'plant names.',
        TyreCoefficients,
        'vehicle_plant',
        'tyre_205_60r15.yaml',
    ),
    Kind(
        'parameters_identify',
        'Parameters of the identification',
        'Of `identify`: how the plant is driven in a circle.',
        CircleParams,
        'vehicle_plant',
        'identify.yaml',
    ),
    Kind(
        'parameters_scenario',
        'Parameters of the scenario node',
        'Of `scenario_node`.',
        ScenarioParams,
        'scenario_publisher',
        'scenario_node.yaml',
    ),
    Kind(
        'parameters_converter',
        'Parameters of the converter',
        'Of `converter_node`.',
        ConverterParams,
        'scenario_publisher',
        'converter_node.yaml',
    ),
    Kind(
        'parameters_recorder',
        'Parameters of the recorder',
        'Of `recorder_node`. In `experiments run`: `--set recorder.NAME=VALUE`.',
        RecorderParams,
        'bags',
        'recorder.yaml',
    ),
    Kind(
        'parameters_player',
        'Parameters of the player',
        'Of `player_node`.',
        PlayerParams,
        'bags',
        'player.yaml',
    ),
    Kind(
        'parameters_markers',
        'Parameters of the markers',
        'Of `markers_node`.',
        ShapeParams,
        'bags',
        'markers.yaml',
    ),
)
EVERY_NODE = 'parameters_every_node'
CONTROLLERS = 'controller_files'


def pages() -> dict[str, str]:
    """Return the pages by name."""
    return {
        **{kind.page: _kind_page(kind) for kind in KINDS},
        EVERY_NODE: (
            '# Parameters of every node\n\nEach node takes them beside its own.\n\n'
            + groups(node_parameters.describe_common())
        ),
        CONTROLLERS: controllers(share.path('mpcc_controller', 'config')),
    }


def _kind_page(kind):
    path = share.path(kind.package, 'config', kind.defaults)
    described = parameter_docs.describe(kind.cls, parameters.read_file(path, path.parent))
    if kind.cls is PlantParams:
        described = (EXTRAS, *described)
    changeable: Collection[str] = ()
    if kind.cls is ControllerParams:
        changeable = run_time_parameters.names(parameters.load(ControllerParams, path))
    return (
        f'# {kind.title}\n\n{kind.about} The defaults are those of '
        f'`{kind.package}/config/{kind.defaults}`.\n\n{groups(described, changeable)}'
    )


def groups(described: Sequence[GroupDoc], changeable: Collection[str] = ()) -> str:
    """Return a table per group; `changeable` are parameters that may be set while driving."""
    parts = []
    for group in described:
        heads = ('parameter', 'unit', 'allowed', 'default', 'set while driving', 'meaning')
        rows = [
            (
                code(row.name),
                text(row.unit) if row.unit != '-' else '',
                text(row.allowed),
                text(row.default_text),
                'yes' if row.name in changeable else '',
                text(row.meaning),
            )
            for row in group.parameters
        ]
        title = f'## `{group.name}`\n\n' if group.name else ''
        parts.append(f'{title}{text(group.meaning)}\n\n{table(heads, rows)}')
    return '\n'.join(parts)


def controllers(folder: Path) -> str:
    """Return the page about the controller files of a folder: what each sets over its base."""
    parts = [
        '# Controller files',
        'The files of `mpcc_controller/config/` and what each of them sets itself; the other '
        'parameters are those of its base. The meanings: '
        '[parameters of the controller](parameters_controller.md).',
    ]
    for path in sorted(folder.glob('*.yaml')):
        file = parameters.read_file(path, folder)
        if 'car_file' not in file.values:
            continue  # a car
        if file.base is None:
            parts += [f'## `{path.name}`', 'Every parameter that must be given; no base.']
            continue
        base = parameters.read_file(file.base, folder)
        own = [name for name, source in file.sources.items() if source.startswith(f'{path}:')]
        rows = [
            (
                code(n),
                _value(file.values[n]),
                _value(base.values.get(n)),
                text(file.comments.get(n, '')),
            )
            for n in own
        ]
        heads = ('parameter', 'here', f'in `{file.base.name}`', 'meaning')
        parts += [f'## `{path.name}`', f'Base: `{file.base.name}`.', table(heads, rows)]
    return '\n\n'.join(parts) + '\n'


def _value(value):
    if value is None:
        return 'left out'
    return text(str(value).lower() if isinstance(value, bool) else value)
