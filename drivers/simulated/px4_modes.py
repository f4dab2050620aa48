"""PX4's commander in the small: modes, arming, the offboard-loss and battery failsafes.

Pure: no I/O and no clock but the times it is given. It keeps what a real PX4 does in ways that
hurt: OFFBOARD needs a fresh set-point to be entered, and is entered again by the autopilot itself
when set-points resume after its failsafe; after landing the mode from before the landing returns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, IntEnum

from drivers.simulated.px4_parameters import Parameters


class Mode(Enum):
    """PX4 modes as (main, sub) of the custom mode."""

    MANUAL = (1, 0)
    ALTCTL = (2, 0)
    POSCTL = (3, 0)
    TAKEOFF = (4, 2)
    HOLD = (4, 3)
    MISSION = (4, 4)
    RETURN = (4, 5)
    LAND = (4, 6)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)

    @property
    def custom_mode(self) -> int:
        """The number of HEARTBEAT.custom_mode."""
        return self.value[0] << 16 | self.value[1] << 24


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5


class Landed(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class Severity(IntEnum):
    """MAV_SEVERITY of a status text."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


@dataclass(frozen=True, slots=True)
class Health:
    """What the commander decides on."""

    on_ground: bool
    height_m: float
    """Above home, as estimated."""
    climb_mps: float
    position_ok: bool = True
    battery_left: float = 1.0
    battery_ok: bool = True


#: Modes in which PX4 refuses to arm.
_NOT_ARMABLE = (Mode.LAND, Mode.RETURN)
_TRANSIENT = (Mode.TAKEOFF, Mode.LAND, Mode.RETURN)
_SUPPORTED = tuple(mode for mode in Mode if mode is not Mode.MISSION)
#: Worst last: what wins when several failsafes are active.
_ORDER = (Mode.HOLD, Mode.POSCTL, Mode.ALTCTL, Mode.RETURN, Mode.LAND)
#: COM_OBL_RC_ACT -> mode; a remote control with centred sticks is always present here.
_OFFBOARD_LOSS = {
    0: Mode.POSCTL,
    1: Mode.ALTCTL,
    2: Mode.ALTCTL,
    3: Mode.RETURN,
    4: Mode.LAND,
    5: Mode.HOLD,
}
#: PX4 measured: the failsafe comes this long after GPS is lost.
_POSITION_LOST_AFTER_S = 5.3


