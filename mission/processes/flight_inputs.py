"""The newest of everything that flight is told, turned into parts of an observation."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from drivers.autopilot_state import VehicleReading
from drivers.bus import Bus, Key, Sample
from drivers.codecs import BadMessage, decode_points
from drivers.payload import CameraReading, GimbalReading
from mission.flight.guard import NOTHING_AROUND, Surroundings
from mission.flight.observation import (
    BladeTrack,
    CameraState,
    ClearanceState,
    ExposureState,
    FlightMode,
    GimbalState,
    HubPrior,
    PhotoResult,
    RotorEstimate,
    Vehicle,
)
from mission.remote.messages import PhotoResultMessage, ReadyMessage, SensingHealth

Part = TypeVar("Part")

_CLEARANCE = TypeAdapter(ClearanceState)
_HUB_PRIOR = TypeAdapter(HubPrior)
_ROTOR = TypeAdapter(RotorEstimate)
_BLADE = TypeAdapter(BladeTrack)
_EXPOSURE = TypeAdapter(ExposureState)
_VEHICLE_FIELDS = tuple(field.name for field in dataclasses.fields(Vehicle))
_GIMBAL_FIELDS = tuple(field.name for field in dataclasses.fields(GimbalState))
_CAMERA_FIELDS = tuple(field.name for field in dataclasses.fields(CameraState))


class FlightInputs:
    """What perception, sensing and recorder last said."""

    def __init__(self, bus: Bus, on_exposure: Callable[[ExposureState], None]) -> None:
        """``on_exposure`` is called with every metering as it comes."""
        self._on_exposure = on_exposure
        self.clearance: ClearanceState | None = None
        self.hub_prior: HubPrior | None = None
        self.rotor: RotorEstimate | None = None
        self.blade: BladeTrack | None = None
        self.exposure: ExposureState | None = None
        self.sensing: SensingHealth | None = None
        self.ready: set[str] = set()
        """Perception workers that can work."""
        self.surroundings: Surroundings = NOTHING_AROUND
        self.frames = 0
        self.frames_out_of_range = 0
        self.bad_messages = 0
        self._photos: list[PhotoResult] = []
        bus.subscribe_newest(Key.CLEARANCE, self._take_clearance)
        bus.subscribe_newest(Key.OCCUPANCY, self._take_occupancy)
        bus.subscribe_newest(Key.HUB_PRIOR, self._take_hub_prior)
        bus.subscribe_newest(Key.ROTOR, self._take_rotor)
        bus.subscribe_newest(Key.BLADE, self._take_blade)
        bus.subscribe_newest(Key.EXPOSURE, self._take_exposure)
        bus.subscribe_newest(Key.SENSING, self._take_sensing)
        bus.subscribe(Key.READY, self._take_ready)
        bus.subscribe(Key.PHOTO_RESULT, self._take_photo_result)

    def forget(self) -> None:
        """A new mission: what was found for the last one does not count."""
        self.hub_prior = self.rotor = self.blade = None
        self.frames = self.frames_out_of_range = 0
        self._photos.clear()

    def photos(self) -> tuple[PhotoResult, ...]:
        """Return the photos judged since the last call."""
        judged = tuple(self._photos)
        self._photos.clear()
        return judged

    def _parsed(self, adapter: TypeAdapter[Part], sample: Sample) -> Part | None:
        try:
            return adapter.validate_json(sample.payload)
        except ValidationError:
            self.bad_messages += 1
            return None

    def _take_clearance(self, sample: Sample) -> None:
        self.clearance = self._parsed(_CLEARANCE, sample) or self.clearance

    def _take_hub_prior(self, sample: Sample) -> None:
        self.hub_prior = self._parsed(_HUB_PRIOR, sample) or self.hub_prior

    def _take_rotor(self, sample: Sample) -> None:
        self.rotor = self._parsed(_ROTOR, sample) or self.rotor

    def _take_blade(self, sample: Sample) -> None:
        self.blade = self._parsed(_BLADE, sample) or self.blade

    def _take_exposure(self, sample: Sample) -> None:
        exposure = self._parsed(_EXPOSURE, sample)
        if exposure is not None:
            self.exposure = exposure
            self.frames += 1
            self.frames_out_of_range += not exposure.in_range
            self._on_exposure(exposure)

    def _take_sensing(self, sample: Sample) -> None:
        self.sensing = SensingHealth.model_validate_json(sample.payload)

    def _take_ready(self, sample: Sample) -> None:
        self.ready.add(ReadyMessage.model_validate_json(sample.payload).name)

    def _take_occupancy(self, sample: Sample) -> None:
        try:
            points, stamp_s = decode_points(sample.payload)
        except BadMessage:
            self.bad_messages += 1
            return
        self.surroundings = Surroundings(points.astype(np.float64), stamp_s)

    def _take_photo_result(self, sample: Sample) -> None:
        result = PhotoResultMessage.model_validate_json(sample.payload)
        self._photos.append(
            PhotoResult(
                result.photo_id,
                result.kept,
                result.reason,
                result.stamp_s,
                result.mean_grey,
                result.exposed,
                result.beside_w,
            )
        )


def vehicle_part(reading: VehicleReading | None) -> Vehicle | None:
    """Return the vehicle's part of the observation."""
    if reading is None:
        return None
    modes = ("mode", "intended")
    values = {name: getattr(reading, name) for name in _VEHICLE_FIELDS if name not in modes}
    intended = None if reading.intended is None else FlightMode(reading.intended)
    return Vehicle(mode=FlightMode(reading.mode), intended=intended, **values)


def gimbal_part(reading: GimbalReading | None) -> GimbalState | None:
    """Return the gimbal's part of the observation."""
    if reading is None:
        return None
    return GimbalState(**{name: getattr(reading, name) for name in _GIMBAL_FIELDS})


def camera_part(reading: CameraReading | None) -> CameraState | None:
    """Return the camera's part of the observation."""
    if reading is None:
        return None
    return CameraState(**{name: getattr(reading, name) for name in _CAMERA_FIELDS})
