"""The live position of the car in a run, read from the bag that is being recorded.

Reads each new chunk of the bag, about twice a second, and takes no part in the ROS graph.
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

from bags.evaluation import geometry
from bags.storage.columns import DECODE_ERRORS, decode_message
from bags.storage.mcap_reader import RECORD_PREFIX, records_in_chunk
from bags.storage.rosbag2_metadata import BagTopic
from msgs_yaml.conversions import NS_PER_S

STATE = '/vehicle/odometry'
MAGIC_BYTES = 8
AHEAD = 60.0  # m, the most that the car may drive between two reads


class LivePosition(NamedTuple):
    """The position of the car when the last chunk was closed."""

    t: float  # s, since the first state
    station: float  # m, along the reference
    speed: float  # m/s


class PositionReader:
    """Reads the new chunks of a growing bag at each `poll`."""

    def __init__(self, folder: Path, reference: np.ndarray, pause_s: float = 0.0):
        """`folder` is that of the bag, `reference` (n, 2) [m] the coarse path.

        A poll within `pause_s` of wall time after the last one returns None and costs nothing.
        """
        self.pause_s, self._next_s = pause_s, time.monotonic()
        self.folder = folder
        self.reference = reference
        self._offsets = {}  # bytes read of each file of the bag
        self._schemas, self._channel = {}, None
        self._begin_ns = None
        self._track = []  # one point per poll: the station never jumps

    def poll(self) -> LivePosition | None:
        """Return the latest position, None when nothing new was recorded.

        An invalid or torn state is ignored: the display must not end the run.
        """
        if time.monotonic() < self._next_s:
            return None
        self._next_s = time.monotonic() + self.pause_s
        chunks = list(self._new_chunks())
        if self._begin_ns is not None:
            chunks = chunks[-1:]  # the others are out of date
        state = None
        for chunk in chunks:
            with suppress(*DECODE_ERRORS):
                state = self._last_state(chunk) or state
        if state is None:
            return None
        self._track.append((state.X, state.Y))
        station = geometry.project_drive(self._track, self.reference, AHEAD).distance[-1]
        t = (state.stamp_ns - self._begin_ns) / NS_PER_S
        return LivePosition(t, float(station), float(np.hypot(state.vx, state.vy)))

    def _new_chunks(self):
        # files are written one after the other; their times may be equal
        files = self.folder.glob('*.mcap')
        for file in sorted(files, key=lambda file: (len(file.name), file.name)):
            offset = self._offsets.get(file, MAGIC_BYTES)
            with file.open('rb') as stream:
                stream.seek(offset)
                data = stream.read()
            for opcode, body in records_in_chunk(data):
                offset += RECORD_PREFIX.size + len(body)
                self._offsets[file] = offset
                if opcode == Opcode.CHUNK:
                    yield Chunk.read(ReadDataStream(BytesIO(body)))

    def _last_state(self, chunk):
        """Return the last state in a chunk; store channel, schema and the time of the first."""
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
        topic = BagTopic(STATE, schema.name, schema.data.decode(), '', '')
        return decode_message(topic, message.data)
