"""Rest detection."""
