"""Another PX4-like simulator in the place of the mock: its pose moves the synthetic sensors.

The field relays its MAVLink unchanged to the mission's URL, and reads along: pose, time, arming.
World time follows the vehicle's ``time_boot_ms``; the turbine stands relative to its home. What the
other simulator does not send (wind, battery) stays unknown.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable

from config.settings import Settings
from drivers.clock import SharedClockWriter, sleep_until
from drivers.simulated.followed_clock import FollowedClock
from drivers.simulated.link import CameraSetting, FaultChange, StillRequest, TruthState
from drivers.simulated.mavlink_payload import MockPayload
from drivers.simulated.mavlink_streams import Telemetry
from drivers.simulated.mavlink_wire import MavlinkLink, Message, Received, finite, made
from drivers.simulated.ned import Home, enu_quaternion, euler, swapped, turned
from drivers.simulated.scene import Scene
from drivers.simulated.setpoint_timing import SetpointTiming
from drivers.simulated.truth_report import WorldFacts
from drivers.simulated.vehicle import Vec3
from perception.geometry import quaternion_from_euler

ToRenderer = TruthState | CameraSetting | StillRequest | FaultChange

log = logging.getLogger(__name__)

_TICK_S = 0.02
_OFFBOARD_MAIN = 6
#: A peripheral of the same vehicle, as which the field asks for its streams.
_OWN_COMPONENT = 158
_ASKED_HZ = {31: 50.0, 32: 50.0, 242: 1.0, 245: 2.0, 231: 1.0}
_SET_INTERVAL, _REQUEST, _HOME_POSITION = 511, 512, 242
#: Streams of the vehicle's own clock.
_TIMED = ("ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT")
#: After a heartbeat, for its estimator to settle.
_SETTLE_S = 60.0
#: So long after its first position a vehicle that tells no home is taken to stand there.
_NO_HOME_S = 15.0
_AFTER_MISSION_ASKED_S = 0.5
#: So high above its home a vehicle that does not tell whether it has landed is taken to fly.
_AIRBORNE_M = 1.0


class FollowedWorld:
    """The synthetic sensors of a vehicle that another simulator flies."""

    def __init__(
        self,
        settings: Settings,
        scene: Scene,
        clock: SharedClockWriter,
        to_renderer: Callable[[ToRenderer], None],
    ) -> None:
        autopilot, url = settings.autopilot, settings.simulation.autopilot_url
        if not autopilot.payload_url or autopilot.url == url:
            raise ConnectionError(
                "following another simulator needs autopilot.payload_url, and an autopilot.url "
                f"that is not {url} itself: the field relays between the two"
            )
        self._url, self._system = url, autopilot.system_id
        self._timeout_s = autopilot.connect_timeout_s
        self._clock, self._scene, self._to_renderer = clock, scene, to_renderer
        self._follow = FollowedClock(clock)
        self._telemetry = Telemetry(Home(0.0, 0.0, 0.0))
        # The link takes URLs as the mission's end writes them; here the field is that end.
        self._outer = MavlinkLink(_other_end(url), delay_s=0.0)
        self._inner = MavlinkLink(autopilot.url, delay_s=0.0)
        self._payload_link = MavlinkLink(autopilot.payload_url)
        self._outer.on_bytes, self._inner.on_bytes = self._to_mission, self._to_vehicle
        self._outer.on_arrival, self._inner.on_arrival = self._heard, self._asked
        self.payload = MockPayload(
            settings, self._payload_link, self._telemetry, to_renderer, shared=False
        )
        self.timing = SetpointTiming()
        self.now_s = 0.0
        self.airborne = False
        self.faults_applied: list[dict[str, str | float]] = []
        self._took_off = False
        self._custom_mode = 0
        self._home_l: Vec3 = (0.0, 0.0, 0.0)
        self._local: Vec3 = (0.0, 0.0, 0.0)
        """In the vehicle's own frame, whose origin need not be its home."""
        self._seen: set[str] = set()
        self._positioned_s = math.inf
        self._ask_at_s = math.inf
        self._wind_max_mps = 0.0
        self._last_truth_s = -1.0
        self._handlers: dict[str, Callable[[Message], None]] = {
            "HEARTBEAT": self._heartbeat,
            "ATTITUDE_QUATERNION": self._attitude,
            "ATTITUDE": self._euler_attitude,
            "LOCAL_POSITION_NED": self._position,
            "HOME_POSITION": self._home,
            "GLOBAL_POSITION_INT": self._geodetic,
            "EXTENDED_SYS_STATE": self._landed_state,
            "WIND_COV": self._wind,
        }

    @property
    def home(self) -> Home:
        """Geodetic place of the take-off point, as the vehicle tells it."""
        return self._telemetry.home

    async def start(self) -> None:
        """Wait for the vehicle; tell the renderer its first state."""
        loop = asyncio.get_running_loop()
        for link in (self._outer, self._inner, self._payload_link):
            loop.add_reader(link.fileno(), self._read, link)
        limit_s, begun_s = self._timeout_s, loop.time()
        while missing := self._missing():
            if missing != "heartbeat" and limit_s == self._timeout_s:
                limit_s += _SETTLE_S
            if loop.time() - begun_s > limit_s:
                words = f"no {missing} from {self._url} within {limit_s:.0f} s"
                others = sorted(self._outer.systems - {self._system})
                if missing == "heartbeat" and others:
                    heard = ", ".join(map(str, others))
                    words += f" (heard system id {heard}: set autopilot.system_id)"
                raise TimeoutError(words)
            self._ask_streams()
            await asyncio.sleep(0.5)
        self.payload.camera.start()

    def _missing(self) -> str:
        """Return what is not known yet of the vehicle; where all is, nothing."""
        if "HEARTBEAT" not in self._seen:
            return "heartbeat"
        if "LOCAL_POSITION_NED" not in self._seen:
            return "position"
        if not self._seen & {"ATTITUDE_QUATERNION", "ATTITUDE"}:
            return "attitude"
        if "HOME_POSITION" in self._seen:
            return ""
        if time.monotonic() - self._positioned_s < _NO_HOME_S:
            return "home position"
        log.warning("the vehicle tells no home position: where it stands is taken for it")
        self._home_l = self._local
        self._seen.add("HOME_POSITION")
        return ""

    async def run(self) -> None:
        """Step the payload with the followed clock until cancelled."""
        self.now_s = self._clock.now_s()
        asked_s = time.monotonic()
        while True:
            await sleep_until(self._clock, self.now_s + _TICK_S)
            self.now_s = max(self.now_s + _TICK_S, self._clock.now_s())
            self._telemetry.now_s = self.now_s
            for received in self._payload_link.due(self.now_s):
                self.payload.handle(received)
            self.payload.step(_TICK_S)
            self._payload_link.flush(self.now_s)
            self._follow.watch()
            if time.monotonic() - asked_s > 1.0:
                asked_s = time.monotonic()
                self._outer.send(
                    made("heartbeat", 18, 8, 0, 0, 4, 3), self._system, _OWN_COMPONENT, 0
                )
                self._outer.flush(1.0)
            if time.monotonic() > self._ask_at_s:
                self._ask_at_s = math.inf
                self._ask_streams()

    def close(self) -> None:
        """Close the links."""
        loop = asyncio.get_running_loop()
        for link in (self._outer, self._inner, self._payload_link):
            loop.remove_reader(link.fileno())
            link.close()

    def fault(self, device: str, word: str) -> None:
        """Change a device's failure word; the autopilot's own devices are the other simulator's."""
        if device == "link":
            self._inner.fault(word)
        elif device == "gimbal":
            self.payload.gimbal.fault(word)
        elif device in ("lidar", "camera", "stream"):
            if device == "camera":
                self.payload.camera.fault(word)
            self._to_renderer(FaultChange(device, word))
        else:
            return
        self.faults_applied.append({"device": device, "word": word, "at_s": round(self.now_s, 3)})

    def facts(self) -> WorldFacts:
        """Return what is known of the flight so far."""
        gaps, counts = self.timing.gaps(), self._inner.counts
        return WorldFacts(
            mission_s=self.now_s,
            setpoint_gap_ms=gaps[0].as_json(),
            setpoint_gap_wall_ms=gaps[1].as_json(),
            setpoints=self.timing.count,
            offboard_losses=0,
            landed=not self.airborne,
            armed=self._telemetry.armed,
            took_off=self._took_off,
            touchdown_mps=0.0,
            wind_mean_mps=0.0,
            wind_from_deg=0.0,
            wind_max_mps=self._wind_max_mps,
            battery_left=None,
            energy_wh=None,
            landing_error_m=None,
            link={"sent": counts.sent, "received": counts.received, "dropped": counts.dropped},
            faults=self.faults_applied,
        )

    # relay

    def _read(self, link: MavlinkLink) -> None:
        link.read(self._clock.now_s() if link is self._payload_link else 0.0)
        if link is not self._payload_link:
            link.due(1.0)

    def _to_mission(self, data: bytes) -> None:
        self._inner.send_bytes(data, 0.0)
        self._inner.flush(1.0)

    def _to_vehicle(self, data: bytes) -> None:
        self._outer.send_bytes(data, 0.0)
        self._outer.flush(1.0)

    def _ask_streams(self) -> None:
        for number, hz in _ASKED_HZ.items():
            self._command(_SET_INTERVAL, number, 1e6 / hz)
        if "HOME_POSITION" not in self._seen:
            self._command(_REQUEST, _HOME_POSITION)
        self._outer.flush(1.0)

    def _command(self, command: int, first: float, second: float = 0.0) -> None:
        ask = made("command_long", self._system, 1, command, 0, first, second, 0, 0, 0, 0, 0)
        self._outer.send(ask, self._system, _OWN_COMPONENT, 0.0)

    # what is read along

    def _asked(self, received: Received) -> None:
        message = received.message
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            offboard = self._telemetry.armed and self._custom_mode >> 16 & 0xFF == _OFFBOARD_MAIN
            at_s = self._clock.mission_time_of(received.arrival_ns)
            self.timing.arrived(at_s, received.arrival_ns, offboard=offboard)
        elif getattr(message, "command", 0) == _SET_INTERVAL:
            # The mission may want less of a stream than the sensors' world does: on one link the
            # last wish counts.
            self._ask_at_s = time.monotonic() + _AFTER_MISSION_ASKED_S

    def _heard(self, received: Received) -> None:
        message = received.message
        if message.get_srcSystem() != self._system or message.get_srcComponent() != 1:
            return
        if message.get_type() in _TIMED:
            self._follow.take(int(getattr(message, "time_boot_ms", 0)) * 1e-3)
        handler = self._handlers.get(message.get_type())
        if handler is not None:
            handler(message)
            self._seen.add(message.get_type())

    def _heartbeat(self, message: Message) -> None:
        self._telemetry.armed = bool(int(getattr(message, "base_mode", 0)) & 0x80)
        self._custom_mode = int(getattr(message, "custom_mode", 0))

    def _landed_state(self, message: Message) -> None:
        self._flies(flying=getattr(message, "landed_state", 0) in (2, 3, 4))

    def _flies(self, *, flying: bool) -> None:
        self.airborne = flying
        self._took_off = self._took_off or flying

    def _wind(self, message: Message) -> None:
        north, east = (float(getattr(message, name, 0.0)) for name in ("wind_x", "wind_y"))
        self._wind_max_mps = max(self._wind_max_mps, (north * north + east * east) ** 0.5)

    def _home(self, message: Message) -> None:
        get = [float(getattr(message, n, 0.0)) for n in ("latitude", "longitude", "altitude")]
        self._telemetry.home = Home(get[0] * 1e-7, get[1] * 1e-7, get[2] * 1e-3)
        local = [finite(float(getattr(message, n, 0.0))) for n in ("x", "y", "z")]
        self._home_l = swapped((local[0], local[1], local[2]))

    def _geodetic(self, message: Message) -> None:
        """Take where the vehicle stands for its home until it tells one."""
        if "HOME_POSITION" not in self._seen:
            lat, lon, alt = (float(getattr(message, n, 0.0)) for n in ("lat", "lon", "alt"))
            self._telemetry.home = Home(lat * 1e-7, lon * 1e-7, alt * 1e-3)

    def _attitude(self, message: Message) -> None:
        q = [float(getattr(message, name)) for name in ("q1", "q2", "q3", "q4")]
        self._turn((q[0], q[1], q[2], q[3]), message)

    def _euler_attitude(self, message: Message) -> None:
        if "ATTITUDE_QUATERNION" not in self._seen:
            e = [float(getattr(message, name)) for name in ("roll", "pitch", "yaw")]
            self._turn(quaternion_from_euler(e[0], e[1], e[2]), message)

    def _turn(self, ned_q: tuple[float, float, float, float], message: Message) -> None:
        t = self._telemetry
        p, q, r = (float(getattr(message, n, 0.0)) for n in ("rollspeed", "pitchspeed", "yawspeed"))
        t.ned_q, t.rates_b, t.quaternion_lb = ned_q, (p, -q, -r), enu_quaternion(ned_q)

    def _position(self, message: Message) -> None:
        t = self._telemetry
        p = [float(getattr(message, name)) for name in ("x", "y", "z")]
        v = [float(getattr(message, name)) for name in ("vx", "vy", "vz")]
        self._local = swapped((p[0], p[1], p[2]))
        t.velocity_l = swapped((v[0], v[1], v[2]))
        x, y, z = (here - home for here, home in zip(self._local, self._home_l, strict=True))
        t.position_l = (x, y, z)
        if "EXTENDED_SYS_STATE" not in self._seen:
            self._flies(flying=t.armed and z > _AIRBORNE_M)
        self._positioned_s = min(self._positioned_s, time.monotonic())
        world_s = self._follow.world_s(int(getattr(message, "time_boot_ms", 0)) * 1e-3)
        if world_s > self._last_truth_s:
            self._last_truth_s = world_s
            self._tell_truth(world_s)

    def _tell_truth(self, at_s: float) -> None:
        t, launch = self._telemetry, self._scene.launch_w
        body_yaw = turned(euler(t.ned_q)[2])
        camera = self.payload.gimbal.truth(body_yaw, _TICK_S)
        x, y, z = (launch[i] + t.position_l[i] for i in range(3))
        self._to_renderer(
            TruthState(
                t_s=at_s,
                position_w=(x, y, z),
                velocity_w=t.velocity_l,
                quaternion_wb=t.quaternion_lb,
                angular_rate_b=t.rates_b,
                camera_quaternion_wc=camera.quaternion_wc,
                camera_rate_rps=camera.rate_rps,
            )
        )


def _other_end(url: str) -> str:
    """Return the URL that the vehicle's end of this link would have."""
    url = url.replace("udp://", "udpin://", 1)
    if url.startswith("udpin://"):
        return "udpout://" + url.removeprefix("udpin://")
    if url.startswith("udpout://"):
        return "udpin://" + url.removeprefix("udpout://")
    raise ConnectionError(f"--autopilot takes udpin://HOST:PORT or udpout://HOST:PORT, not {url}")
