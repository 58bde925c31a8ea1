"""Serves topics to Foxglove over a WebSocket on this machine: recorded bytes, shapes and frames.

Messages keep the schema and the bytes (CDR) of ROS 2, so that Foxglove shows them as it would a
bag; shapes and the frame of the car are sent in Foxglove's own schemas.


Passes messages on to a server, and draws what they change."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import foxglove
from foxglove import Capability, Schema, messages
from foxglove.channels import FrameTransformsChannel, SceneUpdateChannel
from foxglove.websocket import ServerListener

from bags.errors import BagError
from bags.storage.decoding import DECODE_ERRORS, decode_message
from bags.storage.rosbag2_metadata import BagTopic
from bags.viewers import marker_scene
from bags.viewers.marker_scene import (
    PREDICTION,
    SAFETY,
    STATE,
    VEHICLE,
    WATCHED,
    Drawing,
    MarkerScene,
    Shape,
)
from msgs_yaml import conversions, share
from msgs_yaml.types import VehicleState

HOST, PORT = '127.0.0.1', 8765
# messages per client that wait: two seconds of every topic at its rate
BACKLOG = 8192
FRAME, CHILD_FRAME = 'map', 'base_link'


class Served(NamedTuple):
    """A topic as it is offered."""

    name: str
    type: str  # 'package/msg/Name'
    schema: str  # definition text
    latched: bool  # who comes late gets the last message


class Server(ServerListener):
    """A WebSocket server; every method may be called whether or not anybody listens."""

    def __init__(
        self,
        topics: Iterable[Served],
        port: int,
        span_ns: tuple[int, int] | None = None,
        control: Any = None,
    ):
        """Offer `topics` on `port` (0: any free one); BagError when it is taken.

        `span_ns` and `control` belong to a recording: first and last time, and what is asked to
        play, pause and seek (on_playback_control_request of foxglove.ServerListener).
        """
        foxglove.set_log_level('ERROR')
        topics = list(topics)
        # channels live as long as their context
        self._context = context = foxglove.Context()
        self._channels = {topic.name: _channel(topic, context) for topic in topics}
        self._latched = {topic.name: None for topic in topics if topic.latched}
        drawn = [name for name in (VEHICLE, SAFETY, PREDICTION) if name not in self._channels]
        self._scenes = {name: SceneUpdateChannel(name, context=context) for name in drawn}
        self._frames = FrameTransformsChannel('/tf', context=context)
        self._control = control
        capabilities = [Capability.Time] + ([Capability.PlaybackControl] if span_ns else [])
        try:
            self._server = foxglove.start_server(
                name='bags',
                host=HOST,
                port=port,
                capabilities=capabilities,
                context=context,
                server_listener=self,
                playback_time_range=span_ns,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            raise BagError(f'no server on {HOST}:{port}: {error}; --port N takes another') from None

    @property
    def url(self) -> str:
        """Where Foxglove connects to."""
        return f'ws://{HOST}:{self._server.port}'

    def send(self, topic: str, payload: bytes, log_ns: int) -> None:
        """Send a message (CDR with its encapsulation header) of an offered topic."""
        if topic in self._latched:
            self._latched[topic] = (payload, log_ns)
        self._channels[topic].log(payload, log_time=log_ns)

    def draw(self, picture: Drawing, log_ns: int) -> None:
        """Show a picture, unless its topic is among those that are sent as they are."""
        if picture.topic in self._scenes:
            update = scene_update(picture)
            self._scenes[picture.topic].log(update, log_time=log_ns)

    def place(self, state: VehicleState, log_ns: int) -> None:
        """Say where the car is."""
        self._frames.log(frame_transforms(state), log_time=log_ns)

    def tell_time(self, now_ns: int) -> None:
        """Tell the clients what time it is in the recording, or on the clock of the ring."""
        self._server.broadcast_time(now_ns)

    def tell_playback(self, state: foxglove.websocket.PlaybackState) -> None:
        """Tell the clients that the playback has changed by itself."""
        self._server.broadcast_playback_state(state)

    def close(self) -> None:
        """End the server and the connections."""
        self._server.stop()

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Called by the server: who comes late still gets the facts."""
        last = self._latched.get(channel.topic)
        if last:
            payload, log_ns = last
            self._channels[channel.topic].log(payload, log_time=log_ns)

    def on_playback_control_request(self, request: Any) -> Any:
        """Called by the server when a client plays, pauses or seeks."""
        return self._control(request) if self._control else None


