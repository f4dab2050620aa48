"""Autonomous inspection of wind-turbine blades by drone: the public names.

`Client` and its asyncio twin `AsyncClient` talk to a daemon; `estimate` finds the rotor in a point
cloud; `simulate` flies an inspection here. The pytest fixture is `bladescout.testing`.
"""

from bladescout.recorded import estimate
from bladescout.simulated import Simulated, simulate
from mission.remote.async_client import AsyncClient
from mission.remote.client import Client, NoReply
from mission.remote.messages import EventMessage, Reply, StateMessage, TurbineInfo
from perception.cloud_estimate import CloudAnswer
from perception.rotor import Refusal, Rotor

__all__ = [
    "AsyncClient",
    "Client",
    "CloudAnswer",
    "EventMessage",
    "NoReply",
    "Refusal",
    "Reply",
    "Rotor",
    "Simulated",
    "StateMessage",
    "TurbineInfo",
    "estimate",
    "simulate",
]
