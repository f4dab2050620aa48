"""Robust Gauss-Newton with priors on the points and edges of three blades."""

from __future__ import annotations

import numpy as np

from perception import rotor_fit_kernel as kernel
from perception.rotor_fit_kernel import Prior, Rows, Shape
from perception.values import Float

REJECT = 7.0
"""Rows further off than this many of their sigmas are let go."""


BOUND_INFO = 1e5
"""Holds three pitches together, as one."""


class RotorSolver:
    """The fit on one set of rows; ``free`` holds no parameter."""

    def __init__(self, rows: Rows, shape: Shape, prior: Prior) -> None:
        self.rows, self.shape, self.prior = rows, shape, prior
        self._jtj = np.zeros((kernel.PARAMETERS, kernel.PARAMETERS))
        self._jtr = np.zeros(kernel.PARAMETERS)
        self._residual = np.zeros(len(rows.r_m))
        self._free = np.zeros(kernel.PARAMETERS)

    def cost(self, params: Float, reject: float = REJECT, every: int = 1) -> float:
        """Return the robust cost with priors, of every ``every``-th row."""
        return float(
            kernel.system(
                params, self.rows, self.shape, self.prior, reject, every, False,
                self._jtj, self._jtr, self._residual,
            )
        )  # fmt: skip

    def run(
        self,
        params: Float,
        iterations: int,
        held: Float | None = None,
        reject: float = REJECT,
        every: int = 1,
        *,
        bound: bool = False,
        rigid: bool = False,
    ) -> Float:
        """Return the parameters settled from ``params``.

        ``held``: (P,) additional stiffness; ``bound``: the blades' pitches go together;
        ``rigid``: the sections keep their shape.
        """
        return self.run_cost(params, iterations, held, reject, every, bound=bound, rigid=rigid)[0]

    def run_cost(
        self,
        params: Float,
        iterations: int,
        held: Float | None = None,
        reject: float = REJECT,
        every: int = 1,
        *,
        bound: bool = False,
        rigid: bool = False,
    ) -> tuple[Float, float]:
        """Return what `run` does, and its cost."""
        settled = params.copy()
        stiff = self._free if held is None else held
        prior = self.prior._replace(pitch_info=BOUND_INFO) if bound else self.prior
        cost = kernel.settle(
            settled, self.rows, self.shape, prior, stiff, iterations, reject, every, rigid
        )
        return settled, float(cost)

    def last(self, params: Float) -> tuple[Float, float, Float]:
        """Return the system (P, P), the cost and the residuals (M,) at ``params``."""
        cost = self.cost(params)
        ridge = np.eye(kernel.PARAMETERS) * 1e-9
        return self._jtj + ridge, cost, self._residual.copy()
