"""How the plant node keeps simulated time: a tick per command."""

from rclpy.node import Node

from msgs_yaml import encode
from node_runtime import ros, spin_node
from vehicle_plant import health
from vehicle_plant.ring import Lockstep
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import START_NS

REPEAT_S = 1.0  # the first state, until somebody answers it
ALONE_S = 0.001  # between ticks without a controller


class LockstepDrive:
    """The plant owns time: a tick per command."""

    def __init__(self, node: Node):
        self.node = node
        self.clock_pub = ros.publisher(node, '/clock')
        self.ring = self.monitor = None
        self.repeating = None
        self.watch = None  # for a controller that is gone
        self.asked_again = False

    def wait(self, told):
        """Tell nobody else: simulated time has not begun."""

    def begin(self):
        """Publish the first state until somebody answers it."""
        car = self.node.car_at(START_NS)
        self.ring = Lockstep(car, RunEnd(self.node.params.stop, car.now))
        self.monitor = health.Monitor(self.ring)
        self.repeat()
        self.repeating = self.node.every(REPEAT_S, self.repeat)

    def repeat(self):
        """Publish the present state."""
        self.node.send(self.ring.car.now)
        self.clock_pub.publish(encode.clock(self.ring.car.stamp_ns))

    def command(self, command):
        """Advance a tick if this is the command for the present instant."""
        if self.ring and self.ring.answers(command.stamp_ns):
            self.tick(self.ring.tick(command))
            self.keep_watch()

    def unreadable(self, stamp_ns, reason):
        """Advance a tick under the last good command."""
        if self.ring and self.ring.answers(stamp_ns):
            self.ring.car.gate.refuse(reason)
            self.tick(self.ring.tick(None))
            self.keep_watch()

    def tick(self, track):
        """Publish a burst and the boundary that it ends at."""
        self.node.send(track)
        self.clock_pub.publish(encode.clock(self.ring.car.stamp_ns))
        self.node.follow_up(self.ring, self.monitor, track)
        if self.ring.outcome:
            spin_node.finish(self.node, self.ring.outcome.exit_code)

    def keep_watch(self):
        """Wait for the next command anew."""
        self.asked_again = False
        if self.watch:
            self.watch.reset()
            return
        self.repeating.cancel()
        self.watch = self.node.every(self.node.params.lockstep_timeout_s / 2, self.on_silence)

    def on_silence(self):
        """Ask again: a node that was started again has not heard it; then go on alone."""
        if not self.asked_again:
            self.asked_again = True
            self.node.get_logger().warning('no command comes: sending the present state again')
            self.repeat()
            return
        self.node.get_logger().error('no command comes: braking straight')
        self.watch.cancel()
        self.watch = self.node.every(ALONE_S, self.on_alone)

    def on_alone(self):
        """Advance a tick without a command."""
        if self.ring.outcome is None:
            self.tick(self.ring.tick_alone())
