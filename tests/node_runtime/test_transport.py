"""The transport of a node: what the environment decides, and what a real process then uses.

Sockets and mappings of the process show that Fast DDS has taken the profile.
"""

import contextlib
import os
import socket
import struct
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from msgs_yaml import share
from node_runtime import transport

RANGE, PROFILES = 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'FASTRTPS_DEFAULT_PROFILES_FILE'
SHARED_MEMORY = '/dev/shm/fastrtps_'


LOCAL, OPEN = 'fast_dds_localhost.xml', 'fast_dds_subnet.xml'
KEPT = {RANGE: 'LOCALHOST'}  # no profile: the middleware does what the user has chosen


@pytest.mark.parametrize(
    ('given', 'profile', 'discovery'),
    [
        # the LOCALHOST of rmw_fastrtps would add shared memory
        ({}, LOCAL, 'SYSTEM_DEFAULT'),
        ({RANGE: ''}, LOCAL, 'SYSTEM_DEFAULT'),
        ({RANGE: 'LOCALHOST'}, LOCAL, 'SYSTEM_DEFAULT'),
        ({'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}, LOCAL, 'SYSTEM_DEFAULT'),
        ({RANGE: 'SUBNET'}, OPEN, 'SUBNET'),
        # named hosts are added to the subnet
        ({RANGE: 'SUBNET', 'ROS_STATIC_PEERS': '192.168.1.20'}, OPEN, 'SUBNET'),
    ],
)
def test_a_profile_keeps_nodes_on_this_machine_unless_the_user_opens_it(given, profile, discovery):
    environment = dict(given)
    transport.configure(environment, 'rmw_fastrtps_cpp')
    assert (Path(environment[PROFILES]).name, environment[RANGE]) == (profile, discovery)
    once = dict(environment)
    transport.configure(environment, 'rmw_fastrtps_cpp')
    assert environment == once


@pytest.mark.parametrize(
    ('choice', 'middleware'),
    [
        ({PROFILES: 'mine.xml'}, 'rmw_fastrtps_cpp'),
        ({'ROS_DISCOVERY_SERVER': '192.168.1.20:11811'}, 'rmw_fastrtps_cpp'),
        ({'FASTDDS_BUILTIN_TRANSPORTS': 'DEFAULT'}, 'rmw_fastrtps_cpp'),
        ({'ROS_LOCALHOST_ONLY': '1'}, 'rmw_fastrtps_cpp'),
        ({'ROS_STATIC_PEERS': '192.168.1.20'}, 'rmw_fastrtps_cpp'),
        ({RANGE: 'OFF'}, 'rmw_fastrtps_cpp'),
        ({RANGE: 'SYSTEM_DEFAULT'}, 'rmw_fastrtps_cpp'),
        # to another middleware, SYSTEM_DEFAULT might mean the whole subnet
        ({}, 'rmw_cyclonedds_cpp'),
        ({RANGE: 'SUBNET'}, 'rmw_cyclonedds_cpp'),
    ],
)
def test_what_the_user_has_chosen_stays(choice, middleware):
    environment = dict(choice)
    transport.configure(environment, middleware)
    assert environment == KEPT | choice


def test_a_file_of_profiles_in_the_working_directory_is_a_choice(tmp_path, monkeypatch):
    """Fast DDS loads it after ours: without a range it might open the whole subnet."""
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').write_text('<profiles/>')
    monkeypatch.chdir(tmp_path)
    environment = {}
    transport.configure(environment, 'rmw_fastrtps_cpp')
    assert environment == KEPT


def addresses(pid):
    """Return the addresses that the UDP sockets of a process are bound to."""
    inodes = set()
    for descriptor in Path(f'/proc/{pid}/fd').iterdir():
        with contextlib.suppress(FileNotFoundError):  # it may be closed meanwhile
            inodes.add(os.readlink(descriptor))
    rows = [line.split() for line in Path(f'/proc/{pid}/net/udp').read_text().splitlines()[1:]]
    bound = {row[1].partition(':')[0] for row in rows if f'socket:[{row[9]}]' in inodes}
    return {socket.inet_ntoa(struct.pack('=I', int(one, 16))) for one in bound}


@pytest.mark.parametrize(
    ('given', 'address', 'shares'),
    [
        ({}, '127.0.0.1', False),
        ({RANGE: 'SUBNET'}, '0.0.0.0', False),
        ({'FASTDDS_BUILTIN_TRANSPORTS': 'DEFAULT'}, '0.0.0.0', True),
    ],
    ids=str,
)
def test_a_node_listens_where_it_was_told_and_uses_shared_memory_on_request_only(
    run, given, address, shares
):
    node = run(**given)
    node.until('tick')
    listens = addresses(node.popen.pid)
    assert address in listens
    assert given or listens == {address}
    assert (SHARED_MEMORY in Path(f'/proc/{node.popen.pid}/maps').read_text()) == shares


def seconds(root, path):
    """Return the duration [s] at a path of a profile."""
    names = {'dds': 'http://www.eprosima.com'}
    (period,) = root.findall(f'dds:{path.replace("/", "/dds:")}', names)
    whole, nanoseconds = (float(part.text) for part in period)
    return whole + 1e-9 * nanoseconds


def test_profiles_repeat_a_lost_message_and_announce_a_node_after_tenths_of_a_second():
    for name in (LOCAL, OPEN):
        root = ElementTree.parse(share.path('node_runtime', 'config', name)).getroot()
        assert seconds(root, 'data_writer/times/heartbeatPeriod') == 0.1
        if name == LOCAL:  # it does not hear those who look for it by multicast
            announcement = 'participant/rtps/builtin/discovery_config/leaseAnnouncement'
            assert seconds(root, announcement) <= 0.2


@pytest.mark.usefixtures('domain')
def test_a_program_of_the_default_range_finds_a_node_of_the_loopback_interface(run):
    run().until('tick')
    looks = (
        'import time, rclpy; rclpy.init(); looker = rclpy.create_node("looker")'
        '\nwhile len(looker.get_node_names()) < 2: time.sleep(0.01)'
    )
    environment = os.environ | {RANGE: 'SUBNET'}
    subprocess.run([sys.executable, '-c', looks], env=environment, timeout=60, check=True)
