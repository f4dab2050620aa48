"""Everything that touches the outside: bus, autopilot, camera, LiDAR, and their simulated twins."""
