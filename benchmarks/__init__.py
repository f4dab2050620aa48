"""The tables of the README, measured here and now."""
