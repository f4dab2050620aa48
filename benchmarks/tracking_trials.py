"""Which missions the tracking bench flies: turbines, stop angles, winds and position profiles.

Every draw comes from the bench's seed and the mission's number alone, so a single mission can be
flown again by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from config.inspection import Inspection
from config.settings import Settings
from config.simulation import Simulation, TruthDraws, Wind
from config.turbine import Site, Turbine
from drivers.simulated.scene import Scene, draw_scene

#: Turbine type and the scale of its lengths: blades of 40 to 80 m, the first four of them straight.
MODELS: tuple[tuple[str, float], ...] = (
    ("gw82-1.5", 1.03),
    ("v90-2.0", 1.0),
    ("swt-2.3-93", 1.0),
    ("nrel-5mw", 1.0),
    ("nrel-1.72-103", 1.0),
    ("v110-2.0", 1.0),
    ("g114-2.0", 1.0),
    ("iea-3.4-130", 1.0),
    ("nrel-2.8-127", 1.13),
    ("dtu-10mw", 0.926),
)

WindKind = Literal["5 m/s", "9 m/s", "gust to 15"]
#: Mean at hub height, turbulence intensity, extreme gust on top of the mean.
WINDS: dict[WindKind, tuple[float, float, float]] = {
    "5 m/s": (5.0, 0.10, 0.0),
    # At the height of the upper tips its gusts then reach 12 m/s in a flight's time; above that,
    # five seconds long, the flight is ended, as it has to be.
    "9 m/s": (9.0, 0.085, 0.0),
    "gust to 15": (9.0, 0.05, 6.0),
}
#: The share of missions at exactly 0 and at exactly 60 deg; the others lie round the circle.
_UPRIGHT_SHARE = 0.2


@dataclass(frozen=True, slots=True)
class Trial:
    """One mission of the bench."""

    number: int
    settings: Settings
    scene: Scene
    wind: WindKind
    model: str
    straight: bool
    profile: Literal["rtk", "gnss"]

    @property
    def turbine(self) -> Turbine:
        """The turbine as the catalogue has it, scaled: what the mission is told."""
        return self.scene.turbine

    @property
    def site(self) -> Site:
        """The site as the mission is told it: with the prior's error, from the take-off point."""
        error, launch = self.scene.prior_error_m, self.scene.launch_w
        told = {
            "tower_east_m": error[0] - launch[0],
            "tower_north_m": error[1] - launch[1],
            "tower_up_m": error[2] - launch[2],
        }
        return self.settings.sites[0].model_copy(update=told)


def draw_trial(seed: int, number: int, settings: Settings | None = None) -> Trial:
    """Return mission ``number`` of a bench's seed; ``settings`` are the flight's own."""
    rng = np.random.default_rng([seed, number, 0x7B])
    base = settings or Settings()
    # Turbines and winds take turns, so that few missions already hold all of them.
    model, scale = MODELS[(number + seed) % len(MODELS)]
    kinds: tuple[WindKind, ...] = ("5 m/s", "9 m/s", "9 m/s", "5 m/s", "gust to 15")
    kind = kinds[(number // 2) % len(kinds)]
    mean, turbulence, gust = WINDS[kind]
    upright, angle = float(rng.random()), float(rng.uniform(0.0, 120.0))
    if upright < 2 * _UPRIGHT_SHARE:
        angle = 0.0 if upright < _UPRIGHT_SHARE else 60.0
    profile: Literal["rtk", "gnss"] = "rtk" if rng.random() < 0.5 else "gnss"
    simulation = Simulation(
        seed=int(rng.integers(1, 2**31)),
        position_profile=profile,
        truth=TruthDraws(stop_angle_deg=angle),
        wind=Wind(
            mean_mps=mean,
            turbulence=turbulence,
            gust_mps=gust,
            gust_at_s=float(rng.uniform(250.0, 700.0)),
        ),
    )
    site = Site(name="bench", turbine=model, scale=scale)
    chosen = base.model_copy(
        update={
            "sites": (site,),
            "simulation": simulation,
            "inspection": Inspection(),
            # As `bladescout simulate` tells the flight which receiver the vehicle has.
            "positioning": base.positioning.model_copy(update={"method": profile}),
        }
    )
    scene = draw_scene(chosen)
    straight = max(scene.turbine.blade.prebend_m) < 0.5
    return Trial(number, chosen, scene, kind, f"{model} x{scale:g}", straight, profile)
