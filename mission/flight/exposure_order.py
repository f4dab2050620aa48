"""When a wanted exposure is sent to the camera, and which exposures it has."""

from __future__ import annotations

from mission.flight.observation import CameraState, Observation
from perception.exposure_limits import EvSteps

EV_AGAIN_S = 2.0


def ev_steps(camera: CameraState) -> EvSteps:
    """Return the EVs that a camera has: those that it lists, else multiples of its step."""
    if camera.evs:
        return EvSteps(camera.evs)
    return EvSteps.spaced(camera.min_ev, camera.max_ev, camera.step_ev)


def exposure_words(camera: CameraState | None) -> str:
    """Say how a camera is exposed, for the log."""
    if camera is None or camera.ev is None:
        return "the camera tells of no exposure that could be set: its own automatic exposes"
    kind = "set" if camera.manual else "a bias of the camera's own automatic"
    evs = ev_steps(camera).evs
    return f"exposure is {kind}, {evs[0]:+.1f} to {evs[-1]:+.1f} EV, {len(evs)} values"


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
        steps = ev_steps(camera)
        snapped = steps.nearest(wanted)
        step, now = steps.width_at(snapped), observation.now_s
        if self._told is not None and abs(self._told[0] - snapped) < step / 2:
            taken = abs(camera.ev - snapped) < 0.75 * step
            if taken or now - self._told[1] < EV_AGAIN_S:
                return None
        self._told = (snapped, now)
        return snapped
