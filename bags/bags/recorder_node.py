"""Records every topic of the contract as raw bytes into a rosbag2 folder.

So it does frames, log lines and transitions (`derived` in the contract) whose types are installed.
It subscribes to the topics of its namespace and files them under the names of the contract.
Messages are polled: a callback of rclpy costs about 90 us per message, taking raw bytes every few
milliseconds about 25 us. The middleware provides the times of sending and receiving.
"""

import json
import signal
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from itertools import count
from pathlib import Path

from rclpy.qos import HistoryPolicy

from bags.errors import BagError
from bags.storage.bag_writer import BagWriter
from bags.storage.message_filing import (
    CLOCK,
    LOCKSTEP,
    LOSS_RECORD,
    ClockError,
    Filing,
    Losses,
    RecorderParams,
    SimulatedTime,
    bag_topic,
)
from msgs_yaml import contract, encode, share
from msgs_yaml.contract import Topic
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Health
from node_runtime import provenance, ros, spin_node
from node_runtime.input_monitor import OK, STALE, WARN, HeldLevel
from node_runtime.managed_node import ManagedNode
from node_runtime.parameters import ParameterError

LARGEST_TAKE = 5000  # messages of one topic before the next topic is polled
NAMESPACE = 'namespace'  # key in the record of the run
ROSOUT = '/rosout'  # in no namespace
ANY = 'any'  # publisher in the contract of a topic that several nodes publish
QUIET_S = 0.05  # at the end: no message has arrived for so long
LONGEST_END_S = 1.0
MB = 1e6
RECORDER = 'recorder'
NO_TOPIC = 'none'
_MESSAGES = {
    OK: 'recording',
    WARN: 'messages were lost: the recorder or the network is too slow',
    STALE: 'no message has arrived yet',
}


