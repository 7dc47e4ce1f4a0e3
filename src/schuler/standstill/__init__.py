"""Rest detection: test statistics, intervals at rest of a log, rests of a log turned by hand, rests while it grows."""
