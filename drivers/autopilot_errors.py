"""What can go wrong between us and the vehicle.

::

    AutopilotError
    ├── NoVehicle       nobody with our system id answered in time
    ├── PortTaken       another process listens where we are to listen
    ├── LinkFailed      the URL cannot be opened, or nothing can be sent
    ├── Refused         a command was denied, failed, or never acknowledged
    │   └── Unanswered  never acknowledged
    └── BadSetpoint     a setpoint that no vehicle may be given
"""

from __future__ import annotations


class AutopilotError(Exception):
    """The vehicle, or the way to it, did not do what was asked."""


class NoVehicle(AutopilotError):
    """Nobody with our system id answered in time."""


class PortTaken(AutopilotError):
    """Another process listens where we are to listen."""


class LinkFailed(AutopilotError):
    """The URL cannot be opened, or nothing can be sent."""


class Refused(AutopilotError):
    """A command was denied, failed, or never acknowledged."""


class Unanswered(Refused):
    """A command was never acknowledged."""


class BadSetpoint(AutopilotError, ValueError):
    """A setpoint with a number that is not finite."""
