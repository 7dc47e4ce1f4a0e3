"""Navigation of recordings: start, aids, filter, smoother, evaluation, report."""
