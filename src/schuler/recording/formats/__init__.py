"""Formats of other programs and devices, one file each; :mod:`schuler.recording.formats.registry` lists them."""
