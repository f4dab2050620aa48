"""When a wanted exposure is sent to the camera."""

from __future__ import annotations

from mission.flight.observation import Observation

EV_AGAIN_S = 2.0


class ExposureOrder:
    """Remembers what the camera was last told, and when."""

    def __init__(self) -> None:
        self._told: tuple[float, float] | None = None

    def due(self, wanted: float | None, observation: Observation) -> float | None:
        """Return the EV to send now, None where there is none.

        A changed one is sent once, and again after a while when the camera did not take it.
        """
        camera = observation.camera
        if wanted is None or camera is None or camera.ev is None:
            return None
        step = camera.step_ev
        snapped = min(max(round(wanted / step) * step, camera.min_ev), camera.max_ev)
        now = observation.now_s
        if self._told is not None and abs(self._told[0] - snapped) < step / 2:
            taken = abs(camera.ev - snapped) < 0.75 * step
            if taken or now - self._told[1] < EV_AGAIN_S:
                return None
        self._told = (snapped, now)
        return snapped
