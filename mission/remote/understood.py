"""Reading what came over the bus: a message of its kind, or a line in the log."""

from __future__ import annotations

import logging
from typing import TypeVar

from pydantic import ValidationError

from drivers.bus import Sample
from mission.remote.messages import Message

log = logging.getLogger(__name__)

Heard = TypeVar("Heard", bound=Message)


def understood(sample: Sample, kind: type[Heard]) -> Heard | None:
    """Return the message of a sample; None, and a line in the log, where it is not one."""
    try:
        return kind.model_validate_json(sample.payload)
    except ValidationError as error:
        log.warning("%s of %s was not understood: %s", sample.key, sample.vehicle, error)
        return None
