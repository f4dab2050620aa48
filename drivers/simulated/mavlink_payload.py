"""The payload on MAVLink: camera and gimbal behind one link, of their own or the autopilot's."""

from __future__ import annotations

from collections.abc import Callable

from config.settings import Settings
from drivers.simulated.link import CameraSetting, StillRequest
from drivers.simulated.mavlink_autopilot import COMPONENT as AUTOPILOT
from drivers.simulated.mavlink_camera import CameraPorts, MockCamera
from drivers.simulated.mavlink_gimbal import MockGimbal
from drivers.simulated.mavlink_streams import Telemetry
from drivers.simulated.mavlink_wire import MavlinkLink, Message, Received


class MockPayload:
    """Hands messages to camera and gimbal, and theirs to the link."""

    def __init__(
        self,
        settings: Settings,
        link: MavlinkLink,
        telemetry: Telemetry,
        to_renderer: Callable[[CameraSetting | StillRequest], None],
        *,
        shared: bool,
    ) -> None:
        """Build camera and gimbal.

        ``shared``: the link is the autopilot's, whose component 1 is then the gimbal manager.
        """
        self._link, self._telemetry = link, telemetry
        self._system = settings.autopilot.system_id
        camera_id = settings.camera.component_id
        ports = CameraPorts(
            lambda message: self._send(message, camera_id), to_renderer, to_renderer
        )
        self.camera = MockCamera(settings, ports, telemetry)
        manager = AUTOPILOT if shared else settings.gimbal.component_id
        self.gimbal = MockGimbal(
            settings.gimbal, manager, self._send, telemetry, settings.simulation.seed
        )

    def handle(self, received: Received) -> bool:
        """Act on one message; return whether the payload took it."""
        message = received.message
        if getattr(message, "target_system", 0) not in (0, self._system):
            return False
        component = int(getattr(message, "target_component", 0))
        for_gimbal = component in (0, self.gimbal.device, self.gimbal.manager)
        if for_gimbal and self.gimbal.handle(message):
            return True
        if component == self.gimbal.device and component != self.camera.component:
            self.gimbal.refuse(message)
            return True
        if component in (0, self.camera.component):
            self.camera.handle(message)
            return component != 0
        return False

    def step(self, dt_s: float) -> None:
        """Advance camera and gimbal."""
        self.gimbal.step(dt_s)
        self.camera.step()

    def _send(self, message: Message, component: int) -> None:
        self._link.send(message, self._system, component, self._telemetry.now_s)
