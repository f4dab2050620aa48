"""The tables of the docs/measured.md, measured here and now."""