def connection_hint(url: str) -> str:
    """Return what a person has to do to see what is served."""
    layout = share.path('bags', 'viewers', 'foxglove.json')
    return (
        f'Foxglove: open connection, Foxglove WebSocket, {url}; import the layout {layout}\n'
        'Ctrl-C ends it.'
    )


def _channel(topic, context):
    schema = Schema(name=topic.type, encoding='ros2msg', data=topic.schema.encode())
    return foxglove.Channel(topic.name, schema=schema, message_encoding='cdr', context=context)


def frame_transforms(x: VehicleState) -> messages.FrameTransforms:
    """Return the pose of base_link in map."""
    z, w = conversions.heading_to_quaternion(x.psi)
    one = messages.FrameTransform(
        timestamp=_time(x.stamp_ns),
        parent_frame_id=FRAME,
        child_frame_id=CHILD_FRAME,
        translation=messages.Vector3(x=float(x.X), y=float(x.Y)),
        rotation=messages.Quaternion(z=z, w=w),
    )
    return messages.FrameTransforms(transforms=[one])


def scene_update(picture: Drawing) -> messages.SceneUpdate:
    """Return a picture as one entity: the next of its topic replaces it whole."""
    found = {
        marker_scene.BOX: [],
        marker_scene.DISC: [],
        marker_scene.LINE: [],
        marker_scene.TEXT: [],
    }
    for one in picture.shapes:
        found[one.kind].append(PRIMITIVES[one.kind](one))
    entity = messages.SceneEntity(
        timestamp=_time(picture.stamp_ns),
        frame_id=FRAME,
        id=picture.topic,
        cubes=found[marker_scene.BOX],
        cylinders=found[marker_scene.DISC],
        lines=found[marker_scene.LINE],
        texts=found[marker_scene.TEXT],
    )
    return messages.SceneUpdate(entities=[entity])


def _time(stamp_ns):
    return messages.Timestamp(*conversions.split_stamp(stamp_ns))


def _pose(one: Shape):
    z, w = conversions.heading_to_quaternion(one.yaw)
    x, y, up = one.at
    position = messages.Vector3(x=x, y=y, z=up)
    return messages.Pose(position=position, orientation=messages.Quaternion(z=z, w=w))


def _colour(rgba):
    red, green, blue, opacity = (float(value) for value in rgba)
    return messages.Color(r=red, g=green, b=blue, a=opacity)


def _size(one):
    x, y, z = one.size
    return messages.Vector3(x=x, y=y, z=z)


def _box(one):
    return messages.CubePrimitive(pose=_pose(one), size=_size(one), color=_colour(one.colour))


def _disc(one):
    look = {'size': _size(one), 'color': _colour(one.colour)}
    return messages.CylinderPrimitive(pose=_pose(one), bottom_scale=1.0, top_scale=1.0, **look)


def _line(one):
    width, _, _ = one.size
    return messages.LinePrimitive(
        type=messages.LinePrimitiveLineType.LineStrip,
        pose=_pose(one),
        thickness=width,
        points=[messages.Point3(x=float(x), y=float(y)) for x, y in one.points],
        color=_colour(one.colour),
        colors=[_colour(colour) for colour in one.colours],
    )


def _text(one):
    height, _, _ = one.size
    look = {'billboard': True, 'font_size': height, 'color': _colour(one.colour)}
    return messages.TextPrimitive(pose=_pose(one), text=one.text, **look)


PRIMITIVES = {
    marker_scene.BOX: _box,
    marker_scene.DISC: _disc,
    marker_scene.LINE: _line,
    marker_scene.TEXT: _text,
}


class Forwarder:
    """A server and the stage that it shows."""

    def __init__(self, server: Server, stage: MarkerScene):
        self.server = server
        self._stage = stage

    def show(self, topic: str, kind: str, schema: str, payload: bytes, log_ns: int) -> None:
        """Send a message (CDR) of the type `kind`, whose definition is `schema`; draw the scene.

        A message that breaks the contract is sent all the same, and nothing is drawn of it.
        """
        self.server.send(topic, payload, log_ns)
        if topic not in WATCHED or not self._stage.wants(topic, log_ns):
            return
        try:
            value = decode_message(BagTopic(topic, kind, schema, '', ''), payload)
        except DECODE_ERRORS:
            return
        for picture in self._stage.take(topic, value):
            self.server.draw(picture, log_ns)
        if topic == STATE:
            self.server.place(value, log_ns)
