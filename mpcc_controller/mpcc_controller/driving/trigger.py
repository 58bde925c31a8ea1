"""When to step: which of the incoming states is answered. Stamps in ns; no ROS."""

from typing import NamedTuple

from msgs_yaml.conversions import NS_PER_S, ns_to_s


class Due(NamedTuple):
    """What to do now."""

    step: bool  # answer this state
    repeat: bool  # it was answered before: send the same answer again
    restart: bool  # time went back, or began: take the set-points from the actuators first


NOTHING = Due(step=False, repeat=False, restart=False)


class Lockstep:
    """Answers the states on tick boundaries for which the obstacles carry the same stamp.

    The answer is then a function of what was sent, not of what arrived first. The first state is
    answered when the actuators of its instant are known too.
    """

    def __init__(self, step_s: float):
        self.step_ns = round(step_s * NS_PER_S)
        self.state = self.obstacles = self.actuators = self.answered = None

    def on_state(self, stamp_ns: int) -> bool:
        """Take the stamp of a state; return whether it is one to keep."""
        if stamp_ns % self.step_ns:
            return False
        self.state = stamp_ns
        return True

    def on_obstacles(self, stamp_ns: int) -> None:
        """Take the stamp of the obstacles."""
        self.obstacles = stamp_ns

    @property
    def wants_actuators(self) -> bool:
        """Tell whether the state kept last is the first one: it needs those of its instant."""
        return self.state is not None and (self.answered is None or self.state < self.answered)

    def on_actuators(self, stamp_ns: int) -> None:
        """Take the stamp of the actuators."""
        self.actuators = stamp_ns

    def due(self) -> Due:
        """Return what to do with the state kept last; call it once per message."""
        if self.state is None or self.obstacles != self.state:
            return NOTHING
        begun = self.wants_actuators
        if begun and self.actuators != self.state:
            return NOTHING
        repeat = self.state == self.answered
        self.answered = self.state
        self.state = None  # the next message with this stamp is a repetition by the plant
        return Due(step=not repeat, repeat=repeat, restart=begun)

    def on_lost(self, stamp_ns: int) -> None:
        """Take note that a state was not answered: the plant sends it again, with the actuators."""
        self.answered = self.state = self.actuators = None

    def age_s(self, now_ns: int) -> float:
        """Return the age of the state answered last: time stands still while it is answered."""
        return 0.0


class Realtime:
    """Answers the first state at or after each tick boundary, with whatever else is known."""

    def __init__(self, step_s: float):
        self.step_ns = round(step_s * NS_PER_S)
        self.state = self.actuators = self.answered = None
        self.begun = False

    def on_state(self, stamp_ns: int) -> bool:
        """Take the stamp of a state; return whether it is one to keep.

        One from before the last answer came late, or twice: on the wall clock nothing goes back.
        """
        new_tick = self.answered is None or self._tick(stamp_ns) > self._tick(self.answered)
        if new_tick:
            self.state = stamp_ns
        return new_tick

    def on_obstacles(self, stamp_ns: int) -> None:
        """Obstacles do not decide anything here."""

    @property
    def wants_actuators(self) -> bool:
        """Tell whether the next step is the first one."""
        return not self.begun

    def on_actuators(self, stamp_ns: int) -> None:
        """Take the stamp of the actuators."""
        self.actuators = stamp_ns

    def due(self) -> Due:
        """Return what to do with the state kept last; call it once per message."""
        if self.state is None or self._lacks_actuators():
            return NOTHING
        begun, self.begun = self.begun, True
        self.answered, self.state = self.state, None
        return Due(step=True, repeat=False, restart=not begun)

    def on_lost(self, stamp_ns: int) -> None:
        """Take note of a command without a state: the next one starts from the actuators."""
        self.answered, self.state, self.actuators = stamp_ns, None, None
        self.begun = False

    def is_next(self, now_ns: int) -> bool:
        """Tell whether a tick has passed since the last answer."""
        return now_ns - self.answered >= self.step_ns

    def age_s(self, now_ns: int) -> float:
        """Return the age of the state answered last."""
        return ns_to_s(now_ns - self.answered)

    def _lacks_actuators(self):
        """Tell whether those that a first step starts from are missing, or of another time."""
        if self.begun:
            return False
        return self.actuators is None or abs(self.state - self.actuators) > self.step_ns

    def _tick(self, stamp_ns):
        return stamp_ns // self.step_ns


def make(mode: str, step_s: float) -> Lockstep | Realtime:
    """Return the trigger of a mode of the contract; KeyError for others."""
    return {'lockstep': Lockstep, 'realtime': Realtime}[mode](step_s)
