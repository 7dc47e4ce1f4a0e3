from .configuration import Proposal as Proposal
from .configuration import propose as propose
from .configuration import propose_reading as propose_reading
from .decision import Decision as Decision
from .decision import UndecidedError as UndecidedError
