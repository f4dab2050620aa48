"""The Livox MID-360 in its own UDP protocol."""
