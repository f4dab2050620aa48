"""The JSON object of `bladescout estimate`: the names of mission.json's `rotor`."""

from __future__ import annotations

from collections.abc import Sequence

from perception.cloud_estimate import CloudAnswer
from perception.rotor import Refusal, Rotor, blade_angles_deg

SCHEMA = "bladescout/estimate/1"


def cloud_record(answer: CloudAnswer, notes: Sequence[str] = ()) -> dict[str, object]:
    """Return an answer as plain values; what a refusal leaves unknown is null.

    ``hub_m`` and the directions are in the cloud's own frame.
    """
    rotor = answer.rotor
    refusal = {"code": str(rotor.code), "text": rotor.text} if isinstance(rotor, Refusal) else None
    return {
        "schema": SCHEMA,
        **_measured(None if isinstance(rotor, Refusal) else rotor),
        "refusal": refusal,
        "found_by": answer.found_by,
        "points": answer.points,
        "dropped": answer.dropped,
        "looks": answer.looks,
        "spread_deg": answer.spread_deg,
        "from_behind": answer.from_behind,
        "notes": list(notes),
    }


def _measured(rotor: Rotor | None) -> dict[str, object]:
    if rotor is None:
        names = (
            "stop_angle_deg", "sigma_deg", "reference", "hub_m", "normal", "cone_deg", "method"
        )  # fmt: skip
        return {**dict.fromkeys(names), "blades": []}
    angles = blade_angles_deg(rotor.stop_angle_deg)
    return {
        "stop_angle_deg": rotor.stop_angle_deg,
        "sigma_deg": rotor.sigma_deg,
        "reference": rotor.reference,
        "hub_m": [float(value) for value in rotor.hub_w],
        "normal": [float(value) for value in rotor.normal_w],
        "cone_deg": rotor.cone_deg,
        "method": rotor.method,
        "blades": [
            {
                "name": blade.name,
                "angle_deg": angle,
                "direction": [float(value) for value in blade.direction_w],
                "pitch_deg": blade.pitch_deg,
                "pitch_sigma_deg": blade.pitch_sigma_deg,
            }
            for blade, angle in zip(rotor.blades, angles, strict=True)
        ],
    }
