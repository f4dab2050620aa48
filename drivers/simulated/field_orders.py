"""Orders to the field process: one line of JSON each."""

from __future__ import annotations

from config.model import ConfigModel
from config.simulation import Device, Word


class FaultOrder(ConfigModel):
    """Change a device's failure word now."""

    device: Device
    word: Word


class Order(ConfigModel):
    """What a line of standard input may say."""

    finish: str | None = None
    """The mission is over: judge this mission folder, write the truth and end."""
    fault: FaultOrder | None = None
    swap: bool = False
    """Fit a charged battery; only on the ground."""
    pilot: bool = False
    """The pilot sends the vehicle home by the autopilot's own return."""
    trace: str | None = None
    """Write what the autopilot really does into this file, from now on."""
