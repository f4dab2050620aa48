"""The inspection: flight, processes, remote control, records, command line."""
