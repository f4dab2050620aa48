"""Autonomous inspection of wind-turbine blades by drone."""
