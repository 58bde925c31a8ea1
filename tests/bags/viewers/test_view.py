"""A bag and the running ring, seen through a real WebSocket client."""

import asyncio
import json
import signal
import socket
import struct
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
import rclpy
from foxglove.websocket import PlaybackCommand, PlaybackStatus
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from bags import cli
from bags.storage.bag_writer import BagWriter
from bags.storage.message_definitions import schema_text, type_hash
from bags.storage.rosbag2_metadata import BagTopic, qos_text
from bags.viewers import playback_server
from msgs_yaml import cdr_templates, contract, encode
from msgs_yaml.types import Obstacle, Obstacles, VehicleState
from node_runtime import ros, spin_node

SECONDS = 60.0
PROTOCOL = 'foxglove.sdk.v1'
MESSAGE = 1  # opcode of message data: subscription (u32), log time (u64), payload
S = 1_000_000_000
CUT = bytes.fromhex('00010000ff')  # no message of any type
DRAWN = {'/markers/vehicle', '/markers/safety', '/tf'}


class Client:
    """What a viewer does: read what is offered, subscribe, collect."""

    def __init__(self, connection):
        self.connection = connection
        self.info, self.channels, self.received, self.states = None, {}, {}, []

    async def read(self):
        said = await asyncio.wait_for(self.connection.read_message(), SECONDS)
        assert said is not None, 'the server hung up'
        if isinstance(said, str):
            said = json.loads(said)
            if said['op'] == 'serverInfo':
                self.info = said
            if said['op'] == 'advertise':
                self.channels |= {one['topic']: one for one in said['channels']}
        elif said[0] == MESSAGE:
            number, log_ns = struct.unpack_from('<IQ', said, 1)
            self.received.setdefault(number, []).append((log_ns, said[13:]))

    async def subscribe(self, *topics):
        while self.info is None or not set(topics) <= self.channels.keys():
            await self.read()
        wanted = [{'id': k, 'channelId': self.channels[t]['id']} for k, t in enumerate(topics)]
        await self.connection.write_message(
            json.dumps({'op': 'subscribe', 'subscriptions': wanted})
        )

    async def until(self, true):
        end = time.monotonic() + SECONDS
        while not true():
            assert time.monotonic() < end, self.received.keys()
            await self.read()


def look(url, visit):
    """Connect to a server and return what the coroutine visit(client) returns."""

    async def connected():
        request = HTTPRequest(url, headers={'Sec-WebSocket-Protocol': PROTOCOL})
        connection = await websocket_connect(request, subprotocols=[PROTOCOL])
        try:
            return await visit(Client(connection))
        finally:
            connection.close()

    return asyncio.run(asyncio.wait_for(connected(), SECONDS))


def states(n):
    return [VehicleState(S + k * 1_000_000, 0.02 * k, 0.0, 0.0, 20.0, 0.0, 0.0) for k in range(n)]


@pytest.fixture
def bag(tmp_path):
    """Return the folder of a bag of two seconds."""
    kinds = {'/vehicle/odometry': 'volatile', '/scenario/reference': 'transient_local'}
    topics = []
    for name, durability in kinds.items():
        kind = contract.load().topics[name].type
        text, digest = schema_text(kind), type_hash(kind)
        qos = qos_text('keep_last', 1, 'reliable', durability)
        topics.append(BagTopic(name, kind, text, digest, qos))
    writer = BagWriter(tmp_path / 'bag', topics, {})
    template = cdr_templates.Template('/vehicle/odometry')
    path = b'\x00\x01\x00\x00' + struct.pack('<iII', 1, 0, 4) + b'map\x00' + struct.pack('<I', 0)
    writer.write(1, S, S, path)
    for state in states(2000):
        writer.write(0, state.stamp_ns, state.stamp_ns, bytes(template.fill(state)))
    writer.close()
    return tmp_path / 'bag'


