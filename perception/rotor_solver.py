"""Robust Gauss-Newton with priors on the points and edges of three blades."""

from __future__ import annotations

import math

import numpy as np

from perception import rotor_fit_kernel as kernel
from perception.blade_section import SectionTable
from perception.rotor_edges import BladeData
from perception.values import Float

PITCH_SPREAD_RAD = math.radians(1.3)
"""Blades of one rotor rarely stand further apart; beyond three times this they are let go."""
APART_COST = 25.0
APART_RAD = math.radians(20.0)
HUBER, REJECT = 1.5, 7.0


class RotorSolver:
    """Gauss-Newton with priors on one set of rows."""

    def __init__(
        self,
        data: BladeData,
        axes: Float,
        station: Float,
        table: SectionTable,
        sense: float,
        prior_mean: Float,
        prior_info: Float,
    ) -> None:
        self._rows = (
            data.blade,
            data.r_m,
            data.v_m,
            data.w_m,
            data.kind,
            np.ascontiguousarray(data.view),
            data.sigma_m,
        )
        self._shape = (
            np.ascontiguousarray(axes),
            station,
            table.x,
            table.y,
            table.length_m,
            table.hub_radius_m,
            sense,
        )
        self._mean, self._info = prior_mean, prior_info
        self._jtj = np.zeros((kernel.PARAMETERS, kernel.PARAMETERS))
        self._jtr = np.zeros(kernel.PARAMETERS)
        self._residual = np.zeros(len(data.r_m))
        self._data = data

    def cost(self, params: Float, reject: float = REJECT, every: int = 1) -> float:
        """Return the robust cost with priors, of every ``every``-th row."""
        rows = (
            tuple(np.ascontiguousarray(c[::every]) for c in self._rows) if every > 1 else self._rows
        )
        value = kernel.normal_equations(
            params,
            *rows,
            *self._shape,
            HUBER,
            reject,
            self._jtj,
            self._jtr,
            self._residual[: len(rows[1])],
        )
        off = params - self._mean
        return float(value) + float(off @ self._info @ off) + self._couple(params)

    def _couple(self, params: Float) -> float:
        """Add what binds the pitches to each other; return its share of the cost."""
        cost = 0.0
        info = 1.0 / PITCH_SPREAD_RAD**2
        for a, b in ((0, 1), (1, 2), (2, 0)):
            i, j = kernel.PITCH + a, kernel.PITCH + b
            gap = float(params[i] - params[j])
            part = gap * gap * info / 3.0
            if abs(gap) > APART_RAD:
                cost += APART_COST
                continue
            cost += min(part, APART_COST)
            self._jtj[i, i] += info / 3.0
            self._jtj[j, j] += info / 3.0
            self._jtj[i, j] -= info / 3.0
            self._jtj[j, i] -= info / 3.0
            self._jtr[i] -= gap * info / 3.0
            self._jtr[j] += gap * info / 3.0
        return cost

    def run(
        self,
        params: Float,
        iterations: int,
        held: Float | None = None,
        reject: float = REJECT,
        every: int = 1,
    ) -> Float:
        """Iterate; ``held`` is an additional stiffness per parameter (large: not moved)."""
        stiff = np.zeros(kernel.PARAMETERS) if held is None else held
        params = params.copy()
        for _ in range(iterations):
            self.cost(params, reject, every)
            system = self._jtj + self._info + np.diag(stiff + 1e-9)
            step = np.linalg.solve(system, self._jtr - self._info @ (params - self._mean))
            limit = np.full(kernel.PARAMETERS, 0.3)
            limit[: kernel.SR] = 1.0
            limit[kernel.SAG] = 1.0
            step = np.clip(step, -limit, limit)
            params += step
            params[kernel.CHORD : kernel.AXIS] = np.clip(
                params[kernel.CHORD : kernel.AXIS], -0.4, 0.5
            )
            params[kernel.THICK : kernel.TWIST] = np.clip(
                params[kernel.THICK : kernel.TWIST], -0.5, 0.7
            )
            if (
                np.abs(step[: kernel.PREBEND]).max() < 1e-4
                and np.abs(step[kernel.PITCH : kernel.CHORD]).max() < 2e-3
            ):
                break
        return params

    def last(self, params: Float) -> tuple[Float, float, Float]:
        """Return the system (P, P), the cost and the residuals (M,) at ``params``."""
        cost = self.cost(params)
        return (
            self._jtj + self._info + np.eye(kernel.PARAMETERS) * 1e-9,
            cost,
            self._residual.copy(),
        )
