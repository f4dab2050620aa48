"""The simulated inspection camera on MAVLink: stills, storage, stream, and exposure by PARAM_EXT.

It has no definition file. Exposure stands in extended parameters: `CAM_EXPMODE` (0 automatic,
1 manual), `CAM_EV` in thirds from -3 to +3, `CAM_SHUTTER` and `CAM_ISO` read-only. A still is
acknowledged first; CAMERA_IMAGE_CAPTURED follows when the picture exists.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from config.settings import Settings
from drivers.simulated.camera_model import exposure_of
from drivers.simulated.link import CameraSetting, StillDone, StillRequest
from drivers.simulated.mavlink_autopilot import Command, command_of
from drivers.simulated.mavlink_streams import Telemetry
from drivers.simulated.mavlink_wire import Message, made
from drivers.simulated.px4_modes import Result

INT32, REAL32 = 6, 9
EV_STEP = 1 / 3
EV_LIMIT = 3.0
#: From the command to the shutter, and from the shutter to the stored file at the earliest.
_SHUTTER_LAG_S = 0.05
_STORE_S = 0.3
_GIVE_UP_S = 8.0
#: The range that is left when the camera clamps (failure word `wrong`).
_CLAMPED_EV = 1.0
_SLOW_S = 1.0
#: What may be asked of the shutter.
_SHORTEST_S, _LONGEST_S = 1 / 16000, 1 / 500


@dataclass(slots=True)
class _Still:
    """A still under way."""

    index: int
    shutter_s: float
    asked: bool = False
    done: StillDone | None = None


@dataclass(slots=True)
class Exposure:
    """What the camera was told, and what its last still used."""

    manual: bool
    ev: float = 0.0
    locked: bool = False
    longest_s: float = 1 / 2000
    """Exposure time asked for: exceeded only when the amplifier is at its end."""
    shutter_s: float = 1 / 2000
    iso: float = 100.0


@dataclass(slots=True)
class CameraPorts:
    """Where the camera's effects go."""

    send: Callable[[Message], None]
    setting: Callable[[CameraSetting], None]
    still: Callable[[StillRequest], None]


@dataclass(slots=True)
class _Later:
    due_s: float
    message: Message = field(compare=False)


