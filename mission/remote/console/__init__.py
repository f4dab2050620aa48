"""The ground console: one page for all vehicles of a router, served on loopback."""
