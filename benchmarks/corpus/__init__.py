"""Every real recording as a case: read as its README says, run with defaults, judged by what was held back.

    python -m benchmarks.corpus [--only PATTERN] [--json] [--before FILE]

runs all of them, prints one table and writes ``docs/corpus.md``; see there for what the columns mean, and CONTRIBUTING
for what the table decides.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # one process a core, said before numpy is imported