@pytest.fixture
def view():
    """Return view(arguments...) -> url of `bags view` in a process of its own."""
    started = []

    def start(*arguments, program=('bags.cli', 'view')):
        process = subprocess.Popen(
            [sys.executable, '-m', *program, '--port', '0', *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        started.append(process)
        output = []
        for line in process.stdout:  # the node may report its parameters first
            output.append(line)
            if 'ws://127.0.0.1:' in line:
                return line[line.index('ws://') :].split(';')[0]
        raise AssertionError(f'ended without an address: {output}')

    yield start
    for process in started:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=SECONDS)
        assert process.returncode == 0, output
        assert 'rror' not in output


def test_a_bag_arrives_with_its_schemas_bytes_and_times(view, bag):
    async def visit(client):
        await client.subscribe('/vehicle/odometry', '/scenario/reference', '/tf')
        await client.until(lambda: {0, 1, 2} <= client.received.keys())
        await client.until(lambda: len(client.received[0]) >= 500)
        return client

    client = look(view(bag, '--loop'), visit)
    channel = client.channels['/vehicle/odometry']
    assert (channel['encoding'], channel['schemaEncoding']) == ('cdr', 'ros2msg')
    assert channel['schemaName'] == 'nav_msgs/msg/Odometry'
    assert channel['schema'] == schema_text('nav_msgs/msg/Odometry')
    assert {'time', 'playbackControl'} <= set(client.info['capabilities'])
    template = cdr_templates.Template('/vehicle/odometry')
    sent = {item.stamp_ns: bytes(template.fill(item)) for item in states(2000)}
    for log_ns, payload in client.received[0]:
        assert payload == sent[log_ns]


def test_it_listens_on_this_machine_only(view, bag):
    port = int(view(bag).rpartition(':')[2])
    with socket.socket() as outside:
        outside.settimeout(2.0)
        # 127.0.0.2 is this machine, too, but not the address that is served
        assert outside.connect_ex(('127.0.0.2', port)) != 0


def test_a_port_that_is_taken_is_one_line(view, bag, capsys):
    port = view(bag).rpartition(':')[2]
    assert cli.main(['view', str(bag), '--port', port]) == 1
    output = capsys.readouterr().err
    assert output.count('\n') == 1
    assert f'127.0.0.1:{port}' in output


@pytest.mark.usefixtures('domain')
@pytest.mark.parametrize('namespace', ['/', '/car1'])
def test_the_running_ring_is_seen_with_its_shapes(view, namespace):
    inside = ('--ros-args', '-r', f'__ns:={namespace}')
    url = view('--live') if namespace == '/' else view(*inside, program=('bags.view_node',))
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('ring', context=context, namespace=namespace)
    node.declare_parameter('mode', 'realtime')
    state_pub = ros.publisher(node, '/vehicle/odometry')
    seen_pub = ros.publisher(node, '/scenario/obstacles')
    stamps = iter(range(S, 10_000 * S, 50_000_000))

    async def visit(client):
        await client.subscribe('/vehicle/odometry', *sorted(DRAWN))
        everything = client.until(lambda: {0, 1, 2, 3} <= client.received.keys())
        reading = asyncio.ensure_future(everything)
        while not reading.done():
            stamp_ns = next(stamps)
            obstacle = Obstacle(1, 60.0, 0.0, 1.0, 0.0, 0.0)
            seen_pub.publish(encode.obstacles(Obstacles(stamp_ns, (obstacle,))))
            state = VehicleState(stamp_ns, 1.0, 2.0, 0.0, 20.0, 0.0, 0.0)
            state_pub.publish(encode.odometry(state))
            state_pub.publish(CUT)
            await asyncio.sleep(0.05)
        await reading
        return client

    try:
        client = look(url, visit)
    finally:
        spin_node.shut_down(node, context=context)
    schemas = {topic: client.channels[topic]['schemaName'] for topic in DRAWN}
    assert schemas['/markers/vehicle'] == 'foxglove.SceneUpdate'
    assert schemas['/tf'] == 'foxglove.FrameTransforms'
    everything = b''.join(payload for _, payload in client.received[0])
    assert struct.pack('<d', 2.0) in everything


def test_foxglove_pauses_and_seeks_and_gets_the_facts_again(bag):
    from bags.storage import read

    shown = playback_server.PlaybackServer(read.load(bag), 0, 1.0, False)
    try:
        sent = []
        shown.server.send = lambda name, payload, log_ns: sent.append((name, log_ns))
        request = SimpleNamespace(
            playback_command=PlaybackCommand.Pause,
            playback_speed=1.0,
            seek_time=2 * S,
            request_id='7',
        )
        answer = shown.on_control(request)
        assert (answer.status, answer.current_time) == (PlaybackStatus.Paused, 2 * S)
        assert (answer.did_seek, answer.request_id) == (True, '7')
        calls = iter([False, True])
        shown.run(lambda: next(calls))
        assert sent == [('/scenario/reference', 2 * S), ('/vehicle/odometry', 2 * S)]
    finally:
        shown.close()


@pytest.mark.usefixtures('domain')
def test_the_live_view_says_so_when_its_port_is_taken(view, bag):
    port = view(bag).rpartition(':')[2]
    done = subprocess.run(
        [sys.executable, '-m', 'bags.cli', 'view', '--live', '--port', port],
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert done.returncode == spin_node.EXIT_CONFIGURATION
    assert f'127.0.0.1:{port}' in done.stdout + done.stderr
