"""What a recording says again: commands, estimates and exposure, computed anew and compared."""
