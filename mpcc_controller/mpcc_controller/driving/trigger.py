"""Trigger: decides which of the incoming states is answered, and when. Stamps in ns; no ROS."""

from typing import NamedTuple

from msgs_yaml.conversions import NS_PER_S, ns_to_s


class Due(NamedTuple):
    """What to do now."""

    step: bool  # answer this state
    repeat: bool  # it was answered before: publish the same answer again
    restart: bool  # first step, or time went back: take the set-points from the actuators first


NOTHING = Due(step=False, repeat=False, restart=False)


class Trigger:
    """The stamps of the state kept last, of the newest other inputs and of the last answer."""

    def __init__(self, step_s: float):
        self.step_ns = round(step_s * NS_PER_S)
        self.state = self.actuators = self.obstacles = self.answered = None
        self.predictions = None


class LockstepTrigger(Trigger):
    """Answers the states on tick boundaries for which the obstacles carry the same stamp.

    So do the predictions of obstacles where somebody sends some (`with_predictions`). The answer
    then depends on the messages and not on the order of their arrival. The first state is answered
    when the actuators of the same stamp are known too, and so are all others of a car whose
    actuators come `with_states`.
    """

    with_states = with_predictions = False

    def on_state(self, stamp_ns: int) -> bool:
        """Note the stamp of a state; return whether the state is to be kept."""
        if stamp_ns % self.step_ns:
            return False
        self.state = stamp_ns
        return True

    @property
    def needs_actuators(self) -> bool:
        """Whether the state kept last needs actuators of its stamp."""
        return self.state is not None and (self.with_states or self.begins)

    @property
    def waits_for_actuators(self) -> bool:
        """Whether a state after the first one waits for them: `with_states` may end that."""
        return self.needs_actuators and not self.begins and self.actuators != self.state

    def due(self) -> Due:
        """Return what to do with the state kept last; to be called once per message."""
        if self.state is None or self.obstacles != self.state:
            return NOTHING
        if self.with_predictions and self.predictions != self.state:
            return NOTHING
        begins = self.begins
        if self.needs_actuators and self.actuators != self.state:
            return NOTHING
        repeat = self.state == self.answered
        self.answered = self.state
        self.state = None  # the next message with this stamp is a repetition by the plant
        return Due(step=not repeat, repeat=repeat, restart=begins)

    def on_lost(self, stamp_ns: int) -> None:
        """Note that a state was not answered: the plant repeats it, with the actuators."""
        self.answered = self.state = self.actuators = None

    def restart(self) -> None:
        """Answer the state kept last, or the next one, as the first one of all."""
        self.answered = None

    def age_s(self, now_ns: int) -> float:
        """Return the age [s] of the state answered last: 0, simulated time waits for the answer."""
        return 0.0

    @property
    def begins(self) -> bool:
        """Whether the state kept last starts the controller."""
        return self.state is not None and (self.answered is None or self.state < self.answered)


class RealtimeTrigger(Trigger):
    """Answers the first state at or after each tick boundary, with the newest other inputs."""

    waits_for_actuators = False  # after the first step
    with_states = True  # whatever is newest counts
    begun = False

    def on_state(self, stamp_ns: int) -> bool:
        """Note the stamp of a state; return whether the state is to be kept.

        A state of a tick that was answered is late or a repetition: wall time never goes back.
        """
        step_ns, answered = self.step_ns, self.answered
        new_tick = answered is None or stamp_ns // step_ns > answered // step_ns
        if new_tick:
            self.state = stamp_ns
        return new_tick

    @property
    def needs_actuators(self) -> bool:
        """Whether the next step is the first one."""
        return not self.begun

    @property
    def begins(self) -> bool:
        """Whether the state kept last starts the controller."""
        return self.state is not None and not self.begun

    def due(self) -> Due:
        """Return what to do with the state kept last; to be called once per message."""
        if self.state is None:
            return NOTHING
        # a first step takes actuators of about its time
        known = self.actuators is not None and abs(self.state - self.actuators) <= self.step_ns
        if not (self.begun or known):
            return NOTHING
        begun, self.begun = self.begun, True
        self.answered, self.state = self.state, None
        return Due(step=True, repeat=False, restart=not begun)

    def on_lost(self, stamp_ns: int) -> None:
        """Note a command without a state: the next step starts from the actuators."""
        self.answered, self.state, self.actuators = stamp_ns, None, None
        self.begun = False

    def restart(self) -> None:
        """Answer the next state as the first one of all."""
        self.answered = self.state = self.actuators = None
        self.begun = False

    def is_next(self, now_ns: int) -> bool:
        """Return whether a tick has passed since the last answer."""
        return now_ns - self.answered >= self.step_ns

    def age_s(self, now_ns: int) -> float:
        """Return the age [s] of the state answered last."""
        return ns_to_s(now_ns - self.answered)


def make(mode: str, step_s: float) -> LockstepTrigger | RealtimeTrigger:
    """Return the trigger of a mode, 'lockstep' or 'realtime'; KeyError for others."""
    return {'lockstep': LockstepTrigger, 'realtime': RealtimeTrigger}[mode](step_s)