class RecorderNode(ManagedNode):
    """Polls its subscriptions, files the messages, and closes the bag at the end.

    The bag is created by `configure` and completed by the clean-up or at the end of the process.
    What arrives while the node is inactive is not in it. Configured again, the node creates another
    one beside it.
    """

    def __init__(self):
        super().__init__('recorder')
        defaults = share.path('bags', 'config', 'recorder.yaml')
        self.params = ros.declare(self, RecorderParams, defaults)
        self.bag = self.inbox = None
        self.folders: set[str] = set()  # of the bags of this node
        self.stopping, self.exit_code = False, 0
        # instead of rclpy's handlers: a signal must not tear a record, a second one has no effect
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: setattr(self, 'stopping', True))
        ros.steady_timer(self, self.params.poll_s, self.poll)

    def configure(self):
        """Create the bag, and subscribe."""
        self.time = SimulatedTime(lambda: _arrived(self.inlets[CLOCK]))
        mode, params = ros.mode(self), self.params
        recorded = recorded_topics()
        topics = [bag_topic(topic, mode) for topic in recorded.values()]
        if not params.out:
            raise ParameterError('out: is missing; it names the folder to create for the bag')
        folder, numbers = params.out, count(2)
        while folder in self.folders and Path(folder).exists():
            folder = f'{params.out}_{next(numbers)}'
        split = round(params.split_mb * MB), round(params.split_s * NS_PER_S)
        info = {**run_info(params.run_info, mode), NAMESPACE: self.get_namespace()}
        try:
            self.bag = BagWriter(folder, topics, {'run': info}, *split)
        except BagError as error:
            raise ParameterError(f'out: {error}') from error
        self.folders.add(folder)
        clock_publisher = contract.load().topics[CLOCK].publisher
        # a second node without an executor: only `drain` takes its messages
        self.inbox = ros.polled_node(self, f'{self.get_name()}_inbox')
        self.filings, self.inlets = {}, {}  # by topic
        for k, (described, (name, topic)) in enumerate(zip(topics, recorded.items())):
            write, by_plant = partial(self.bag.write, k), topic.publisher == clock_publisher
            is_single = topic.publisher != ANY
            self.filings[name] = Filing(described, mode, write, is_single, self.time, by_plant)
            # a queue that drops no message
            profile = ros.to_qos_profile(topic.requested_qos(mode))
            profile.history = HistoryPolicy.KEEP_ALL
            full = name if name == ROSOUT else ros.full_name(self, name)
            self.inlets[name] = self.inbox.create_subscription(
                ros.message_type(name), full, lambda data: None, profile, raw=True
            )
        self.received, self.warned = set(), set()
        # in lockstep a bag must not depend on the speed of the machine
        if mode != LOCKSTEP:
            self.health = RecordingHealth(mode)
            self.health_pub = ros.publisher(self, ros.HEALTH)
            period_s = 1.0 / contract.load().topics[ros.HEALTH].rate_hz[mode]
            ros.steady_timer(self, period_s, self.publish_health)
        self.next_chunk = time.monotonic() + params.chunk_s

    def activate(self):
        """Record from now on."""
        self.get_logger().info(f'recording into {self.bag.folder}')

    def deactivate(self):
        """File what has arrived; then file nothing until the node is active again."""
        if self.bag is not None:
            self._guard(self._file_arrived)

    def clean_up(self):
        """Complete the bag, and remove the second node."""
        self.close()
        self.bag = None
        if self.inbox:
            self.inbox.destroy_node()
            self.inbox = None

    def poll(self):
        """File the messages that have arrived; close a chunk when it is due."""
        if self.is_active:
            self._guard(self._file_arrived)
        elif self.bag is not None:
            # a queue that is full would block its publisher
            for topic, filing in self.filings.items():
                for _ in _arrived(self.inlets[topic]):
                    filing.pass_over()
        if self.stopping:
            spin_node.finish(self, self.exit_code)

    def _file_arrived(self):
        if self.drain():
            received = {name for name, counts in self.losses().items() if counts.received}
            if received > self.received:
                # each topic once, when its first message is filed
                new = ', '.join(sorted(received - self.received))
                self.get_logger().info(f'hears {new}')
                self.received = received
            self.warn_of_misdated()
        if time.monotonic() >= self.next_chunk:
            self.bag.flush()
            self.next_chunk = time.monotonic() + self.params.chunk_s

    def _guard(self, write):
        """Call what writes into the bag; an error ends the recording with exit code 1."""
        try:
            write()
        except ClockError as error:
            # the bag is completed with the messages so far
            self.get_logger().fatal(f'{error}; the bag ends there and is complete')
        except BagError as error:
            self.get_logger().fatal(str(error))
            self.bag = None
        else:
            return
        self.stopping, self.exit_code = True, 1

    def drain(self) -> int:
        """File every message that has arrived; return how many there were."""
        taken = 0
        for topic, filing in self.filings.items():
            arrived = self.time.take() if topic == CLOCK else _arrived(self.inlets[topic])
            for message in arrived:
                filing.file(*message)
                taken += 1
        return taken

    def losses(self):
        """Return the Losses so far of each topic of the contract, which a run consists of."""
        return {name: self.filings[name].counter.losses for name in contract.load().topics}

    def warn_of_misdated(self):
        """Warn once per topic of a message whose log time differs from its stamp."""
        for topic, filing in self.filings.items():
            if filing.misdated and topic not in self.warned:
                self.warned.add(topic)
                stamp_ns, log_ns = filing.first_misdated
                self.get_logger().warning(
                    f'{topic}: a message has the stamp {stamp_ns / NS_PER_S:.9f} s and is filed '
                    f'under {log_ns / NS_PER_S:.9f} s of the simulated time: either its node was '
                    'started again, or another program publishes this topic'
                )

    def publish_health(self):
        """Publish the health, stamped with the time of the machine."""
        now_ns = self.get_clock().now().nanoseconds
        self.health_pub.publish(encode.health(self.health.health(now_ns, self.losses())))

    def close(self):
        """File the messages still in transit, complete the bag."""
        for write in (self._drain_to_the_end, self._complete):
            if self.bag is not None:
                self._guard(write)

    def destroy_node(self):
        """Remove the second node, too."""
        if self.inbox:
            self.inbox.destroy_node()
        super().destroy_node()

    def _drain_to_the_end(self):
        quiet_since = time.monotonic()
        end = quiet_since + (LONGEST_END_S if self.is_active else 0.0)
        while not self.exit_code and time.monotonic() < min(end, quiet_since + QUIET_S):
            if self.drain():
                quiet_since = time.monotonic()
            time.sleep(self.params.poll_s)

    def _complete(self):
        left_out = self.time.end(fell_back=bool(self.exit_code))
        self.warn_of_misdated()
        warn = self.get_logger().warning
        if left_out:
            warn(f'{left_out} messages are left out whose stamp fell back before {CLOCK} did')
        losses = {name: filing.counter.losses for name, filing in self.filings.items()}
        record = {name: json.dumps(counts._asdict()) for name, counts in losses.items()}
        written = self.bag.close({LOSS_RECORD: record})
        self.get_logger().info(f'{written} messages in {self.bag.folder}')
        for topic, filing in self.filings.items():
            if losses[topic].lost:
                lost, gaps = losses[topic].lost, losses[topic].gaps
                warn(f'{topic}: {lost} messages lost in {gaps} places')
            if filing.misdated:
                other = f'{filing.misdated} messages are filed under another time than their stamp'
                warn(f'{topic}: {other}')


