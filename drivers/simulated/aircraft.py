"""The simulated aircraft: body, estimator, commander, controller and pack, in one step.

It flies by what it believes (the estimate) and moves as physics has it (the truth). Positions
with ``_w`` are world ENU (origin at the tower's base); ``_l`` are local ENU, whose origin is home.
"""

from __future__ import annotations

import math
from random import Random

from config.settings import Settings
from drivers.simulated.battery import Pack
from drivers.simulated.guidance import Guidance
from drivers.simulated.mavlink_streams import Telemetry
from drivers.simulated.ned import Home, product, rates_b
from drivers.simulated.position_control import Estimate, PositionController
from drivers.simulated.position_error import PROFILES, EstimatorError
from drivers.simulated.px4_modes import Commander, Health, Mode
from drivers.simulated.px4_parameters import Parameters, parameters_for
from drivers.simulated.scene import Scene
from drivers.simulated.vehicle import GRAVITY_MPS2, AttitudeCommand, Multirotor, Quaternion, Vec3
from drivers.simulated.wind import WindField
from perception.geometry import quaternion_from_euler

TICK_S = 0.02
#: A place at sea for the geodetic datum of the synthetic site.
HOME = Home(54.0138, 6.5878, 21.0)
#: The filter needs this long to see the wind from its own tilt.
_WIND_LAG_S = 2.0
_TIP_MARGIN_M = 20.0


