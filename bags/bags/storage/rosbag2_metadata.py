"""The metadata that rosbag2 (layout version 9, ROS 2 Jazzy) keeps beside and inside MCAP files."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import yaml

from msgs_yaml.contract import Qos
from msgs_yaml.conversions import NS_PER_S

DEPTH = 10  # messages kept by a publisher whose history is not in the bag
INFINITE = {'sec': 9223372036, 'nsec': 854775807}
# of PyYAML for an invalid text, also for a tag that does not fit its value
YAML_ERRORS = (yaml.YAMLError, ValueError, LookupError, AttributeError, RecursionError)
INFINITE_NS = INFINITE['sec'] * NS_PER_S + INFINITE['nsec']


class BagTopic(NamedTuple):
    """The description of a topic in a bag."""

    name: str
    type: str  # 'package/msg/Name'
    schema: str  # definition text, see definitions.schema_text
    type_hash: str  # 'RIHS01_...'
    qos: str  # offered QoS profiles: the text of a YAML list


class FileFacts(NamedTuple):
    """The metadata of one file of a bag."""

    name: str
    first_ns: int  # log times of its messages, 0 without any
    last_ns: int
    counts: Counter[str]  # messages per topic


def qos_text(qos: Qos) -> str:
    """Return one offered QoS profile as rosbag2 writes it: a YAML list with one entry."""
    deadline = INFINITE
    if qos.deadline_ms is not None:
        deadline = dict(zip(('sec', 'nsec'), divmod(round(qos.deadline_ms * 1e6), NS_PER_S)))
    profile = {
        'history': qos.history,
        'depth': qos.depth,
        'reliability': qos.reliability,
        'durability': qos.durability,
        'deadline': deadline,
        'lifespan': INFINITE,
        'liveliness': 'automatic',
        'liveliness_lease_duration': INFINITE,
        'avoid_ros_namespace_conventions': False,
    }
    return dump([profile])


# of each policy what a profile is taken to say, the other word, and its number in rmw/types.h, as
# older bags have it
_WORDS = {
    'reliability': ('reliable', 'best_effort', 2),
    'durability': ('volatile', 'transient_local', 1),
    'history': ('keep_last', 'keep_all', 2),
}


def parse_qos(text: str) -> list[Qos]:
    """Return the QoS profiles in the text of a bag, empty for an invalid one: a bag may lack QoS.

    What a profile does not say is reliable, volatile, the last DEPTH messages, no deadline.
    """
    parsed = []
    for profile in _profiles(text):
        if not isinstance(profile, dict):
            continue
        words = {
            name: other if profile.get(name) in (other, number) else usual
            for name, (usual, other, number) in _WORDS.items()
        }
        depth, deadline_ms = profile.get('depth'), None
        depth = depth if isinstance(depth, int) and depth > 0 else DEPTH
        match profile.get('deadline'):
            case {'sec': int(sec), 'nsec': int(nsec)} if 0 < sec * NS_PER_S + nsec < INFINITE_NS:
                deadline_ms = (sec * NS_PER_S + nsec) / 1e6
        parsed.append(Qos(**words, depth=depth, deadline_ms=deadline_ms))
    return parsed


def _profiles(text):
    """Return the list in a text, empty where it is none."""
    if '*' in text:  # aliases may be recursive or grow exponentially
        return []
    try:
        profiles = yaml.safe_load(text)
    except YAML_ERRORS:
        return []
    return profiles if isinstance(profiles, list) else []


def build_metadata(topics: Sequence[BagTopic], files: Sequence[FileFacts]) -> dict:
    """Return the mapping under 'rosbag2_bagfile_information' of a bag in one file or several."""
    counts = sum((file.counts for file in files), Counter())
    filled = [file for file in files if file.counts.total()]
    first_ns = min((file.first_ns for file in filled), default=0)
    last_ns = max((file.last_ns for file in filled), default=0)
    return {
        'version': 9,
        'storage_identifier': 'mcap',
        **_times(FileFacts('', first_ns, last_ns, counts)),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': _profiles(topic.qos),
                    'type_description_hash': topic.type_hash,
                },
                'message_count': counts[topic.name],
            }
            for topic in topics
        ],
        # chunks are compressed by MCAP itself; these two are of rosbag2's own compression
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.name for file in files],
        'files': [{'path': file.name, **_times(file)} for file in files],
        'custom_data': None,
        'ros_distro': 'jazzy',
    }


def _times(file):
    return {
        'starting_time': {'nanoseconds_since_epoch': file.first_ns},
        'duration': {'nanoseconds': file.last_ns - file.first_ns},
        'message_count': file.counts.total(),
    }


def dump(value: list | dict) -> str:
    """Return the YAML of a value as rosbag2 writes it."""
    return yaml.dump(value, Dumper=_PlainDumper, sort_keys=False, default_flow_style=False)


class _PlainDumper(yaml.SafeDumper):
    """No anchors: rosbag2's reader needs every duration written out."""

    def ignore_aliases(self, data):
        return True
