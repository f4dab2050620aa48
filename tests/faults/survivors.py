"""Mutants of the guard that no test can notice, and why each is no gap."""

REASONS: dict[str, str] = {}
