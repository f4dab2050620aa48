"""The method, pure: arrays in, frozen results out."""
