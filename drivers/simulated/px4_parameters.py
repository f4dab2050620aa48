"""PX4 parameters that the mock autopilot knows: names, types and defaults as PX4 v1.17 has them.

Where a default here differs from PX4's (COM_OF_LOSS_T, COM_OBL_RC_ACT, RTL_RETURN_ALT), the mock
plays a vehicle that was set up for inspection; the mission reads and checks them all the same.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from config.settings import Settings

INT32, REAL32 = 6, 9
"""MAV_PARAM_TYPE of PX4's two parameter types."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter as it stands."""

    name: str
    value: float
    integer: bool

    @property
    def kind(self) -> int:
        """MAV_PARAM_TYPE."""
        return INT32 if self.integer else REAL32

    def wire_value(self) -> float:
        """Return the float of PARAM_VALUE; PX4 puts the bytes of an integer into it."""
        if not self.integer:
            return self.value
        return float(struct.unpack("<f", struct.pack("<i", int(self.value)))[0])


_INTEGERS = {
    "COM_OBL_RC_ACT": 5,
    "COM_LOW_BAT_ACT": 3,
    "COM_RC_IN_MODE": 0,
    "COM_RCL_EXCEPT": 0,
    "CBRK_SUPPLY_CHK": 0,
    "GF_ACTION": 2,
    "GF_SOURCE": 0,
    "NAV_DLL_ACT": 0,
    "NAV_RCL_ACT": 2,
    "COM_FLTMODE1": -1,
    "MAV_SYS_ID": 1,
    "MAV_COMP_ID": 1,
    "MAV_TYPE": 2,
    "SYS_AUTOSTART": 4001,
    "RTL_TYPE": 0,
    "EKF2_EN": 1,
}

_REALS = {
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "BAT_LOW_THR": 0.15,
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_DL_LOSS_T": 10.0,
    "COM_FAIL_ACT_T": 5.0,
    "COM_OF_LOSS_T": 0.5,
    "COM_RC_LOSS_T": 0.5,
    "COM_WIND_MAX": -1.0,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_ACC_HOR": 3.0,
    "MPC_JERK_AUTO": 4.0,
    "MPC_LAND_ALT2": 5.0,
    "MPC_LAND_SPEED": 0.7,
    "MPC_TILTMAX_AIR": 45.0,
    "MPC_TKO_SPEED": 1.5,
    "MPC_XY_CRUISE": 5.0,
    "MPC_XY_P": 0.95,
    "MPC_XY_VEL_D_ACC": 0.2,
    "MPC_XY_VEL_I_ACC": 0.4,
    "MPC_XY_VEL_MAX": 12.0,
    "MPC_XY_VEL_P_ACC": 1.8,
    "MPC_YAWRAUTO_MAX": 45.0,
    "MPC_Z_P": 1.0,
    "MPC_Z_VEL_D_ACC": 0.0,
    "MPC_Z_VEL_I_ACC": 2.0,
    "MPC_Z_VEL_MAX_DN": 1.5,
    "MPC_Z_VEL_MAX_UP": 3.0,
    "MPC_Z_VEL_P_ACC": 4.0,
    "MPC_Z_V_AUTO_DN": 1.5,
    "MPC_Z_V_AUTO_UP": 3.0,
    "RTL_DESCEND_ALT": 30.0,
    "RTL_LAND_DELAY": 0.0,
    "RTL_MIN_DIST": 10.0,
    "RTL_RETURN_ALT": 60.0,
}


class Parameters:
    """The parameter table: read, set and listed by name or index."""

    def __init__(self, overrides: dict[str, float] | None = None) -> None:
        self._values: dict[str, float] = {**_INTEGERS, **_REALS}
        for name, value in (overrides or {}).items():
            self.set(name, value)

    @property
    def names(self) -> tuple[str, ...]:
        """All names in the order of their index."""
        return tuple(sorted(self._values))

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __len__(self) -> int:
        return len(self._values)

    def get(self, name: str) -> Parameter | None:
        """Return a parameter, or None where PX4 has no such name."""
        if name not in self._values:
            return None
        return Parameter(name, self._values[name], name in _INTEGERS)

    def at(self, index: int) -> Parameter | None:
        """Return the parameter of an index."""
        names = self.names
        return self.get(names[index]) if 0 <= index < len(names) else None

    def index_of(self, name: str) -> int:
        """Return the index of a name."""
        return self.names.index(name)

    def set(self, name: str, value: float) -> bool:
        """Set a parameter; False where the name is unknown or the value is no number."""
        if name not in self._values or not math.isfinite(value):
            return False
        self._values[name] = float(round(value)) if name in _INTEGERS else float(value)
        return True

    def set_from_wire(self, name: str, wire_value: float, kind: int) -> bool:
        """Set from PARAM_SET; a type that is not the parameter's own is refused, as by PX4."""
        known = self.get(name)
        if known is None or known.kind != kind:
            return False
        if known.integer:
            wire_value = float(struct.unpack("<i", struct.pack("<f", wire_value))[0])
        return self.set(name, wire_value)


def parameters_for(settings: Settings, rtl_return_alt_m: float) -> Parameters:
    """Return the parameters of a vehicle that was set up for this turbine.

    ``rtl_return_alt_m``: above home; over the highest blade tip.
    """
    battery, airframe = settings.battery, settings.airframe
    return Parameters(
        {
            "RTL_RETURN_ALT": rtl_return_alt_m,
            "BAT_CRIT_THR": battery.autopilot_return_at,
            "BAT_LOW_THR": min(battery.autopilot_return_at + 0.05, 0.5),
            "MPC_Z_VEL_MAX_UP": airframe.max_climb_mps,
            "MPC_Z_VEL_MAX_DN": airframe.max_descent_mps,
            "MPC_YAWRAUTO_MAX": airframe.max_yaw_rate_dps,
            "MPC_XY_CRUISE": min(5.0, airframe.max_speed_mps),
        }
    )
