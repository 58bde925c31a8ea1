"""How the plant node keeps wall time: a step per millisecond."""

from rclpy.node import Node

from node_runtime import scheduling, spin_node
from node_runtime.clocks import SteadyClock
from vehicle_plant import health
from vehicle_plant.ring import Hold, Realtime
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import STEP_NS, TICK_STEPS

HELD_S = 0.02  # between two states of the car that is held at its start
LEAVE_S = 0.02  # between the last state and the end
TOLD_NS = 1_000_000_000  # between two words on what is waited for
THROTTLE_S = 1.0


class RealtimeDrive:
    """The plant follows the wall clock: a step per millisecond."""

    def __init__(self, node: Node):
        self.node = node
        self.ring = self.monitor = None
        self.timer = None
        self.hold = Hold()
        # so that a correction of the system's clock is no jump of the car
        self.wall = SteadyClock()
        self.told_ns = 0

    def now_ns(self) -> int:
        """Return the present wall time, whole steps."""
        return self.wall.now_ns() // STEP_NS * STEP_NS

    def wait(self, told):
        """Tell once a second what is waited for."""
        now_ns = self.now_ns()
        if now_ns - self.told_ns >= TOLD_NS:
            self.told_ns = now_ns
            self.node.tell(health.waiting(now_ns, told))

    def begin(self):
        """Hold the car at its start until the first command comes."""
        # the first steps of all are slow: code and data have to be brought into memory
        self.node.car_at(self.now_ns()).advance(None, TICK_STEPS)
        scheduling.freeze_garbage()
        self.node.get_logger().info('holding the car at its start until a command answers it')
        self.timer = self.node.every(HELD_S, self.on_held)

    def on_held(self):
        """Publish the state at the start with the present time."""
        now_ns = self.now_ns()
        self.hold.sent(now_ns)
        self.node.send(self.node.car_at(now_ns).now)
        self.wait('waiting for a command that answers the start')

    def command(self, command):
        """Follow a command; the first one that answers the start and passes lets the car go."""
        if self.ring:
            self.ring.command(command)
        elif self.hold.is_answer(command):
            self.let_go(command)

    def let_go(self, command):
        """Begin the run under its first command."""
        now_ns, params = self.now_ns(), self.node.params
        car = self.node.car_at(now_ns)
        ring = Realtime(car, RunEnd(params.stop, car.now), params.command_age_s)
        ring.command(command._replace(stamp_ns=now_ns))
        if car.gate.rejected:
            told = f'held at the start: {car.gate.last_reason}'
            self.node.get_logger().error(told, throttle_duration_sec=THROTTLE_S)
            return
        self.ring, self.monitor = ring, health.Monitor(ring)
        self.node.tell(self.monitor.health(now_ns))
        self.node.destroy_timer(self.timer)
        self.timer = self.node.every(STEP_NS / 1e9, self.on_step)

    def unreadable(self, _, reason):
        """Count a command that breaks the contract; the last good one stands."""
        if self.ring:
            self.ring.refuse(reason)

    def on_step(self):
        """Advance by what is due."""
        if self.ring.outcome:  # a call that was on its way
            return
        track = self.ring.advance_to(self.now_ns())
        if track:
            self.node.send(track)
            self.node.follow_up(self.ring, self.monitor, track)
        if self.ring.outcome:
            self.end()

    def end(self):
        """Leave without a vehicle: a controller that still had one would brake it."""
        self.node.destroy_timer(self.timer)
        self.node.destroy_publisher(self.node.odometry_pub.publisher)
        # the executor has to let go of the publisher first, which it does while it spins
        self.timer = self.node.every(LEAVE_S, self.leave)

    def leave(self):
        """End the node."""
        spin_node.finish(self.node, self.ring.outcome.exit_code)
