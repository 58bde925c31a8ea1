"""The transport of a node: what the environment decides, and what a real process then uses.

Sockets and mappings of the process show that Fast DDS has taken the profile.
"""

import contextlib
import os
import socket
import statistics
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


def configured(middleware='rmw_fastrtps_cpp', **environment):
    transport.configure(environment, middleware)
    return environment


def test_a_profile_keeps_nodes_on_this_machine_unless_the_user_opens_it():
    for given in ({}, {RANGE: ''}, {RANGE: 'LOCALHOST'}):
        found = configured(**given)
        assert Path(found[PROFILES]).name == 'fast_dds_localhost.xml'
        assert found[RANGE] == 'SYSTEM_DEFAULT'  # its own LOCALHOST adds shared memory
    found = configured(**{RANGE: 'SUBNET'})
    assert Path(found[PROFILES]).name == 'fast_dds_subnet.xml'
    assert found[RANGE] == 'SUBNET'


@pytest.mark.parametrize(
    'choice',
    [
        {PROFILES: 'mine.xml'},
        {'ROS_DISCOVERY_SERVER': '192.168.1.20:11811'},
        {'FASTDDS_BUILTIN_TRANSPORTS': 'DEFAULT'},
        {'ROS_LOCALHOST_ONLY': '1'},
        {'ROS_STATIC_PEERS': '192.168.1.20'},
        {RANGE: 'OFF'},
        {RANGE: 'SYSTEM_DEFAULT'},
    ],
    ids=str,
)
def test_what_the_user_has_chosen_stays(choice):
    assert configured(**choice) == {RANGE: 'LOCALHOST', **choice}


def test_a_file_of_profiles_in_the_working_directory_is_a_choice(tmp_path, monkeypatch):
    """Fast DDS loads it after ours: without a range it might open the whole subnet."""
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').write_text('<profiles/>')
    monkeypatch.chdir(tmp_path)
    assert configured() == {RANGE: 'LOCALHOST'}


@pytest.mark.parametrize('given', [{}, {RANGE: 'LOCALHOST'}, {RANGE: 'SUBNET'}], ids=str)
def test_another_middleware_keeps_its_range(given):
    """To it, SYSTEM_DEFAULT might mean the whole subnet."""
    found = configured('rmw_cyclonedds_cpp', **given)
    assert found == {RANGE: 'LOCALHOST', **given}


def test_named_hosts_are_added_to_the_subnet():
    found = configured(**{RANGE: 'SUBNET', 'ROS_STATIC_PEERS': '192.168.1.20'})
    assert Path(found[PROFILES]).name == 'fast_dds_subnet.xml'


@pytest.mark.parametrize('given', [{}, {RANGE: 'SUBNET'}], ids=str)
def test_a_second_call_changes_nothing(given):
    once = configured(**given)
    assert configured(**once) == once


def addresses(pid):
    """Return the addresses that the UDP sockets of a process are bound to."""
    inodes = set()
    for descriptor in Path(f'/proc/{pid}/fd').iterdir():
        with contextlib.suppress(FileNotFoundError):  # it may be closed meanwhile
            inodes.add(os.readlink(descriptor))
    rows = [line.split() for line in Path(f'/proc/{pid}/net/udp').read_text().splitlines()[1:]]
    bound = {row[1].partition(':')[0] for row in rows if f'socket:[{row[9]}]' in inodes}
    return {socket.inet_ntoa(struct.pack('=I', int(one, 16))) for one in bound}


def mappings(pid):
    return Path(f'/proc/{pid}/maps').read_text()


@pytest.mark.parametrize('given', [{}, {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}], ids=str)
def test_by_default_a_node_uses_the_loopback_interface_and_no_shared_memory(run, given):
    node = run(**given)
    node.until('tick')
    assert addresses(node.popen.pid) == {'127.0.0.1'}
    assert SHARED_MEMORY not in mappings(node.popen.pid)


def test_with_subnet_a_node_listens_on_every_interface_and_uses_no_shared_memory(run):
    node = run(**{RANGE: 'SUBNET'})
    node.until('tick')
    assert '0.0.0.0' in addresses(node.popen.pid)
    assert SHARED_MEMORY not in mappings(node.popen.pid)


def test_every_profile_repeats_a_lost_message_after_a_tenth_of_a_second():
    for name in ('fast_dds_localhost.xml', 'fast_dds_subnet.xml'):
        root = ElementTree.parse(share.path('node_runtime', 'config', name)).getroot()
        names = {'dds': 'http://www.eprosima.com'}
        (period,) = root.findall(
            "dds:data_writer[@is_default_profile='true']//dds:heartbeatPeriod", names
        )
        assert [part.text for part in period] == ['0', '100000000']  # s, ns


@pytest.mark.usefixtures('domain')
def test_a_program_of_the_default_range_soon_finds_a_node_of_the_loopback_interface(run):
    """It would be found with its announcement of every 3 s, after 1.5 s in the mean."""
    run().until('tick')
    looks = (
        'import time, rclpy; rclpy.init()'
        '\nt, looker = time.monotonic(), rclpy.create_node("looker")'
        '\nwhile len(looker.get_node_names()) < 2: time.sleep(0.01)'
        '\nprint(time.monotonic() - t)'
    )
    environment = os.environ | {RANGE: 'SUBNET'}
    took = [
        float(subprocess.check_output([sys.executable, '-c', looks], env=environment, timeout=60))
        for _ in range(9)
    ]
    assert statistics.median(took) < 0.8, took


def test_the_user_may_choose_shared_memory(run):
    node = run(FASTDDS_BUILTIN_TRANSPORTS='DEFAULT')
    node.until('tick')
    assert SHARED_MEMORY in mappings(node.popen.pid)
