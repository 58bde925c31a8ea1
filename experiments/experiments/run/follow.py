"""Follow a bag while it is being recorded: where the car is now, from the chunks closed so far.

Costs a look at each new chunk, about twice a second, and takes no part in the ROS graph.
"""

import time
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import breakup_chunk

from bags.storage import decoders
from bags.storage.rosbag2_layout import BagTopic
from bags.storage.scan import PREFIX, inner
from bags.verdict import geometry
from msgs_yaml.stamp import NS_PER_S

STATE = '/vehicle/odometry'
MAGIC_BYTES = 8
AHEAD = 60.0  # m, that the car may drive between two looks


class Sight(NamedTuple):
    """Where the car was when the last chunk was closed."""

    t: float  # s, since the first state
    station: float  # m, along the reference
    speed: float  # m/s


class Follower:
    """Reads what has been added to a growing bag at each `look`."""

    def __init__(self, folder: Path, reference: np.ndarray, rest_s: float = 0.0):
        """`folder` is that of the bag, `reference` (n, 2) [m] the coarse path.

        For `rest_s` of wall time after a look the next one sees nothing, and costs nothing.
        """
        self.rest_s, self._next_s = rest_s, time.monotonic()
        self.folder = folder
        self.reference = reference
        self._positions = {}  # in each file of the bag
        self._schemas, self._channel = {}, None
        self._begin_ns = None
        self._passed = []  # one point per look: the station never jumps

    def look(self) -> Sight | None:
        """Return where the car was last, None when nothing new is there.

        A state that breaks the contract, or is torn, is none: what follows the run must not end it.
        """
        if time.monotonic() < self._next_s:
            return None
        self._next_s = time.monotonic() + self.rest_s
        chunks = list(self._new_chunks())
        if self._begin_ns is not None:
            chunks = chunks[-1:]  # the others say nothing about now
        state = None
        for chunk in chunks:
            with suppress(*decoders.INVALID):
                state = self._last_state(chunk) or state
        if state is None:
            return None
        self._passed.append((state.X, state.Y))
        station = geometry.track(self._passed, self.reference, AHEAD).distance[-1]
        t = (state.stamp_ns - self._begin_ns) / NS_PER_S
        return Sight(t, float(station), float(np.hypot(state.vx, state.vy)))

    def _new_chunks(self):
        # files are made one after the other; times of writing need not tell them apart
        for file in sorted(
            self.folder.glob('*.mcap'), key=lambda file: (len(file.name), file.name)
        ):
            position = self._positions.get(file, MAGIC_BYTES)
            with file.open('rb') as stream:
                stream.seek(position)
                data = stream.read()
            for opcode, begin, end in inner(data):
                position += PREFIX.size + end - begin
                self._positions[file] = position
                if opcode == Opcode.CHUNK:
                    yield Chunk.read(ReadDataStream(BytesIO(data[begin:end])))

    def _last_state(self, chunk):
        """Return the last state in a chunk; note the first one, and what describes it."""
        first = last = None
        for record in breakup_chunk(chunk):
            if isinstance(record, Schema):
                self._schemas[record.id] = record
            elif isinstance(record, Channel) and record.topic == STATE:
                self._channel = record
            elif isinstance(record, Message) and record.channel_id == self._channel.id:
                first, last = first or record, record
        if last is None:
            return None
        if self._begin_ns is None:
            self._begin_ns = self._decoded(first).stamp_ns
        return self._decoded(last)

    def _decoded(self, message):
        schema = self._schemas[self._channel.schema_id]
        return decoders.value(
            BagTopic(STATE, schema.name, schema.data.decode(), '', ''), message.data
        )
