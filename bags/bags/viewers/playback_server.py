"""Show a bag to Foxglove: played at a rate, paused and sought from its own controls."""

import threading
import time
from collections.abc import Callable

import numpy as np
from foxglove.websocket import PlaybackCommand, PlaybackState, PlaybackStatus

from bags.evaluation.drive import facts_from_run_info
from bags.storage import read
from bags.viewers import marker_scene
from bags.viewers.foxglove_server import Forwarder, Served, Server
from bags.viewers.marker_scene import MarkerScene
from msgs_yaml import share
from node_runtime import parameters

LOOK_S = 0.01  # of wall time between two looks at the clock
LATCHED = 'transient_local'


class Pace:
    """Where a recording is: bag time as a function of the wall clock, which callers give."""

    def __init__(self, first_ns: int, last_ns: int, rate: float):
        self.first_ns, self.last_ns = first_ns, last_ns
        self.rate, self.playing = rate, True
        self._at_ns, self._since_s = first_ns, None

    def now(self, wall_s: float) -> int:
        """Return the bag time [ns], not beyond the end."""
        if self._since_s is None:
            self._since_s = wall_s
        passed = (wall_s - self._since_s) * self.rate * 1e9 if self.playing else 0.0
        return min(self._at_ns + int(passed), self.last_ns)

    def change(self, wall_s: float, playing=None, rate=None, seek_ns=None) -> None:
        """Play or pause, at another rate, from elsewhere; None leaves it as it is."""
        at_ns = self.now(wall_s) if seek_ns is None else seek_ns
        self._at_ns, self._since_s = min(max(at_ns, self.first_ns), self.last_ns), wall_s
        self.playing = self.playing if playing is None else playing
        self.rate = self.rate if rate is None else rate


class PlaybackServer:
    """A bag on a server. `run` sends until it is stopped."""

    def __init__(self, bag: read.Bag, port: int, rate: float, loop: bool):
        """Raises BagError when the port is taken."""
        self.bag, self.loop = bag, loop
        self.names = [name for name, one in bag.recordings.items() if one.payloads]
        log_ns = [bag.recordings[name].log_ns for name in self.names]
        owner = np.repeat(np.arange(len(self.names)), [len(one) for one in log_ns])
        place = np.concatenate([np.arange(len(one)) for one in log_ns])
        times = np.concatenate(log_ns)
        order = np.argsort(times, kind='stable')
        self.times, self.owner, self.place = times[order], owner[order], place[order]
        self.latched = {
            k
            for k, name in enumerate(self.names)
            if f'durability: {LATCHED}' in bag.recordings[name].topic.qos
        }
        span = int(self.times[0]), int(self.times[-1])
        self.pace = Pace(*span, rate)
        self.next = 0  # message to send
        self.lock = threading.Lock()
        self.sought = False
        topics = [bag.recordings[name].topic for name in self.names]
        served = [
            Served(topic.name, topic.type, topic.schema, k in self.latched)
            for k, topic in enumerate(topics)
        ]
        self.server = Server(served, port, span, self.on_control)
        self.projector = Forwarder(self.server, MarkerScene(_params(bag)))

    def run(self, stopped: Callable[[], bool]) -> None:
        """Send what is due until `stopped`."""
        ended = False
        while not stopped():
            with self.lock:
                now_ns = self.pace.now(time.monotonic())
                if self.sought:
                    self._jump(now_ns)
            self._send_until(now_ns)
            self.server.tell_time(now_ns)
            at_end = now_ns >= self.pace.last_ns
            if at_end and self.loop:
                with self.lock:
                    self.pace.change(time.monotonic(), seek_ns=self.pace.first_ns)
                    self.sought = True
            elif at_end and not ended:
                self.server.tell_playback(self._state(now_ns, False, None))
            ended = at_end
            time.sleep(LOOK_S)

    def on_control(self, request) -> PlaybackState:
        """Do what Foxglove asks for, from its thread; tell it where the playback is."""
        wall_s, seek_ns = time.monotonic(), request.seek_time
        playing = request.playback_command == PlaybackCommand.Play
        with self.lock:
            self.pace.change(wall_s, playing, request.playback_speed or None, seek_ns)
            self.sought |= seek_ns is not None
            return self._state(self.pace.now(wall_s), seek_ns is not None, request.request_id)

    def _state(self, now_ns, did_seek, request_id):
        status = PlaybackStatus.Playing if self.pace.playing else PlaybackStatus.Paused
        if now_ns >= self.pace.last_ns:
            status = PlaybackStatus.Ended
        return PlaybackState(status, now_ns, self.pace.rate, did_seek, request_id)

    def _jump(self, now_ns):
        """Continue from another time: facts that were latched by then come first."""
        self.sought = False
        self.next = int(np.searchsorted(self.times, now_ns))
        before = self.owner[: self.next]
        for k in self.latched:
            (places,) = np.nonzero(before == k)
            if places.size:
                self._send(int(places[-1]), now_ns)

    def _send_until(self, now_ns):
        while self.next < len(self.times) and self.times[self.next] <= now_ns:
            self._send(self.next, int(self.times[self.next]))
            self.next += 1

    def _send(self, index, log_ns):
        name = self.names[self.owner[index]]
        found = self.bag.recordings[name]
        payload = found.payloads[self.place[index]]
        self.projector.show(name, found.topic.type, found.topic.schema, payload, log_ns)


def _params(bag):
    """Those of the run; a bag recorded by hand does not know, and gets the defaults."""
    if 'parameters' not in bag.run_info:
        return parameters.load(
            marker_scene.ShapeParams, share.path('bags', 'config', 'markers.yaml')
        )
    facts = facts_from_run_info(bag.run_info, str(bag.path))
    return marker_scene.ShapeParams(
        marker_scene.OutlineParams(*facts.outline),
        marker_scene.SafetyParams(
            facts.circles, facts.vehicle_radius, facts.safe_obstacle, facts.safe_edge
        ),
    )
