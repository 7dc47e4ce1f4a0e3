from .bound import information_bound as information_bound
from .campaign import field_campaign as field_campaign
from .modes import DriveModes as DriveModes
from .modes import drive_modes as drive_modes
from .modes import rms_errors as rms_errors
from .recorded import RecordedModes as RecordedModes
from .recorded import recorded_modes as recorded_modes
from .runs import FieldJob as FieldJob
from .static import StaticDrift as StaticDrift
from .static import rest_drift as rest_drift
from .static import static_drift as static_drift
from .static_unit import levelled as levelled
from .statistics import FieldCampaign as FieldCampaign
from .unit import CalibratedUnit as CalibratedUnit
from .unit import FieldUnit as FieldUnit
from .unit import calibrate_unit as calibrate_unit
from .unit_drives import FieldDrives as FieldDrives
from .unit_drives import field_drives as field_drives
from .unit_drives import nine_modes as nine_modes

__all__ = [
    "CalibratedUnit",
    "DriveModes",
    "FieldCampaign",
    "FieldDrives",
    "FieldJob",
    "FieldUnit",
    "RecordedModes",
    "StaticDrift",
    "calibrate_unit",
    "drive_modes",
    "field_campaign",
    "field_drives",
    "information_bound",
    "levelled",
    "nine_modes",
    "recorded_modes",
    "rest_drift",
    "rms_errors",
    "static_drift",
]
