"""``python -m schuler``."""

import sys

from schuler.cli import main

sys.exit(main())
