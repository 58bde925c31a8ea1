"""The parameters of the recorder. No ROS: they are checked before anything starts."""

from dataclasses import dataclass
from typing import Annotated

from node_runtime.parameters import Range


@dataclass(frozen=True)
class RecorderParams:
    """Parameters of the recorder, see config/recorder.yaml."""

    out: str
    run_info: str
    chunk_s: Annotated[float, Range(0.01, 0.5, 's')]
    poll_s: Annotated[float, Range(0.001, 0.1, 's')]
    split_mb: Annotated[float, Range(0.0, 1e6, 'MB')]
    split_s: Annotated[float, Range(0.0, 1e6, 's')]
