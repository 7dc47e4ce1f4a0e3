"""Calibration from a hand-held log: rests in any pose and the turns between them."""
