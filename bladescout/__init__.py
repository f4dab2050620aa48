"""Autonomous inspection of wind-turbine blades by drone: the public names."""

from bladescout.recorded import estimate
from mission.remote.client import Client, NoReply
from mission.remote.messages import EventMessage, Reply, StateMessage

__all__ = ["Client", "EventMessage", "NoReply", "Reply", "StateMessage", "estimate"]
