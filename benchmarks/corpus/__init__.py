"""Every real recording as a case: read as its README says, run with defaults, judged by what was held back.

    python -m benchmarks.corpus [--only PATTERN] [--json] [--before FILE]

runs all of them, prints one table and writes ``docs/corpus.md``; see there for what the columns mean, and CONTRIBUTING
for what the table decides.
"""
