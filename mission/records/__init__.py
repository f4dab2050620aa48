"""What a mission leaves: catalogue, photos, recording, report."""
