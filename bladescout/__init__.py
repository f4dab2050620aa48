"""Autonomous inspection of wind-turbine blades by drone: the public names."""

from bladescout.recorded import estimate
from mission.remote.async_client import AsyncClient
from mission.remote.client import Client, NoReply
from mission.remote.messages import EventMessage, Reply, StateMessage, TurbineInfo

__all__ = [
    "AsyncClient",
    "Client",
    "EventMessage",
    "NoReply",
    "Reply",
    "StateMessage",
    "TurbineInfo",
    "estimate",
]