class RecordingHealth:
    """Computes the health of a recording; a loss is held for a while (`HeldLevel`)."""

    def __init__(self, mode: str):
        """Take from the contract which topics nodes publish without request in `mode`."""
        topics = contract.load().topics.values()
        self._expected = [topic.name for topic in topics if topic.rate_hz[mode]]
        self._lost = 0  # at the last report
        self._held = HeldLevel()

    def health(self, stamp_ns: int, counted: Mapping[str, Losses]) -> Health:
        """Return the health at a stamp; `counted` are the losses of every topic so far."""
        received = sum(losses.received for losses in counted.values())
        lost = sum(losses.lost or 0 for losses in counted.values())
        more, self._lost = lost > self._lost, lost
        level = self._held.update(WARN if more else OK if received else STALE, stamp_ns)
        silent = [name for name in self._expected if not counted[name].received]
        values = {'messages': received, 'lost': lost, 'silent': ' '.join(silent) or NO_TOPIC}
        return Health(stamp_ns, RECORDER, level, _MESSAGES[level], values)


def recorded_topics() -> dict[str, Topic]:
    """Return the topics of the contract by name, with the derived ones whose type is installed."""
    known = contract.load()
    topics = dict(known.topics)
    for name, topic in known.derived.items():
        with suppress(ModuleNotFoundError, FileNotFoundError):
            ros.message_type(name)
            bag_topic(topic, LOCKSTEP)  # takes the definition of the type
            topics[name] = topic
    return topics


def _arrived(subscription):
    """Yield the messages of a subscription as arguments of `Filing.file`."""
    handle, kind = subscription.handle, subscription.msg_type
    with handle:
        for _ in range(LARGEST_TAKE):
            message = handle.take_message(kind, True)
            if message is None:
                break
            data, info = message
            yield (
                data,
                info['source_timestamp'],
                info['received_timestamp'],
                info['publication_sequence_number'],
            )


def run_info(path: str, mode: str) -> dict[str, str]:
    """Return the names and values of a JSON file as text; without a file versions, machine, mode.

    Values other than texts are kept as JSON. Raises ParameterError when it is not a JSON object.
    """
    if not path:
        return provenance.describe_environment(mode)
    try:
        read = json.loads(Path(path).read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        raise ParameterError(f'run_info: {path}: {error}') from error
    if not isinstance(read, dict):
        raise ParameterError(f'run_info: {path}: must be one JSON object of names and values')
    return {k: v if isinstance(v, str) else json.dumps(v) for k, v in read.items()}


def main() -> int:
    """Record until SIGINT or SIGTERM; exit code 1 when the disk failed."""
    about = 'Record every topic of a run into a bag, until SIGINT or SIGTERM.'
    return spin_node.run(RecorderNode, about, '--ros-args -p out:=my_bag -p mode:=realtime')


if __name__ == '__main__':
    sys.exit(main())
