"""Requests over Zenoh, client, fleet, console."""
