"""Passes messages on to a server, and draws what they change."""

from bags.storage import decoders
from bags.storage.rosbag2_layout import BagTopic
from bags.viewers.foxglove_server import Server
from bags.viewers.stage import STATE, WATCHED, Stage


class Projector:
    """A server and the stage that it shows."""

    def __init__(self, server: Server, stage: Stage):
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
            value = decoders.value(BagTopic(topic, kind, schema, '', ''), payload)
        except decoders.INVALID:
            return
        for picture in self._stage.take(topic, value):
            self.server.draw(picture, log_ns)
        if topic == STATE:
            self.server.place(value, log_ns)
