from .cells import Cell as Cell
from .cells import against as against
from .cells import claimed as claimed
from .cells import digits as digits
from .cells import over_settings as over_settings
from .cells import shown as shown
from .cells import transcribed as transcribed
from .items import Effort as Effort
from .items import Item as Item
from .items import Outcome as Outcome
from .items import Result as Result
from .run import THESES as THESES
from .run import Reproduction as Reproduction
from .run import reproduce as reproduce

__all__ = [
    "THESES",
    "Cell",
    "Effort",
    "Item",
    "Outcome",
    "Reproduction",
    "Result",
    "against",
    "claimed",
    "digits",
    "over_settings",
    "reproduce",
    "shown",
    "transcribed",
]
