"""Every number a person may set: frozen models, presets, scenarios."""
