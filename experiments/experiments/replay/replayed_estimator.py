"""Today's estimator with the parameters of a recorded run, on the messages of its sensors."""

import json
from collections.abc import Iterator

from bags.errors import BagError
from bags.evaluation.drive import LOCKSTEP
from bags.storage import read
from bags.storage.decoding import DECODE_ERRORS, decode_message
from experiments.configuration.inputs import ESTIMATOR
from experiments.replay.recorded_ticks import BELIEVED
from msgs_yaml.types import Chassis, EstimatedState, Gnss, Imu
from node_runtime import parameters
from state_estimator.estimators import Stream
from state_estimator.parameters import EstimatorParams
from vehicle_plant.sensors import TOPICS


def estimates(bag: read.Bag) -> dict[int, tuple[EstimatedState, EstimatedState]]:
    """Return (recorded, replayed) estimates by stamp [ns], {} of a run without an estimator.

    Nor of a run on the wall clock, of which messages may be lost. Raises BagError for parameters
    that today's estimator refuses.
    """
    noted = json.loads(bag.run_info.get('parameters', '{}')).get(ESTIMATOR)
    if noted is None or bag.run_info.get('mode') != LOCKSTEP:
        return {}
    own = {name: noted[name] for name in parameters.leaves(EstimatorParams) if name in noted}
    try:
        params = parameters.build(EstimatorParams, own, lambda name: str(bag.path))
    except parameters.ParameterError as error:
        raise BagError(str(error)) from None
    stream, replayed = Stream(params), {}
    for message in _in_order(bag):
        believed = stream.take(message)
        if believed:
            replayed[believed.state.stamp_ns] = believed.as_message()
    recorded = {x.stamp_ns: x for x in read.values(bag, BELIEVED)}
    return {ns: (recorded[ns], replayed[ns]) for ns in recorded.keys() & replayed.keys()}


def _in_order(bag: read.Bag) -> Iterator[Imu | Chassis | Gnss]:
    """Yield the valid messages of the sensors in the order in which they were sent."""
    sent = []
    for name in TOPICS:
        recorded = read.recording(bag, name)
        rows = zip(recorded.publish_ns.tolist(), recorded.payloads)
        sent += [(ns, recorded.topic, payload) for ns, payload in rows]
    for _, topic, payload in sorted(sent, key=lambda row: row[0]):
        try:
            yield decode_message(topic, payload)
        except DECODE_ERRORS:
            continue
