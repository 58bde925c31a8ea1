"""The option `--set`: parameters of the nodes of a run, and of a recorded controller.

Values are read as ROS reads YAML. A replay has no node but the controller, so there `controller.`
may be left out; `weights.<term>=<factor>` scales the weight of one cost term of one tick.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments.configuration import node_config
from msgs_yaml import share, strict_yaml
from node_runtime import parameters

CONTROLLER = 'controller'
WEIGHTS = 'weights.'
OTHER_ROLES = tuple(role for role in node_config.ROLES if role != CONTROLLER)


class Changes(NamedTuple):
    """What `--set` changes in the problem of one tick."""

    parameters: Mapping[str, Any]  # by dotted name
    weight_factors: Mapping[str, float]  # by the name of the cost term


def parse_value(setting: str, text: str, option: str = '--set ') -> Any:
    """Return the value of a setting as ROS reads it: 1e-1 is a number, nothing is EMPTY.

    Raises BagError, which names the setting after `option`, for text that is no YAML value.
    """
    if not text.strip():
        return strict_yaml.EMPTY
    try:
        return strict_yaml.parse(text, option.strip()).value_or_empty()
    except strict_yaml.YamlError:
        raise BagError(f'{option}{setting}: {text!r} is no value') from None


def file_value(item: strict_yaml.Item) -> Any:
    """Return the value of a setting in a YAML file, EMPTY for none. Raises YamlError."""
    value = item.value_or_empty()
    members = value if isinstance(value, list) else [value]
    if any(isinstance(member, dict | list) for member in members):
        raise item.error(
            'is no parameter; allowed a number, true, false, a word, or a list of them'
        )
    return value


def parse_overrides(settings: Sequence[str], option: str = '--set ') -> dict[str, dict[str, Any]]:
    """Return {role: {parameter: value}} of `ROLE.parameter=value` texts.

    `option` comes before each in errors. Raises BagError for text of another form;
    `inputs.check_parameters` checks names and values.
    """
    overrides = {}
    for setting in settings:
        target, equals, text = setting.partition('=')
        role, _, name = target.partition('.')
        if not equals or not name or role not in node_config.ROLES:
            raise BagError(
                f'{option}{setting}: must be NODE.parameter=value, NODE one of '
                f'{", ".join(node_config.ROLES)}{closest_setting(target)}'
            )
        overrides.setdefault(role, {})[name] = parse_value(setting, text, option)
    return overrides


def closest_setting(target: str) -> str:
    """Return '; did you mean ...?' for a setting that names no node, or ''."""
    role, _, name = target.partition('.')
    if f'{role}.' == WEIGHTS:
        return (
            '; weights.<term> are factors of `experiments resolve`; '
            'a run takes controller.tolerances.*'
        )
    roles = node_config.ROLES
    near = [node for node in roles if f"'{node}'" in strict_yaml.closest(role, roles)]
    if near and name:
        return f'; did you mean {f"{near[0]}.{name}"!r}?'
    known = {
        f'{role}.{parameter}'
        for role, (package, file) in node_config.DEFAULTS.items()
        for parameter in parameters.read_file(share.path(package, 'config', file)).values
    }
    exact = sorted(full for full in known if full.partition('.')[2] == target)
    if exact:
        return f'; did you mean {" or ".join(map(repr, exact))}?'
    return strict_yaml.closest(f'{CONTROLLER}.{target}', known)


def parse_controller_settings(settings: Sequence[str]) -> dict[str, Any]:
    """Return {parameter: value} of `[controller.]parameter=value` texts for a replay.

    Raises BagError for another form and for another node; the names are checked together with the
    parameters of the run.
    """
    values = {}
    for setting in settings:
        target, equals, text = setting.partition('=')
        if target.startswith(WEIGHTS):
            raise BagError(
                f'--set {setting}: weights.<term>=<factor> is for one tick (experiments resolve); '
                'here, change controller.tolerances.* or controller.priorities.*'
            )
        if target.partition('.')[0] in OTHER_ROLES:
            raise BagError(
                f'--set {setting}: only parameters of the controller can be changed in a replay'
            )
        name = target.removeprefix(f'{CONTROLLER}.')
        if not equals or not name:
            raise BagError(f'--set {setting}: must be [controller.]parameter=value')
        values[name] = parse_value(setting, text)
    return values


def parse_tick_changes(settings: Sequence[str]) -> Changes:
    """Return controller parameters, and weight factors given as `weights.<term>=<factor>`.

    Raises BagError as `parse_controller_settings`, and for a factor that is no number.
    """
    factors, others = {}, []
    for setting in settings:
        if not setting.startswith(WEIGHTS):
            others.append(setting)
            continue
        name, _, text = setting.removeprefix(WEIGHTS).partition('=')
        try:
            factors[name] = float(text)
        except ValueError:
            raise BagError(
                f'--set {setting}: must be weights.<term>=<factor>; 1 changes nothing, 0 switches '
                'the term off'
            ) from None
    return Changes(parse_controller_settings(others), factors)
