"""The phases of a mission, a file a phase. Each decides one tick from the flight's memory."""
