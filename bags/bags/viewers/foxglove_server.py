"""Serve topics to Foxglove over a WebSocket on this machine: recorded bytes, shapes and frames.

Messages keep the schema and the bytes (CDR) of ROS 2, so that Foxglove shows them as it would a
bag; shapes and the frame of the car are sent in Foxglove's own schemas.
"""

from collections.abc import Sequence
from typing import Any

import foxglove
from foxglove import Capability, Schema, messages
from foxglove.channels import FrameTransformsChannel, SceneUpdateChannel
from foxglove.websocket import ServerListener

from bags.errors import BagError
from bags.playback import is_latched
from bags.storage.decoding import DECODE_ERRORS, decode_message
from bags.storage.rosbag2_metadata import BagTopic
from bags.viewers import marker_scene
from bags.viewers.marker_scene import Drawing, MarkerScene
from msgs_yaml import conversions, share
from msgs_yaml.types import VehicleState

HOST, PORT = '127.0.0.1', 8765
BACKLOG = 8192  # waiting messages per client: two seconds of every topic at its rate
FRAME, CHILD_FRAME, TF = 'map', 'base_link', '/tf'
SCENES = (marker_scene.VEHICLE, marker_scene.SAFETY, marker_scene.PREDICTION)


class Server(ServerListener):
    """A WebSocket server; every method may be called with or without clients."""

    def __init__(
        self,
        topics: Sequence[BagTopic],
        port: int,
        scene: MarkerScene,
        span_ns: tuple[int, int] | None = None,
        control: Any = None,
    ):
        """Offer `topics` on `port` (0: any free one); BagError when it is taken.

        `scene` follows the messages. `span_ns` and `control` belong to a recording: first and last
        time, and what is called to play, pause and seek (on_playback_control_request of
        foxglove.ServerListener).
        """
        foxglove.set_log_level('ERROR')
        # channels live as long as their context
        self._context = context = foxglove.Context()
        self._channels = {topic.name: _channel(topic, context) for topic in topics}
        self._latched = {topic.name: None for topic in topics if is_latched(topic)}
        computed = [name for name in SCENES if name not in self._channels]
        self._scenes = {name: SceneUpdateChannel(name, context=context) for name in computed}
        is_framed = TF in self._channels  # a recording may have the frames of the plant
        self._frames = None if is_framed else FrameTransformsChannel(TF, context=context)
        self._scene, self._control = scene, control
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
        """The address for Foxglove."""
        return f'ws://{HOST}:{self._server.port}'

    def send(self, topic: str, payload: bytes, log_ns: int) -> None:
        """Send a message (CDR with its encapsulation header) of an offered topic."""
        if topic in self._latched:
            self._latched[topic] = (payload, log_ns)
        self._channels[topic].log(payload, log_time=log_ns)

    def forward(self, topic: BagTopic, payload: bytes, log_ns: int) -> None:
        """Send a message (CDR), and what it changes in the scene.

        A message that breaks the contract is sent, too, but changes nothing in the scene. Drawings
        whose topic is among the recorded ones are not sent.
        """
        self.send(topic.name, payload, log_ns)
        if topic.name not in marker_scene.WATCHED or not self._scene.needs(topic.name, log_ns):
            return
        try:
            value = decode_message(topic, payload)
        except DECODE_ERRORS:
            return
        for drawing in self._scene.update(topic.name, value):
            if drawing.topic in self._scenes:
                self._scenes[drawing.topic].log(scene_update(drawing), log_time=log_ns)
        if topic.name == marker_scene.STATE and self._frames:
            self._frames.log(frame_transforms(value), log_time=log_ns)

    def broadcast_time(self, now_ns: int) -> None:
        """Send the time of the recording, or of the running nodes."""
        self._server.broadcast_time(now_ns)

    def broadcast_playback(self, state: foxglove.websocket.PlaybackState) -> None:
        """Send a change of the playback that no client requested."""
        self._server.broadcast_playback_state(state)

    def close(self) -> None:
        """End the server and the connections."""
        self._server.stop()

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Send a late client the latched messages; the server calls this."""
        last = self._latched.get(channel.topic)
        if last:
            payload, log_ns = last
            self._channels[channel.topic].log(payload, log_time=log_ns)

    def on_playback_control_request(self, request: Any) -> Any:
        """Do what a client asks for: play, pause, seek; the server calls this."""
        return self._control(request) if self._control else None


def connection_hint(url: str) -> str:
    """Return instructions to connect Foxglove to `url`."""
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
    transform = messages.FrameTransform(
        timestamp=_time(x.stamp_ns),
        parent_frame_id=FRAME,
        child_frame_id=CHILD_FRAME,
        translation=messages.Vector3(x=float(x.X), y=float(x.Y)),
        rotation=_quaternion(x.psi),
    )
    return messages.FrameTransforms(transforms=[transform])


def scene_update(drawing: Drawing) -> messages.SceneUpdate:
    """Return a drawing as one entity, which the next of its topic replaces."""
    primitives = {kind: [] for kind in PRIMITIVES}
    for shape in drawing.shapes:
        primitives[shape.kind].append(PRIMITIVES[shape.kind](shape))
    entity = messages.SceneEntity(
        timestamp=_time(drawing.stamp_ns),
        frame_id=FRAME,
        id=drawing.topic,
        cubes=primitives[marker_scene.BOX],
        cylinders=primitives[marker_scene.DISC],
        lines=primitives[marker_scene.LINE],
        texts=primitives[marker_scene.TEXT],
    )
    return messages.SceneUpdate(entities=[entity])


def _time(stamp_ns):
    return messages.Timestamp(*conversions.split_stamp(stamp_ns))


def _look(shape):
    """Return what every primitive has."""
    x, y, z = shape.at
    position, turn = messages.Vector3(x=x, y=y, z=z), _quaternion(shape.yaw)
    pose = messages.Pose(position=position, orientation=turn)
    return {'pose': pose, 'color': _colour(shape.colour)}


def _quaternion(yaw):
    z, w = conversions.heading_to_quaternion(yaw)
    return messages.Quaternion(z=z, w=w)


def _colour(rgba):
    red, green, blue, opacity = (float(value) for value in rgba)
    return messages.Color(r=red, g=green, b=blue, a=opacity)


def _size(shape):
    x, y, z = shape.size
    return messages.Vector3(x=x, y=y, z=z)


def _box(shape):
    return messages.CubePrimitive(size=_size(shape), **_look(shape))


def _disc(shape):
    ends = {'bottom_scale': 1.0, 'top_scale': 1.0}
    return messages.CylinderPrimitive(size=_size(shape), **ends, **_look(shape))


def _line(shape):
    return messages.LinePrimitive(
        type=messages.LinePrimitiveLineType.LineStrip,
        thickness=shape.size[0],
        points=[messages.Point3(x=float(x), y=float(y)) for x, y in shape.points],
        colors=[_colour(colour) for colour in shape.colours],
        **_look(shape),
    )


def _text(shape):
    font = {'billboard': True, 'font_size': shape.size[0]}
    return messages.TextPrimitive(text=shape.text, **font, **_look(shape))


PRIMITIVES = {
    marker_scene.BOX: _box,
    marker_scene.DISC: _disc,
    marker_scene.LINE: _line,
    marker_scene.TEXT: _text,
}
