"""What the mission is told of the site beforehand: a noisy prior, never the truth."""

from __future__ import annotations

import json
from pathlib import Path

from config.settings import Settings
from drivers.simulated.ned import Home
from drivers.simulated.scene import Scene


def write_told(path: Path, settings: Settings, scene: Scene, home: Home) -> None:
    """Write the site with the tower's place relative to take-off plus the prior's error."""
    error, launch = scene.prior_error_m, scene.launch_w
    site = settings.sites[0].model_copy(
        update={
            "tower_east_m": error[0] - launch[0],
            "tower_north_m": error[1] - launch[1],
            "tower_up_m": error[2] - launch[2],
        }
    )
    told = {
        "site": site.model_dump(mode="json"),
        "home": {
            "latitude_deg": home.latitude_deg,
            "longitude_deg": home.longitude_deg,
            "altitude_m": home.altitude_m,
        },
    }
    path.write_text(json.dumps(told, indent=1), "utf-8")
