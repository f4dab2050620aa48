"""Records of photos of a straight blade along east, its pressure side up."""

import numpy as np

from mission.records.photo_record import Station, View
from perception.geometry import camera_looking_along, quaternion_from_rotation

LENGTH_M, CHORD_M, AWAY_M = 30.0, 2.0, 12.0


def photo(a_record, metre, *, aside_m=0.0, away_m=AWAY_M, kept=True):
    """Return a photo of the pressure side at a metre, taken from above and aside."""
    eye = np.array([metre, aside_m, away_m])
    down = np.array([0.0, -aside_m, -away_m])
    turn = quaternion_from_rotation(camera_looking_along(down / np.linalg.norm(down)))
    stations = tuple(
        Station(metre=m, centre_w=(m, 0.0, 0.0), leading_w=(0.0, 1.0, 0.0),
                pressure_w=(0.0, 0.0, 1.0), chord_m=CHORD_M, thickness=0.2, pitch_axis=0.5)
        for m in np.linspace(max(0.0, metre - 8), min(LENGTH_M, metre + 8), 33)
    )  # fmt: skip
    # 10 m of blade at 12 m: 1000 px wide, 1200 px of focal length.
    view = View(
        matrix=((1200.0, 0.0, 500.0), (0.0, 1200.0, 375.0), (0.0, 0.0, 1.0)),
        distortion=(0.0,) * 5, position_w=tuple(eye), quaternion_wc=tuple(turn),
        position_sigma_m=(0.1,) * 3, yaw_sigma_deg=1.0, pitch_sigma_deg=0.2, stations=stations,
    )  # fmt: skip
    size = {"width_px": 1000, "height_px": 750, "gsd_mm": 10.0, "gsd_full_mm": 1.0}
    place = {"blade": "A", "side": "PS", "metre": metre, "kept": kept}
    return a_record.model_copy(update={"view": view, **size, **place})
