"""Mutants of the guard that no test can notice, and why each is no gap."""

_BOUNDARY = "differs only where two measured numbers are equal to the last bit"
_MILLIONTH = "differs only within the tolerance of a millionth of a metre, or of a metre per second"
_BILLIONTH = "differs only within the tolerance of a billionth of a metre, or of a metre per second"
_MIDDLE = "differs only for what lies within a millionth of a metre of the body's middle"

REASONS: dict[str, str] = {
    "if near.nearest_m < self._bounds.min_clearance_m: -> "
    "near.nearest_m <= self._bounds.min_clearance_m": _BOUNDARY,
    "if far > bounds.max_lead_m + 1e-9: -> far >= bounds.max_lead_m + 1e-09": _BOUNDARY,
    "if speed > limit + 1e-9: -> speed >= limit + 1e-09": _BOUNDARY,
    "if grown > most + 1e-9 and np.linalg.norm(velocity) > np.linalg.norm(before): -> "
    "grown >= most + 1e-09": _BOUNDARY,
    "if height < 2.0 and rest[2] < here[2] - 1e-6: -> rest[2] <= here[2] - 1e-06": _BOUNDARY,
    "if then >= now - 1e-6: -> then > now - 1e-06": _BOUNDARY,
    "if bool((flown > allowed + 0.3).any()): -> flown >= allowed + 0.3": _BOUNDARY,
    "if asked[worst] <= allowed[worst] + 1e-6: -> asked[worst] < allowed[worst] + 1e-06": _BOUNDARY,
    "over = asked > allowed + 1e-6 -> asked >= allowed + 1e-06": _BOUNDARY,
    "self.is_near = self._model is not None and float(model_m.min()) - radius_m < NEAR_M -> "
    "float(model_m.min()) - radius_m <= NEAR_M": _BOUNDARY,
    "return self.path_clearance(setpoint) >= clearance_m -> "
    "self.path_clearance(setpoint) > clearance_m": _BOUNDARY,
    "kept = all(b >= min(a, clearance_m) - 1e-3 for a, b in zip(now, then, strict=True)) -> "
    "b > min(a, clearance_m) - 0.001": _BOUNDARY,
    "return kept and min(then) >= self.nearest_m - 1e-3 -> "
    "min(then) > self.nearest_m - 0.001": _BOUNDARY,
    "return move if self.path_clearance(move) > self.nearest_m + 0.2 else hold -> "
    "self.path_clearance(move) >= self.nearest_m + 0.2": _BOUNDARY,
    "if far > bounds.max_lead_m + 1e-9: -> 9e-10": _BILLIONTH,
    "if speed > limit + 1e-9: -> 9e-10": _BILLIONTH,
    "if grown > most + 1e-9 and np.linalg.norm(velocity) > np.linalg.norm(before): -> 9e-10": (
        _BILLIONTH
    ),
    "if height < 2.0 and rest[2] < here[2] - 1e-6: -> 9e-07": _MILLIONTH,
    "if then >= now - 1e-6: -> 9e-07": _MILLIONTH,
    "if asked[worst] <= allowed[worst] + 1e-6: -> 9e-07": _MILLIONTH,
    "units = [offsets[close] / np.maximum(apart[close], 1e-6)[:, None]] -> 9e-07": _MIDDLE,
    "length = np.maximum(np.linalg.norm(toward, axis=1), 1e-6) -> 9e-07": _MIDDLE,
    "for _ in range(6): -> 7": (
        "one more try to slide before everything is scaled down; either ends within what is allowed"
    ),
    "if self.nearest_m - reach >= clearance_m: -> self.nearest_m - reach > clearance_m": (
        "where both are equal the whole way is looked at instead, and found clear"
    ),
    "kept = all(b >= min(a, clearance_m) - 1e-3 for a, b in zip(now, then, strict=True)) -> "
    "False": "there are always two of each",
}