class Aircraft:
    """Everything that flies, without its links."""

    def __init__(self, settings: Settings, scene: Scene) -> None:
        seed = settings.simulation.seed
        turbine = scene.turbine
        tip_m = turbine.hub_height_m + turbine.rotor_radius_m - scene.launch_w[2]
        self.parameters: Parameters = parameters_for(settings, math.ceil(tip_m + _TIP_MARGIN_M) + 5)
        self.commander = Commander(self.parameters)
        self.guidance = Guidance(self.parameters)
        self._controller = PositionController(self.parameters)
        self.error = EstimatorError(settings.simulation.position_profile, Random(seed + 11))
        self.pack = Pack(settings.battery)
        self.wind = WindField(
            settings.simulation.wind,
            scene.wind_mean_mps,
            scene.wind_from_deg,
            turbine.hub_height_m,
            Random(seed + 12),
        )
        yaw_rad = Random(seed + 13).uniform(-math.pi, math.pi)
        self._launch_w = scene.launch_w
        self.body = Multirotor(scene.launch_w, yaw_rad)
        self.telemetry = Telemetry(HOME)
        self.telemetry.position_sigma_m = PROFILES[settings.simulation.position_profile].walk_m
        self.quaternion_wb: Quaternion = self.body.quaternion_wb()
        self.rates_b: Vec3 = (0.0, 0.0, 0.0)
        self.battery_ok = True
        self.took_off = False
        self._wind_w: Vec3 = (0.0, 0.0, 0.0)
        self._estimate = self._believe()
        self._report(0.0)

    def step(self, now_s: float) -> None:
        """Advance by one tick of mission time, which ends at ``now_s``."""
        body, commander = self.body, self.commander
        self.error.step(TICK_S, body.position_w, body.velocity_w)
        self._estimate = estimate = self._believe()
        commander.step(
            now_s,
            Health(
                on_ground=body.on_ground,
                height_m=estimate.position_w[2],
                climb_mps=estimate.velocity_w[2],
                position_ok=self.error.position_ok,
                battery_left=self.pack.charge,
                battery_ok=self.battery_ok,
            ),
        )
        target = self.guidance.step(commander, estimate, TICK_S)
        self._wind_w = self.wind.step(now_s, TICK_S, body.z, body.velocity_w)
        # PX4's position loop runs at 100 Hz; the body is integrated at 200 Hz beneath it.
        for _ in range(2):
            command = self._controller.step(target, self._believe(), TICK_S / 2)
            body.step(self._turned(command), self._wind_w, TICK_S / 2)
        self.took_off = self.took_off or not body.on_ground
        self._draw(body)
        before = self.quaternion_wb
        self.quaternion_wb = body.quaternion_wb()
        self.rates_b = rates_b(before, self.quaternion_wb, TICK_S)
        self._report(now_s)

    def _believe(self) -> Estimate:
        """Return the estimate: local frame, with the filter's errors."""
        body, error, launch = self.body, self.error, self._launch_w
        p, v = error.position, error.velocity
        return Estimate(
            (
                body.x - launch[0] + p[0],
                body.y - launch[1] + p[1],
                body.z - launch[2] + p[2],
            ),
            (body.vx + v[0], body.vy + v[1], body.vz + v[2]),
            body.yaw_rad + error.yaw,
        )

    def _turned(self, command: AttitudeCommand) -> AttitudeCommand:
        """A tilt commanded in the believed frame acts in the true one: turned, and a little off."""
        error = self.error
        c, s = math.cos(error.yaw), math.sin(error.yaw)
        east, north = command.lean_east + error.pitch, command.lean_north - error.roll
        return AttitudeCommand(
            c * east + s * north, c * north - s * east, command.thrust_mps2, command.yaw_rate_rps
        )

    def _draw(self, body: Multirotor) -> None:
        rx, ry, rz = (v - w for v, w in zip(body.velocity_w, self._wind_w, strict=True))
        self.pack.step(
            TICK_S,
            flying=not body.on_ground,
            airspeed_mps=math.sqrt(rx * rx + ry * ry + rz * rz),
            climb_mps=body.vz,
        )

    def _report(self, now_s: float) -> None:
        """Fill the snapshot that the telemetry streams read."""
        t, commander, error, pack = self.telemetry, self.commander, self.error, self.pack
        t.now_s = now_s
        t.position_l, t.velocity_l = self._estimate.position_w, self._estimate.velocity_w
        about_up = quaternion_from_euler(0.0, 0.0, error.yaw)
        lean = quaternion_from_euler(error.roll, error.pitch, 0.0)
        t.quaternion_lb = product(product(about_up, self.quaternion_wb), lean)
        t.rates_b = self.rates_b
        blend = TICK_S / _WIND_LAG_S
        t.wind_l = (
            t.wind_l[0] + blend * (self._wind_w[0] - t.wind_l[0]),
            t.wind_l[1] + blend * (self._wind_w[1] - t.wind_l[1]),
            t.wind_l[2] + blend * (self._wind_w[2] - t.wind_l[2]),
        )
        t.custom_mode = commander.mode.custom_mode
        t.intended_custom_mode = commander.intention.custom_mode
        t.armed = commander.armed
        t.failsafe = commander.mode is not commander.intention
        t.landed_state = int(commander.landed)
        t.armable = commander.armable(now_s)
        t.position_ok = error.position_ok
        t.charge, t.pack_v, t.cells = pack.told, pack.pack_v, pack.cells
        t.current_a, t.used_wh, t.battery_present = pack.current_a, pack.used_wh, pack.present
        t.thrust_share = self.body.thrust_mps2 / (2 * GRAVITY_MPS2)
        t.reset_count = error.reset_count
        t.settle()

    @property
    def offboard(self) -> bool:
        """Whether a set-point would be flown, or awaited: armed and OFFBOARD asked for."""
        return self.commander.armed and self.commander.intention is Mode.OFFBOARD

    @property
    def distance_from_launch_m(self) -> float:
        """Horizontal distance from the take-off point, true."""
        body, launch = self.body, self._launch_w
        return round(math.hypot(body.x - launch[0], body.y - launch[1]), 3)

    def fault(self, device: str, word: str) -> None:
        """Change the failure word of a device of the autopilot."""
        if device in ("gps", "compass", "baro"):
            self.error.fault(device, word, self.body.position_w)
        elif device == "battery":
            self._battery_fault(word)

    def _battery_fault(self, word: str) -> None:
        self.pack.word = word
        self.battery_ok = word != "garbage"
        if word == "wrong":
            # The pack is suddenly nearly empty, as with a lost cell.
            self.pack.charge = min(self.pack.charge, 0.12)
