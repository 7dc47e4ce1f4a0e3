"""Recordings of sensors, and reading and writing them."""

from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import GnssSeries, ImuSeries, Increments, OdometerSeries
from schuler.recording.trajectory import Trajectory

__all__ = ["GnssSeries", "ImuSeries", "Increments", "Metadata", "OdometerSeries", "Recording", "Trajectory"]