class MockCamera:
    """MAVLink camera component."""

    def __init__(self, settings: Settings, ports: CameraPorts, telemetry: Telemetry) -> None:
        self._camera, self._simulated = settings.camera, settings.simulation.camera
        self._url = settings.camera.stream_url
        self.component = settings.camera.component_id
        self._gimbal = settings.gimbal.component_id
        self._ports, self._telemetry = ports, telemetry
        self.exposure = Exposure(manual=self._simulated.exposure_mode == "manual")
        self._still: _Still | None = None
        self._last_still_s = -10.0
        self._captured: dict[int, Message] = {}
        self._count = 0
        self._later: list[_Later] = []
        self._word = "ok"
        self._next_s = {"heartbeat": 0.0, "status": 0.5}
        self._commands: dict[int, Callable[[Command], Result]] = {
            512: lambda c: self._request(c.whole(0), c.whole(1)),
            521: lambda _: self._request(259, 0),
            522: lambda _: self._request(260, 0),
            525: lambda _: self._request(261, 0),
            527: lambda _: self._request(262, 0),
            2504: lambda _: self._request(269, 0),
            2505: lambda _: self._request(270, 0),
            530: lambda _: Result.ACCEPTED,
            2000: self._shoot,
            2001: lambda _: Result.ACCEPTED,
            2502: lambda _: Result.ACCEPTED,
            2503: lambda _: Result.ACCEPTED,
        }

    @property
    def now_s(self) -> float:
        """Mission time."""
        return self._telemetry.now_s

    def start(self) -> None:
        """Tell the renderer the exposure at power-on."""
        self._tell_setting()

    def fault(self, word: str) -> None:
        """Change the failure word: `stuck` rejects EV, `wrong` clamps it, `off` is unplugged."""
        self._word = word

    def handle(self, message: Message) -> None:
        """Act on a message addressed to the camera."""
        if self._word == "off":
            return
        name = message.get_type()
        if name in ("COMMAND_LONG", "COMMAND_INT"):
            self._command(message)
        elif name == "PARAM_EXT_REQUEST_READ":
            self._param_read(message)
        elif name == "PARAM_EXT_REQUEST_LIST":
            for index, parameter in enumerate(self._parameters()):
                self._send_parameter(parameter, index)
        elif name == "PARAM_EXT_SET":
            self._param_set(message)

    def step(self) -> None:
        """Open the shutter, finish stills, send what is due."""
        now_s = self.now_s
        if self._word == "off":
            self._still = None
            return
        if now_s >= self._next_s["heartbeat"]:
            self._next_s["heartbeat"] = now_s + 1.0
            self._send(made("heartbeat", 30, 8, 0, 0, 4, 3))
        if now_s >= self._next_s["status"]:
            self._next_s["status"] = now_s + 5.0
            self._request(262, 0)
        for later in [late for late in self._later if late.due_s <= now_s]:
            self._later.remove(later)
            self._ports.send(later.message)
        self._advance_still()

    def still_done(self, done: StillDone) -> None:
        """Take the renderer's word that a still exists."""
        if self._still is not None and self._still.index == done.index:
            self._still.done = done

    # stills

    def _shoot(self, command: Command) -> Result:
        if command.whole(2, 1) != 1:
            return Result.DENIED
        now_s = self.now_s
        if self._still is not None or now_s - self._last_still_s < self._camera.min_interval_s:
            return Result.TEMPORARILY_REJECTED
        if self._word == "intermittent" and self._count % 2:
            self._count += 1
            return Result.FAILED
        self._still = _Still(self._count, now_s + _SHUTTER_LAG_S)
        self._count += 1
        self._last_still_s = now_s
        return Result.ACCEPTED

    def _advance_still(self) -> None:
        still, now_s = self._still, self.now_s
        if still is None or now_s < still.shutter_s:
            return
        if not still.asked:
            still.asked = True
            self._ports.still(StillRequest(still.shutter_s, still.index))
        given_up = now_s > still.shutter_s + _GIVE_UP_S
        stored = still.done is not None and now_s >= still.shutter_s + _STORE_S
        if not (stored or given_up):
            return
        done = still.done
        if done is not None and done.ok:
            self.exposure.shutter_s, self.exposure.iso = done.shutter_s, done.iso
        message = self._captured_message(still)
        self._captured[still.index] = message
        self._still = None
        self._send(message)

    def _captured_message(self, still: _Still) -> Message:
        t, done = self._telemetry, still.done
        latitude, longitude, altitude = t.home.geodetic(t.position_l)
        return made(
            "camera_image_captured",
            int(still.shutter_s * 1e3),
            int(still.shutter_s * 1e6),
            1,
            round(latitude * 1e7),
            round(longitude * 1e7),
            round(altitude * 1e3),
            round(t.position_l[2] * 1e3),
            list(t.ned_q),
            still.index,
            1 if done is not None and done.ok else 0,
            (done.url if done is not None else "").encode()[:204],
        )

    # commands

    def _command(self, message: Message) -> None:
        command = command_of(message)
        action = self._commands.get(command.number)
        if action is None and getattr(message, "target_component", 0) != self.component:
            return
        result = action(command) if action is not None else Result.UNSUPPORTED
        self._send(
            made("command_ack", command.number, result, 0, 0, command.system, command.component)
        )

    def _request(self, number: int, index: int) -> Result:
        if number == 263:
            captured = self._captured.get(index)
            if captured is None:
                return Result.FAILED
            self._send(captured)
            return Result.ACCEPTED
        builders = {
            259: self._information,
            260: self._settings_message,
            261: self._storage,
            262: self._capture_status,
            269: self._stream_information,
            270: self._stream_status,
        }
        builder = builders.get(number)
        if builder is None:
            return Result.UNSUPPORTED
        self._send(builder())
        return Result.ACCEPTED

    def _information(self) -> Message:
        camera = self._camera
        vendor, model = list(b"bladescout".ljust(32, b"\0")), list(b"synthetic".ljust(32, b"\0"))
        # Captures images, also while video runs; has modes; has a video stream.
        flags = 0x2 | 0x4 | 0x8 | 0x100
        return made(
            "camera_information",
            self._telemetry.ms,
            vendor,
            model,
            1 << 24,
            camera.focal_length_mm,
            camera.sensor_width_mm,
            camera.sensor_height_mm,
            camera.width_px,
            camera.height_px,
            0,
            flags,
            0,
            b"",
            self._gimbal,
            0,
        )

    def _settings_message(self) -> Message:
        return made("camera_settings", self._telemetry.ms, 0, float("nan"), float("nan"))

    def _storage(self) -> Message:
        return made(
            "storage_information",
            self._telemetry.ms,
            1,
            1,
            2,
            128000.0,
            self._count * 12.0,
            128000.0 - self._count * 12.0,
            90.0,
            90.0,
            2,
            b"",
            1 | 2,
        )

    def _capture_status(self) -> Message:
        return made(
            "camera_capture_status",
            self._telemetry.ms,
            1 if self._still is not None else 0,
            0,
            0.0,
            0,
            128000.0 - self._count * 12.0,
            self._count,
        )

    def _stream_information(self) -> Message:
        simulated = self._simulated
        return made(
            "video_stream_information",
            1,
            1,
            0,
            1,
            simulated.stream_fps,
            simulated.stream_width_px,
            simulated.stream_height_px,
            2_000_000,
            0,
            21,
            b"live",
            self._url.encode()[:159],
            1,
        )

    def _stream_status(self) -> Message:
        simulated = self._simulated
        return made(
            "video_stream_status",
            1,
            1,
            simulated.stream_fps,
            simulated.stream_width_px,
            simulated.stream_height_px,
            2_000_000,
            0,
            21,
        )

    # exposure

    def _parameters(self) -> list[tuple[str, int, float]]:
        exposure = self.exposure
        limit = _CLAMPED_EV if self._word == "wrong" else EV_LIMIT
        return [
            ("CAM_EXPMODE", INT32, float(exposure.manual)),
            ("CAM_EV", REAL32, exposure.ev),
            ("CAM_EV_MIN", REAL32, -limit),
            ("CAM_EV_MAX", REAL32, limit),
            ("CAM_EV_STEP", REAL32, EV_STEP),
            ("CAM_AELOCK", INT32, float(exposure.locked)),
            ("CAM_SHUTTER", REAL32, exposure.shutter_s),
            ("CAM_ISO", INT32, exposure.iso),
        ]

    def _param_read(self, message: Message) -> None:
        wanted, index = str(getattr(message, "param_id", "")), getattr(message, "param_index", -1)
        for i, parameter in enumerate(self._parameters()):
            if parameter[0] == wanted or (i == index and not wanted):
                self._send_parameter(parameter, i)

    def _send_parameter(self, parameter: tuple[str, int, float], index: int) -> None:
        name, kind, value = parameter
        self._send(
            made(
                "param_ext_value",
                name.encode(),
                _encoded(kind, value),
                kind,
                len(self._parameters()),
                index,
            )
        )

    def _param_set(self, message: Message) -> None:
        name = str(getattr(message, "param_id", ""))
        raw: bytes = getattr(message, "_param_value_raw", b"")
        kind = int(getattr(message, "param_type", 0))
        value = _decoded(kind, raw)
        accepted = value is not None and self._set(name, value)
        for known, own_kind, current in self._parameters():
            if known == name:
                ack = made(
                    "param_ext_ack",
                    name.encode(),
                    _encoded(own_kind, current),
                    own_kind,
                    0 if accepted else 1,
                )
                self._send(ack)

    def _set(self, name: str, value: float) -> bool:
        exposure = self.exposure
        if self._word == "stuck":
            return False
        if name == "CAM_EV":
            limit = _CLAMPED_EV if self._word == "wrong" else EV_LIMIT
            exposure.ev = round(min(max(value, -limit), limit) / EV_STEP) * EV_STEP
        elif name == "CAM_AELOCK":
            exposure.locked = value != 0
        elif name == "CAM_EXPMODE":
            # A camera that only compensates its own automatic has no manual mode.
            if value not in (0, 1) or (value == 1 and self._simulated.exposure_mode != "manual"):
                return False
            exposure.manual = value == 1
        elif name == "CAM_SHUTTER" and _SHORTEST_S <= value <= _LONGEST_S:
            exposure.longest_s = value
        else:
            return False
        self._tell_setting()
        return True

    def _tell_setting(self) -> None:
        exposure = self.exposure
        mode = "manual" if exposure.manual else "compensation"
        self._ports.setting(
            CameraSetting(self.now_s, mode, exposure.ev, exposure.locked, exposure.longest_s)
        )
        if exposure.manual:
            in_force = exposure_of(exposure.ev, exposure.longest_s)
            exposure.shutter_s, exposure.iso = in_force.shutter_s, in_force.iso

    def _send(self, message: Message) -> None:
        if self._word in ("slow", "delayed"):
            self._later.append(_Later(self.now_s + _SLOW_S, message))
        else:
            self._ports.send(message)


def _encoded(kind: int, value: float) -> bytes:
    """Return the 128 bytes of an extended parameter's value."""
    packed = struct.pack("<i", round(value)) if kind == INT32 else struct.pack("<f", value)
    return packed.ljust(128, b"\0")


def _decoded(kind: int, raw: bytes) -> float | None:
    """Return the value of PARAM_EXT_SET, or None for a type that this camera has not."""
    raw = raw.ljust(8, b"\0")
    formats = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i", 9: "<f"}
    if kind not in formats:
        return None
    value = float(struct.unpack_from(formats[kind], raw)[0])
    return value if value == value and abs(value) < 1e9 else None
