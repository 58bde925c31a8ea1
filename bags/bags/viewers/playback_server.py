"""Show a bag to Foxglove: played at a rate, paused and sought from Foxglove's own controls."""

import threading
import time
from collections.abc import Callable

import numpy as np
from foxglove.websocket import PlaybackCommand, PlaybackState, PlaybackStatus

from bags.evaluation.drive import facts_from_run_info
from bags.playback import PlaybackClock, build_playlist, is_latched
from bags.storage import read
from bags.viewers.foxglove_server import Server
from bags.viewers.marker_scene import MarkerScene, OutlineParams, SafetyParams, ShapeParams
from msgs_yaml import share
from node_runtime import parameters

POLL_S = 0.01  # of wall time


class PlaybackServer:
    """A bag on a server. `run` sends its messages until it is stopped."""

    def __init__(self, bag: read.Bag, port: int, rate: float, loop: bool):
        """Raise BagError when the port is taken."""
        self.loop = loop
        self.playlist = build_playlist(bag)
        topics = self.playlist.topics
        self.latched = {k for k, topic in enumerate(topics) if is_latched(topic)}
        first_ns, length_ns = self.playlist.first_ns, self.playlist.duration_ns
        self.clock = PlaybackClock(rate, time.monotonic_ns(), end_ns=length_ns)
        self.next = 0  # message to send
        self.lock = threading.Lock()
        self.seeking = False
        scene, span_ns = MarkerScene(_shape_params(bag)), (first_ns, first_ns + length_ns)
        self.server = Server(topics, port, scene, span_ns, self.on_control)
        self.url, self.close = self.server.url, self.server.close

    def run(self, stopped: Callable[[], bool]) -> None:
        """Send what is due until `stopped`."""
        ended = False
        while not stopped():
            with self.lock:
                position_ns = self.clock.position_ns(time.monotonic_ns())
                if self.seeking:
                    self._seek(position_ns)
            self._send_until(position_ns)
            self.server.broadcast_time(self._log_ns(position_ns))
            at_end = position_ns >= self.playlist.duration_ns
            if at_end and self.loop:
                with self.lock:
                    self.clock.set(time.monotonic_ns(), position_ns=0)
                    self.seeking = True
            elif at_end and not ended:
                self.server.broadcast_playback(self._state(position_ns, False, None))
            ended = at_end
            time.sleep(POLL_S)

    def on_control(self, request) -> PlaybackState:
        """Do what Foxglove requests, from its thread; return the state of the playback."""
        now_ns, seek_ns = time.monotonic_ns(), request.seek_time
        position_ns = None if seek_ns is None else seek_ns - self.playlist.first_ns
        paused = request.playback_command != PlaybackCommand.Play
        rate = request.playback_speed or None
        with self.lock:
            self.clock.set(now_ns, paused=paused, rate=rate, position_ns=position_ns)
            self.seeking |= seek_ns is not None
            position_ns = self.clock.position_ns(now_ns)
            return self._state(position_ns, seek_ns is not None, request.request_id)

    def _log_ns(self, position_ns):
        return self.playlist.first_ns + position_ns

    def _state(self, position_ns, did_seek, request_id):
        status = PlaybackStatus.Paused if self.clock.paused else PlaybackStatus.Playing
        if position_ns >= self.playlist.duration_ns:
            status = PlaybackStatus.Ended
        log_ns = self._log_ns(position_ns)
        return PlaybackState(status, log_ns, self.clock.rate, did_seek, request_id)

    def _seek(self, position_ns):
        """Continue from another position: the last latched messages before it are sent first."""
        self.seeking = False
        self.next = int(np.searchsorted(self.playlist.due_ns, position_ns))
        before = self.playlist.topic[: self.next]
        for k in self.latched:
            (rows,) = np.nonzero(before == k)
            if rows.size:
                self._send(int(rows[-1]), position_ns)

    def _send_until(self, position_ns):
        due_ns = self.playlist.due_ns
        while self.next < len(due_ns) and due_ns[self.next] <= position_ns:
            self._send(self.next, int(due_ns[self.next]))
            self.next += 1

    def _send(self, index, position_ns):
        topic = self.playlist.topics[self.playlist.topic[index]]
        self.server.forward(topic, self.playlist.payloads[index], self._log_ns(position_ns))


def _shape_params(bag):
    """Return the parameters of the run; the defaults for a bag that was recorded by hand."""
    if 'parameters' not in bag.run_info:
        return parameters.load(ShapeParams, share.path('bags', 'config', 'markers.yaml'))
    facts = facts_from_run_info(bag.run_info, str(bag.path))
    return ShapeParams(
        OutlineParams(*facts.outline),
        SafetyParams(facts.circles, facts.vehicle_radius, facts.safe_obstacle, facts.safe_edge),
    )
