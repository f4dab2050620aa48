"""What a mission folder tells the next flight: its photos, laid on their blades, and the rotor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mission.flight.earlier import Earlier, EarlierPhoto, OnBlade, Standing
from mission.records.flights import FlightRecord
from mission.records.photo_record import PhotoRecord
from mission.remote.messages import FlightReport
from perception.values import Float


def earlier_of(
    flights: Sequence[FlightRecord], photos: Sequence[PhotoRecord], waiting: Sequence[int] = ()
) -> Earlier:
    """Return what earlier flights left behind.

    ``waiting``: numbers of photos that exist, but could not be fetched.
    """
    reports = [one.report for one in flights if one.report is not None]
    rotor = next((one.report.rotor for one in reports if one.report.rotor is not None), None)
    skipped = {
        (side.blade, side.side) for one in reports for side in one.report.passes if side.skipped
    }
    numbers = [photo.photo_id for photo in photos] + list(waiting)
    return Earlier(
        flights=max((one.number for one in flights), default=0),
        next_photo_id=max(numbers, default=0) + 1,
        photos=tuple(_photo(photo) for photo in photos),
        stop_angle_deg=None if rotor is None else rotor.stop_angle_deg,
        sigma_deg=0.0 if rotor is None else rotor.sigma_deg,
        skipped=tuple(sorted(skipped)),
        standing=next(filter(None, (_standing(one) for one in reversed(reports))), None),
    )


def _standing(report: FlightReport) -> Standing | None:
    """Return how the rotor stood in a flight's own frame, where that can be told again."""
    rotor, place = report.report.rotor, report.place
    if rotor is None or place is None:
        return None
    blades = tuple((one.name, one.direction_w, one.pitch_deg) for one in rotor.blades)
    return Standing(rotor.hub_w, rotor.normal_w, blades, report.tower_foot_w, *place)


def _photo(record: PhotoRecord) -> EarlierPhoto:
    return EarlierPhoto(
        record.photo_id, record.blade, record.side, record.metre, record.kept, _place(record),
        exposed=record.exposure_in_range is not False,
    )  # fmt: skip


def _place(record: PhotoRecord) -> OnBlade | None:
    """Return from where a photo was taken, by the sections of the blade that it shows."""
    if record.view is None:
        return None
    stations, camera = record.view.blade(), record.view.camera()
    if stations is None:
        return None
    nearest = int(np.abs(stations.metre_m - record.metre).argmin())
    leading, pressure = stations.leading_w[nearest], stations.pressure_w[nearest]
    along: Float = np.cross(leading, pressure)
    outward = stations.centre_w[-1] - stations.centre_w[0]
    along = along * np.sign(float(along @ outward))
    directions = np.stack([leading, pressure, along])
    eye = directions @ (camera.position_w - stations.centre_w[nearest])
    sight = directions @ camera.rotation_wc[:, 2]
    return OnBlade(float(stations.metre_m[nearest]), _xyz(eye), _xyz(sight))


def _xyz(values: Float) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 4) for value in values)
    return x, y, z
