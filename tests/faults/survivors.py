"""Mutants of the guard that no test can notice, and why each is no gap."""

_BOUNDARY = "differs only where two measured numbers are equal to the last bit"
_TOLERANCE = "differs only within the tolerance of a millionth"
_SECOND_LOCK = (
    "a second lock: the distance to a point, or to a convex part, is convex along a line, so the "
    "closing rule before it has already bounded the whole way; it is kept in case that rule errs"
)

REASONS: dict[str, str] = {
    "over = asked > allowed + 1e-6 -> GtE": _BOUNDARY,
    "over = asked > allowed + 1e-6 -> Sub": _TOLERANCE,
    "if self.nearest_m - reach >= clearance_m: -> not self.nearest_m - reach >= clearance_m": (
        _SECOND_LOCK
    ),
    "if self.nearest_m - reach >= clearance_m: -> Gt": _BOUNDARY,
    "if self.nearest_m - reach >= clearance_m: -> Lt": _SECOND_LOCK,
    "if self.nearest_m - reach >= clearance_m: -> Add": _SECOND_LOCK,
    "reach = float(np.linalg.norm(_rest(setpoint) - self._here)) -> Add": _SECOND_LOCK,
    "if not (asked > allowed + 1e-6).any(): -> 9e-07": _TOLERANCE,
    "over = asked > allowed + 1e-6 -> 9e-07": _TOLERANCE,
    "if far < STILL_M or not inside: -> LtE": _BOUNDARY,
    "kept = all(b >= min(a, clearance_m) - 1e-3 for a, b in zip(now, then, strict=True)) -> "
    "False": "there are always two of each",
    "if height < 2.0 and rest[2] < here[2] - 1e-6: -> 9e-07": _TOLERANCE,
    "return move if self.path_clearance(move) > self.nearest_m + 0.2 else hold -> GtE": _BOUNDARY,
    "return self.path_clearance(setpoint) >= clearance_m -> Gt": _BOUNDARY,
    'return float(np.einsum("nk,nk->n", apart, apart).min()) <= reach_m * reach_m -> Lt': _BOUNDARY,
    "return max(0.0, -2.2 + math.sqrt(4.84 + 4 * room)) if room > 0 else 0.0 -> GtE": (
        "without room the formula gives 0 as well"
    ),
    "if near.nearest_m < self._bounds.min_clearance_m: -> LtE": _BOUNDARY,
    "if far > bounds.max_lead_m + 1e-9: -> GtE": _BOUNDARY,
    "if speed > limit + 1e-9: -> GtE": _BOUNDARY,
    "still = float(np.linalg.norm(_rest(setpoint) - here)) < STILL_M -> LtE": _BOUNDARY,
    "if then >= now - 1e-6: -> Gt": _BOUNDARY,
    "inside = float(np.linalg.norm(rest - airspace.sphere_w)) < airspace.sphere_radius_m -> LtE": (
        _BOUNDARY
    ),
    "for _ in range(6): -> 7": "one more try to slide before everything is scaled down",
    "if asked[worst] <= allowed[worst] + 1e-6: -> Lt": _BOUNDARY,
    "close = apart < NEAR_M + 5.0 -> LtE": _BOUNDARY,
    "if float(np.linalg.norm(rest - self._here)) < 1e-3: -> LtE": _BOUNDARY,
    "return self.path_clearance(setpoint) >= self.nearest_m - 1e-3 -> Gt": _BOUNDARY,
}