class Commander:
    """Mode and arming state of the mock autopilot."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self.intention = Mode.HOLD
        """What the user asked for last."""
        self.mode = Mode.HOLD
        """What is flown, and reported: the intention or a failsafe."""
        self.armed = False
        self.landed = Landed.ON_GROUND
        self.texts: list[tuple[Severity, str]] = []
        """Status texts not yet sent."""
        self.offboard_losses = 0
        self.takeoff_height_m = parameters["MIS_TAKEOFF_ALT"]
        self._health = Health(on_ground=True, height_m=0.0, climb_mps=0.0)
        self._mode_after_disarm = Mode.HOLD
        self._setpoint_s = -math.inf
        self._position_s = 0.0
        self._resting_since_s: float | None = None
        self._disarm_at_s = math.inf
        self._since: dict[str, float] = {}
        self._overridden: set[str] = set()

    def setpoint_received(self, now_s: float) -> None:
        """Note that a valid offboard set-point came."""
        self._setpoint_s = now_s

    def setpoint_fresh(self, now_s: float) -> bool:
        """Return whether a set-point came within COM_OF_LOSS_T."""
        return now_s - self._setpoint_s <= self._parameters["COM_OF_LOSS_T"]

    def armable(self, now_s: float) -> bool:
        """Return whether arming would be accepted in this mode now."""
        if self.intention in _NOT_ARMABLE or not self._health.position_ok:
            return False
        if (
            not self._health.battery_ok
            or self._health.battery_left < self._parameters["BAT_LOW_THR"]
        ):
            return False
        return self.intention is not Mode.OFFBOARD or self.setpoint_fresh(now_s)

    def set_mode(self, mode: Mode, now_s: float) -> Result:
        """Change the mode at a user's wish (any client may: PX4 does not ask who)."""
        if mode not in _SUPPORTED:
            return Result.TEMPORARILY_REJECTED
        if mode is Mode.OFFBOARD and not self.setpoint_fresh(now_s):
            self._say(Severity.CRITICAL, "Switching to mode 'Offboard' is currently not possible")
            return Result.TEMPORARILY_REJECTED
        if mode not in (Mode.MANUAL, Mode.STABILIZED, Mode.ALTCTL) and not self._health.position_ok:
            self._say(Severity.CRITICAL, "No valid local position estimate")
            return Result.TEMPORARILY_REJECTED
        # A change of mode while a failsafe acts is the user taking over.
        self._overridden |= set(self._since) & {"battery"}
        if mode not in _TRANSIENT:
            self._mode_after_disarm = mode
        self.intention = mode
        self._resolve(now_s)
        return Result.ACCEPTED

    def take_off(self, height_m: float, now_s: float) -> Result:
        """Enter TAKEOFF; NaN takes MIS_TAKEOFF_ALT. Accepted while disarmed, as by PX4."""
        wanted = height_m if math.isfinite(height_m) else self._parameters["MIS_TAKEOFF_ALT"]
        self.takeoff_height_m = max(wanted, 0.5)
        return self.set_mode(Mode.TAKEOFF, now_s)

    def arm(self, now_s: float, *, force: bool = False) -> Result:
        """Arm, if the checks pass."""
        if self.armed:
            return Result.ACCEPTED
        if not (force or self.armable(now_s)):
            self._say(
                Severity.CRITICAL, f"Arming denied: resolve system health ({self._reason(now_s)})"
            )
            return Result.TEMPORARILY_REJECTED
        self.armed = True
        self._disarm_at_s = now_s + self._parameters["COM_DISARM_PRFLT"]
        self._say(Severity.INFO, "Armed by external command")
        return Result.ACCEPTED

    def disarm(self, now_s: float, *, force: bool = False) -> Result:
        """Disarm; in the air only by force."""
        if self.armed and self.landed is not Landed.ON_GROUND and not force:
            self._say(Severity.CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        if self.armed:
            self.armed = False
            self.intention = self._mode_after_disarm
            self._since.clear()
            self._overridden.clear()
            self._say(Severity.INFO, "Disarmed")
            self._resolve(now_s)
        return Result.ACCEPTED

    def step(self, now_s: float, health: Health) -> None:
        """Judge landing, the end of a take-off, and the failsafes."""
        self._health = health
        if health.position_ok:
            self._position_s = now_s
        self._judge_landing(now_s)
        climbed = health.height_m > self.takeoff_height_m - 0.3
        if self.intention is Mode.TAKEOFF and self.armed and climbed:
            self.intention = Mode.HOLD
        self._resolve(now_s)

    def _judge_landing(self, now_s: float) -> None:
        health = self._health
        if not self.armed:
            self.landed, self._resting_since_s = Landed.ON_GROUND, None
            return
        if not health.on_ground:
            self._resting_since_s, self._disarm_at_s = None, math.inf
            airborne = {Mode.TAKEOFF: Landed.TAKEOFF, Mode.LAND: Landed.LANDING}
            self.landed = airborne.get(self.mode, Landed.IN_AIR)
            return
        if self._resting_since_s is None:
            self._resting_since_s = now_s
        if self.landed is not Landed.ON_GROUND and now_s - self._resting_since_s > 1.0:
            self.landed = Landed.ON_GROUND
            self._disarm_at_s = now_s + self._parameters["COM_DISARM_LAND"]
            self._say(Severity.INFO, "Landing detected")
        if self.landed is Landed.ON_GROUND and now_s > self._disarm_at_s:
            self.disarm(now_s)

    def _resolve(self, now_s: float) -> None:
        """Set the flown mode: the intention, or the worst failsafe."""
        before = self.mode
        failsafes = self._failsafes(now_s) if self.armed else {}
        self._since = {name: self._since.get(name, now_s) for name in failsafes}
        self._overridden &= set(failsafes)
        active = [mode for name, mode in failsafes.items() if name not in self._overridden]
        self.mode = max(active, key=_ORDER.index) if active else self.intention
        if active and self.mode is not before:
            names = ", ".join(failsafes)
            self._say(Severity.CRITICAL, f"Failsafe activated: {names}, {self.mode.name}")

    def _failsafes(self, now_s: float) -> dict[str, Mode]:
        found: dict[str, Mode] = {}
        if self.intention is Mode.OFFBOARD and not self.setpoint_fresh(now_s):
            if "offboard" not in self._since:
                self.offboard_losses += 1
            action = _OFFBOARD_LOSS.get(int(self._parameters["COM_OBL_RC_ACT"]), Mode.RETURN)
            found["offboard"] = self._after_hold("offboard", action, now_s)
        if now_s - self._position_s > _POSITION_LOST_AFTER_S:
            # PX4 reports its blind descent as ALTCTL.
            found["position"] = Mode.ALTCTL
        battery = self._battery_action()
        if battery is not None:
            found["battery"] = self._after_hold("battery", battery, now_s)
        return found

    def _battery_action(self) -> Mode | None:
        health, parameters = self._health, self._parameters
        action = int(parameters["COM_LOW_BAT_ACT"])
        if not health.battery_ok:
            return Mode.LAND
        if action not in (2, 3):
            return None
        if health.battery_left < parameters["BAT_EMERGEN_THR"]:
            return Mode.LAND
        if health.battery_left < parameters["BAT_CRIT_THR"]:
            return Mode.LAND if action == 2 else Mode.RETURN
        return None

    def _after_hold(self, name: str, action: Mode, now_s: float) -> Mode:
        """PX4 holds for COM_FAIL_ACT_T before it acts, so that a pilot may step in."""
        since_s = self._since.get(name, now_s)
        return action if now_s - since_s >= self._parameters["COM_FAIL_ACT_T"] else Mode.HOLD

    def _reason(self, now_s: float) -> str:
        if not self._health.position_ok:
            return "no position"
        if self.intention in _NOT_ARMABLE:
            return f"mode {self.intention.name} cannot be armed"
        if self.intention is Mode.OFFBOARD and not self.setpoint_fresh(now_s):
            return "no offboard signal"
        return "battery low"

    def _say(self, severity: Severity, text: str) -> None:
        self.texts.append((severity, text))


def mode_from_custom(main: int, sub: int) -> Mode | None:
    """Return the mode of DO_SET_MODE's numbers, or None where PX4 has none."""
    wanted = (main, sub if main == 4 else 0)
    return next((mode for mode in Mode if mode.value == wanted), None)
