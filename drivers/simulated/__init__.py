"""The same devices, played by one synthetic world."""
