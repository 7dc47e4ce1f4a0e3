from .foot import LiveFoot as LiveFoot
from .messages import Broadcast as Broadcast
from .messages import Event as Event
from .messages import Fix as Fix
from .messages import Heading as Heading
from .messages import Height as Height
from .messages import ImuBlock as ImuBlock
from .messages import ImuSample as ImuSample
from .messages import SatelliteEpoch as SatelliteEpoch
from .messages import Solution as Solution
from .messages import Speed as Speed
from .navigator import LiveNavigator as LiveNavigator

__all__ = [
    "Broadcast",
    "Event",
    "Fix",
    "Heading",
    "Height",
    "ImuBlock",
    "ImuSample",
    "LiveFoot",
    "LiveNavigator",
    "SatelliteEpoch",
    "Solution",
    "Speed",
]
